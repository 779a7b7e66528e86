"""Input of the explorer page: numbers of an arm under a load, its stroke, posterior bands and measured values."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.chain import Moments
from ident.arm.multibody import Multibody, multibody
from ident.errors import refusal, require
from ident.identify.binding import check_references, loads_of
from ident.measure import Campaign, Load
from ident.measure.load import Vector
from ident.text import did_you_mean, quoted
from ident.vibrate.motion import Motion

FINE = 401
"""Positions at which the speed of the stroke is tabulated; the page interpolates linearly."""
SHARE = 0.1
"""Largest mass at a point, as a share of the arm's, rounded."""
INTERVAL = (0.05, 0.95)
"""Quantiles of a band."""


@dataclass(frozen=True)
class Carried:
    """Payload of the slider: a mass at a point, or a payload with fixed shape and variable density.

    Attributes:
        kind: payload or point.
        name: of the payload or the point.
        joint: index of the joint that carries it.
        unit: moments about the bushing for 1 kg of it, along the link's axes, without batch.
        nominal: [kg] mass of the payload in the arm file; zero for a point.
        inertia: (3,) [kg m^2] diagonal of the payload's inertia in the arm file; zero for a point.
        largest: [kg] end of the slider.
        present: [kg] initial value.
    """

    kind: Literal["payload", "point"]
    name: str
    joint: int
    unit: Moments
    nominal: float
    inertia: Float[np.ndarray, "3"]
    largest: float
    present: float


@dataclass(frozen=True)
class StrokeSpeed:
    """Speed of a stroke over position, at full speed.

    Attributes:
        alpha: (F,) [rad] from folded to unfolded.
        rate: (F,) [rad/s] of alpha, at 100 %; its sign is that of the extension.
        words: profile of the motion.
    """

    alpha: Float[np.ndarray, "F"]
    rate: Float[np.ndarray, "F"]
    words: str


@dataclass(frozen=True)
class Exploration:
    """An arm, to be explored.

    Attributes:
        arm: with the initial numbers of the page.
        model: its moments of mass, bushings, points and drives under the permanent load, without batch.
        fixed: the permanent load.
        carried: the payload of the slider.
        stroke: speed along the stroke; None without one.
        bands: 5 and 95 % quantiles of a posterior [SI], by path.
        measured: measured values for comparison.
    """

    arm: Arm
    model: Multibody
    fixed: Load
    carried: Carried
    stroke: StrokeSpeed | None
    bands: Mapping[str, tuple[float, float]]
    measured: Campaign | None


def exploration(
    arm: Arm,
    load: Load,
    payload: str = "",
    extension: Motion | None = None,
    draws: Mapping[str, Float[np.ndarray, "D"]] | None = None,
    measured: Campaign | None = None,
) -> Exploration:
    """Collect the input of the explorer page.

    Args:
        arm: of plain numbers.
        load: initial load.
        payload: payload or point with variable mass; by default the first payload or else the end point.
        extension: the stroke at full speed, of an arm that has one.
        draws: of numbers of the arm [SI], by path.
        measured: measured values for comparison.

    Raises:
        InputError: an unknown payload or point, an arm without any point or with curved springs, a campaign of another
            arm.
    """
    _check(arm, payload, measured)
    loads_of(arm, load)
    carried = _carried(arm, load, payload or [*(p.body.name for p in arm.payloads), arm.points[-1].name][0])
    fixed = without(load, carried)
    model: Multibody = jax.tree.map(np.asarray, multibody(arm, loads_of(arm, fixed)))
    paths = set(stiffness_paths(arm))
    quantiles = {path: np.quantile(values, INTERVAL) for path, values in (draws or {}).items() if path in paths}
    bands = {path: (float(low), float(high)) for path, (low, high) in quantiles.items()}
    speed = _stroke_speed(arm, extension) if extension is not None else None
    return Exploration(arm, model, fixed, carried, speed, bands, measured)


def without(load: Load, carried: Carried) -> Load:
    """Return the load without the slider's payload."""
    payloads = tuple(name for name in load.payloads if (carried.kind, name) != ("payload", carried.name))
    masses = tuple((m, point) for m, point in load.masses if (carried.kind, point) != ("point", carried.name))
    return Load(payloads, masses, load.forces, load.moments, load.own)


class Added(NamedTuple):
    """Difference between a load case and the permanent load.

    Attributes:
        mass: [kg] of the slider's payload.
        masses: mass [kg] and point of each other one; negative for a missing one.
        forces: (3,) force [N] and point of each.
    """

    mass: float
    masses: tuple[tuple[float, str], ...]
    forces: tuple[tuple[Vector, str], ...]


def added(load: Load, fixed: Load, carried: Carried) -> Added | None:
    """Return the difference between a load case and the permanent load; None if a payload or moment differs."""
    rest = without(load, carried)
    if (rest.payloads, rest.moments, rest.own) != (fixed.payloads, fixed.moments, fixed.own):
        return None
    masses = {point: mass for mass, point in rest.masses}
    for mass, point in fixed.masses:
        masses[point] = masses.get(point, 0.0) - mass
    away = tuple(((-x, -y, -z), point) for (x, y, z), point in fixed.forces)
    forces = Load(forces=(*rest.forces, *away)).forces
    return Added(_mass(load, carried), tuple((m, point) for point, m in masses.items() if m), forces)


def mass_of(load: Load, fixed: Load, carried: Carried) -> float | None:
    """Return the slider mass [kg] that gives a load case; None if no mass does."""
    return None if without(load, carried) != fixed else _mass(load, carried)


def _mass(load: Load, carried: Carried) -> float:
    if carried.kind == "payload":
        return carried.nominal if carried.name in load.payloads else 0.0
    return sum(mass for mass, point in load.masses if point == carried.name)


def _check(arm: Arm, payload: str, measured: Campaign | None) -> None:
    remedy = "add a [[point]] at the arm's end: modes are named by how it moves"
    require(arm.points, arm.name, "no point", "at least one", remedy)
    if arm.springs:
        got, remedy = f"a curved spring ({arm.springs[0].name})", "take its table out: k_bend and k_tors stay"
        raise refusal(arm.name, got, "straight springs, as the page computes with no others", remedy)
    for joint in arm.joints:
        if joint.k_bend is None or joint.k_tors is None:
            got, expected = f"{joint.name}, which is rigid", "stiffnesses, as the page computes with no others"
            raise refusal(arm.name, got, expected, "give it a value in the arm file")
    names = [*(each.body.name for each in arm.payloads if float(each.body.mass) > 0), *(p.name for p in arm.points)]
    if payload and payload not in names:
        expected = f"one of {', '.join(names)}"
        raise refusal("payload", quoted(payload), expected, did_you_mean(payload, names, "correct it"))
    if measured is not None:
        check_references(arm, measured)


def _carried(arm: Arm, load: Load, name: str) -> Carried:
    names = [joint.name for joint in arm.joints]
    for payload in arm.payloads:
        body, mass = payload.body, float(payload.body.mass)
        if body.name == name and mass > 0:
            unit = _unit_moments(np.asarray(body.com), np.asarray(body.inertia) / mass)
            present, diagonal = mass if name in load.payloads else 0.0, np.diag(np.asarray(body.inertia)).copy()
            return Carried("payload", name, names.index(payload.joint), unit, mass, diagonal, 2 * mass, present)
    point = next((each for each in arm.points if each.name == name), arm.points[-1])
    total = sum(float(body.mass) for body in arm.bodies)
    present = sum(mass for mass, where in load.masses if where == point.name)
    unit = _unit_moments(np.asarray(point.position), np.zeros((3, 3)))
    largest = max(_round_number(SHARE * total), 2 * present)
    return Carried("point", point.name, names.index(point.joint), unit, 0.0, np.zeros(3), largest, present)


def _unit_moments(r: Float[np.ndarray, "3"], inertia: Float[np.ndarray, "3 3"]) -> Moments:
    """Return the moments of 1 kg; `inertia` [m^2] is about its mass centre."""
    second = np.outer(r, r) - inertia + np.trace(inertia) / 2 * np.eye(3)
    return Moments(jnp.ones(1), jnp.asarray(r[:, None]), jnp.asarray(second[:, :, None]))


def _stroke_speed(arm: Arm, extension: Motion) -> StrokeSpeed:
    assert arm.stroke is not None
    direction = np.asarray(arm.stroke.direction)
    largest = int(np.argmax(np.abs(direction)))
    q, qd, _ = (np.asarray(x)[largest] / direction[largest] for x in extension(np.linspace(0, extension.arrival, FINE)))
    q[[0, -1]] = float(arm.stroke.folded), float(arm.stroke.unfolded)
    return StrokeSpeed(q, qd, extension.name)


def _round_number(value: float) -> float:
    """Return 1, 2 or 5 times a power of ten, near a value."""
    if not value > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return power * min((1, 2, 5, 10), key=lambda digit: abs(math.log(digit * power / value)))
