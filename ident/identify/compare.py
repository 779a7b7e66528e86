"""Two campaigns on one arm: which of its joint stiffnesses have changed in between."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm, stiffness_paths
from ident.errors import InputError, Problem
from ident.identify.fit import CampaignFit
from ident.inference.change import Change, change
from ident.inference.independent_change import Estimate, independent_change
from ident.text import did_you_mean, quoted


@dataclass(frozen=True)
class Posterior:
    """Draws of an arm's stiffnesses whose measurements are not at hand: another program has sampled them.

    Attributes:
        name: what they are called.
        values: (n,) [SI] of each stiffness, by path.
    """

    name: str
    values: Mapping[str, Float[np.ndarray, "n"]]


@dataclass(frozen=True)
class Comparison:
    """Two fits of one arm, and what has changed from the first to the second.

    Attributes:
        first: the earlier fit, or draws without one.
        second: the later one.
        change: of the stiffnesses, both campaigns fitted together; of draws, as if they had nothing in common.
        unlike: numbers of the arm, not fitted, that differ between the two arm files.
        priors_differ: whether the fits have other priors; those of the first count.
    """

    first: CampaignFit | Posterior
    second: CampaignFit | Posterior
    change: Change
    unlike: tuple[str, ...] = ()
    priors_differ: bool = False

    @property
    def fits(self) -> tuple[CampaignFit, ...]:
        """Those of the two that are fits."""
        return tuple(each for each in (self.first, self.second) if isinstance(each, CampaignFit))

    @property
    def independent(self) -> bool:
        """Whether both count as if they had nothing in common, since measurements of one are not at hand."""
        return len(self.fits) < 2

    @property
    def names(self) -> tuple[str, str]:
        """The campaigns' names."""
        return names_of(self.first, self.second)

    @property
    def name(self) -> str:
        """Both names; one where they are the same."""
        return "-".join(dict.fromkeys(self.names))


def names_of(first: CampaignFit | Posterior, second: CampaignFit | Posterior) -> tuple[str, str]:
    """Return the campaigns' names."""
    one, other = (each.campaign.name if isinstance(each, CampaignFit) else each.name for each in (first, second))
    return one, other


def compare_posteriors(
    first: CampaignFit | Posterior, second: CampaignFit | Posterior, same: Collection[str] = ()
) -> Comparison:
    """Return which stiffnesses have changed where the measurements of one or both are not at hand.

    The logarithms of the stiffnesses are taken as normal, and both estimates as independent.

    Args:
        first: the earlier fit, or draws.
        second: the later one.
        same: stiffnesses that are left out: they are known not to have changed.

    Raises:
        InputError: no stiffness that both have, or a name that is none of them.
    """
    ours, theirs = (_estimates(each) for each in (first, second))
    changing = _changing([name for name in ours if name in theirs], same)
    pair = (_estimate(each, changing) for each in (first, second))
    return Comparison(first, second, independent_change(changing, *pair))


def _estimates(each: CampaignFit | Posterior) -> list[str]:
    """Return the stiffnesses that are known."""
    if isinstance(each, Posterior):
        return list(each.values)
    own = set(stiffness_paths(each.arm))
    return [item.name for item in each.problem.parameters.items if item.name in own]


def _estimate(each: CampaignFit | Posterior, names: Sequence[str]) -> Estimate:
    """Return what is known of some stiffnesses."""
    if isinstance(each, Posterior):
        logs = np.log([each.values[name] for name in names])
        return Estimate(logs.mean(1), np.atleast_2d(np.cov(logs)))
    places = [each.problem.parameters.names.index(name) for name in names]
    return Estimate(np.log(np.asarray(each.best.values)[places]), each.information.covariance[np.ix_(places, places)])


def compare_fits(first: CampaignFit, second: CampaignFit, same: Collection[str] = ()) -> Comparison:
    """Fit the campaigns of two fits together, and return which stiffnesses have changed.

    Args:
        first: the earlier fit.
        second: the later one.
        same: stiffnesses that are known not to have changed.

    Raises:
        InputError: no stiffness that both have fitted, or a name that is none of them.
    """
    found = change(first, second, _changing(list(_of_both(first, second)), same))
    return Comparison(first, second, found, tuple(_unlike(first, second)), _priors_differ(first, second))


def _changing(names: Sequence[str], same: Collection[str]) -> list[str]:
    """Return the stiffnesses of both that may have changed.

    Raises:
        InputError: there is none, or one that is known not to have changed is none of them.
    """
    if unknown := [name for name in same if name not in names]:
        remedy = did_you_mean(unknown[0], names, "name one of them")
        raise InputError(Problem("same", quoted(unknown[0]), f"one of {', '.join(names)}", remedy))
    changing = [name for name in names if name not in same]
    if not changing:
        got, expected = "no stiffness that both have fitted", "one or more that may have changed"
        raise InputError(Problem("second", got, expected, "fit both campaigns with the same unknowns"))
    return changing


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
