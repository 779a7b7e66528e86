"""Planning in one call: from an arm and existing measurements to the experiments with the most gain for their cost."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from ident.arm.arm import Arm
from ident.errors import require
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
from ident.text import by_key


@dataclass(frozen=True)
class PlanSettings:
    """Settings of a plan.

    Attributes:
        count: most experiments in the batch.
        criterion: `d` (information), `a` (mean variance) or the name of one parameter.
        target: standard deviation of theta that all sought parameters should reach; the batch ends there. 0 for none.
        step: [rad] of the grid over each driven joint.
        modes: number of frequencies from a hammer test.
        loads: available load cases.
        sigma: by kind, the standard deviation of a value as a share of it; by default as in the campaign.
        costs: of the parts of an experiment, in place of `COSTS`.
        common: share of a value's variance that is common to its posture; None for that of the campaign, or assumed.
        draws: points of the parameters, in addition to the best estimate, over which gains are averaged.
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
        require(self.count >= 1, "count", f"{self.count}", "at least one experiment", "ask for more")
        self.instruments(Campaign())

    def instruments(self, campaign: Campaign) -> Instruments:
        """Return the available instruments, by default with the sigmas of the campaign.

        Raises:
            InputError: unknown kinds or parts, or impossible numbers.
        """
        common = common_share(campaign, self.common)
        return Instruments(self.modes, self.loads, relative_sigma(campaign, self.sigma), self.costs, common)


DEFAULT = PlanSettings()
ALIKE = 1e-3
"""Relative difference below which two predictions are of one quantity: damped and undamped frequencies differ less."""


@dataclass(frozen=True)
class Grid:
    """The compared postures.

    Attributes:
        postures: (G, joints) [rad] within the limits.
        seen: (G,) index in `CandidatePredictions` of the posture with the same predictions; -1 for none.
        sampled: whether they are a sample, as the full grid would be too large.
    """

    postures: Float[np.ndarray, "G joints"]
    seen: Int[np.ndarray, "G"]
    sampled: bool


@dataclass(frozen=True)
class CampaignPlan:
    """The next experiments, and their expected gain.

    Attributes:
        arm: with the numbers of its file.
        fit: of the existing measurements; None for an empty campaign.
        parameters: the unknowns; nuisances are not sought.
        known: present information on them.
        left_out: draws of the parameters for which the arm has no stable equilibrium in some posture.
        instruments: the available ones.
        grid: the postures.
        predictions: at the postures, each distinct one once.
        measured: (V,) whether the campaign has measured in each posture of the predictions.
        before: rows that have measured a value already, by value (its index within the state), posture and load case.
        experiments: (C,) all possible ones.
        candidates: (C,) information and cost of each.
        gain: (C,) gain of each as the next experiment, by the criterion.
        nats: (C,) its information gain.
        steps: the batch, in the order of choice.
        settings: of the plan.
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
        """Criterion of the choice: `d`, `a` or a parameter's name."""
        return self.settings.criterion

    @property
    def sought(self) -> tuple[Parameter, ...]:
        """The sought unknowns."""
        return tuple(item for item in self.parameters.items if not item.nuisance)

    @property
    def missed(self) -> tuple[str, ...]:
        """The parameters whose standard deviation is above the target at the end of the batch; none without target."""
        wide = (self.sd[-1] > self.settings.target) & (self.settings.target > 0)
        return tuple(name for name, is_wide in zip(self.known.sought, wide, strict=True) if is_wide)

    @property
    def at_draws(self) -> Float[np.ndarray, "draws sought"]:
        """Standard deviations of each sought theta after the batch, at the other draws."""
        return (self.steps[-1].sd if self.steps else self.known.sd)[1:]

    @property
    def missed_at_draws(self) -> Int[np.ndarray, "sought"]:
        """Number of the other draws at which each standard deviation is above the target after the batch."""
        return ((self.at_draws > self.settings.target) & (self.settings.target > 0)).sum(0)

    def best_for(self, place: int) -> tuple[int, float]:
        """Return the best experiment after the batch for one sought parameter, and the parameter's sd then."""
        chosen = [step.experiment for step in self.steps]
        information = self.known.information[0] + self.candidates.together(chosen)[0]
        after = sds(self.known.of_sought(information + self.candidates.after(chosen)[:, 0]))[:, place]
        best = int(np.argmin(after))
        return best, float(after[best])

    @property
    def per_cost(self) -> Float[np.ndarray, "C"]:
        """Gain of each experiment per unit cost, the ranking criterion."""
        return self.gain / self.candidates.cost

    @property
    def best_gain(self) -> Float[np.ndarray, "V"]:
        """Gain per unit cost of the best experiment in each posture of the predictions."""
        best = np.full(len(self.predictions.postures), -np.inf)
        np.maximum.at(best, [experiment.place for experiment in self.experiments], self.per_cost)
        return best

    @property
    def gain_over_grid(self) -> Float[np.ndarray, "G"]:
        """The same for each posture of the grid; NaN where the arm has no stable equilibrium."""
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
        """Return the batch as a campaign of the expected values.

        A value measured several times, also in earlier rows of the campaign, must be entered once, as the mean: rows
        without label in one state are different modes. The sigma of a mean reproduces the standard deviations of the
        plan: s sqrt(c + (1 - c) / n) for n readings of standard deviation s with the common share c.
        """
        point, common = self.arm.points[-1].name, self.instruments.common
        old = self.fit.campaign.measurements if self.fit else ()
        rows = list[Measurement]()
        for (place, case), experiments in by_key(((each.place, each.case), each) for each in self.batch).items():
            parts = "hammer", "labelled", "dial"
            hammer, labelled, dial = (sum(getattr(v, part) for v in experiments) for part in parts)
            whole = replace(experiments[0], hammer=hammer > 0, labelled=labelled > 0, dial=dial > 0)
            frequencies = len(self.predictions.frequency)
            expected = expected_rows(self.predictions, self.instruments, whole, point)
            # all rows of a state keep their earlier labels, or have none: frequencies are entered in ascending order
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
        """Return each relevant value of a step's experiment, with its information gain [nat] as the only one."""
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
    """Return the rows of a campaign that measured a value of the predictions: those with the same prediction."""
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
        arm: the arm; its limits define the holdable postures.
        fit: of the existing measurements; None for none, so that only the priors count.
        unknowns: with priors, if there is no fit.
        settings: of the plan.

    Raises:
        InputError: arm and settings do not match.
        ModelError: the arm has no stable equilibrium in any posture.
    """
    remedy = "add a [[point]] at the arm's end: there deflection is read, and modes are named by how it moves"
    require(arm.points, arm.name, "no point", "at least one", remedy)
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
