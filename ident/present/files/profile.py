"""Profiles as rows."""

from collections.abc import Sequence
from typing import Any

from ident.inference.profile import Profile
from ident.present.text.units import unit_of


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
