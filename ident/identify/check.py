"""All that can be said of a campaign before solving, in one call: an arm and a campaign in, a check out."""

import math
from collections.abc import Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.parts import DIRECTIONS, CubicSpring, Spring
from ident.errors import refusal
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
# Whether a campaign can tell a curved spring from a straight one, and how it is loaded while it is measured.

TOLD_APART = 3.84
"""Chi-squared that a straight spring must cost, for the data to tell: the 95 % limit of one number."""
UNLOADED = 0.1
"""Share of T1 below which a spring counts as unloaded; assumed."""


@dataclass(frozen=True)
class SpringCheck:
    """What a campaign can tell of one curved spring, at the numbers of the arm file.

    Attributes:
        spring: its name.
        chi_squared: what exact data of this arm would cost at best, were the spring straight; NaN where no arm with a
            straight one stands.
        torque1: [N m] T1; NaN of a cubic spring.
        at_rest: [N m] least and largest load in the states in which deflections, rotations and twists were read.
        vibrating: [N m] likewise where modes were measured; NaN without any.
    """

    spring: str
    chi_squared: float
    torque1: float
    at_rest: tuple[float, float]
    vibrating: tuple[float, float]

    @property
    def told(self) -> bool:
        """Whether the data can tell it from a straight one."""
        return self.chi_squared > TOLD_APART or math.isnan(self.chi_squared)

    @property
    def unloaded(self) -> bool:
        """Whether modes were measured only where the spring carries next to nothing."""
        return self.vibrating[1] < UNLOADED * self.torque1


def check_springs(posed: Posed, unknowns: Unknowns | None = None) -> tuple[SpringCheck, ...]:
    """Look at each curved spring of an arm with the eyes of a campaign.

    Data as the arm file predicts them are fitted with the spring made straight, its own numbers kept and all other
    unknowns free: what that costs is what the data could tell, if they came out as expected.
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
    """What a campaign can tell about an arm, before any solving.

    Attributes:
        arm: with the numbers of its file.
        campaign: what was measured.
        consistency: the data among themselves; None where the model has no answer at the start.
        cross_predictions: each kind of measurement against the others, by fits from a few starts.
        labels: measurements whose mode is not sure.
        changing: at what share of points within the prior each row's label is a near draw, or has no mode; if at any.
        springs: the curved springs of the arm, with the eyes of the campaign.
        repeats: pairs of rows that measured the same and contradict each other; refused unless one is trusted.
        ramps: those of the campaign, and how well it would tell the widths of their loops.
        explanations: what would reconcile the data, see `ident.identify.explanations`; None where that was not asked.
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
    """Say what a campaign can tell about the joint stiffnesses, and what else is freed, before any solving.

    Args:
        arm: its stiffnesses are where the model is linearised.
        campaign: the measurements.
        unknowns: what is unknown, and its priors.
        seed: of the further points that are tried.
        trusted: rows whose values are right though implausible, or contradict a repeat, see `check_values`.

    Raises:
        InputError: campaign and arm, or the named parameters, do not fit together; implausible values; contradictory
            repeats; a campaign that says nothing of any unknown.
    """
    unknowns = unknowns or Unknowns()
    posed = pose(arm, campaign, unknowns)
    with ThreadPoolExecutor(1) as beside:
        labels = beside.submit(label_doubts, posed)  # its program is compiled while the other one is
        check_values(posed, trusted)
        checked = check(posed.problem, seed=seed)
        if checked.blind:
            got = "no measurement that depends on any of the unknowns"
            remedy = "measure modes or postures that the unknown joints take part in, or free other parameters"
            raise refusal(campaign.path, got, "some information on one at least", remedy)
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
