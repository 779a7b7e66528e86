"""Hypotheses about wrong inputs of arm file and campaign: their table, their limits, the search.

`KINDS` is the one table of inputs that may be wrong, each with its plausible size before the data; a fit's assumptions
(`fit.assumptions`) and explanations (`explanations.explain`) are hypotheses of these kinds, or entry errors. All have
the same score, minus twice the logarithm of their probability: the remaining cost of data, priors and labels, and the
square of the implausibility. Causes of a vibration have no such cost, as the noise of a trace is unknown: their score
is the residual share of its energy (`ident.vibrate.hypotheses`).
"""

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.hinges import end_of
from ident.arm.parts import DIRECTIONS, STIFFNESS_OF, Body, CubicSpring, Joint
from ident.identify.conditions import Conditions
from ident.identify.padding import padded
from ident.identify.predict import ArmModel, bushing_moments
from ident.identify.problem import Posed
from ident.identify.unknowns import LOAD, is_loaded, scaled_loads
from ident.inference.fit import agrees
from ident.inference.information import RANK_TOLERANCE
from ident.inference.parameters import AnyArray, Parameter, Parameters, Prior
from ident.inference.problem import Choice, InParts, InverseProblem
from ident.inference.search import TO_THE_END, End, Way, descent, look, looks, searched, together
from ident.measure import Campaign
from ident.programs import RUNS_ONCE, jit

# -------- Kinds
# Inputs that may be wrong, their plausible size, and the evidence from which a hypothesis counts.

CHANCE = 0.01
"""P-value of the cost above which nothing remains to be explained."""
MARGIN = 2.0
"""Least fall of the score, from that of the data as they are, for a hypothesis to be listed: less is "not worth more
than a bare mention" (Kass, Raftery, "Bayes factors", J. Am. Stat. Assoc. 90, 1995, section 3.2)."""
SLIP = 2.6
"""Implausibility [sd] of an entry error, one in a hundred campaigns; assumed."""
ASSUMED = "assumed"
DUMAS = f"{ASSUMED}; links are usually taken as much stiffer (Dumas et al., Robot. Comput. Integr. Manuf. 27, 2011)"


@dataclass(frozen=True)
class Kind:
    """A kind of hypothesis.

    Attributes:
        plausible: standard deviation of its amount before the data: of ln(factor), or of a share.
        of: reference quantity of the factor or share.
        check: what to do about it.
        factor: whether it is a factor, exp(amount); else the amount is a share.
        positive: whether it cannot be negative.
        origin: source of the plausible amount.
    """

    plausible: float
    of: str
    check: str
    factor: bool = False
    positive: bool = False
    origin: str = ASSUMED


FOOT, BENDING = "measure the foot's motion", "its joint's bending compliance"
KINDS = {
    "base rocks": Kind(0.2, "joint 1's bending compliance", FOOT, positive=True),
    "base turns": Kind(0.2, "joint 1's torsional compliance", FOOT, positive=True),
    "link bends": Kind(0.1, BENDING, "measure deflections along the link", positive=True, origin=DUMAS),
    "link twists": Kind(0.1, BENDING, "measure rotations along the link", positive=True, origin=DUMAS),
    "mass": Kind(0.1, "the link's mass, inertia with it", "weigh it", factor=True),
    "mass centre": Kind(0.02, "the link's length", "balance it"),
    "servo gives": Kind(
        0.05, "its joint's torsional compliance", "compare twists with brakes and with servos on", positive=True
    ),
    "payload": Kind(0.05, "the payload's mass", "weigh it", factor=True),
    "length": Kind(0.01, "the link's length", "measure it", factor=True),
    "loads": Kind(
        0.02, "all masses, forces and moments that were hung on", "check the load cell or the scales", factor=True
    ),
    "scale": Kind(0.02, "all values of a kind, as of a gauge", "check the calibration and the unit", factor=True),
    "clock": Kind(0.005, "all frequencies", "check the sampling rate", factor=True),
    "spring": Kind(
        0.1,
        "the torque at the largest load of all that were measured",
        "measure deflections under several loads",
        positive=True,
    ),
}
"""No published ratio of a base's stiffness to that of joint 1 is known: a base is assumed to be at least five times as
stiff, the softest case in the study of detection rates (tests/benchmarks/README.md). The moment of `spring` grows with
the cube of the angle: the secant rises by its share, the tangent by three times its share."""
ENTRY_ERRORS = {
    "value": "measure it again",
    "exchange": "swap them, or check the mode shapes",
    **dict.fromkeys(("on", "off"), "check the load"),
    "soft base": "put a dial gauge on the foot; `--soft-base`",
}
"""What to do about an entry error, and about both compliances of a base together."""
SOFT = ("base rocks", "base turns")
RIGID = ("link bends", "link twists", "servo gives")
"""Kinds that no search frees: the score test of a fit estimates them (`fit.assumptions`)."""
SCALES = ("scale", "clock")

# -------- Alternatives
# Possible errors of an arm file and a campaign, as numbers that a search can move.

UNLOADED = 1e-3
"""Moment [N m] below which a bushing counts as unloaded, so that nonlinearity of its spring has no effect."""
FIXED = 1e-6
"""Length [m] below which a link counts as having none."""


@dataclass(frozen=True)
class Number:
    """One input that may be wrong.

    Attributes:
        kind: one of `KINDS`.
        of: the body, link or kind of measurement; for a spring `joint2.torsion`.
    """

    kind: str
    of: str

    @property
    def name(self) -> str:
        """Its name among the parameters of a model."""
        return f"/{self.kind}/{self.of}"

    @property
    def parameter(self) -> Parameter:
        """The number as an unknown, zero without an error."""
        return Parameter((self.name,), False, 0.0, 0.0, nuisance=True)


class AlteredModel(ArmModel):
    """The model of a campaign with further errors as parameters; with all of them zero, the original model.

    Attributes:
        numbers: these errors.
        moments: (N, 2) [N m] largest bending and torsional moment on each bushing among the states.
    """

    numbers: tuple[Number, ...] = eqx.field(static=True, default=())
    moments: Float[AnyArray, "N 2"] | None = None

    def applied(self, parameters: Mapping[str, Any]) -> tuple[Arm, Conditions]:
        """Return the altered arm and the conditions with these numbers in place."""
        by_kind: dict[str, dict[str, Any]] = {}
        for number in self.numbers:
            if number.name in parameters:
                by_kind.setdefault(number.kind, {})[number.of] = parameters[number.name]
        own = {path: value for path, value in parameters.items() if not path.startswith("/")}
        altered = ArmModel(_rebuilt(self.arm, by_kind), self.conditions, self.scaled, self.frames)
        arm, conditions = altered.applied(own)
        if "loads" in by_kind:
            conditions = replace(conditions, loads=scaled_loads(conditions.loads, jnp.exp(by_kind["loads"][LOAD])))
        springs = by_kind.get("spring", {})
        return (self._curved(arm, springs) if springs else arm), conditions

    def _curved(self, arm: Arm, amounts: Mapping[str, Any]) -> Arm:
        """Give springs a cubic part: at the largest moment M, where the angle is M/k, its amount is a share of k x."""
        assert self.moments is not None
        places = {joint.name: place for place, joint in enumerate(arm.joints)}
        springs = list(arm.springs)
        for of, amount in amounts.items():
            joint, direction = of.split(".")
            k = getattr(arm.joints[places[joint]], STIFFNESS_OF[direction])
            moment = self.moments[places[joint], DIRECTIONS.index(direction)]
            springs.append(CubicSpring(f"/{of}", joint, direction, amount * k**3 / moment**2))
        return eqx.tree_at(lambda a: a.springs, arm, tuple(springs), is_leaf=lambda x: x is arm.springs)


def altered_numbers(
    model: ArmModel, kinds: tuple[str, ...], taken: Mapping[str, float], moments: Float[np.ndarray, "N 2"]
) -> Iterator[Number]:
    """Yield all possible errors that are not unknowns already, also of payloads that were never on.

    So a campaign with such a payload on has the same numbers, and the same program.

    Args:
        model: of the campaign.
        kinds: of measurement.
        taken: the unknowns.
        moments: (N, 2) [N m] on each bushing, see `largest_moments`.
    """
    arm, loads = model.arm, model.conditions.loads
    for place, joint in enumerate(arm.joints):
        yield from (Number("mass", body.name) for body in joint.link if f"{body.name}.mass" not in taken and body.mass)
        if joint.link and np.linalg.norm(end_of(arm, place)) > FIXED:
            if not any(f"{body.name}.com." in path for body in joint.link for path in taken):
                yield Number("mass centre", joint.name)
            # its length: the next bushing's offset, or the points at the arm's end
            ends = [f"{point.name}.position." for point in arm.points if point.joint == joint.name]
            ends = [f"{arm.joints[place + 1].name}.offset."] if place + 1 < len(arm.joints) else ends
            if not any(end in path for end in ends for path in taken):
                yield Number("length", joint.name)
    for payload in arm.payloads:
        if f"{payload.body.name}.mass" not in taken:
            yield Number("payload", payload.body.name)
    if LOAD not in taken and is_loaded(loads):
        yield Number("loads", LOAD)
    scaled = [kind for kind in kinds if kind != "shape"]
    yield from (Number("clock" if kind == "frequency" else "scale", kind) for kind in scaled)
    curved = {(spring.joint, spring.direction) for spring in arm.springs}
    for joint, own in zip(arm.joints, moments, strict=True):
        for direction, moment in zip(DIRECTIONS, own, strict=True):
            if joint.driven and (joint.name, direction) not in curved and moment > UNLOADED:
                yield Number("spring", f"{joint.name}.{direction}")


@partial(jit, options=RUNS_ONCE)
def largest_moments(model: ArmModel, parameters: Mapping[str, Any]) -> Float[AnyArray, "N 2"]:
    """Return the largest bending and torsional moment [N m] on each bushing among the states of a campaign."""
    return bushing_moments(*model.applied(parameters)).max(2).T


def _rebuilt(arm: Arm, amounts: Mapping[str, Mapping[str, Any]]) -> Arm:
    """Return an arm with changed masses, mass centres and lengths."""
    masses = {**amounts.get("mass", {}), **amounts.get("payload", {})}
    centres, lengths = amounts.get("mass centre", {}), amounts.get("length", {})
    if not (masses or centres or lengths):
        return arm

    def body(old: Body, shift: Any) -> Body:
        factor = jnp.exp(masses.get(old.name, 0.0))
        new = old.mass * factor, old.com + shift, old.inertia * factor
        return eqx.tree_at(lambda b: (b.mass, b.com, b.inertia), old, new)

    joints: list[Joint] = []
    for place, joint in enumerate(arm.joints):
        shift = centres.get(joint.name, 0.0) * end_of(arm, place)
        joints.append(eqx.tree_at(lambda j: j.link, joint, tuple(body(each, shift) for each in joint.link)))
    for place, joint in enumerate(arm.joints[:-1], 1):
        if joint.name in lengths:
            longer = joints[place].offset * jnp.exp(lengths[joint.name])
            joints[place] = eqx.tree_at(lambda j: j.offset, joints[place], longer)
    last = arm.joints[-1].name
    stretch = jnp.exp(lengths.get(last, 0.0))
    points = tuple(
        eqx.tree_at(lambda p: p.position, point, point.position * stretch) if point.joint == last else point
        for point in arm.points
    )
    payloads = tuple(eqx.tree_at(lambda p: p.body, each, body(each.body, 0.0)) for each in arm.payloads)
    return eqx.tree_at(lambda a: (a.joints, a.points, a.payloads), arm, (tuple(joints), points, payloads))


# -------- Perturbations
# Searches for a campaign's optimum with some inputs of arm and campaign perturbed.
#
# One program predicts the campaign with all unknowns and all such numbers, and its slopes along a few directions; each
# search moves the unknowns and one or two of the numbers, and all searches share evaluations (`search.together`).

RIDGES = 3.0, 20.0
"""Width of the ridge penalty on a number, as a multiple of its plausible width: first and last."""
STEP_OFF = 20.0
"""Plausible size of a wrong value's error [its sigma], for the same penalty."""
STEPS = 60
"""Most evaluations of a search: without convergence by then there is no explanation."""
TOGETHER = 2
"""Most perturbations at the same time."""


@dataclass(frozen=True)
class Perturbation:
    """One possible error: numbers that change together, by the same amount in their own unit.

    Attributes:
        numbers: that change; none for a wrong row.
        row: index of a wrong value; -1 for none.
    """

    numbers: tuple[Number, ...] = ()
    row: int = -1


@dataclass(frozen=True)
class Perturbed:
    """The optimum of a campaign with some perturbations.

    Attributes:
        hypotheses: to which it belongs.
        amounts: of each perturbation, in its own unit (see `KINDS`); for a row, its error in sigmas.
        sd: of these by data and priors.
        cost: sum of squares of data and priors at the optimum, without the priors of the amounts.
        label_cost: of the labels there, minus twice the logarithm of their probability.
        fits: whether cost, values, kinds and labels all agree with it, by the rules for a fit's verdict.
        theta: of the optimum: the unknowns, then all possible errors.
        way: matrix from unknowns and amounts to theta.
        covariance: of unknowns and amounts, by data and priors.
    """

    hypotheses: "Hypotheses"
    amounts: tuple[float, ...]
    sd: tuple[float, ...]
    cost: float
    label_cost: float
    fits: bool
    theta: Float[np.ndarray, "Q"]
    way: Float[np.ndarray, "Q p"]
    covariance: Float[np.ndarray, "p p"]

    @property
    def values(self) -> dict[str, float]:
        """The unknowns and the perturbed numbers, by path [SI]."""
        parameters = self.hypotheses.problem.parameters
        values = parameters.by_path(np.asarray(parameters.values(self.theta)))
        return {path: float(x) for path, x in values.items()}

    def among(self, hypotheses: "Hypotheses") -> "Perturbed":
        """Return the same optimum among further hypotheses about the same arm, with none of their numbers perturbed."""
        more = (0, len(hypotheses.start.theta) - len(self.theta))
        way = np.pad(self.way, (more, (0, 0)))
        return replace(self, hypotheses=hypotheses, theta=np.pad(self.theta, more), way=way)

    def predict(
        self, campaign: Campaign, conditions: Conditions
    ) -> tuple[Float[np.ndarray, "D"], Float[np.ndarray, "D"]]:
        """Return predictions of other measurements of the arm in the base frame, and their standard deviations."""
        own, count = self.hypotheses, len(campaign)
        assert isinstance(own.problem.model, ArmModel)
        model = replace(own.problem.model, conditions=conditions, frames=None)
        kinds = tuple(m.kind for m in campaign)
        problem = InverseProblem(model, np.ones(count), np.full(count, np.inf), own.problem.parameters, kinds)
        whole = problem.in_parts
        ((predicted, slopes, _),) = looks(whole, [Way(self.theta, own.filled(self.way), whole.first_matching)], 1)
        predicted, slopes = own.calibrated(kinds, self.theta, own.filled(self.way), predicted, slopes)
        slopes = slopes[:, : len(self.covariance)]
        variance = np.einsum("ip,pq,iq->i", slopes, self.covariance, slopes)
        return predicted, np.sqrt(np.maximum(variance, 0.0))


@dataclass(frozen=True)
class Hypotheses:
    """A campaign, and all possible errors of its inputs.

    Attributes:
        problem: with the errors as parameters after the unknowns, all unknowns with a prior.
        unknowns: their number.
        numbers: the possible errors.
        start: theta of the unknowns at the fit, then zeros; prediction there, and its slope by all.
    """

    problem: InverseProblem
    unknowns: int
    numbers: tuple[Number, ...]
    start: End

    @cached_property
    def freedom(self) -> int:
        """Number of values and priors less the number of directions that they determine together."""
        s = np.linalg.svd(self._weigh(self._along(()), np.zeros(0))[1], compute_uv=False)
        seen = int((s > RANK_TOLERANCE * max(s.max(initial=0.0), 1e-300)).sum())
        proper = int(self.problem.parameters.proper[: self.unknowns].sum())
        return int(np.isfinite(np.asarray(self.problem.sigma)).sum()) + proper - seen

    def search(
        self,
        sets: Sequence[Sequence[Perturbation]] = ((),),
        ridges: Sequence[float] = RIDGES,
        ended: Callable[[], Any] = bool,
    ) -> list[Perturbed | None]:
        """Return the optimum with each set of perturbations; None where the model has no solution.

        A ridge penalty with their plausible widths holds them near zero, ever weaker until nothing remains to be
        explained. A search begins at the fit and, if that fails, at the priors' centre.

        Args:
            sets: perturbations that act together.
            ridges: widths of the penalty, as multiples of the plausible widths.
            ended: called whenever a search has ended.
        """
        return together([self._search(each, ridges) for each in sets], self._looks, ended)

    def _search(
        self, perturbations: Sequence[Perturbation], ridges: Sequence[float]
    ) -> Generator[Any, End, Perturbed | None]:
        found, none = list[Perturbed](), np.zeros(len(perturbations))
        starts = [self.start.theta[: self.unknowns], self._known.theta_centre]
        for start in starts[: 1 if np.array_equal(*starts) else 2]:
            for ridge in ridges if perturbations else ridges[:1]:
                end = yield from self._descent(perturbations, np.append(start, none), ridge)
                if end is not None and end.fits:
                    return end
                found += [] if end is None else [end]
        return min(found, key=lambda end: end.cost, default=None)

    def _descent(
        self, perturbations: Sequence[Perturbation], start: np.ndarray, ridge: float
    ) -> Generator[Any, End, Perturbed | None]:
        way, held = self._way(perturbations), self.start.choice.held
        widths = ridge * self._widths(way)
        if isinstance(self.problem.model, AlteredModel):
            weigh, ask = partial(self._weigh, widths=widths), partial(_Ask, perturbations, way)
            end, _ = yield from descent(weigh, start, held, True, STEPS, ask)
        else:
            end, _ = searched(self.problem, start, held, TO_THE_END)
        if not np.isfinite(end.cost):
            return None
        _, slope = self._weigh(end, widths)
        covariance = np.linalg.pinv(slope.T @ slope, rcond=RANK_TOLERANCE**2, hermitian=True)
        amounts, sd = end.theta[self.unknowns :], np.sqrt(np.diag(covariance)[self.unknowns :])
        residuals, slope = self._weigh(end, np.inf * widths)
        cost = float((residuals**2).sum())
        likely = self.chance(cost, len(perturbations)) >= CHANCE
        fits = bool(likely and end.choice.settled and agrees(self.problem, residuals, slope))
        label_cost, theta = float(np.sum(end.choice.cost)), way @ end.theta
        both = tuple(amounts.tolist()), tuple(sd.tolist())
        return Perturbed(self, *both, cost, label_cost, fits, theta, way, covariance)

    @property
    def effective(self) -> tuple[Number, ...]:
        """The numbers on which any value depends, without payloads that were never on."""
        columns = self.start.jacobian.T[self.unknowns :]
        return tuple(n for n, column in zip(self.numbers, columns, strict=True) if column.any())

    def gain(self, perturbations: Sequence[Perturbation]) -> float:
        """Return the fall of the cost in the first search, in the linear model."""
        residuals, slope = self._weigh(self._along(perturbations), RIDGES[0] * self._widths(self._way(perturbations)))
        step, *_ = np.linalg.lstsq(slope, -residuals, rcond=RANK_TOLERANCE)
        return float(residuals @ residuals - ((residuals + slope @ step) ** 2).sum())

    def chance(self, cost: float, spent: int) -> float:
        """Return the p-value of a cost with this number of free perturbations."""
        from scipy.special import chdtrc

        left = self.freedom - spent
        return float(chdtrc(left, cost)) if left > 0 else float(cost < 1.0)

    def at(self, theta: Float[np.ndarray, "U"], held: Any = None) -> "Hypotheses":
        """Return the same with another start, with the held matching of labels, or a new one."""
        theta = np.append(theta, np.zeros(len(self.numbers)))
        if not isinstance(self.problem.model, AlteredModel):
            return replace(self, start=look(self.problem, theta, held))
        held, every = self._parts.first_matching if held is None else held, np.eye(len(theta))
        size = self.unknowns + TOGETHER
        parts = [every[:, i : i + size] for i in range(0, len(theta), size)]
        each = looks(self._parts, [Way(theta, self.filled(part), held) for part in parts])
        predicted, slopes = each[0][0], np.hstack([along for _, along, _ in each])[:, : len(theta)]
        predicted, slopes = self.calibrated(self.problem.kinds, theta, every, predicted, slopes)
        return replace(self, start=End(theta, np.nan, np.full(len(theta), np.nan), predicted, slopes, each[0][2]))

    def filled(self, way: Float[np.ndarray, "Q p"]) -> Float[np.ndarray, "Q most"]:
        """Return a way padded to the largest number of directions, so that one program serves all."""
        return np.pad(way, ((0, 0), (0, self.unknowns + TOGETHER - way.shape[1])))

    def _along(self, perturbations: Sequence[Perturbation]) -> End:
        """Return the start with its slope by the unknowns and by the amounts of some perturbations."""
        way = self._way(perturbations)
        return self.start._replace(theta=self.start.theta @ way, jacobian=self.start.jacobian @ way)

    def _way(self, perturbations: Sequence[Perturbation]) -> Float[np.ndarray, "Q p"]:
        """Return the matrix from unknowns and perturbations to all coordinates."""
        places = {number: self.unknowns + i for i, number in enumerate(self.numbers)}
        way = np.eye(self.unknowns + len(self.numbers), self.unknowns + len(perturbations))
        way[:, self.unknowns :] = 0.0
        for i, perturbation in enumerate(perturbations):
            for number in perturbation.numbers:
                way[places[number], self.unknowns + i] = 1.0
        return way

    def _looks(self, asked: "Sequence[_Ask]") -> list[End]:
        """Return predictions with perturbations, gauges and wrong rows included, and their slopes by x."""
        ways = [Way(each.way @ each.x, self.filled(each.way), each.held) for each in asked]
        found, sigma = list[End](), np.asarray(self.problem.sigma)
        for ask, way, (predicted, slopes, choice) in zip(asked, ways, looks(self._parts, ways), strict=True):
            both = predicted, slopes[:, : len(ask.x)]
            predicted, slopes = self.calibrated(self.problem.kinds, way.theta, ask.way, *both)
            for i, perturbation in enumerate(ask.perturbations, self.unknowns):
                if perturbation.row >= 0:
                    slopes[perturbation.row, i] = sigma[perturbation.row]
                    predicted = predicted + slopes[:, i] * ask.x[i]
            found.append(End(ask.x, np.nan, np.full(len(ask.x), np.nan), predicted, slopes, choice))
        return found

    def calibrated(
        self, kinds: Sequence[str], theta: np.ndarray, way: np.ndarray, predicted: np.ndarray, slopes: np.ndarray
    ) -> tuple[Float[np.ndarray, "D"], Float[np.ndarray, "D p"]]:
        """Return predictions (D,) and slopes (D, p) along a way, with the gauge errors of these kinds applied."""
        for place, number in enumerate(self.numbers, self.unknowns):
            if number.kind in SCALES:
                own = np.array(kinds) == number.of
                factor = np.where(own, np.exp(theta[place]), 1.0)
                predicted = predicted * factor
                slopes = slopes * factor[:, None] + np.outer(np.where(own, predicted, 0.0), way[place])
        return predicted, slopes

    @cached_property
    def _parts(self) -> InParts:
        return self.problem.in_parts

    @cached_property
    def _known(self) -> Parameters:
        """The unknowns, without the possible errors."""
        return Parameters(self.problem.parameters.items[: self.unknowns])

    @cached_property
    def _prior(self) -> Prior:
        return self._known.prior(1)

    def _weigh(self, here: End, widths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return residuals of data, of priors and of the perturbations, by these widths; and their slope."""
        prior, slope = (np.asarray(part) for part in self._prior.residuals(here.theta[: self.unknowns]))
        data = np.asarray(self.problem.scaled(here.predicted - np.asarray(self.problem.measured)))
        by_data = np.asarray(self.problem.scaled(here.jacobian))
        rows = np.vstack([by_data, np.diag(np.concatenate([slope, 1 / widths]))])
        return np.concatenate([data, prior, here.theta[self.unknowns :] / widths]), rows

    def _widths(self, way: np.ndarray) -> Float[np.ndarray, "perturbations"]:
        """Return the plausible width of each perturbation, that of a wrong value in its sigmas."""
        own = [KINDS[number.kind].plausible for number in self.numbers]
        moved = way[self.unknowns :, self.unknowns :].T > 0
        return np.array([own[int(np.argmax(each))] if each.any() else STEP_OFF for each in moved])


class _Ask(NamedTuple):
    """A point that a search requests: its perturbations, their matrix to theta, the point, the held matching."""

    perturbations: Sequence[Perturbation]
    way: Float[np.ndarray, "Q p"]
    x: Float[np.ndarray, "p"]
    held: Any


def hypotheses_of(
    posed: Posed, fitted: Mapping[str, float], held: Any = None, *, altered: bool = True
) -> Hypotheses | None:
    """Return the possible errors of a fit's inputs; None where the model has no solution.

    Args:
        posed: the problem to fit; every stiffness has a prior.
        fitted: start, by path [SI]; missing numbers start at the priors' centre.
        held: the fit's matching of labels to modes; without it they are matched again.
        altered: whether any number may be wrong; else the fit's own program serves the searches.
    """
    problem, model = posed.problem, posed.problem.model
    if not isinstance(model, ArmModel):  # scaled by discrepancies, which are explanations already
        return None
    own, numbers = problem.parameters, tuple[Number, ...]()
    values = {path: fitted.get(path, float(x)) for path, x in own.by_path(own.column("centre")).items()}
    theta = np.asarray(own.theta(np.array([float(values[item.name]) for item in own.items])))
    if altered:
        few = replace(model, conditions=padded(model.conditions)[0])  # of one of few sizes, so that one program serves
        moments = np.asarray(largest_moments(few, {name: np.asarray(x) for name, x in values.items()}))
        numbers = tuple(altered_numbers(model, tuple(dict.fromkeys(problem.kinds)), values, moments))
        parts = model.arm, model.conditions, model.scaled, model.frames
        altering = AlteredModel(*parts, numbers=numbers, moments=jax.device_put(moments))
        every = Parameters((*own.items, *(number.parameter for number in numbers)))
        problem = replace(problem, model=altering, parameters=every)
    blank = End(theta, np.nan, theta, theta, theta, Choice(None, False, theta))
    hypotheses = Hypotheses(problem, len(own.items), numbers, blank).at(theta, held)
    return hypotheses if np.isfinite(hypotheses.start.predicted).all() else None
