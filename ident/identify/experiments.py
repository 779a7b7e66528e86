"""What can be done on a visit to an arm, how well, and at what cost: hammer, accelerometers, dial gauge, payload."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from jaxtyping import Bool, Float

from ident.arm.labels import Label
from ident.errors import InputError, Problem
from ident.identify.candidate_predictions import CandidatePredictions
from ident.inference.optimal_design import Experiments
from ident.inference.prior_information import fisher
from ident.measure import OWN_WEIGHT, Campaign, Load, Measurement
from ident.text import did_you_mean

SIGMA = {"frequency": 0.005, "deflection": 0.02}
"""Standard deviations as shares of the value, where a campaign does not say; assumed."""
RESOLUTION = 1e-5
"""Standard deviation [m] that a dial gauge has however small the deflection; assumed."""
COSTS = {"posture": 10.0, "hammer": 10.0, "labels": 10.0, "dial": 10.0, "load": 20.0}
"""Minutes for each part of a visit; assumed."""
PARTS = {
    "posture": "a new posture",
    "hammer": "a hammer test",
    "labels": "a second accelerometer",
    "dial": "a dial gauge",
    "load": "a load",
}
CLOSE = 0.05
"""Frequencies nearer to each other than this share may come in another order on the arm than in the model."""


@dataclass(frozen=True)
class Instruments:
    """What is at hand to measure with.

    Attributes:
        modes: frequencies that a hammer test gives, from the lowest.
        loads: the load cases.
        sigma: by kind, the standard deviation as a share of the value.
        costs: of the parts of a visit, in one unit, see `COSTS`.
    """

    modes: int = 4
    loads: tuple[Load, ...] = (OWN_WEIGHT,)
    sigma: Mapping[str, float] = field(default_factory=lambda: SIGMA)
    costs: Mapping[str, float] = field(default_factory=lambda: COSTS)

    def __post_init__(self) -> None:
        object.__setattr__(self, "sigma", _complete("sigma", self.sigma, SIGMA, above=0.0))
        object.__setattr__(self, "costs", _complete("cost", self.costs, COSTS))
        object.__setattr__(self, "loads", tuple(dict.fromkeys(self.loads)))
        if self.modes < 1:
            raise InputError(Problem("modes", f"{self.modes}", "at least one", "ask for more"))


@dataclass(frozen=True)
class Experiment:
    """One visit: the arm goes to a posture, under a load, and is measured.

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
        return costs["posture"] + sum(costs[part] for part, done in parts.items() if done)


WAYS = ((True, False, False), (True, True, False), (False, False, True), (True, False, True), (True, True, True))
"""What may be done on a visit: hammer, labels, dial."""


def relative_sigma(campaign: Campaign, given: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the relative standard deviation by kind: as given, or as in the campaign (the median), or as assumed."""
    found = {}
    for kind in SIGMA:
        shares = [m.sigma / abs(m.value) for m in campaign.of_kind(kind) if m.value]
        if shares:
            found[kind] = float(np.median(shares))
    return SIGMA | found | dict(given or {})


def candidates(view: CandidatePredictions, means: Instruments) -> tuple[tuple[Experiment, ...], Experiments]:
    """Return all visits, and what each would tell."""
    rows, counted = row_information(view, means), counted_modes(view)
    by_way = []
    for hammer, labelled, dial in WAYS:
        modes = (rows[:-1] * counted[int(labelled)][..., None, None]).sum(0)
        by_way.append(modes * hammer + rows[-1] * dial)
    places = list(product(range(len(view.postures)), range(len(means.loads))))
    visits = tuple(
        Experiment(g, s, tuple(map(float, view.postures[g])), means.loads[s], *way) for way in WAYS for g, s in places
    )
    information = np.concatenate([part.reshape(len(places), *part.shape[2:]) for part in by_way])
    return visits, Experiments(information, np.array([visit.cost(means.costs) for visit in visits]))


def row_information(view: CandidatePredictions, means: Instruments) -> Float[np.ndarray, "r G L T P P"]:
    """Return the Fisher information of each frequency, and last of the deflection."""
    scaled = np.moveaxis(view.jacobian, 1, -1) / sigmas(view, means)[..., None]
    return fisher(scaled[..., None, :])


def sigmas(view: CandidatePredictions, means: Instruments) -> Float[np.ndarray, "r G L T"]:
    """Return the standard deviations [SI] that are to be expected."""
    read = np.hypot(means.sigma["deflection"] * view.deflection, RESOLUTION)
    return np.concatenate([means.sigma["frequency"] * view.frequency, read[None]])


def counted_modes(view: CandidatePredictions) -> tuple[Bool[np.ndarray, "m G L T"], Bool[np.ndarray, "m G L T"]]:
    """Return which frequencies count without and with a second accelerometer.

    Without one, those that no neighbour is so close to that their order is in doubt. With one, those too whose label
    is clear.
    """
    apart = view.gap >= CLOSE
    return apart, apart | view.named


def modes_of(view: CandidatePredictions, visit: Experiment) -> list[tuple[Label, bool]]:
    """Return the modes of a visit with their labels, and whether each counts."""
    counted = counted_modes(view)[int(visit.labelled)][:, visit.place, visit.case, 0]
    return list(zip(view.labels(visit.place, visit.case), map(bool, counted), strict=True))


def expected_rows(
    view: CandidatePredictions, means: Instruments, visit: Experiment, point: str
) -> tuple[Measurement, ...]:
    """Return a visit's measurements with the values that are expected at the first point.

    All frequencies are there, so that those without label can be matched in ascending order.

    Args:
        view: what the arm would show.
        means: gives the standard deviations.
        visit: the visit.
        point: name of the arm's end point.
    """
    sigma = sigmas(view, means)[:, visit.place, visit.case, 0]
    clear = view.named[:, visit.place, visit.case, 0]
    rows = []
    for i, label in enumerate(view.labels(visit.place, visit.case) if visit.hammer else ()):
        value = float(view.frequency[i, visit.place, visit.case, 0])
        mode = str(label) if visit.labelled and clear[i] else None
        rows.append(_row(visit, "frequency", value, sigma[i], mode=mode))
    if visit.dial:
        value = float(view.deflection[visit.place, visit.case, 0])
        rows.append(_row(visit, "deflection", value, sigma[-1], point=point))
    return tuple(rows)


def _row(visit: Experiment, kind: str, value: float, sigma: float, **what: str | None) -> Measurement:
    return Measurement(kind=kind, posture=visit.posture, load=visit.load, value=value, sigma=float(sigma), **what)  # type: ignore[arg-type]


def _complete(what: str, given: Mapping[str, float], known: Mapping[str, float], above: float = -1e-300) -> dict:
    for name, value in given.items():
        if name not in known:
            remedy = did_you_mean(name, known, "name one of them")
            raise InputError(Problem(what, f"'{name}'", f"one of {', '.join(known)}", remedy))
        if not above < value < np.inf:
            expected = "a finite number above 0" if above == 0 else "a finite number >= 0"
            raise InputError(Problem(what, f"{name}={value:g}", expected, "correct it"))
    return {**known, **given}
