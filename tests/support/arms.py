"""Arms that several test files use."""

import dataclasses
from functools import cache
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from ident.arm.arm import ANYWHERE, Arm
from ident.arm.parts import Body, Joint, Payload, Point
from ident.description.file import read_arm

DATA = Path(__file__).parents[2] / "data"


def file_with_limits(rates: np.ndarray) -> str:
    """The shipped arm's file with limits of its joints' speed, acceleration and jerk (3, driven) [rad/s, ...]."""
    text = (DATA / "lcd_arm" / "arm.toml").read_text()
    for n, numbers in enumerate(np.degrees(rates).T.tolist(), 1):
        keys = zip(("speed", "acceleration", "jerk"), numbers, ("deg/s", "deg/s^2", "deg/s^3"), strict=True)
        lines = [f'{key} = {{ value = {number}, unit = "{unit}", origin = "datasheet" }}' for key, number, unit in keys]
        text = text.replace(f'name = "joint{n}"\n', "\n".join([f'name = "joint{n}"', *lines, ""]), 1)
    return text


def random_body(rng: np.random.Generator, name: str) -> Body:
    """A body of three unequal, randomly turned principal moments that obey the triangle inequality."""
    root = rng.normal(size=(3, 3)) * 0.15
    second = root @ root.T
    mass = rng.uniform(1, 5)
    return Body(name, mass, rng.normal(size=3) * 0.2, mass * (np.trace(second) * np.eye(3) - second))


def unit_vector(rng: np.random.Generator) -> np.ndarray:
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def random_arm(
    rng: np.random.Generator, joints: int, *, undriven: tuple[int, ...] = (), gravity: float = 9.80665
) -> Arm:
    """A stiff arm that is mounted at any angle: random axes, offsets, bodies, stiffnesses and damping."""
    return Arm(
        f"random{joints}",
        tuple(
            Joint(
                f"j{j}",
                axis=unit_vector(rng),
                offset=rng.normal(size=3) * 0.3,
                k_bend=np.exp(rng.uniform(np.log(3e4), np.log(3e5))),
                k_tors=np.exp(rng.uniform(np.log(3e4), np.log(3e5))),
                tau_bend=rng.uniform(1e-4, 1e-3),
                tau_tors=rng.uniform(1e-4, 1e-3),
                shaft=(random_body(rng, f"shaft{j}"),),
                link=(random_body(rng, f"link{j}"), random_body(rng, f"motor{j}"))[: 1 + j % 2],
                driven=j not in undriven,
            )
            for j in range(joints)
        ),
        points=(
            Point("elbow", f"j{joints // 2}", rng.normal(size=3) * 0.3),
            Point("tip", f"j{joints - 1}", rng.normal(size=3) * 0.3),
        ),
        payloads=(Payload(f"j{joints - 1}", random_body(rng, "glass")),),
        gravity=gravity * unit_vector(rng),
    )


@cache
def lcd_arm() -> Arm:
    """The arm of the paper."""
    return read_arm(DATA / "lcd_arm" / "arm.toml").arm


@cache
def first_guess_arm() -> Arm:
    """The arm of the paper as it was first guessed: ratio 120, an s-curve from 80 degrees, pulleys near a mode."""
    return read_arm(DATA / "lcd_arm" / "first_guess.toml").arm


@cache
def loose_arm() -> Arm:
    """The arm of the paper, were its joints not tied by belts."""
    return dataclasses.replace(lcd_arm(), workspace=ANYWHERE)


def two_equal_arm() -> Arm:
    """A column of two bodies of revolution: every bending frequency is there twice, exactly."""

    def joint(name: str, height: float, mass: float) -> Joint:
        body = Body(f"body_{name}", mass, (0.0, 0.0, 0.3), mass * np.diag([0.04, 0.04, 0.02]))
        return Joint(
            name,
            offset=(0.0, 0.0, height),
            k_bend=8e3,
            k_tors=3e3,
            tau_bend=3e-4,
            tau_tors=5e-4,
            link=(body,),
        )

    return Arm(
        "column",
        (joint("lower", 0.2, 12.0), joint("upper", 0.6, 7.0)),
        points=(Point("top", "upper", (0.1, 0.05, 0.6)),),
    )


def without_gravity(arm: Arm) -> Arm:
    return Arm(arm.name, arm.joints, arm.points, arm.payloads, jnp.zeros(3))


def posture_of(arm: Arm, rng: np.random.Generator) -> jnp.ndarray:
    """Any angles for the arm's pins."""
    return jnp.asarray(rng.uniform(-np.pi, np.pi, len(arm.driven)))
