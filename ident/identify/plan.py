"""Planning in one call: an arm, and what is measured already, in; the experiments that tell most for their cost out."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from ident.arm.arm import Arm
from ident.errors import refusal
from ident.identify.binding import bind_loads
from ident.identify.candidates import (
    CandidatePredictions,
    Experiment,
    any_campaign,
    candidate_experiments,
    distinct_predictions,
    expected_rows,
    modes_of,
    whole_information,
)
from ident.identify.fit import CampaignFit
from ident.identify.instruments import STEP, Instruments, common_share, posture_grid, relative_sigma
from ident.identify.problem import pose
from ident.identify.unknowns import Unknowns, is_of_readings
from ident.inference.design import (
    D_OPTIMAL,
    DRAWS,
    Experiments,
    PriorInformation,
    Step,
    criterion,
    gains,
    greedy,
    information_gain,
    prior_and_data_information,
    prior_information,
    sds,
)
from ident.inference.parameters import Parameter, Parameters
from ident.measure import OWN_WEIGHT, Campaign, Load, Measurement


@dataclass(frozen=True)
class PlanSettings:
    """What to choose, from what.

    Attributes:
        count: experiments in the batch, at most.
        criterion: `d` (information), `a` (mean variance) or the name of one parameter.
        target: standard deviation of theta below which all are to be brought; the batch ends there. 0 for none.
        step: [rad] of the grid over each driven joint.
        modes: frequencies that a hammer test gives.
        loads: load cases that can be had.
        sigma: by kind, the standard deviation of a value as a share of it; as in the campaign where not given.
        costs: of the parts of an experiment, in place of `COSTS`.
        common: share of a value's variance that is common to its posture; None for that of the campaign, or assumed.
        draws: points of the parameters, beside the best estimate, over which gains are averaged.
        seed: of draws and sampled postures.
    """

    count: int = 4
    criterion: str = D_OPTIMAL
    target: float = 0.0
    step: float = STEP
    modes: int = 4
    loads: tuple[Load, ...] = (OWN_WEIGHT,)
    sigma: Mapping[str, float] = field(default_factory=dict)
    costs: Mapping[str, float] = field(default_factory=dict)
    common: float | None = None
    draws: int = DRAWS
    seed: int = 0

    def __post_init__(self) -> None:
        if self.count < 1:
            raise refusal("count", f"{self.count}", "at least one experiment", "ask for more")
        self.instruments(Campaign())

    def instruments(self, campaign: Campaign) -> Instruments:
        """Return what there is to measure with, as exact as in a campaign where nothing else is said.

        Raises:
            InputError: unknown kinds or parts, or numbers that can't be.
        """
        common = common_share(campaign, self.common)
        return Instruments(self.modes, self.loads, relative_sigma(campaign, self.sigma), self.costs, common)


DEFAULT = PlanSettings()
ALIKE = 1e-3
"""Share of a value within which two predictions are of one thing: damped and undamped frequencies differ by less."""


@dataclass(frozen=True)
class Grid:
    """The postures that were compared.

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
        parameters: the unknowns, of which the nuisances are not sought.
        known: what is known of them now.
        left_out: draws of the parameters with which the arm would not stand in every posture.
        instruments: what there is to measure with.
        grid: the postures.
        predictions: what they would show, those that show the same once.
        measured: (V,) which of the predictions' postures the campaign has been in.
        before: by value (its place among those of a state), posture and load case, the rows that have measured it.
        experiments: (C,) all that could be done.
        candidates: (C,) what each would tell, and its cost.
        gain: (C,) gain of each as the next experiment, by the criterion.
        nats: (C,) its information gain.
        steps: the batch, in the order of choice.
        settings: what was asked for.
    """

    arm: Arm
    fit: CampaignFit | None
    parameters: Parameters
    known: PriorInformation
    left_out: int
    instruments: Instruments
    grid: Grid
    predictions: CandidatePredictions
    measured: Bool[np.ndarray, "V"]
    before: Mapping[tuple[int, int, int], tuple[int, ...]]
    experiments: tuple[Experiment, ...]
    candidates: Experiments
    gain: Float[np.ndarray, "C"]
    nats: Float[np.ndarray, "C"]
    steps: tuple[Step, ...]
    settings: PlanSettings

    @property
    def name(self) -> str:
        """The campaign's name, or else the arm's."""
        return self.fit.campaign.name if self.fit else self.arm.name

    @property
    def criterion(self) -> str:
        """`d`, `a` or the parameter that experiments are chosen for."""
        return self.settings.criterion

    @property
    def sought(self) -> tuple[Parameter, ...]:
        """The unknowns that the plan is for."""
        return tuple(item for item in self.parameters.items if not item.nuisance)

    @property
    def missed(self) -> tuple[str, ...]:
        """The parameters whose standard deviation is above the target at the end of the batch; none without target."""
        wide = (self.sd[-1] > self.settings.target) & (self.settings.target > 0)
        return tuple(name for name, is_wide in zip(self.known.sought, wide, strict=True) if is_wide)

    @property
    def at_draws(self) -> Float[np.ndarray, "draws sought"]:
        """Standard deviations of each sought theta at the end of the batch, at the other draws."""
        return (self.steps[-1].sd if self.steps else self.known.sd)[1:]

    @property
    def missed_at_draws(self) -> Int[np.ndarray, "sought"]:
        """At how many of the other draws each standard deviation is above the target at the end of the batch."""
        return ((self.at_draws > self.settings.target) & (self.settings.target > 0)).sum(0)

    def best_for(self, place: int) -> tuple[int, float]:
        """Return the experiment after the batch that tells most of one sought parameter, and its sd then."""
        chosen = [step.experiment for step in self.steps]
        information = self.known.information[0] + self.candidates.together(chosen)[0]
        after = sds(self.known.of_sought(information + self.candidates.after(chosen)[:, 0]))[:, place]
        best = int(np.argmin(after))
        return best, float(after[best])

    @property
    def per_cost(self) -> Float[np.ndarray, "C"]:
        """Gain of each experiment per unit cost, by which they are ranked."""
        return self.gain / self.candidates.cost

    @property
    def best_gain(self) -> Float[np.ndarray, "V"]:
        """Gain per unit cost of the best experiment to each posture of the predictions."""
        best = np.full(len(self.predictions.postures), -np.inf)
        np.maximum.at(best, [experiment.place for experiment in self.experiments], self.per_cost)
        return best

    @property
    def gain_over_grid(self) -> Float[np.ndarray, "G"]:
        """The same for each posture of the grid; NaN where the arm does not stand."""
        return np.append(self.best_gain, np.nan)[self.grid.seen]

    @property
    def batch(self) -> tuple[Experiment, ...]:
        """The chosen experiments."""
        return tuple(self.experiments[step.experiment] for step in self.steps)

    @property
    def sd(self) -> Float[np.ndarray, "steps sought"]:
        """Standard deviations of each sought theta at the best estimate, now and after each step."""
        return np.array([self.known.sd[0], *(step.sd[0] for step in self.steps)])

    def ranked(self, count: int) -> list[int]:
        """Return the best experiment of each of the best postures, as the next one."""
        best: dict[int, int] = {}
        for i in np.argsort(-self.per_cost, kind="stable"):
            best.setdefault(self.experiments[i].place, int(i))
        return list(best.values())[:count]

    def sd_after(self, experiment: int) -> Float[np.ndarray, "sought"]:
        """Return the standard deviations at the best estimate after one experiment."""
        return sds(self.known.of_sought(self.known.information[0] + self.candidates.information[experiment, 0]))

    def campaign(self) -> Campaign:
        """Return the batch as a campaign of the values that are expected.

        A value that is taken several times, earlier rows of the campaign among them, is to be entered once, as their
        mean: rows without label in one state are different modes. The standard deviation of a mean is such that the fit
        of all has the standard deviations of the plan: of n readings of one standard deviation s and the common share
        c, s sqrt(c + (1 - c) / n).
        """
        point, common = self.arm.points[-1].name, self.instruments.common
        old = self.fit.campaign.measurements if self.fit else ()
        states: dict[tuple[int, int], list[Experiment]] = {}
        for experiment in self.batch:
            states.setdefault((experiment.place, experiment.case), []).append(experiment)
        rows = list[Measurement]()
        for (place, case), experiments in states.items():
            parts = "hammer", "labelled", "dial"
            hammer, labelled, dial = (sum(getattr(v, part) for v in experiments) for part in parts)
            whole = replace(experiments[0], hammer=hammer > 0, labelled=labelled > 0, dial=dial > 0)
            frequencies = len(self.predictions.frequency)
            expected = expected_rows(self.predictions, self.instruments, whole, point)
            # all rows of a state have the labels of before, or none: measured frequencies are entered as they rise
            read = [self.before.get((i, place, case), ()) for i in range(frequencies)]
            keep_labels = all(any(old[k].mode for k in rows_of_mode) for rows_of_mode in read)
            for i, row in enumerate(expected):
                is_frequency = row.kind == "frequency"
                earlier = [old[k] for k in self.before.get((i if is_frequency else frequencies, place, case), ())]
                n = (hammer if is_frequency else dial) + len(earlier)
                weight = [1 / (common + (1 - common) / k) if k else 0.0 for k in (len(earlier), n)]
                told = sum(1 / m.spread**2 for m in earlier) + (weight[1] - weight[0]) / row.sigma**2
                note = f"enter the mean of {n} readings" * (n > 1)
                if earlier:
                    rows_before = " and ".join(Path(m.where).name or "the earlier row" for m in earlier)
                    note = f"replace {rows_before}: {note}, the earlier one among them"
                mode = next((m.mode for m in earlier if m.mode and keep_labels), row.mode)
                rows.append(replace(row, mode=mode, sigma=told**-0.5, note=note))
        return Campaign(f"{self.name}.plan", measurements=tuple(rows))

    def value_gains(self, step: int) -> list[tuple[str, float]]:
        """Return each value of a step's experiment that counts, with the nats it would give as the only one."""
        experiment = self.batch[step]
        chosen = [each.experiment for each in self.steps[:step]]
        before = self.known.information + self.candidates.together(chosen)
        state = int(self.candidates.group[self.steps[step].experiment])
        rows = whole_information(self.predictions, self.instruments)[:, experiment.place, experiment.case]
        added = self.candidates.added(self.candidates.taken(state, chosen), rows)
        sought = self.known.of_sought
        alone = information_gain(sought(before), sought(before + added)).mean(-1)
        frequencies = [
            (str(label), float(nats))
            for (label, counts), nats in zip(modes_of(self.predictions, experiment), alone[:-1], strict=True)
            if experiment.hammer and counts
        ]
        return frequencies + ([("deflection", float(alone[-1]))] if experiment.dial else [])


def _read_before(
    fit: CampaignFit, predictions: CandidatePredictions, loads: tuple[Load, ...], point: str
) -> dict[tuple[int, int, int], tuple[int, ...]]:
    """Return the rows of a campaign that measured a value of the predictions: those that the fit predicts alike."""
    found: dict[tuple[int, int, int], tuple[int, ...]] = {}
    places = {tuple(posture): place for place, posture in enumerate(predictions.postures.tolist())}
    for row, (m, value) in enumerate(zip(fit.campaign, fit.predicted.tolist(), strict=True)):
        place = places.get(m.posture)
        if place is None or m.load not in loads or not (m.kind == "frequency" or m.point == point):
            continue
        case = loads.index(m.load)
        shown = predictions.frequency if m.kind == "frequency" else predictions.deflection[None]
        off = np.abs(shown[:, place, case, 0] - value)
        if m.kind in ("frequency", "deflection") and off.min() < ALIKE * abs(value):
            first = 0 if m.kind == "frequency" else len(predictions.frequency)
            key = (first + int(np.argmin(off)), place, case)
            found[key] = (*found.get(key, ()), row)
    return found


def plan_campaign(
    arm: Arm, fit: CampaignFit | None = None, unknowns: Unknowns | None = None, settings: PlanSettings = DEFAULT
) -> CampaignPlan:
    """Choose what to measure next on an arm.

    Args:
        arm: the arm; its limits say which postures can be held.
        fit: of what is measured already; None for nothing, so that the priors alone are known.
        unknowns: what is unknown, and its priors, where there is no fit.
        settings: what is chosen, from what.

    Raises:
        InputError: arm and settings do not fit together.
        ModelError: the arm stands in no posture.
    """
    if not arm.points:
        remedy = "add a [[point]] at the arm's end: there deflection is read, and modes are named by how it moves"
        raise refusal(arm.name, "no point", "at least one", remedy)
    instruments = settings.instruments(fit.campaign if fit else Campaign())
    loads = bind_loads(arm, instruments.loads)
    postures, sampled = posture_grid(arm, settings.step, seed=settings.seed)
    problem = fit.problem if fit else pose(arm, any_campaign(arm, settings.loads), unknowns).problem
    parameters = Parameters(tuple(item for item in problem.parameters.items if not is_of_readings(item.name)))
    spread = {"draws": settings.draws, "seed": settings.seed}
    known = prior_and_data_information(fit, **spread) if fit else prior_information(problem.parameters, **spread)
    known = known.without([name for name in known.names if is_of_readings(name)])
    gain = criterion(settings.criterion, known.sought)
    before = np.array(fit.campaign.postures) if fit else postures[:0]
    predictions, place, measured = distinct_predictions(
        arm, parameters, known.points, np.concatenate([postures, before]), before, loads, instruments.modes
    )
    stable = np.asarray(predictions.stable.all(0))
    known, predictions = known.at(stable), predictions.at(points=stable)
    read = _read_before(fit, predictions, instruments.loads, arm.points[-1].name) if fit else {}
    experiments, candidates = candidate_experiments(predictions, instruments, read)
    return CampaignPlan(
        arm=arm,
        fit=fit,
        parameters=parameters,
        known=known,
        left_out=int((~stable).sum()),
        instruments=instruments,
        grid=Grid(postures, place[: len(postures)], sampled),
        predictions=predictions,
        measured=measured,
        before=read,
        experiments=experiments,
        candidates=candidates,
        settings=settings,
        gain=gains(known, known.information, candidates.information, gain),
        nats=gains(known, known.information, candidates.information, information_gain),
        steps=greedy(known, candidates, settings.count, gain, target=settings.target),
    )
