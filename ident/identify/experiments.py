"""What can be measured on an arm, how well, and at what cost: hammer, accelerometers, dial gauge, payload."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from ident.arm.arm import Arm
from ident.arm.labels import Label
from ident.errors import InputError, Problem
from ident.identify.candidate_predictions import CandidatePredictions
from ident.inference.optimal_design import Experiments
from ident.inference.prior_information import fisher
from ident.measure import OWN_WEIGHT, Campaign, Load, Measurement
from ident.measure.covariance import COMMON
from ident.text import did_you_mean

SIGMA = {"frequency": 0.005, "deflection": 0.02}
"""Standard deviations as shares of the value, where a campaign does not say; assumed."""
RESOLUTION = 1e-5
"""Standard deviation [m] that a dial gauge has however small the deflection; assumed."""
COSTS = {"posture": 10.0, "hammer": 10.0, "labels": 10.0, "dial": 10.0, "load": 20.0}
"""Minutes for each part of an experiment; assumed."""
PARTS = {
    "posture": "a new posture",
    "hammer": "a hammer test",
    "labels": "a second accelerometer",
    "dial": "a dial gauge",
    "load": "a load",
}
MOST_COMMON = 0.99
"""Common share of a variance at most: what is left is noise, which every reading has."""
CLOSE = 0.05
"""Frequencies nearer to each other than this share may come in another order on the arm than in the model."""


@dataclass(frozen=True)
class Instruments:
    """What is at hand to measure with.

    Attributes:
        modes: frequencies that a hammer test gives, from the lowest.
        loads: the load cases.
        sigma: by kind, the standard deviation as a share of the value.
        costs: of the parts of an experiment, in one unit, see `COSTS`.
        common: share of the variance that all frequencies of a posture have in common, and all deflections: a repeat
            there makes it no smaller.
    """

    modes: int = 4
    loads: tuple[Load, ...] = (OWN_WEIGHT,)
    sigma: Mapping[str, float] = field(default_factory=lambda: SIGMA)
    costs: Mapping[str, float] = field(default_factory=lambda: COSTS)
    common: float = COMMON

    def __post_init__(self) -> None:
        object.__setattr__(self, "sigma", _complete("sigma", self.sigma, SIGMA, above=0.0))
        object.__setattr__(self, "costs", _complete("cost", self.costs, COSTS))
        object.__setattr__(self, "loads", tuple(dict.fromkeys(self.loads)))
        if not 0 <= self.common <= MOST_COMMON:
            expected = f"a share from 0 to {MOST_COMMON:g}"
            raise InputError(Problem("common_share", f"{self.common:g}", expected, "0.5 for half of the variance"))
        if self.modes < 1:
            raise InputError(Problem("modes", f"{self.modes}", "at least one", "ask for more"))


@dataclass(frozen=True)
class Experiment:
    """The arm goes to a posture, under a load, and is measured.

    Attributes:
        place: posture in the `CandidatePredictions`.
        case: load case there.
        posture: (joints,) [rad]
        load: the load.
        hammer: whether the frequencies are measured.
        labelled: whether a second accelerometer tells which mode is which.
        dial: whether the deflection of the end point is read.
    """

    place: int
    case: int
    posture: tuple[float, ...]
    load: Load
    hammer: bool
    labelled: bool
    dial: bool

    def cost(self, costs: Mapping[str, float]) -> float:
        """Return what it costs."""
        parts = {"hammer": self.hammer, "labels": self.labelled, "dial": self.dial, "load": bool(self.load)}
        return costs["posture"] + sum(costs[part] for part, included in parts.items() if included)


WAYS = ((True, False, False), (True, True, False), (False, False, True), (True, False, True), (True, True, True))
"""What may be done in an experiment: hammer, labels, dial."""


def relative_sigma(campaign: Campaign, given: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the relative standard deviation by kind: as given, or as in the campaign (the median), or as assumed."""
    measured = {}
    for kind in SIGMA:
        shares = [m.sigma / abs(m.value) for m in campaign.of_kind(kind) if m.value]
        if shares:
            measured[kind] = float(np.median(shares))
    return SIGMA | measured | dict(given or {})


def common_share(campaign: Campaign, given: float | None = None) -> float:
    """Return the common share of the frequencies' variance: as given, as in the campaign (the median), or assumed."""
    if given is not None:
        return given
    rows = campaign.measurements
    shares = [
        matrix[i][j]
        for places, matrix in campaign.correlated
        for i, a in enumerate(places)
        for j, b in enumerate(places[:i])
        if rows[a].kind == rows[b].kind == "frequency"
    ]
    return float(np.clip(np.median(shares), 0.0, MOST_COMMON)) if shares else COMMON


def candidate_experiments(
    predictions: CandidatePredictions, instruments: Instruments
) -> tuple[tuple[Experiment, ...], Experiments]:
    """Return all experiments, and what each would tell; those at one posture have errors in common."""
    rows, counted = whole_information(predictions, instruments), counted_modes(predictions)
    by_way = []
    for hammer, labelled, dial in WAYS:
        modes = (rows[:-1] * counted[int(labelled)][..., None, None]).sum(0)
        by_way.append(modes * hammer + rows[-1] * dial)
    places = list(product(range(len(predictions.postures)), range(len(instruments.loads))))
    experiments = tuple(
        Experiment(g, s, tuple(map(float, predictions.postures[g])), instruments.loads[s], *way)
        for way in WAYS
        for g, s in places
    )
    whole = np.concatenate([part.reshape(len(places), *part.shape[2:]) for part in by_way])
    cost = np.array([experiment.cost(instruments.costs) for experiment in experiments])
    group = np.array([experiment.place for experiment in experiments], int)
    return experiments, Experiments.with_common_errors(whole, predictions.jacobian.shape[1], group, cost)


def whole_information(predictions: CandidatePredictions, instruments: Instruments) -> Float[np.ndarray, "r G L T Q Q"]:
    """Return the information of each frequency, and last of the deflection, on the parameters and on common errors.

    A value is off by sqrt(c) sigma u + sqrt(1 - c) sigma e with the common share c; u is one number for all frequencies
    of a posture, and another one for its deflections: the last two of the Q coordinates.
    """
    scaled = np.moveaxis(predictions.jacobian, 1, -1) / sigmas(predictions, instruments)[..., None]
    both = np.zeros((*scaled.shape[:-1], 2))
    both[:-1, ..., 0] = both[-1, ..., 1] = np.sqrt(instruments.common)
    return fisher(np.concatenate([scaled, both], -1)[..., None, :]) / (1 - instruments.common)


def row_information(predictions: CandidatePredictions, instruments: Instruments) -> Float[np.ndarray, "r G L T P P"]:
    """Return the Fisher information of each frequency, and last of the deflection, as the only value."""
    scaled = np.moveaxis(predictions.jacobian, 1, -1) / sigmas(predictions, instruments)[..., None]
    return fisher(scaled[..., None, :])


def sigmas(predictions: CandidatePredictions, instruments: Instruments) -> Float[np.ndarray, "r G L T"]:
    """Return the standard deviations [SI] that are to be expected."""
    read = np.hypot(instruments.sigma["deflection"] * predictions.deflection, RESOLUTION)
    return np.concatenate([instruments.sigma["frequency"] * predictions.frequency, read[None]])


def counted_modes(predictions: CandidatePredictions) -> tuple[Bool[np.ndarray, "m G L T"], Bool[np.ndarray, "m G L T"]]:
    """Return which frequencies count without and with a second accelerometer.

    Without one, those that no neighbour is so close to that their order is in doubt. With one, those too whose label
    is clear.
    """
    apart = predictions.gap >= CLOSE
    return apart, apart | predictions.named


def modes_of(predictions: CandidatePredictions, experiment: Experiment) -> list[tuple[Label, bool]]:
    """Return the modes of an experiment with their labels, and whether each counts."""
    counted = counted_modes(predictions)[int(experiment.labelled)][:, experiment.place, experiment.case, 0]
    return list(zip(predictions.labels(experiment.place, experiment.case), map(bool, counted), strict=True))


def expected_rows(
    predictions: CandidatePredictions, instruments: Instruments, experiment: Experiment, point: str
) -> tuple[Measurement, ...]:
    """Return an experiment's measurements with the values that are expected at the first point.

    All frequencies are there, so that those without label can be matched in ascending order.

    Args:
        predictions: what the arm would show.
        instruments: gives the standard deviations.
        experiment: the experiment.
        point: name of the arm's end point.
    """
    sigma = sigmas(predictions, instruments)[:, experiment.place, experiment.case, 0]
    clear = predictions.named[:, experiment.place, experiment.case, 0]
    rows = []
    for i, label in enumerate(predictions.labels(experiment.place, experiment.case) if experiment.hammer else ()):
        value = float(predictions.frequency[i, experiment.place, experiment.case, 0])
        mode = str(label) if experiment.labelled and clear[i] else None
        rows.append(_row(experiment, "frequency", value, sigma[i], mode=mode))
    if experiment.dial:
        value = float(predictions.deflection[experiment.place, experiment.case, 0])
        rows.append(_row(experiment, "deflection", value, sigma[-1], point=point))
    return tuple(rows)


def _row(
    experiment: Experiment, kind: str, value: float, sigma: float, mode: str | None = None, point: str | None = None
) -> Measurement:
    return Measurement(
        kind=kind,
        posture=experiment.posture,
        load=experiment.load,
        value=value,
        sigma=float(sigma),
        mode=mode,
        point=point,
    )


def _complete(what: str, given: Mapping[str, float], known: Mapping[str, float], above: float = -1e-300) -> dict:
    for name, value in given.items():
        if name not in known:
            remedy = did_you_mean(name, known, "name one of them")
            raise InputError(Problem(what, f"'{name}'", f"one of {', '.join(known)}", remedy))
        if not above < value < np.inf:
            expected = "a finite number above 0" if above == 0 else "a finite number >= 0"
            raise InputError(Problem(what, f"{name}={value:g}", expected, "correct it"))
    return {**known, **given}


def any_campaign(arm: Arm, loads: Iterable[Load]) -> Campaign:
    """Return a campaign of what can be planned, to pose a problem with before anything is measured."""
    still = (0.0,) * len(arm.driven)
    deflection = Measurement(kind="deflection", posture=still, value=1.0, sigma=1.0, point=arm.points[-1].name)
    frequency = Measurement(kind="frequency", posture=still, value=1.0, sigma=1.0)
    return Campaign(measurements=(deflection, *(replace(frequency, load=load) for load in loads)))
