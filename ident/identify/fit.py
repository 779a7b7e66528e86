"""The main job in one call: from an arm and a campaign to a fit with its warnings."""

from collections.abc import Callable, Collection, Hashable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Int

from ident.arm.arm import Arm
from ident.identify.assumptions import Assumptions, assumptions
from ident.identify.damping import RATIO, Damping, Poles, damping_of
from ident.identify.data_checks import check_values, repeated, row_names
from ident.identify.exchangeable import exchangeable, moves_of
from ident.identify.mode_matching import FAR
from ident.identify.predict import vector_of
from ident.identify.problem import Posed, Ramp, pose, ramps_of
from ident.identify.unknowns import Unknowns, is_damping
from ident.inference.fit import FIT_STARTS, Fit, cross_predictions, fit, with_stretch
from ident.inference.optima import fixed_combinations
from ident.inference.problem import DISCREPANCY_PREFIX, InverseProblem
from ident.inference.scrutiny import SUSPICIOUS, Exchange, exchanges, robust_weights, weighted
from ident.inference.search import End, look, solve
from ident.measure import Campaign
from ident.programs import Progress

if TYPE_CHECKING:
    from ident.identify.explanations import Explanations


# -------- Fit

FARTHEST = 20
"""Number of worst outliers in a large campaign to test for swapped values."""
NAMED = 30
"""Most rows named in a remark."""
ROUNDS, STILL = 4, 0.05
"""Most fits while the damping moves damped modes; move [sd] that counts as none."""
LEAST_CHANGE = 0.1
"""Least change of chi-squared worth a remark; assumed."""


@dataclass(frozen=True)
class Loop(Ramp):
    """Hysteresis loop of a ramp of loads.

    Attributes:
        width: [m or rad] reading while unloading, less the reading at the same load while loading.
        largest: [m or rad] the largest reading.
    """

    width: float
    largest: float


@dataclass(frozen=True, kw_only=True)
class CampaignFit(Fit):
    """A fit of an arm to a campaign.

    Attributes:
        arm: with the numbers of its file.
        campaign: the measurements, without damping ratios.
        assumptions: of the fit, and the effect of their violation; None if no optimum was reached.
        exchanges: pairs of values whose swap would make contradictory data fit.
        weights: (D,) of each value in a robust fit, see `ident.inference.scrutiny`; None in any other.
        explanations: of contradictory data, see `ident.identify.explanations`; None if not requested.
        damping: the law of damping given these stiffnesses; None without measured damping ratios.
        poles: damping used for frequencies and shapes of damped modes.
    """

    arm: Arm
    campaign: Campaign
    assumptions: Assumptions | None = None
    exchanges: tuple[Exchange, ...] = ()
    weights: Float[np.ndarray, "D"] | None = None
    explanations: "Explanations | None" = None
    damping: Damping | None = None
    poles: Poles = field(default_factory=Poles)

    @property
    def off(self) -> Float[np.ndarray, "D"]:
        """(predicted - measured) / sigma, with the stated sigmas."""
        return self.residuals if self.weights is None else self.residuals / np.sqrt(self.weights)

    @property
    def standardised(self) -> Float[np.ndarray, "D"]:
        """(predicted - measured) / its standard deviation, see `RowTests.z`, with the stated sigmas."""
        return self.row_tests.z if self.weights is None else self.row_tests.z / np.sqrt(self.weights)

    @property
    def farthest_off(self) -> tuple[int, ...]:
        """Indices of the fitted measurements, largest standardised residual first."""
        off = np.where(np.isfinite(np.asarray(self.problem.sigma)), np.abs(np.nan_to_num(self.standardised)), -1.0)
        order = np.argsort(-off, kind="stable")
        return tuple(order[off[order] >= 0].tolist())

    @property
    def suspicious(self) -> Bool[np.ndarray, "D"]:
        """Which values are outliers: corrected for their number, or in a robust fit with a weight below one half."""
        return self.outliers if self.weights is None else self.weights < SUSPICIOUS

    @property
    def p_value(self) -> float:
        """Probability of a larger chi-squared, see `Fit`; NaN for a robust fit, whose weights hide outliers."""
        return super().p_value if self.weights is None else np.nan

    @property
    def mislabelled(self) -> bool:
        """Whether the best-fitting modes are not the most probable ones by labels and values."""
        return not self.choice.settled

    @property
    def renamed(self) -> tuple[int, ...]:
        """Indices of the measurements whose mode has another label on the fitted arm."""
        return tuple(np.flatnonzero(np.asarray(self.choice.cost) >= FAR).tolist())

    @property
    def doubts(self) -> tuple[str, ...]:
        """Objections to this fit: with any of them, no interval is reported."""
        contradict = "the measured frequencies match other modes than their labels say: check the labels"
        return (*((contradict,) if self.mislabelled else ()), *super().doubts)

    @property
    def in_doubt(self) -> bool:
        """Whether there is an objection to the fit, or evidence against one of its assumptions."""
        return bool(self.doubts or (self.assumptions and self.assumptions.asked_for))

    @property
    def remarks(self) -> tuple[str, ...]:
        """Remarks on this fit that do not suppress intervals."""
        names = row_names(self.campaign)
        rows = _several([f"{names[i]} ('{self.campaign.measurements[i].mode}')" for i in self.renamed])
        mode = "this mode has another label: row" if len(self.renamed) == 1 else "these modes have other labels: rows"
        renamed = (f"on the fitted arm {mode} {rows}",) if rows else ()
        single = (self.blamed_in_words,) if self.blamed_in_words else ()
        alone = [names[i] for i in np.flatnonzero(self.row_tests.unchecked)]
        several = f"row{'s' * (len(alone) > 1)} {_several(alone)}"
        unchecked = (f"no other measurement can check {several}: an error would go unnoticed",) if alone else ()
        return (*super().remarks, *renamed, *single, *unchecked, *self.exchanges_in_words)

    @property
    def without_rounding(self) -> tuple[float, int]:
        """Chi-squared and degrees of freedom without scatter of repeated readings that a display's resolution hides.

        Such readings may all be equal, however large their sigmas.
        """
        chi_squared, freedom = self.chi_squared, self.degrees_of_freedom
        if self.problem.correlation is not None or self.weights is not None:
            return chi_squared, freedom if self.weights is None else 0
        measured, sigma = np.asarray(self.problem.measured), np.asarray(self.problem.sigma)
        for rows in repeated(self.campaign):
            own = [i for i in rows if np.isfinite(sigma[i])]
            if len(own) > 1 and any(self.campaign.measurements[i].resolution for i in own):
                mean = np.average(measured[own], weights=sigma[own] ** -2)
                chi_squared -= float((((measured[own] - mean) / sigma[own]) ** 2).sum())
                freedom -= len(own) - 1
        return chi_squared, freedom

    @property
    def blamed_in_words(self) -> str:
        """Write which rows alone may be wrong; empty if the only such row is an outlier, or there is none."""
        if not self.blamed or (self.outliers.sum() < 2 and len(self.blamed) < 2):
            return ""
        names = row_names(self.campaign)
        units = (", ".join(names[i] for i in own) for own in self.blamed)
        each = " or ".join(f"row{'s' * (',' in unit)} {unit}" for unit in units)
        return f"without {each} no other value is an outlier: check it first"

    @property
    def exchanges_in_words(self) -> tuple[str, ...]:
        """Write for each suspected pair of rows that the data would fit with its two values swapped."""
        names, words = row_names(self.campaign), []
        for each in self.exchanges:
            one, other = (names[i] for i in each.rows)
            rows = [self.campaign.measurements[i] for i in each.rows]
            labels = all(m.mode for m in rows)
            what, check = ("labels", "check the mode shapes") if labels else ("values", "measure both again")
            better = self.chi_squared - each.chi_squared > LEAST_CHANGE
            change = f" (chi-squared {self.chi_squared:.3g} -> {each.chi_squared:.3g})" if better else ""
            words.append(f"the {what} of rows {one} and {other} are probably swapped{change}: swap them, or {check}")
        return tuple(words)

    @property
    def loops(self) -> tuple[Loop, ...]:
        """Hysteresis loops of ramps of loads: difference between readings while unloading and while loading."""
        values = np.abs([m.value for m in self.campaign])
        return tuple(
            Loop(**vars(ramp), width=self.parameters[ramp.name], largest=float(values[list(ramp.rows)].max()))
            for ramp in ramps_of(self.campaign, self.problem, self.information.sd)
        )

    @property
    def fitted_arm(self) -> Arm:
        """The arm with the fitted numbers in place."""
        return self.posed.applied(self.parameters)[0]

    def state(self) -> dict[str, Any]:
        """Return the numbers from which the fit can be rebuilt, see `ident.identify.stored`."""
        from ident.identify.stored import fit_state

        return fit_state(self)

    @property
    def posed(self) -> Posed:
        """The campaign as a problem of this arm."""
        return Posed(self.campaign, self.problem)


def _several(rows: Sequence[str]) -> str:
    """Write a list of rows; of many, the first ones."""
    return ", ".join(rows[:NAMED]) + (f" and {len(rows) - NAMED} more" if len(rows) > NAMED else "")


def fit_campaign(
    arm: Arm,
    campaign: Campaign,
    unknowns: Unknowns | None = None,
    *,
    starts: int = FIT_STARTS,
    seed: int = 0,
    trusted: Collection[str] = (),
    robust: str | None = None,
    progress: Progress = iter,
) -> CampaignFit:
    """Fit joint stiffnesses and other freed numbers to a campaign; then, given these, damping to damping ratios.

    Frequencies and shapes of damped modes depend on both: their damping comes from a first search, and the fit is
    repeated with its own damping until no row moves.

    Args:
        arm: its stiffnesses are starting values and centres of the priors.
        campaign: the measurements.
        unknowns: with their priors.
        starts: number of starts.
        seed: of the starts.
        trusted: rows with correct though implausible values, see `check_values`.
        robust: loss function that reduces the weight of outliers.
        progress: wraps the numbers of the starts, to show a bar.

    Raises:
        InputError: campaign and arm, or the named parameters, do not match; implausible values.
        ModelError: no optimum was reached.
    """
    unknowns = unknowns or Unknowns()
    check_values(with_poles(arm, campaign, unknowns, _damping_of_file(arm, campaign)), trusted)
    search = partial(fit, starts=starts, seed=seed, progress=progress)
    posed, used, best = fit_with_poles(arm, campaign, unknowns, search)
    weights = None if robust is None else robust_weights(best, units_of(posed.campaign), robust)
    if weights is not None:
        best = fit(weighted(posed.problem, weights), starts=starts, seed=seed)
    if unknowns.with_prior != unknowns:
        weak = posed.with_unknowns(unknowns.with_prior).problem
        weak = weak if weights is None else weighted(weak, weights)
        compared, _ = cross_predictions(weak, [o.theta for o in best.optima], seed=seed)
        best = with_stretch(replace(best, cross_predictions=compared))
    granted = assumptions(best, posed) if best.best.converged else None
    known = {each.name: getattr(best, each.name) for each in fields(best)}
    damping = damping_given(arm, posed, best, campaign, unknowns)
    whole = CampaignFit(
        **known, arm=arm, campaign=posed.campaign, assumptions=granted, weights=weights, damping=damping, poles=used
    )
    whole = replace(whole, exchanges=_suspected(whole))
    widths = not whole.doubts
    return replace(whole, combinations=fixed_combinations(whole.problem, whole.end, whole.information, widths=widths))


def _damping_of_file(arm: Arm, campaign: Campaign) -> Poles:
    """Return the arm's own damping if rows depend on fitted damping, with loss factors so that one program serves."""
    coupled = any(m.kind == RATIO for m in campaign) and any(m.of for m in campaign)
    return Poles({path: float(arm.get(path)) for path in arm.paths() if is_damping(path)} if coupled else {})


def fit_with_poles(
    arm: Arm, campaign: Campaign, unknowns: Unknowns, search: Callable[[InverseProblem], Fit]
) -> tuple[Posed, Poles, Fit]:
    """Fit stiffnesses, with the damping of damped modes from their ratios given these; see `fit_campaign`."""
    poles = _damping_of_file(arm, campaign)
    posed, coupled = with_poles(arm, campaign, unknowns, poles), bool(poles.numbers)
    if coupled and np.isfinite((first := solve(posed.problem, posed.problem.parameters.theta_start)).cost):
        poles = _poles(arm, campaign, unknowns, posed, first)
    for _ in range(ROUNDS):
        used, posed = poles, with_poles(arm, campaign, unknowns, poles)
        best = search(posed.problem)
        poles = _poles(arm, campaign, unknowns, posed, best.end) if coupled else poles
        if not coupled or _moved(arm, campaign, unknowns, (used, poles), best) < STILL:
            break
    return posed, used, best


def with_poles(arm: Arm, campaign: Campaign, unknowns: Unknowns, poles: Poles) -> Posed:
    """Pose a campaign to an arm with the damping of its damped modes in place."""
    posed = pose(poles.on(arm), campaign, unknowns)
    if not any(poles.apart):
        return posed
    return replace(posed, problem=posed.problem.with_sigma(np.hypot(np.asarray(posed.problem.sigma), poles.apart)))


def damping_given(arm: Arm, posed: Posed, end: End | Fit, campaign: Campaign, unknowns: Unknowns) -> Damping | None:
    """Return the law of damping at the end of a fit or of a search; None without measured ratios.

    Args:
        arm: as in its file.
        posed: the campaign and the fitted arm.
        end: with stiffnesses and predictions.
        campaign: all rows.
        unknowns: of the fit.
    """
    if not len(posed.ratios):
        return None
    parameters, theta = posed.problem.parameters, end.best.theta if isinstance(end, Fit) else end.theta
    values = parameters.by_path(parameters.values(np.asarray(theta)))
    own = {name: value for name, value in values.items() if not name.startswith(DISCREPANCY_PREFIX)}
    return damping_of(arm, posed.model, campaign, np.asarray(end.predicted), own, unknowns.named(arm))


def _poles(arm: Arm, campaign: Campaign, unknowns: Unknowns, posed: Posed, end: End) -> Poles:
    """Return the damping of the best law, and the differences of rows under laws that the data cannot separate."""
    damping = damping_given(arm, posed, end, campaign, unknowns)
    assert damping is not None
    laws = [Poles(damping.numbers(law)) for law in (damping.best, *damping.rivals)]
    first, *others = (_predicted(arm, campaign, unknowns, poles, end) for poles in laws)
    apart = np.max([np.zeros_like(first), *(np.abs(other - first) for other in others)], 0)
    sigma = np.array([m.sigma for m in posed.campaign])
    return replace(laws[0], apart=tuple(np.where(apart > STILL * sigma, apart, 0.0).tolist()))


def _predicted(arm: Arm, campaign: Campaign, unknowns: Unknowns, poles: Poles, end: End) -> Float[np.ndarray, "D"]:
    return np.asarray(look(with_poles(arm, campaign, unknowns, poles).problem, end.theta, end.choice.held).predicted)


def _moved(arm: Arm, campaign: Campaign, unknowns: Unknowns, pair: tuple[Poles, Poles], best: Fit) -> float:
    """Return the largest move of a row [sigma] from one damping to the next."""
    before, now = (_predicted(arm, campaign, unknowns, poles, best.end) for poles in pair)
    apart = [np.array(poles.apart) if poles.apart else np.zeros(len(now)) for poles in pair]
    off = np.maximum(np.abs(now - before), np.abs(apart[1] - apart[0])) / np.asarray(best.problem.sigma)
    return float(off.max())


def units_of(campaign: Campaign) -> Int[np.ndarray, "D"]:
    """Return each row's unit number: rows of a group, or components of a vector, share one."""
    units: dict[Hashable, int] = {}
    rows = enumerate(campaign)
    return np.array([units.setdefault(m.group or vector_of(m) or i, len(units)) for i, m in rows], int)


def _suspected(fit: CampaignFit) -> tuple[Exchange, ...]:
    """Return the pairs of values that may have been swapped, if data or labels do not fit."""
    odd = fit.mislabelled or fit.improbable or fit.outliers.any()
    if not (odd and fit.best.converged and fit.degrees_of_freedom > 0):
        return ()
    pairs = list(exchangeable(fit.campaign, [*fit.farthest_off[:FARTHEST], *fit.renamed[:FARTHEST]]))
    suspected = [pair for pair in pairs if set(pair) <= set(fit.renamed)]
    return exchanges(fit, pairs, suspected, moves_of(fit.campaign))
