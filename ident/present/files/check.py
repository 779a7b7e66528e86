"""What a check found, as rows."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.identify.check import CampaignCheck
from ident.identify.compare import Comparison, Validation
from ident.inference.profile import Profile
from ident.present.text.words import unit_of


def check_rows(check: CampaignCheck) -> list[dict[str, Any]]:
    """Return a row for each parameter: verdict, and standard deviations of theta by the data alone [-].

    NaN where the model has no answer.
    """
    sd = check.data_sd
    return [
        {
            "parameter": name,
            "verdict": verdict,
            "data_sd": float(sd[0, i]) if len(sd) else float("nan"),
            "worst_data_sd": float(sd[:, i].max()) if len(sd) else float("nan"),
        }
        for i, (name, verdict) in enumerate(zip((item.name for item in check.items), check.verdicts, strict=True))
    ]


# -------- Compare
# Changes between two campaigns as rows.


def compare_rows(comparisons: Sequence[Comparison], unpaired: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Return a row for each stiffness: both values [SI], their ratio with its 95 % interval, p, and the verdict."""
    several = len(comparisons) > 1
    return [({"campaigns": each.name} if several else {}) | row for each in comparisons for row in _rows(each)]


def _rows(comparison: Comparison) -> list[dict[str, Any]]:
    change = comparison.change
    low, high = np.exp(change.interval).T
    return [
        {
            "parameter": name,
            "unit": unit_of(name),
            "before": float(change.first[i]),
            "after": float(change.second[i]),
            "ratio": float(np.exp(change.change[i])),
            "low_95": float(low[i]),
            "high_95": float(high[i]),
            "p": float(change.p_values[i]),
            "changed": bool(change.changed[i]),
            "open": bool(change.open[i]),
        }
        for i, name in enumerate(change.names)
    ]


# -------- Profile
# Profiles as rows.


def profile_rows(profiles: Sequence[Profile]) -> list[dict[str, Any]]:
    """Return a row for each profile: fitted value, unit, ends [SI] of the linear interval and of the profile's.

    An open end is infinite, or zero for a positive number.
    """

    def row(profile: Profile) -> dict[str, Any]:
        spans = profile.linear_interval, profile.widest
        thetas = [profile.optimum, *(theta for span in spans for theta in (span.low, span.high))]
        names = ("value", "linear_low_95", "linear_high_95", "low_95", "high_95")
        numbers = zip(names, map(float, profile.values(thetas)), strict=True)
        return {"parameter": profile.name, "unit": unit_of(profile.name), **dict(numbers)}

    return [row(profile) for profile in profiles]


# -------- Validate
# Predictions of what was left out, as rows.


def validate_rows(validation: Validation) -> list[dict[str, Any]]:
    """Return a row for each measurement: the part it belongs to, value, prediction and standard deviation [SI]."""
    campaign = validation.fit.campaign.measurements
    return [
        {
            "part": part.name,
            "row": int(place) + 1,
            "kind": campaign[place].kind,
            "measured": float(part.measured[i]),
            "predicted": float(part.predicted[i]),
            "sd": float(part.sd[i]),
            "off_sd": float(part.off[i] / part.sd[i]),
        }
        for part in validation.parts
        for i, place in enumerate(part.places)
    ]
