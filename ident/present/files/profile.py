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

FORMAT = "ident-profile/1"


def profile_document(
    result: CampaignFit, profiles: Sequence[Profile], arm_file: ArmFile, options: Mapping[str, Any]
) -> dict[str, Any]:
    """Describe profiles as plain data, all numbers SI; where an interval is open, its end is null."""
    document = provenance(FORMAT, arm_file, result.campaign, options) | {
        "cost": result.fit.best.cost,
        "doubts": list(result.doubts),
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
                    "cost_rise": profile.rise,
                    "settled": profile.settled,
                },
            }
            for profile in profiles
        ],
    }
    return plain(document)


def _interval(profile: Profile, interval: Interval) -> dict[str, Any]:
    values = profile.values([interval.low, interval.high])
    ends = zip(values, interval.endings, strict=True)
    low, high = (None if ending is Ending.OPEN else float(value) for value, ending in ends)
    endings = [str(ending) for ending in interval.endings]
    return {"level": interval.level, "low": low, "high": high, "endings": endings}
