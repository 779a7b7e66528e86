"""Check of a campaign before any fit, in one call: from an arm and a campaign to a check."""

import math
from collections.abc import Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.parts import DIRECTIONS, CubicSpring, Spring
from ident.errors import require
from ident.identify.data_checks import check_values, contradictory_repeats
from ident.identify.label_checks import LabelDoubt, changing_labels, label_doubts
from ident.identify.predict import bushing_moments
from ident.identify.problem import Posed, Ramp, pose, ramps
from ident.identify.unknowns import Unknowns
from ident.inference.fit import CrossPrediction, contradicting, cross_predictions
from ident.inference.identifiability import Check, Consistency, check, consistency
from ident.inference.search import evaluate, solve
from ident.measure import Campaign

if TYPE_CHECKING:
    from ident.identify.explanations import Explanations


# -------- Curved
# Whether a campaign can distinguish a nonlinear spring from a linear one, and the spring's load during measurements.

TOLD_APART = 3.84
"""Least chi-squared of a linear spring for the data to distinguish it: the 95 % limit for one degree of freedom."""
UNLOADED = 0.1
"""Share of T1 below which a spring counts as unloaded; assumed."""


@dataclass(frozen=True)
class SpringCheck:
    """Sensitivity of a campaign to one nonlinear spring, at the numbers of the arm file.

    Attributes:
        spring: its name.
        chi_squared: least cost of exact data of this arm with the spring made linear; NaN if no such arm is stable.
        torque1: [N m] T1; NaN for a cubic spring.
        at_rest: [N m] least and largest load in the states with deflections, rotations and twists.
        vibrating: [N m] likewise in the states with modes; NaN without any.
    """

    spring: str
    chi_squared: float
    torque1: float
    at_rest: tuple[float, float]
    vibrating: tuple[float, float]

    @property
    def told(self) -> bool:
        """Whether the data can distinguish it from a linear spring."""
        return self.chi_squared > TOLD_APART or math.isnan(self.chi_squared)

    @property
    def unloaded(self) -> bool:
        """Whether modes were measured only with the spring practically unloaded."""
        return self.vibrating[1] < UNLOADED * self.torque1


def check_springs(posed: Posed, unknowns: Unknowns | None = None) -> tuple[SpringCheck, ...]:
    """Return the sensitivity of a campaign to each nonlinear spring of an arm.

    Data predicted by the arm file are fitted with the spring made linear, its own numbers fixed and all other unknowns
    free: the cost measures how well data as expected would show the nonlinearity.
    """
    arm, campaign, conditions = posed.arm, posed.campaign, posed.conditions
    if not arm.springs:
        return ()
    exact = evaluate(posed.problem).predicted
    if not np.isfinite(exact).all():
        return ()
    rows = (replace(m, value=float(value)) for m, value in zip(campaign, exact, strict=True))
    as_predicted = replace(campaign, measurements=tuple(rows))
    sizes = dict(zip(DIRECTIONS, np.asarray(bushing_moments(arm, conditions)), strict=True))
    readings, unknowns = conditions.readings, unknowns or Unknowns()
    joints = [joint.name for joint in arm.joints]
    vibrating = np.concatenate([conditions.named.states, conditions.unnamed.states])
    at_rest = np.concatenate([readings.states, np.asarray(readings.references)[np.asarray(readings.references) >= 0]])
    found = []
    for spring in arm.springs:
        load, cost = sizes[spring.direction][joints.index(spring.joint)], _cost(arm, spring, as_predicted, unknowns)
        torque1 = float(spring.torque1) if isinstance(spring, Spring) else math.nan
        found.append(SpringCheck(spring.name, cost, torque1, _ends(load[at_rest]), _ends(load[vibrating])))
    return tuple(found)


def _cost(arm: Arm, spring: Spring | CubicSpring, exact: Campaign, unknowns: Unknowns) -> float:
    def others(paths: Mapping[str, Any]) -> dict[str, Any]:
        return {path: x for path, x in paths.items() if not path.startswith(f"{spring.name}.")}

    tied = tuple(group for group in unknowns.tied if len(others(dict.fromkeys(group))) == len(group))
    kept = replace(unknowns, free=others(unknowns.free), priors=others(unknowns.priors), tied=tied).with_prior
    straight = {"cubic": 0.0} if isinstance(spring, CubicSpring) else {"ratio2": 1.0, "ratio3": 1.0}
    numbers = {f"{spring.name}.{field}": value for field, value in straight.items()}
    problem = pose(arm.replace(numbers), exact, kept).problem
    end = solve(problem, problem.parameters.theta_start)
    residuals = np.asarray(problem.scaled(np.asarray(problem.measured) - end.predicted))
    return float(residuals @ residuals)


def _ends(loads: Float[np.ndarray, "states"]) -> tuple[float, float]:
    return (float(loads.min()), float(loads.max())) if loads.size else (math.nan, math.nan)


# -------- Check


@dataclass(frozen=True, kw_only=True)
class CampaignCheck(Check):
    """Check of a campaign for an arm, before any fit.

    Attributes:
        arm: with the numbers of its file.
        campaign: the measurements.
        consistency: of the data with each other; None where the model has no solution at the start.
        cross_predictions: each kind of measurement against the others, by fits from a few starts.
        labels: measurements with an uncertain mode.
        changing: share of points within the prior at which each row's label is ambiguous, or has no mode; if any.
        springs: sensitivity to each nonlinear spring of the arm.
        repeats: pairs of repeated rows that contradict each other; refused unless one is trusted.
        ramps: of the campaign, and how well it would determine their hysteresis widths.
        explanations: of contradictory data, see `ident.identify.explanations`; None if not requested.
    """

    arm: Arm
    campaign: Campaign
    consistency: Consistency | None
    cross_predictions: tuple[CrossPrediction, ...]
    labels: tuple[LabelDoubt, ...]
    changing: Mapping[int, float]
    springs: tuple[SpringCheck, ...]
    repeats: tuple[tuple[int, int], ...]
    ramps: tuple[Ramp, ...] = ()
    explanations: "Explanations | None" = None

    @property
    def contradictory(self) -> bool:
        """Whether one kind of measurement contradicts the others."""
        return bool(contradicting(self.cross_predictions))


def check_campaign(
    arm: Arm, campaign: Campaign, unknowns: Unknowns | None = None, *, seed: int = 0, trusted: Collection[str] = ()
) -> CampaignCheck:
    """Check what a campaign determines of joint stiffnesses and other freed numbers, before any fit.

    Args:
        arm: the model is linearised at its stiffnesses.
        campaign: the measurements.
        unknowns: with their priors.
        seed: of the further points.
        trusted: rows with correct though implausible values, or that contradict a repeat, see `check_values`.

    Raises:
        InputError: campaign and arm, or the named parameters, do not match; implausible values; contradictory repeats;
            a campaign without information on any unknown.
    """
    unknowns = unknowns or Unknowns()
    posed = pose(arm, campaign, unknowns)
    with ThreadPoolExecutor(1) as beside:
        labels = beside.submit(label_doubts, posed)  # its program is compiled while the other one is
        check_values(posed, trusted)
        checked = check(posed.problem, seed=seed)
        got = "no measurement that depends on any of the unknowns"
        remedy = "measure modes or postures that the unknown joints take part in, or free other parameters"
        require(not checked.blind, campaign.path, got, "some information on one at least", remedy)
        compared = posed.with_unknowns(unknowns.with_prior).problem
        return CampaignCheck(
            **vars(checked),
            arm=arm,
            campaign=posed.campaign,
            consistency=consistency(compared),
            cross_predictions=cross_predictions(compared, [compared.parameters.theta_start], seed=seed)[0],
            labels=labels.result(),
            changing=changing_labels(posed.problem, seed=seed),
            springs=check_springs(posed, unknowns),
            repeats=tuple(contradictory_repeats(posed.campaign)),
            ramps=ramps(posed),
        )
