"""Two campaigns on one arm: which of its joint stiffnesses have changed in between."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import stiffness_paths
from ident.errors import refusal
from ident.identify.damping import mode_of
from ident.identify.fit import CampaignFit
from ident.inference.change import Change, Estimate, change, independent_change
from ident.inference.draws import PosteriorPredictive, Weights, check_weighable, posterior_predictive, weigh
from ident.inference.information import half_width, rare
from ident.inference.posterior import posterior
from ident.inference.sample import DEFAULT, Sample, Settings, sample
from ident.inference.scrutiny import HeldOut, held_out
from ident.measure import Campaign
from ident.programs import Progress, cores
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
    if not changing:
        got, expected = "no stiffness that both have fitted", "one or more that may have changed"
        raise refusal("second", got, expected, "fit both campaigns with the same unknowns")
    return changing


# -------- Sample
# The posterior of an arm's campaign, with its starting fit.


@dataclass(frozen=True)
class CampaignSample:
    """A sampled posterior of an arm's campaign.

    Attributes:
        fitted: the fit, arm and campaign with it.
        sample: the draws.
        posterior_predictive: data predicted by the draws about the best optimum.
        weights: shares of the optima; None for a single one, or if they are unknown.
    """

    fitted: CampaignFit
    sample: Sample
    posterior_predictive: PosteriorPredictive
    weights: Weights | None

    @cached_property
    def damping(self) -> dict[tuple[str, ...], Float[np.ndarray, "chains draws"]]:
        """Damping given stiffness, one draw for each draw, by the paths of damping numbers in an arm file."""
        if self.fitted.damping is None:
            return {}
        by_chain, names = self.sample.by_chain().values, self.sample.posterior.parameters.items
        draws = {path: own.ravel() for item, own in zip(names, by_chain, strict=True) for path in item.paths}
        own = set(self.fitted.damping.parameters)
        given = self.fitted.damping.given({path: x for path, x in draws.items() if path in own})
        return {paths: x.reshape(by_chain.shape[1:]) for paths, x in given.items()}

    @property
    def withheld(self) -> tuple[str, ...]:
        """Objections that suppress intervals: the fit's warnings, unless the sizes of the sigmas are inferred."""
        return () if self.sample.posterior.noise.items else self.fitted.doubts

    @property
    def trust(self) -> dict[str, Any]:
        """Diagnosis of the chains, and the shares of the optima, as plain data."""
        return {
            "doubts": list(self.withheld),
            "optima": list(self.sample.basins),
            "enough": [d.enough(self.sample.settings.target_ess) for d in self.sample.diagnosis],
            "diagnosis": [asdict(d) for d in self.sample.diagnosis],
            "weights": None if self.weights is None else asdict(self.weights),
        }


def sample_campaign(
    fitted: CampaignFit,
    *,
    settings: Settings = DEFAULT,
    noise: Sequence[str] = (),
    weights: bool = False,
    folder: Path | None = None,
    provenance: Mapping[str, str] | None = None,
    progress: Progress = iter,
) -> CampaignSample:
    """Sample the posterior of a fitted campaign.

    Args:
        fitted: from `fit_campaign`; its problem is sampled.
        settings: of the sampler; the number of threads is chosen here.
        noise: kinds of measurement whose sigma is known only up to a factor.
        weights: weigh several optima against each other, by nested sampling.
        folder: for checkpoints; None for none.
        provenance: further conditions that must be equal to continue from a checkpoint.
        progress: wraps the numbers of the blocks, to show a bar.

    Raises:
        InputError: see `sample`.
        ModelError: see `sample`.
    """
    target = posterior(fitted.problem, noise)
    # poles call LAPACK, which must not run concurrently under jax 0.10
    damped = fitted.posed.conditions.damped
    settings = replace(settings, threads=1 if damped else min(cores(), settings.ensembles))
    if weights:
        check_weighable(target)
    drawn = sample(fitted, target, settings, folder=folder, provenance=provenance, progress=progress)
    several = len(drawn.basins) > 1
    return CampaignSample(fitted, drawn, posterior_predictive(drawn), weigh(drawn) if several and weights else None)


# -------- Validate
# Cross-validation of a fitted arm: parts of a campaign, predicted by the rest of it.

LEAVE = ("posture", "kind", "row", "fraction")
"""Units of cross-validation: left out one at a time."""
FOLDS = 5
"""Random parts of a campaign for `fraction`, left out one at a time; usual for cross-validation."""
LEVEL = 0.95
"""Share of measurements like these that a scope should contain."""


@dataclass(frozen=True)
class Scope:
    """Prediction error of one kind of measurement in cross-validation.

    Attributes:
        kind: of measurement.
        folds: left-out parts with such a measurement.
        count: measurements of the kind in them.
        rms: [-] rms prediction error, relative to the measured value; [SI] if it is absolute.
        seen: [-] or [SI] half-width of the interval with 95 % of the errors: Student's t for the folds, times rms.
        expected: [-] or [SI] the same by the model's own standard deviations.
    """

    kind: str
    folds: int
    count: int
    rms: float
    seen: float
    expected: float

    @property
    def half(self) -> float:
        """Half-width to report: the larger of both, so that luck with few parts does not count."""
        return max(self.seen, self.expected)


@dataclass(frozen=True)
class Validation:
    """A fit, and the prediction of each part of its campaign from the rest.

    Attributes:
        fit: to the whole campaign.
        leave: unit of cross-validation.
        parts: each left-out part, with its prediction.
    """

    fit: CampaignFit
    leave: str
    parts: tuple[HeldOut, ...]

    @property
    def told(self) -> tuple[HeldOut, ...]:
        """The parts for which the others determine a prediction."""
        return tuple(part for part in self.parts if part.told)

    @property
    def missed(self) -> tuple[HeldOut, ...]:
        """The parts too far from their prediction, corrected for their number."""
        told = self.told
        far = rare([part.p_value for part in told])
        return tuple(part for part, too_far in zip(told, far, strict=True) if too_far)

    @property
    def z(self) -> np.ndarray:
        """(n,) distance of each measurement from its prediction, in standard deviations."""
        return np.concatenate([part.off / part.sd for part in self.told]) if self.told else np.empty(0)

    @property
    def covered(self) -> int:
        """Number of measurements in the 95 % interval of their prediction."""
        return int((np.abs(self.z) < half_width(LEVEL)).sum())

    @cached_property
    def ratios(self) -> Float[np.ndarray, "n 3"]:
        """Damping ratios as measured, as predicted from the other parts, and their distance, see `Damping.left_out`."""
        damping = self.fit.damping
        return damping.left_out(parts_of(damping.rows, self.leave).values()) if damping else np.zeros((0, 3))

    @property
    def scopes(self) -> tuple[Scope, ...]:
        """Prediction error of each kind of measurement."""
        kinds = dict.fromkeys(m.kind for m in self.fit.campaign)
        return tuple(scope for kind in kinds if (scope := self.scope(kind)))

    def scope(self, kind: str, *, relative: bool = True) -> Scope | None:
        """Return the prediction error of a kind of measurement, relative or in SI; None without a predicted part."""
        from scipy.stats import t

        of_kind = np.array([m.kind == kind for m in self.fit.campaign])
        off, sd = [], []
        for part in self.told:
            own = of_kind[part.places] & ((part.measured != 0) | (not relative))
            if own.any():
                size = np.abs(part.measured[own]) if relative else 1.0
                off.append(part.off[own] / size)
                sd.append(part.sd[own] / size)
        if not off:
            return None
        rms = float(np.sqrt(np.mean([np.mean(each**2) for each in off])))
        expected = float(np.sqrt(np.mean([np.mean(each**2) for each in sd])))
        seen = float(t.ppf((1 + LEVEL) / 2, len(off))) * rms
        return Scope(kind, len(off), sum(map(len, off)), rms, seen, half_width(LEVEL) * expected)


def validate_fit(fit: CampaignFit, leave: str = "posture", seed: int = 0, progress: Progress = iter) -> Validation:
    """Cross-validate: leave out each part of a campaign in turn, fit the arm to the rest, and predict the part.

    Args:
        fit: to the whole campaign.
        leave: `posture`, `kind`, `row` or `fraction`; a part is left out whole.
        seed: of randomly chosen parts.
        progress: wraps the numbers of the parts, to show a bar.

    Raises:
        InputError: there are fewer than two parts.
    """
    parts = parts_of(fit.campaign, leave, seed)
    if len(parts) < 2:
        got, remedy = f"{leave}, of which the campaign has {len(parts)}", "leave out something else"
        raise refusal("leave", got, "two parts or more", remedy)
    return Validation(fit, leave, held_out(fit, parts, progress))


def parts_of(campaign: Campaign, leave: str, seed: int = 0) -> Mapping[str, list[int]]:
    """Return the indices of the measurements in each part of a campaign, by the part's name."""
    if leave not in LEAVE:
        raise no_such("leave", leave, LEAVE, "")
    count, parts = len(campaign), dict[str, list[int]]()
    fold = np.random.default_rng(seed).permutation(np.arange(count) % min(FOLDS, count))
    for place, m in enumerate(campaign):
        name = {
            "posture": f"({', '.join(f'{degrees(angle) + 0.0:.4g}' for angle in m.posture)}) deg",
            "kind": m.kind,
            "row": f"row {place + 1}",
            "fraction": f"part {fold[place] + 1}",
        }[leave]
        parts.setdefault(name, []).append(place)
    return parts
