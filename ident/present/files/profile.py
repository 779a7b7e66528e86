"""The result file of profiles."""

from collections.abc import Mapping, Sequence
from typing import Any

from ident.description.file import ArmFile
from ident.identify.fit import CampaignFit
from ident.inference.profile import Interval, Profile
from ident.inference.profile_path import Ending
from ident.present.files.document import plain, provenance
from ident.present.text.profile import remarks
from ident.present.text.units import unit_of


def profile_document(
    form: str, fit: CampaignFit, profiles: Sequence[Profile], arm_file: ArmFile, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Describe profiles as plain data, all numbers SI; where an interval is open, its end is null."""
    document = provenance(form, arm_file, fit.campaign, options) | {
        "cost": fit.best.cost,
        "doubts": list(fit.doubts),
        "parameters": [
            {
                "name": profile.name,
                "paths": list(profile.item.paths),
                "value": profile.values([profile.optimum])[0],
                "unit": unit_of(profile.name),
                "linear": _interval(profile, profile.linear_interval),
                "intervals": [_interval(profile, interval) for interval in profile.intervals],
                "flat": list(profile.flat),
                "agrees_with_linear": profile.linear,
                "remarks": list(remarks(profile)),
                "profile": {
                    "value": profile.values(profile.theta),
                    "delta_chi_squared": profile.delta_chi_squared,
                    "converged": profile.converged,
                },
            }
            for profile in profiles
        ],
    }
    return plain(document)


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


def _interval(profile: Profile, interval: Interval) -> dict[str, Any]:
    values = profile.values([interval.low, interval.high])
    ends = zip(values, interval.endings, strict=True)
    low, high = (None if ending is Ending.OPEN else float(value) for value, ending in ends)
    endings = [str(ending) for ending in interval.endings]
    return {"level": interval.level, "low": low, "high": high, "endings": endings}
