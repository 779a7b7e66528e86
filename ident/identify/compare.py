"""Two campaigns on one arm: which of its joint stiffnesses have changed in between."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.arm.arm import stiffness_paths
from ident.errors import require
from ident.identify.damping import mode_of
from ident.identify.fit import CampaignFit
from ident.inference.change import Change, Estimate, change, independent_change
from ident.text import no_such


@dataclass(frozen=True)
class Posterior:
    """Draws of an arm's stiffnesses without the measurements: another program has sampled them.

    Attributes:
        name: of the draws.
        values: (n,) [SI] of each stiffness, by path.
    """

    name: str
    values: Mapping[str, Float[np.ndarray, "n"]]


@dataclass(frozen=True)
class Comparison:
    """Two fits of one arm, and the changes from the first to the second.

    Attributes:
        first: the earlier fit, or draws without one.
        second: the later one.
        change: of the stiffnesses, both campaigns fitted together; draws count as independent.
        unlike: numbers of the arm, not fitted, that differ between the two arm files.
        priors_differ: whether the fits have different priors; those of the first count.
    """

    first: CampaignFit | Posterior
    second: CampaignFit | Posterior
    change: Change
    unlike: tuple[str, ...] = ()
    priors_differ: bool = False

    @property
    def fits(self) -> tuple[CampaignFit, ...]:
        """The fits among the two."""
        return tuple(each for each in (self.first, self.second) if isinstance(each, CampaignFit))

    @property
    def independent(self) -> bool:
        """Whether both count as independent, as the measurements of one are unavailable."""
        return len(self.fits) < 2

    @property
    def names(self) -> tuple[str, str]:
        """The campaigns' names."""
        pair = self.first, self.second
        one, other = (each.campaign.name if isinstance(each, CampaignFit) else each.name for each in pair)
        return one, other

    @property
    def damping(self) -> tuple[int, float, float] | None:
        """Number of modes with ratios in both campaigns, mean change of ln(ratio), and its standard deviation.

        None if a campaign has no damping ratio. It is not part of the verdict.
        """
        pair = [fit.damping for fit in self.fits if fit.damping]
        if len(pair) < 2:
            return None
        rows = [{mode_of(m): i for i, m in enumerate(each.rows) if not each.marked[i]} for each in pair]
        both = [mode for mode in rows[0] if mode in rows[1]]
        if not both:
            return 0, 0.0, np.inf
        before, after = (each.ratios.some([own[mode] for mode in both]) for each, own in zip(pair, rows, strict=True))
        weights = np.linalg.solve(before.covariance + after.covariance, np.ones(len(both)))
        return len(both), float(weights @ (after.log - before.log) / weights.sum()), float(weights.sum() ** -0.5)

    @property
    def name(self) -> str:
        """Both names; a single one if they are equal."""
        return "-".join(dict.fromkeys(self.names))


def compare_posteriors(
    first: CampaignFit | Posterior, second: CampaignFit | Posterior, same: Collection[str] = ()
) -> Comparison:
    """Return which stiffnesses have changed, without the measurements of one or both.

    The logarithms of the stiffnesses are taken as normal, and both estimates as independent.

    Args:
        first: the earlier fit, or draws.
        second: the later one.
        same: stiffnesses to leave out, as they are known not to have changed.

    Raises:
        InputError: no common stiffness, or a name that is not one of them.
    """
    ours, theirs = (_estimates(each) for each in (first, second))
    changing = _changing([name for name in ours if name in theirs], same)
    pair = (_estimate(each, changing) for each in (first, second))
    return Comparison(first, second, independent_change(changing, *pair))


def _estimates(each: CampaignFit | Posterior) -> list[str]:
    """Return the names of the estimated stiffnesses."""
    if isinstance(each, Posterior):
        return list(each.values)
    own = set(stiffness_paths(each.arm))
    return [item.name for item in each.problem.parameters.items if item.name in own]


def _estimate(each: CampaignFit | Posterior, names: Sequence[str]) -> Estimate:
    """Return the estimate of some stiffnesses."""
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
        InputError: no stiffness fitted in both, or a name that is not one of them.
    """
    stiffnesses = set(stiffness_paths(first.arm))
    others = {item.paths for item in second.problem.parameters.items}  # tied alike
    both = [i.name for i in first.problem.parameters.items if i.name in stiffnesses and i.paths in others]
    found = change(first, second, _changing(both, same))
    fitted = {*first.parameters, *second.parameters}
    ours, theirs = ({path: np.asarray(x) for path, x in fit.arm.numbers().items()} for fit in (first, second))
    kept = [path for path in ours | theirs if path not in fitted]
    unlike = tuple(path for path in kept if not np.array_equal(ours.get(path, np.nan), theirs.get(path, np.nan)))
    one, other = ({item.name: item for item in fit.problem.parameters.items} for fit in (first, second))
    priors = ((one[name], other[name], f) for name in one.keys() & other.keys() for f in ("centre", "prior_sd", "flat"))
    priors_differ = any(float(getattr(a, f)) != float(getattr(b, f)) for a, b, f in priors)
    return Comparison(first, second, found, unlike, priors_differ)


def _changing(names: Sequence[str], same: Collection[str]) -> list[str]:
    """Return the stiffnesses of both that may have changed.

    Raises:
        InputError: there is none, or a name in `same` is not one of them.
    """
    if unknown := [name for name in same if name not in names]:
        raise no_such("same", unknown[0], names, "name one of them")
    changing = [name for name in names if name not in same]
    got, expected = "no stiffness that both have fitted", "one or more that may have changed"
    require(changing, "second", got, expected, "fit both campaigns with the same unknowns")
    return changing
