"""Planning in one call: an arm, and what is measured already, in; the visits that tell most for their cost out."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from ident.arm.arm import Arm
from ident.errors import InputError, ModelError, Problem
from ident.identify.build_problem import build_problem
from ident.identify.candidate_predictions import CandidatePredictions, candidate_predictions, equivalent_postures
from ident.identify.experiments import (
    Experiment,
    Instruments,
    candidates,
    expected_rows,
    modes_of,
    relative_sigma,
    row_information,
)
from ident.identify.fit import CampaignFit, fit_campaign
from ident.identify.posture_grid import STEP, posture_grid
from ident.identify.unknowns import Unknowns
from ident.inference.fit import STARTS
from ident.inference.optimal_design import D_OPTIMAL, Experiments, Step, criterion, gains, greedy, information_gain
from ident.inference.parameters import Parameters
from ident.inference.prior_information import DRAWS, PriorInformation, fitted_knowledge, prior_knowledge
from ident.measure import OWN_WEIGHT, Campaign, Load, Measurement

COUNT = 4


@dataclass(frozen=True)
class Grid:
    """The postures that were looked at.

    Attributes:
        postures: (G, joints) [rad] within the limits.
        seen: (G,) place in `CandidatePredictions` of the posture that shows the same; -1 where none.
        sampled: whether they are a sample of a grid that would be too large.
    """

    postures: Float[np.ndarray, "G joints"]
    seen: Int[np.ndarray, "G"]
    sampled: bool


@dataclass(frozen=True)
class CampaignPlan:
    """What to measure next, and what it will give.

    Attributes:
        arm: with the numbers of its file.
        fit: of what is measured already; None for an empty campaign.
        parameters: the unknowns.
        known: what is known of them now.
        left_out: draws of the parameters with which the arm would not stand in every posture.
        means: what there is to measure with.
        grid: the postures.
        view: what they would show, those that show the same once.
        measured: (V,) which of the view's postures the campaign has been in.
        aim: `d`, `a` or the parameter that visits are chosen for.
        visits: (C,) all that could be done.
        offered: (C,) what each would tell, and its cost.
        gain: (C,) gain of each as the next visit, by the criterion.
        nats: (C,) its information gain.
        steps: the batch, in the order of choice.
    """

    arm: Arm
    fit: CampaignFit | None
    parameters: Parameters
    known: PriorInformation
    left_out: int
    means: Instruments
    grid: Grid
    view: CandidatePredictions
    measured: Bool[np.ndarray, "V"]
    aim: str
    visits: tuple[Experiment, ...]
    offered: Experiments
    gain: Float[np.ndarray, "C"]
    nats: Float[np.ndarray, "C"]
    steps: tuple[Step, ...]

    @property
    def name(self) -> str:
        """The campaign's name, or else the arm's."""
        return self.fit.campaign.name if self.fit else self.arm.name

    @property
    def per_cost(self) -> Float[np.ndarray, "C"]:
        """Gain of each visit per unit cost, by which they are ranked."""
        return self.gain / self.offered.cost

    @property
    def best_gain(self) -> Float[np.ndarray, "V"]:
        """Gain per unit cost of the best visit to each posture of the view."""
        best = np.full(len(self.view.postures), -np.inf)
        np.maximum.at(best, [visit.place for visit in self.visits], self.per_cost)
        return best

    @property
    def gain_over_grid(self) -> Float[np.ndarray, "G"]:
        """The same for each posture of the grid; NaN where the arm does not stand."""
        return np.append(self.best_gain, np.nan)[self.grid.seen]

    @property
    def batch(self) -> tuple[Experiment, ...]:
        """The chosen visits."""
        return tuple(self.visits[step.visit] for step in self.steps)

    @property
    def sd(self) -> Float[np.ndarray, "steps P"]:
        """Standard deviations of theta at the best estimate, now and after each step."""
        return np.array([self.known.sd[0], *(step.sd[0] for step in self.steps)])

    def ranked(self, count: int) -> list[int]:
        """Return the best visit of each of the best postures, as the next one."""
        order = np.argsort(-self.per_cost, kind="stable")
        best: dict[int, int] = {}
        for i in order:
            best.setdefault(self.visits[i].place, int(i))
        return list(best.values())[:count]

    def sd_after(self, visit: int) -> Float[np.ndarray, "P"]:
        """Return the standard deviations at the best estimate after one visit."""
        return np.sqrt(np.diag(np.linalg.inv(self.known.information[0] + self.offered.information[visit, 0])))

    def campaign(self) -> Campaign:
        """Return the batch as a campaign of the values that are expected.

        Visits to one posture under one load become one: a value that is taken n times is to be entered once, as a
        mean, since rows without label in one state are different modes.
        """
        point = self.arm.points[-1].name
        held = {(m.posture, m.load) for m in self.fit.campaign} if self.fit else set()
        states: dict[tuple[int, int], list[Experiment]] = {}
        for visit in self.batch:
            states.setdefault((visit.place, visit.case), []).append(visit)
        rows = []
        for visits in states.values():
            hammer, labelled, dial = (sum(getattr(v, part) for v in visits) for part in ("hammer", "labelled", "dial"))
            whole = replace(visits[0], hammer=hammer > 0, labelled=labelled > 0, dial=dial > 0)
            for row in expected_rows(self.view, self.means, whole, point):
                n = hammer if row.kind == "frequency" else dial
                note = f"mean of {n} readings. " * (n > 1)
                if (row.posture, row.load) in held:
                    note += "measured before: put the mean in place of the row that is there. "
                rows.append(replace(row, sigma=row.sigma / math.sqrt(n), note=note.strip()))
        return Campaign(f"{self.name}.plan", measurements=tuple(rows))

    def values_told(self, step: int) -> list[tuple[str, float]]:
        """Return each value of a step's visit that counts, with the nats it would give as the only one."""
        visit = self.batch[step]
        before = self.known.information + sum(self.offered.information[s.visit] for s in self.steps[:step])
        rows = row_information(self.view, self.means)[:, visit.place, visit.case]
        alone = information_gain(before, before + rows).mean(-1)
        told = [
            (str(label), float(nats))
            for (label, counts), nats in zip(modes_of(self.view, visit), alone[:-1], strict=True)
            if visit.hammer and counts
        ]
        return told + ([("deflection", float(alone[-1]))] if visit.dial else [])


def plan_campaign(
    arm: Arm,
    campaign: Campaign | None = None,
    unknowns: Unknowns | None = None,
    *,
    count: int = COUNT,
    aim: str = D_OPTIMAL,
    target: float = 0.0,
    step: float = STEP,
    modes: int = 4,
    loads: tuple[Load, ...] = (OWN_WEIGHT,),
    sigma: Mapping[str, float] | None = None,
    costs: Mapping[str, float] | None = None,
    draws: int = DRAWS,
    starts: int = STARTS,
    seed: int = 0,
    trust_values: bool = False,
) -> CampaignPlan:
    """Choose what to measure next on an arm.

    Args:
        arm: the arm; its limits say which postures can be held.
        campaign: what is measured already; None for nothing, so that the priors alone are known.
        unknowns: what is unknown, and its priors.
        count: visits in the batch, at most.
        aim: `d` (information), `a` (mean variance) or the name of one parameter.
        target: standard deviation of theta below which all are to be brought; the batch ends there. 0 for none.
        step: [rad] of the grid over each driven joint.
        modes: frequencies that a hammer test gives.
        loads: load cases that can be had.
        sigma: by kind, the standard deviation of a value as a share of it; as in the campaign where not given.
        costs: of the parts of a visit, in place of `COSTS`.
        draws: points of the parameters, beside the best estimate, over which gains are averaged.
        starts: of the fit.
        seed: of starts, draws and sampled postures.
        trust_values: take values of the campaign that the arm file makes implausible.

    Raises:
        InputError: arm, campaign and options do not fit together.
        ModelError: the campaign can't be fitted, or the arm stands in no posture.
    """
    if count < 1:
        raise InputError(Problem("count", f"{count}", "at least one visit", "ask for more"))
    if not arm.points:
        remedy = "add a [[point]] at the arm's end: there deflection is read, and modes are named by how it moves"
        raise InputError(Problem(arm.name, "no point", "at least one", remedy))
    means = Instruments(modes, loads, relative_sigma(campaign or Campaign(), sigma), costs or {})
    postures, sampled = posture_grid(arm, step, seed=seed)
    found = None
    if campaign:
        found = fit_campaign(arm, campaign, unknowns, starts=starts, seed=seed, trust_values=trust_values)
    parameters = found.problem.parameters if found else build_problem(arm, _anything(arm), unknowns).parameters
    gain = criterion(aim, parameters.names)
    spread = {"draws": draws, "seed": seed}
    known = fitted_knowledge(found, **spread) if found else prior_knowledge(parameters, **spread)
    held = np.array(campaign.postures) if campaign else postures[:0]
    view, seen, measured = _different(arm, parameters, known.points, np.concatenate([postures, held]), held, means)
    stands = np.asarray(view.stands.all(0))
    known, view = known.at(stands), view.at(points=stands)
    visits, offered = candidates(view, means)
    return CampaignPlan(
        arm=arm,
        fit=found,
        parameters=parameters,
        known=known,
        left_out=int((~stands).sum()),
        means=means,
        grid=Grid(postures, seen[: len(postures)], sampled),
        view=view,
        measured=measured,
        aim=aim,
        visits=visits,
        offered=offered,
        gain=gains(known, offered, gain),
        nats=gains(known, offered, information_gain),
        steps=greedy(known, offered, count, gain, target=target),
    )


def _different(
    arm: Arm, parameters: Parameters, points: np.ndarray, postures: np.ndarray, held: np.ndarray, means: Instruments
) -> tuple[CandidatePredictions, np.ndarray, np.ndarray]:
    """Look at the postures in which the arm stands, at one of each that show the same.

    Returns:
        What they show; for each posture its place there, -1 for none; which of them were held already.
    """
    first = candidate_predictions(arm, parameters, points[:2], postures, means.loads, means.modes)
    stands = first.stands[:, 0]
    if not stands.any():
        raise ModelError(
            f"{arm.name} has no stable equilibrium in any of {len(postures)} postures: its bushings are too soft for"
            " what they carry; check stiffnesses, masses and their units"
        )
    standing = np.flatnonzero(stands)
    fine = first.at(postures=standing, points=np.asarray(first.stands[standing].all(0)))
    before = (postures[standing, None] == held[None]).all(-1).any(1)
    # for their twins stand postures that were held, then those of little turning, to the left rather than the right
    turning = np.abs(postures[standing]).sum(1) - 1e-6 * postures[standing].sum(1)
    leader = equivalent_postures(fine, np.where(before, -1.0 / (1.0 + turning), turning))
    leaders = np.unique(leader)
    seen = np.full(len(postures), -1)
    seen[standing] = np.searchsorted(leaders, leader)
    view = candidate_predictions(arm, parameters, points, postures[standing[leaders]], means.loads, means.modes)
    return view, seen, np.isin(np.arange(len(leaders)), seen[standing[before]])


def _anything(arm: Arm) -> Campaign:
    """Return a campaign of both kinds that can be planned, to pose a problem with before anything is measured."""
    still = (0.0,) * len(arm.driven)
    frequency = Measurement(kind="frequency", posture=still, value=1.0, sigma=1.0)
    read = Measurement(kind="deflection", posture=still, value=1.0, sigma=1.0, point=arm.points[-1].name)
    return Campaign(measurements=(frequency, read))
