"""What might be otherwise than an arm file and a campaign say, as numbers that a search can move."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.equilibrium import equilibrium
from ident.arm.hinges import end_of
from ident.arm.parts import Body, Joint
from ident.arm.rotations import matvec, transpose
from ident.arm.springs import DIRECTIONS, STIFFNESS_OF, CubicSpring
from ident.identify.conditions import Conditions
from ident.identify.predict import ArmModel, chains
from ident.identify.uncertain import LOAD, scaled_loads
from ident.inference.parameters import AnyArray, Parameter
from ident.jit import RUNS_ONCE, jit

UNLOADED = 1e-3
"""Moment [N m] below which a bushing counts as unloaded, so that a curve of its spring shows nothing."""
FIXED = 1e-6
"""Length [m] of a link that has none."""


@dataclass(frozen=True)
class Kind:
    """A kind of number that may be otherwise.

    Attributes:
        plausible: its standard deviation before the data: of ln(factor), or of a share.
        factor: whether it is a factor, exp(amount); else the amount is a share.
        signed: whether it may be negative; nobody makes what would have to be.
    """

    plausible: float
    factor: bool
    signed: bool = True


NUMBER_KINDS = {
    "mass": Kind(0.1, factor=True),
    "payload": Kind(0.05, factor=True),
    "mass centre": Kind(0.02, factor=False),
    "length": Kind(0.01, factor=True),
    "loads": Kind(0.02, factor=True),
    "scale": Kind(0.02, factor=True),
    "clock": Kind(0.005, factor=True),
    "spring": Kind(0.1, factor=False, signed=False),
}
"""All widths are assumed. `mass centre` is a share of its link's length; `scale` the common factor of all values of a
kind, as of a gauge, for frequencies `clock`; and `spring` the share that the cube of the angle adds to the torque at
the largest load of all that were measured: the secant rises by it, the tangent by three times it."""
SCALES = ("scale", "clock")


@dataclass(frozen=True)
class Number:
    """One number that may be otherwise.

    Attributes:
        kind: one of `KINDS`.
        of: the body, link or kind of measurement; of a spring `joint2.torsion`.
    """

    kind: str
    of: str

    @property
    def name(self) -> str:
        """What it is called among the parameters of a model."""
        return f"/{self.kind}/{self.of}"

    @property
    def parameter(self) -> Parameter:
        """The number as an unknown, zero where nothing is otherwise."""
        return Parameter((self.name,), False, 0.0, 0.0, nuisance=True)


class AlteredModel(ArmModel):
    """The model of a campaign in which further numbers may be otherwise; where they are zero, the model that it was.

    Attributes:
        numbers: which.
        moments: (N, 2) [N m] largest bending and torsional moment on each bushing among the states.
    """

    numbers: tuple[Number, ...] = eqx.field(static=True, default=())
    moments: Float[AnyArray, "N 2"] | None = None

    def at(self, parameters: Mapping[str, Any]) -> tuple[Arm, dict[str, Any], Conditions]:
        """Return the altered arm, its numbers, and the conditions in the base frame."""
        amounts = {each: parameters[each.name] for each in self.numbers if each.name in parameters}
        own = {path: value for path, value in parameters.items() if not path.startswith("/")}
        arm, own, conditions = super().at(own)
        by_kind: dict[str, dict[str, Any]] = {}
        for each, amount in amounts.items():
            by_kind.setdefault(each.kind, {})[each.of] = amount
        if "loads" in by_kind:
            conditions = replace(conditions, loads=scaled_loads(conditions.loads, jnp.exp(by_kind["loads"][LOAD])))
        arm = _rebuilt(arm, by_kind)
        springs = by_kind.get("spring", {})
        return (self._curved(arm, springs, own) if springs else arm), own, conditions

    def _curved(self, arm: Arm, amounts: Mapping[str, Any], own: Mapping[str, Any]) -> Arm:
        """Give springs a cubic part: at the largest moment M, where the angle is M/k, it is so large a share of k x."""
        assert self.moments is not None
        places = {joint.name: place for place, joint in enumerate(arm.joints)}
        springs = list(arm.springs)
        for of, amount in amounts.items():
            joint, direction = of.split(".")
            stiffness = STIFFNESS_OF[direction]
            k = own.get(f"{joint}.{stiffness}", getattr(arm.joints[places[joint]], stiffness))
            moment = self.moments[places[joint], DIRECTIONS.index(direction)]
            springs.append(CubicSpring(f"/{of}", joint, direction, amount * k**3 / moment**2))
        return eqx.tree_at(lambda a: a.springs, arm, tuple(springs), is_leaf=lambda x: x is arm.springs)


def altered_numbers(
    model: ArmModel, kinds: tuple[str, ...], taken: Mapping[str, float], moments: Float[np.ndarray, "N 2"]
) -> Iterator[Number]:
    """Yield all that might be otherwise and is not an unknown already, payloads that never were on among them.

    So a campaign in which one of them was on after all has the same numbers, and the same program.

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
            if not any(f"{name}.{what}." in path for name, what in _lengths(arm, place) for path in taken):
                yield Number("length", joint.name)
    for payload in arm.payloads:
        if f"{payload.body.name}.mass" not in taken:
            yield Number("payload", payload.body.name)
    measured = (loads.mass, loads.force, loads.moment)
    if LOAD not in taken and any(np.any(part) for part in measured if part is not None):
        yield Number("loads", LOAD)
    scaled = [kind for kind in kinds if kind not in ("damping_ratio", "shape")]
    yield from (Number("clock" if kind == "frequency" else "scale", kind) for kind in scaled)
    curved = {(spring.joint, spring.direction) for spring in arm.springs}
    for joint, own in zip(arm.joints, moments, strict=True):
        for direction, moment in zip(DIRECTIONS, own, strict=True):
            if joint.driven and (joint.name, direction) not in curved and moment > UNLOADED:
                yield Number("spring", f"{joint.name}.{direction}")


def largest_moments(model: ArmModel, parameters: Mapping[str, float]) -> Float[np.ndarray, "N 2"]:
    """Return the largest bending and torsional moment [N m] on each bushing among the states of a campaign."""
    return np.asarray(_moments(model, {name: np.asarray(x) for name, x in parameters.items()}))


@partial(jit, options=RUNS_ONCE)
def _moments(model: ArmModel, parameters: Mapping[str, Any]) -> Float[AnyArray, "N 2"]:
    arm, own, conditions = model.at(parameters)
    chain = chains(arm, own, conditions)
    phi = equilibrium(chain)
    moment = matvec(chain.stiffness, phi)
    moment = moment if chain.curved is None else moment + chain.curved.torque(phi)
    own_axes = matvec(transpose(chain.frame), moment)
    axis = jnp.stack([joint.axis for joint in arm.joints], 1)[:, :, None]
    along = (axis * own_axes).sum(0)
    across = jnp.sqrt(((own_axes - axis * along) ** 2).sum(0))
    return jnp.stack([across.max(1), jnp.abs(along).max(1)], 1)


def _lengths(arm: Arm, place: int) -> list[tuple[str, str]]:
    """Return what makes the length of a link: the next bushing's offset, or the points at the arm's end."""
    if place + 1 < len(arm.joints):
        return [(arm.joints[place + 1].name, "offset")]
    return [(point.name, "position") for point in arm.points if point.joint == arm.joints[place].name]


def _rebuilt(arm: Arm, amounts: Mapping[str, Mapping[str, Any]]) -> Arm:
    """Return an arm of other masses, mass centres and lengths."""
    masses = {**amounts.get("mass", {}), **amounts.get("payload", {})}
    centres, lengths = amounts.get("mass centre", {}), amounts.get("length", {})
    if not (masses or centres or lengths):
        return arm

    def body(old: Body, shift: Any) -> Body:
        factor = jnp.exp(masses.get(old.name, 0.0))
        return eqx.tree_at(
            lambda b: (b.mass, b.com, b.inertia), old, (old.mass * factor, old.com + shift, old.inertia * factor)
        )

    joints: list[Joint] = []
    for place, joint in enumerate(arm.joints):
        shift = centres.get(joint.name, 0.0) * end_of(arm, place)
        joints.append(eqx.tree_at(lambda j: j.link, joint, tuple(body(each, shift) for each in joint.link)))
    for name, amount in lengths.items():
        place = next(place for place, joint in enumerate(arm.joints) if joint.name == name)
        if place + 1 < len(joints):
            longer = joints[place + 1].offset * jnp.exp(amount)
            joints[place + 1] = eqx.tree_at(lambda j: j.offset, joints[place + 1], longer)
    last = arm.joints[-1].name
    stretch = jnp.exp(lengths.get(last, 0.0))
    points = tuple(
        eqx.tree_at(lambda p: p.position, point, point.position * stretch) if point.joint == last else point
        for point in arm.points
    )
    payloads = tuple(eqx.tree_at(lambda p: p.body, each, body(each.body, 0.0)) for each in arm.payloads)
    return eqx.tree_at(lambda a: (a.joints, a.points, a.payloads), arm, (tuple(joints), points, payloads))


def altered(model: ArmModel, numbers: tuple[Number, ...], moments: Float[np.ndarray, "N 2"]) -> AlteredModel:
    """Return the model of a campaign in which some numbers may be otherwise."""
    return AlteredModel(
        model.arm, model.conditions, model.scaled, model.frames, numbers=numbers, moments=jax.device_put(moments)
    )


def calibrated(
    numbers: Sequence[Number],
    theta: Float[np.ndarray, "Q"],
    kinds: Sequence[str],
    predicted: Float[np.ndarray, "D"],
    jacobian: Float[np.ndarray, "D Q"],
) -> tuple[Float[np.ndarray, "D"], Float[np.ndarray, "D Q"]]:
    """Return predictions and their Jacobian as gauges read them whose calibration is off.

    Args:
        numbers: the last ones of theta.
        theta: the unknowns, then all numbers.
        kinds: of each value.
        predicted: as the model has them.
        jacobian: by theta.
    """
    for place, number in enumerate(numbers, len(theta) - len(numbers)):
        if number.kind in SCALES:
            own = np.array(kinds) == number.of
            factor = np.where(own, np.exp(theta[place]), 1.0)
            predicted, jacobian = predicted * factor, jacobian * factor[:, None]
            jacobian[:, place] = np.where(own, predicted, 0.0)
    return predicted, jacobian
