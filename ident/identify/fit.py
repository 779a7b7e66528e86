"""The main job in one call: an arm and a campaign in, a fit out, with what speaks against it."""

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from ident.arm.arm import Arm
from ident.identify.assumptions import Assumptions, assumptions
from ident.identify.build_problem import build_problem
from ident.identify.data_checks import check_values, repeated, row_names
from ident.identify.exchangeable import exchangeable, moves_of
from ident.identify.loops import Loop, loops
from ident.identify.mode_assignment import FAR
from ident.identify.predict import ArmModel
from ident.identify.setups import vector_of
from ident.identify.uncertain import scaled_inertia
from ident.identify.unknowns import Unknowns
from ident.inference.cross_prediction import cross_predictions
from ident.inference.curvature import fixed_combinations
from ident.inference.exchange import Exchange, exchanges
from ident.inference.fit import FIT_STARTS, Fit, fit, with_stretch
from ident.inference.robust import SUSPICIOUS, robust_weights, weighted
from ident.measure import Campaign

if TYPE_CHECKING:
    from ident.identify.explanations import Explanations

FARTHEST = 20
"""Values farthest off of which it is asked, in a large campaign, whether they were taken for others."""
NAMED = 30
"""Rows that a remark names at most."""


@dataclass(frozen=True, kw_only=True)
class CampaignFit(Fit):
    """A fit of an arm to a campaign.

    Attributes:
        arm: with the numbers of its file.
        campaign: what was measured.
        assumptions: what it takes for granted, and what that may move; None where no optimum was reached.
        exchanges: which two values, exchanged, would make data fit that do not.
        weights: (D,) by which each value counts in a robust fit, see `ident.inference.robust`; None in any other.
        explanations: what would reconcile the data, see `ident.identify.explanations`; None where that was not asked.
    """

    arm: Arm
    campaign: Campaign
    assumptions: Assumptions | None = None
    exchanges: tuple[Exchange, ...] = ()
    weights: Float[np.ndarray, "D"] | None = None
    explanations: "Explanations | None" = None

    @property
    def off(self) -> Float[np.ndarray, "D"]:
        """(predicted - measured) / sigma, with the sigmas as they were said."""
        return self.residuals if self.weights is None else self.residuals / np.sqrt(self.weights)

    @property
    def standardised(self) -> Float[np.ndarray, "D"]:
        """(predicted - measured) / standard deviation of that, see `RowTests.z`, with the sigmas as they were said."""
        return self.row_tests.z if self.weights is None else self.row_tests.z / np.sqrt(self.weights)

    @property
    def farthest_off(self) -> tuple[int, ...]:
        """Places of the fitted measurements, that of the largest standardised residual first."""
        off = np.where(np.isfinite(np.asarray(self.problem.sigma)), np.abs(np.nan_to_num(self.standardised)), -1.0)
        order = np.argsort(-off, kind="stable")
        return tuple(order[off[order] >= 0].tolist())

    @property
    def suspicious(self) -> Bool[np.ndarray, "D"]:
        """Which values are too far off: for so many, or to count for more than half in a robust fit."""
        return self.outliers if self.weights is None else self.weights < SUSPICIOUS

    @property
    def p_value(self) -> float:
        """Chance of a larger chi-squared, see `Fit`; NaN of a robust fit, whose weights hide what is off."""
        return super().p_value if self.weights is None else np.nan

    @property
    def mislabelled(self) -> bool:
        """Whether the modes that fit best are not those that labels and values make most probable."""
        return not self.choice.settled

    @property
    def renamed(self) -> tuple[int, ...]:
        """Places of the measurements whose mode has another label on the fitted arm than was measured."""
        return tuple(np.flatnonzero(np.asarray(self.choice.cost) >= FAR).tolist())

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why no interval should be quoted from this fit; empty when nothing speaks against it."""
        contradict = "the modes that fit best are not those that the labels name: check the labels"
        return (*((contradict,) if self.mislabelled else ()), *super().doubts)

    @property
    def in_doubt(self) -> bool:
        """Whether anything speaks against the fit, or the data ask to drop what it takes for granted."""
        return bool(self.doubts or (self.assumptions and self.assumptions.asked_for))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is odd about this fit, though it forbids no interval."""
        names = row_names(self.campaign)
        rows = ", ".join(f"{names[i]} ('{self.campaign.measurements[i].mode}')" for i in self.renamed[:NAMED])
        rows += f" and {len(self.renamed) - NAMED} more" if len(self.renamed) > NAMED else ""
        mode = "this mode has another label: row" if len(self.renamed) == 1 else "these modes have other labels: rows"
        renamed = (f"on the fitted arm {mode} {rows}",) if rows else ()
        return (*super().remarks, *renamed, *self._single(names), *self._exchanges(names))

    @property
    def without_rounding(self) -> tuple[float, int]:
        """Chi-squared and degrees of freedom without how readings of one thing differ that a display has rounded.

        They may all be equal, however large their sigmas: the display's steps hide that they are not.
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

    def _single(self, names: Sequence[str]) -> Iterator[str]:
        """Say which rows may be wrong by themselves, and which rows' errors nothing would show."""
        if self.blamed and (self.outliers.sum() > 1 or len(self.blamed) > 1):
            units = (", ".join(names[i] for i in own) for own in self.blamed)
            each = " or ".join(f"row{'s' * (',' in unit)} {unit}" for unit in units)
            yield f"without {each} no other lies too far off: look there first"
        if own := np.flatnonzero(self.row_tests.unchecked).tolist():
            several = ", ".join(names[i] for i in own[:NAMED])
            several += f" and {len(own) - NAMED} more" if len(own) > NAMED else ""
            yield f"row{'s' * (len(own) > 1)} {several} cannot be checked: no other measurement tells the same"

    def _exchanges(self, names: Sequence[str]) -> Iterator[str]:
        """Say of each pair of rows that the data would fit with its two values exchanged."""
        for each in self.exchanges:
            one, other = (names[i] for i in each.rows)
            better = f"chi-squared {self.chi_squared:.3g} -> {each.chi_squared:.3g}"
            yield f"rows {one} and {other}, their values exchanged, would fit ({better}): was one taken for the other?"

    @property
    def loops(self) -> tuple[Loop, ...]:
        """The loops of ramps of loads: how far what was read while unloading is from what was read while loading."""
        return loops(self.campaign, self)

    @property
    def fitted_arm(self) -> Arm:
        """The arm with the fitted numbers in place."""
        own = set(self.arm.paths())
        return self._scaled.replace({path: x for path, x in self.parameters.items() if path in own})

    @property
    def _scaled(self) -> Arm:
        """The arm with the inertia of bodies whose mass is uncertain."""
        model = self.problem.model
        return scaled_inertia(self.arm, self.parameters, model.scaled if isinstance(model, ArmModel) else ())


def fit_campaign(
    arm: Arm,
    campaign: Campaign,
    unknowns: Unknowns | None = None,
    *,
    starts: int = FIT_STARTS,
    seed: int = 0,
    trusted: Collection[str] = (),
    robust: str | None = None,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> CampaignFit:
    """Fit the joint stiffnesses, and what else is freed, to a campaign; damping where damping ratios were measured.

    Args:
        arm: its stiffnesses are starting values and centres of the priors.
        campaign: the measurements.
        unknowns: what is unknown, and its priors.
        starts: number of starts.
        seed: of the starts.
        trusted: rows whose values are right though implausible, see `check_values`.
        robust: the loss by which values count less that are too far off.
        progress: wraps the numbers of the starts, to show a bar.

    Raises:
        InputError: campaign and arm, or the named parameters, do not fit together; implausible values.
        ModelError: no optimum was reached.
    """
    problem = build_problem(arm, campaign, unknowns)
    check_values(problem, campaign, arm, trusted)
    best = fit(problem, starts=starts, seed=seed, progress=progress)
    weights = None if robust is None else robust_weights(best, units_of(campaign), robust)
    if weights is not None:
        best = fit(weighted(problem, weights), starts=starts, seed=seed)
    weak = (unknowns or Unknowns()).with_prior
    if weak != (unknowns or Unknowns()):
        other = build_problem(arm, campaign, weak)
        other = other if weights is None else weighted(other, weights)
        compared, _ = cross_predictions(other, [o.theta for o in best.optima], seed=seed)
        best = with_stretch(replace(best, cross_predictions=compared))
    granted = assumptions(best, arm, campaign) if best.best.converged else None
    known = {field.name: getattr(best, field.name) for field in fields(best)}
    found = CampaignFit(**known, arm=arm, campaign=campaign, assumptions=granted, weights=weights)
    found = replace(found, exchanges=_suspected(found))
    widths = not found.doubts
    return replace(found, combinations=fixed_combinations(found.problem, found.end, found.information, widths=widths))


def units_of(campaign: Campaign) -> Int[np.ndarray, "D"]:
    """Return the number of each row's unit: rows of a group, and components of a vector, are one."""
    units: dict[Hashable, int] = {}
    rows = enumerate(campaign)
    return np.array([units.setdefault(m.group or vector_of(m) or i, len(units)) for i, m in rows], int)


def _suspected(fit: CampaignFit) -> tuple[Exchange, ...]:
    """Return which two values may have been exchanged, where data or labels do not fit."""
    odd = fit.mislabelled or fit.improbable or fit.outliers.any()
    if not (odd and fit.best.converged and fit.degrees_of_freedom > 0):
        return ()
    pairs = list(exchangeable(fit.campaign, [*fit.farthest_off[:FARTHEST], *fit.renamed[:FARTHEST]]))
    suspected = [pair for pair in pairs if set(pair) <= set(fit.renamed)]
    return exchanges(fit, pairs, suspected, moves_of(fit.campaign))
