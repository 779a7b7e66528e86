"""Two campaigns on one arm: which of its joint stiffnesses have changed in between."""

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from ident.arm.arm import Arm, stiffness_paths
from ident.errors import InputError, Problem
from ident.identify.fit import CampaignFit
from ident.inference.change import Change, change
from ident.text import did_you_mean, quoted


@dataclass(frozen=True)
class Comparison:
    """Two fits of one arm, and what has changed from the first to the second.

    Attributes:
        first: the earlier fit.
        second: the later one.
        change: of the stiffnesses, both campaigns fitted together.
        unlike: numbers of the arm, not fitted, that differ between the two arm files.
        priors_differ: whether the fits have other priors; those of the first count.
    """

    first: CampaignFit
    second: CampaignFit
    change: Change
    unlike: tuple[str, ...]
    priors_differ: bool

    @property
    def name(self) -> str:
        """Both campaigns' names."""
        return f"{self.first.campaign.name}-{self.second.campaign.name}"


def compare_fits(first: CampaignFit, second: CampaignFit, same: Collection[str] = ()) -> Comparison:
    """Fit the campaigns of two fits together, and return which stiffnesses have changed.

    Args:
        first: the earlier fit.
        second: the later one.
        same: stiffnesses that are known not to have changed.

    Raises:
        InputError: no stiffness that both have fitted, or a name that is none of them.
    """
    names = list(_of_both(first, second))
    if unknown := [name for name in same if name not in names]:
        remedy = did_you_mean(unknown[0], names, "name one of them")
        raise InputError(Problem("same", quoted(unknown[0]), f"one of {', '.join(names)}", remedy))
    changing = [name for name in names if name not in same]
    if not changing:
        got, expected = "no stiffness that both have fitted", "one or more that may have changed"
        raise InputError(Problem("second", got, expected, "fit both campaigns with the same unknowns"))
    found = change(first, second, changing)
    return Comparison(first, second, found, tuple(_unlike(first, second)), _priors_differ(first, second))


def _of_both(first: CampaignFit, second: CampaignFit) -> Iterator[str]:
    """Yield the stiffnesses that both fits have as unknowns, tied alike."""
    stiffnesses = set(stiffness_paths(first.arm))
    others = {item.paths for item in second.problem.parameters.items}
    for item in first.problem.parameters.items:
        if item.name in stiffnesses and item.paths in others:
            yield item.name


def _unlike(first: CampaignFit, second: CampaignFit) -> Iterator[str]:
    fitted = {*first.parameters, *second.parameters}
    ours, theirs = (_numbers(fit.arm) for fit in (first, second))
    for path in dict.fromkeys([*ours, *theirs]):
        if path not in fitted and not np.array_equal(ours.get(path, np.nan), theirs.get(path, np.nan)):
            yield path


def _numbers(arm: Arm) -> dict[str, np.ndarray]:
    return {path: np.asarray(value) for path, value in arm.numbers().items()}


def _priors_differ(first: CampaignFit, second: CampaignFit) -> bool:
    one, other = ({item.name: item for item in fit.problem.parameters.items} for fit in (first, second))
    fields, shared = ("centre", "prior_sd", "flat"), one.keys() & other.keys()
    return any(float(getattr(one[name], f)) != float(getattr(other[name], f)) for name in shared for f in fields)
