"""Random arms with harmonic drives, belts and loads, and the states in which they are judged."""

from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from arms import random_arm, random_body, unit_vector

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.parts import Belt, Body, Drive, ErrorOrder, Joint


@dataclass(frozen=True)
class State:
    """Flat coordinates, their rates, and the command (3, driven) of angles, rates and accelerations."""

    command: np.ndarray
    y: np.ndarray
    yd: np.ndarray
    ydd: np.ndarray


def random_state(rng: np.random.Generator, pins: int, size: int, *, rate: float = 3.0) -> State:
    """phi of about 0.15 rad, 0.3 rad at most; rates of several rad/s, accelerations of some tens of rad/s^2."""
    command = np.stack([rng.uniform(-np.pi, np.pi, pins), rate * rng.normal(size=pins), 30 * rng.normal(size=pins)])
    y = rng.uniform(-0.3, 0.3, size) / np.sqrt(3)
    return State(command, y, rate * rng.normal(size=size), 30 * rng.normal(size=size))


def random_drive(
    rng: np.random.Generator, joint: Joint, *, error: bool = True, orders: tuple[float, ...] = ()
) -> Drive:
    """A drive that turns either way, at a ratio from 1 to 150, with further transmission errors at some orders."""
    name = f"drive_{joint.name}"
    further = [
        ErrorOrder(name, order, amplitude=rng.uniform(1e-4, 3e-3), phase=rng.uniform(-np.pi, np.pi)) for order in orders
    ]
    return Drive(
        name,
        joint.name,
        ratio=rng.choice([-1, 1]) * np.exp(rng.uniform(0, np.log(150))),
        rotor_inertia=rng.uniform(0.001, 0.02),
        eccentric_mass=rng.uniform(0.2, 1.0),
        eccentricity=rng.uniform(0.002, 0.05),
        height=rng.uniform(-0.2, 0.2),
        phase=rng.uniform(-np.pi, np.pi),
        error=rng.uniform(1e-4, 3e-3) if error else 0.0,
        error_phase=rng.uniform(-np.pi, np.pi),
        errors=tuple(further),
    )


def driven_arm(
    rng: np.random.Generator,
    joints: int,
    *,
    undriven: tuple[int, ...] = (),
    error: bool = True,
    orders: tuple[float, ...] = (),
    belts: bool = False,
    parallel: bool = False,
) -> Arm:
    """A random arm, a drive at each pin, its shafts massive enough to contain what turns on them."""
    arm = random_arm(rng, joints, undriven=undriven)
    drives = tuple(random_drive(rng, joint, error=error, orders=orders) for joint in arm.driven)
    shared = unit_vector(rng)
    parts = tuple(_with_drive(rng, joint, drives, shared if parallel else None) for joint in arm.joints)
    pairs = zip(arm.driven[:-1], arm.driven[1:], strict=True) if belts else ()
    ties = tuple(random_belt(rng, a.name, b.name) for a, b in pairs)
    return Arm(arm.name, parts, arm.points, arm.payloads, arm.gravity, drives, ties)


def random_belt(rng: np.random.Generator, driver: str, driven: str) -> Belt:
    return Belt(
        f"belt_{driver}",
        driver,
        driven,
        driver_radius=rng.uniform(0.02, 0.06),
        driven_radius=rng.uniform(0.02, 0.06),
        pretension=rng.uniform(1e5, 2e5),
        stiffness=rng.uniform(1e5, 4e5),
        tau=rng.uniform(1e-4, 1e-3),
        height=rng.uniform(-0.1, 0.1),
    )


def _with_drive(rng: np.random.Generator, joint: Joint, drives: tuple[Drive, ...], axis: np.ndarray | None) -> Joint:
    """Add the drive's mass on the axis and its rotor, as a disc, to the shaft, in one body with the housing."""
    axis = np.asarray(joint.axis) if axis is None else axis
    offset = np.asarray(joint.offset)
    if np.linalg.norm(np.cross(axis, offset)) < 0.15:
        offset = offset + 0.3 * np.linalg.svd(axis[None])[2][1]
    shaft = joint.shaft
    for drive in drives:
        if drive.joint == joint.name:
            m, J = float(drive.eccentric_mass), float(drive.rotor_inertia)
            disc = J * (0.6 * np.eye(3) + 0.4 * np.outer(axis, axis))
            shaft = (*shaft, Body(f"turning_{joint.name}", m, float(drive.height) * axis, disc))
    return Joint(
        joint.name,
        axis=axis,
        offset=offset,
        **{name: getattr(joint, name) for name in ("k_bend", "k_tors", "tau_bend", "tau_tors", "driven")},
        shaft=(merged(f"shaft_{joint.name}", shaft), random_body(rng, f"box_{joint.name}")),
        link=joint.link,
    )


def merged(name: str, bodies: tuple[Body, ...]) -> Body:
    """One body of the same moments of mass."""
    mass = sum(float(b.mass) for b in bodies)
    com = sum(float(b.mass) * np.asarray(b.com) for b in bodies) / mass
    inertia = np.zeros((3, 3))
    for body in bodies:
        r = np.asarray(body.com) - com
        inertia += np.asarray(body.inertia) + float(body.mass) * (r @ r * np.eye(3) - np.outer(r, r))
    return Body(name, mass, com, (inertia + inertia.T) / 2)


def random_loads(rng: np.random.Generator, arm: Arm) -> Loads:
    """The payload, a mass and a force at each named point."""
    points = len(arm.points)
    mass, force = rng.uniform(0, 3, points), 100 * rng.normal(size=(3, points))
    return Loads(jnp.ones(len(arm.payloads)), jnp.asarray(mass), jnp.asarray(force))
