"""Belts against the textbook's equations, an explicit drawing of an open belt, and an energy."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import random_body
from conformance import agrees
from driven_arms import driven_arm, random_loads, random_state
from moving_engines import PinocchioMoving
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm
from ident.arm.multibody import Command, Multibody, belt_forces, multibody, residual, stretch, tensions
from ident.arm.parts import Belt, Drive, Joint

RADII = ((0.06, 0.03), (0.03, 0.06), (0.05, 0.05))
T0, K, D, RATIOS = 500.0, 4e5, 0.8, (100.0, -50.0)
EIGHTH_ORDER = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
Z = np.array([0.0, 0.0, 1.0])
forces_of, residual_of, stretch_of = map(eqx.filter_jit, (belt_forces, residual, stretch))


def pair(radii: tuple[float, float], *, height: float = 0.1, offset: Any = (D, 0, 0.05), **belt: float) -> Multibody:
    """Two joints with axes along z, a belt between their pulleys, the line of centres along x."""
    rng = np.random.default_rng(0)
    joints = tuple(
        Joint(
            name,
            offset=at,
            k_bend=1e4,
            k_tors=1e4,
            shaft=(random_body(rng, f"shaft_{name}"),),
            link=(random_body(rng, f"link_{name}"),),
        )
        for name, at in (("one", (0, 0, 0)), ("two", offset))
    )
    drives = tuple(Drive(f"drive_{j.name}", j.name, ratio=n) for j, n in zip(joints, RATIOS, strict=True))
    numbers = {"pretension": T0, "stiffness": K, "height": height} | belt
    ties = (Belt("belt", "one", "two", driver_radius=radii[0], driven_radius=radii[1], **numbers),)
    return multibody(Arm("pair", joints, drives=drives, belts=ties), elastic_belts=True)


def forces(
    of: Multibody, phi2: Any = (0, 0, 0), xi: Any = (0, 0), error: Any = (0, 0)
) -> tuple[np.ndarray, np.ndarray]:
    phi = jnp.zeros((3, 2)).at[:, 1].set(jnp.asarray(phi2, float))
    none = jnp.zeros(2)
    place = phi, jnp.asarray(xi, float), jnp.asarray(error, float)
    on_bushings, on_pins, _ = forces_of(of, place, (0 * phi, none, none))
    return np.asarray(on_bushings), np.asarray(on_pins)


def textbook(radii: tuple[float, float], theta: tuple[float, float]) -> tuple[float, float]:
    upper = T0 + K * (radii[0] * theta[0] - radii[1] * theta[1])
    lower = T0 - K * (radii[0] * theta[0] - radii[1] * theta[1])
    return max(upper, 0.0), max(lower, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("radii", RADII)
@pytest.mark.parametrize("xi", [(1e-4, 0.0), (0.0, 1e-4), (-2e-4, 1e-4), (3e-3, 1e-3), (0.5, 0.2)])
def test_textbook_on_straight_shafts(radii: tuple[float, float], xi: tuple[float, float]) -> None:
    """Model.md, section 4. The force acts at height h on the driven shaft; the driving pulley turns against its link.

    The last two states leave one span slack.
    """
    h, theta = 0.1, ((RATIOS[0] - 1) * xi[0], RATIOS[1] * xi[1])
    upper, lower = textbook(radii, theta)
    sine = (radii[0] - radii[1]) / D
    force = np.array([-(upper + lower - 2 * T0) * np.sqrt(1 - sine**2), (upper - lower) * sine, 0.0])
    torque = (-radii[0] * (upper - lower), radii[1] * (upper - lower))
    on_bushings, on_pins = forces(pair(radii), xi=xi)

    np.testing.assert_allclose(on_bushings[:, 0], 0.0)
    moment = np.cross(h * Z, force) + torque[1] * Z
    source = "textbook on straight shafts, two tensions"
    what = "moment of a belt on the driven shaft"
    agrees(-on_bushings[:, 1], moment, "mechanics", what, source, rtol=1e-10, largest=1e-9, unit="N m")
    by_pins = ((RATIOS[0] - 1) * torque[0], RATIOS[1] * torque[1])
    agrees(-on_pins, by_pins, "mechanics", "torques of a belt on the pins", source, rtol=1e-10, unit="N m")


@pytest.mark.slow
def test_across_the_line_of_centres() -> None:
    """The upper span of a larger driver pulls the driven pulley across: seen with the belt drawn, not by formula."""
    left, right = drawing(np.zeros(2), np.array([D, 0]), (0.06, 0.03))
    ends = [(end[0] - end[1]) / np.linalg.norm(end[0] - end[1]) for end in (left, right)]
    upper, lower = textbook((0.06, 0.03), (0.01, 0.0))
    force = upper * ends[0] + lower * ends[1] - T0 * (ends[0] + ends[1])
    on_bushings, _ = forces(pair((0.06, 0.03)), xi=(0.01 / (RATIOS[0] - 1), 0.0))
    moment, source = np.cross(0.1 * Z, [*force, 0])[:2], "a drawing of the open belt"
    what = "pull of unequal pulleys across the line of centres"
    agrees(-on_bushings[:2, 1], moment, "mechanics", what, source, rtol=1e-10, unit="N m")


def drawing(one: np.ndarray, two: np.ndarray, radii: tuple[float, float]) -> list[list[np.ndarray]]:
    """Tangent points of the two straight spans of an open belt, left of the line of centres first.

    The tangent at the first pulley at angle u passes the second centre at its radius: found by bisection.
    """
    line = two - one
    spans = []
    for side in (1, -1):

        def miss(turn: float, side: int = side) -> float:
            n = _direction(np.arctan2(line[1], line[0]) + side * turn)
            return float(n @ line - (radii[0] - radii[1]))

        low, high = 0.0, np.pi
        for _ in range(100):
            middle = (low + high) / 2
            low, high = (middle, high) if miss(middle) > 0 else (low, middle)
        n = _direction(np.arctan2(line[1], line[0]) + side * low)
        spans.append([one + radii[0] * n, two + radii[1] * n])
    return spans


def _direction(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def belt_lengths(centre: np.ndarray, theta: Any, radii: tuple[float, float]) -> np.ndarray:
    """Length of the belt of both spans, from a mark on one pulley to a mark on the other, arcs included.

    Marks are at angles that the pulleys carry: half a turn behind the line of centres.
    """
    lengths = []
    for side, (first, second) in zip((1, -1), drawing(np.zeros(2), centre, radii), strict=True):
        touch = [np.arctan2(*(p - c)[::-1]) for p, c in ((first, np.zeros(2)), (second, centre))]
        on_first = side * (side * np.pi + theta[0] - touch[0]) * radii[0]
        on_second = side * (touch[1] - theta[1]) * radii[1]
        lengths.append(on_first + np.linalg.norm(second - first) + on_second)
    return np.array(lengths)


@pytest.mark.slow
@pytest.mark.parametrize("radii", RADII)
@pytest.mark.parametrize("large", [False, True])
def test_stretch_against_a_drawing(radii: tuple[float, float], large: bool) -> None:
    """The driven pulley's centre moves with the tilt of its shaft; pulleys turn by pins, torsion and error."""
    rng, h, offset = np.random.default_rng(3), 0.2, np.array([0.5, -0.3, 0.1])
    of = pair(radii, height=h, offset=offset)
    for _ in range(20):
        phi2 = rng.uniform(-1, 1, 3) * (0.6 if large else 1e-3)
        xi, error = rng.uniform(-1, 1, (2, 2)) * (0.01 if large else 1e-5)
        tilted = offset + h * (Rotation.from_rotvec(phi2).apply(Z) - Z)
        theta = (RATIOS[0] - 1) * xi[0] - error[0], RATIOS[1] * xi[1] + phi2[2]
        expected = belt_lengths(tilted[:2], theta, radii) - belt_lengths(offset[:2], (0, 0), radii)
        phi = np.stack([rng.normal(size=3), phi2], 1)
        found = stretch_of(of, *(jnp.asarray(x) for x in (phi, xi, error)))[:, 0]
        what, source = "stretch of a belt, shafts tilted and turned", "a drawing of the open belt"
        agrees(found, expected, "mechanics", what, source, rtol=1e-9, atol=3e-15, unit="m")


@pytest.mark.slow
def test_pure_torsion_turns_the_pulley_by_its_whole_angle() -> None:
    """Turned about its own axis by any angle, a pulley takes in its radius times the angle."""
    of = pair((0.05, 0.03))
    phi = jnp.zeros((3, 2)).at[2, 1].set(2.5)
    e = stretch_of(of, phi, jnp.zeros(2), jnp.zeros(2))[:, 0]
    expected, what = [-0.03 * 2.5, 0.03 * 2.5], "stretch by a pulley turned about its axis"
    agrees(e, expected, "mechanics", what, "radius times angle", rtol=1e-14, unit="m")


def energy(of: Multibody, phi: jax.Array, xi: jax.Array) -> jax.Array:
    """Strain energy of both spans over that at rest, without the work of the preload that the assembly took up."""
    belts, none = of.belts, jnp.zeros_like(xi)
    straight = jax.jvp(lambda p: stretch(of, p, xi, none), (0 * phi,), (phi,))[1] + stretch(of, 0 * phi, xi, none)
    pull = jnp.maximum(0.0, belts.pretension + belts.stiffness * stretch(of, phi, xi, none))
    return (pull**2 / (2 * belts.stiffness) - belts.pretension * straight).sum()


def four_joints(**belt: float) -> tuple[Multibody, Arm]:
    """Three belts in a row, axes parallel, drives without transmission error."""
    rng = np.random.default_rng(11)
    arm = driven_arm(rng, 4, error=False, belts=True, parallel=True)
    arm = arm.replace({f"{b.name}.{field}": value for b in arm.belts for field, value in belt.items()})
    return multibody(arm, elastic_belts=True), arm


slopes_of_energy = eqx.filter_jit(jax.grad(energy, (1, 2)))


@pytest.mark.slow
@pytest.mark.parametrize("pretension", [1e6, 300.0])
def test_forces_are_the_gradient_of_an_energy(pretension: float) -> None:
    """Slack or not; no damping."""
    of, _ = four_joints(tau=0.0, pretension=pretension)
    rng, seen = np.random.default_rng(2), set()
    for _ in range(10):
        phi, xi = jnp.asarray(0.3 * rng.normal(size=(3, 4))), jnp.asarray(0.05 * rng.normal(size=4))
        none = jnp.zeros(4)
        found = forces_of(of, (phi, xi, none), (0 * phi, none, none))[:2]
        expected = slopes_of_energy(of, phi, xi)
        for a, b in zip(found, expected, strict=True):
            agrees(a, b, "mechanics", "forces of belts, some slack", "slope of their energy", rtol=1e-10, largest=1e-12)
        e = stretch_of(of, phi, xi, none)
        seen.add(bool((tensions(of, e, 0 * e) == 0).any()))
    assert seen == {pretension < 1e6}


def test_a_slack_span_pulls_with_zero() -> None:
    of = pair((0.06, 0.03), tau=1e-3)
    e = jnp.asarray([[-1.0], [1e-3]])
    expected, source = [0.0, T0 + K * 1e-3], "textbook: no span pushes"
    agrees(tensions(of, e, 0 * e)[:, 0], expected, "mechanics", "tension of a slack span", source, rtol=1e-7, unit="N")
    fast = jnp.asarray([[-10.0], [-1.0]])
    np.testing.assert_allclose(tensions(of, 0 * e, fast)[:, 0], [0.0, T0 - K * 1e-3])


def drawn_forces(engine: PinocchioMoving, command: np.ndarray, y: np.ndarray, yd: np.ndarray) -> np.ndarray:
    """Generalised forces of the belts of parallel axes, from the drawing: differences of lengths, textbook tensions."""

    def lengths(y: np.ndarray, q: np.ndarray) -> np.ndarray:
        return np.array([drawn_lengths(engine, belt, y, q) for belt in engine.arm.belts])

    q, qd, _ = command
    slopes = np.moveaxis([slope(lambda h, e=e: lengths(y + h * e, q)) for e in np.eye(len(y))], 0, -1)
    at_rest = np.moveaxis([slope(lambda h, e=e: lengths(h * e, q)) for e in np.eye(len(y))], 0, -1)
    e = lengths(y, q) - np.array([drawn_lengths(engine, belt, 0 * y) for belt in engine.arm.belts])
    rate = slopes @ yd + slope(lambda t: lengths(y, q + qd * t), 3e-5)
    T0, k, tau = (np.array([[float(getattr(b, f))] for b in engine.arm.belts]) for f in PULL)
    tension = np.maximum(0, T0 + k * (e + tau * rate))
    return np.einsum("bs,bsn->n", tension, slopes) - np.einsum("bs,bsn->n", T0 + 0 * e, at_rest)


PULL = ("pretension", "stiffness", "tau")


def drawn_lengths(engine: PinocchioMoving, belt: Belt, y: np.ndarray, q: np.ndarray | None = None) -> np.ndarray:
    """Of a belt under the transmission errors at q, or, without q, under none."""
    one, two = (engine.names.index(name) for name in (belt.driver, belt.driven))
    joint, xi = engine.arm.joints[two], np.zeros(len(engine.names))
    xi[engine.loose] = y[3 * len(engine.names) :]
    axis, offset = np.array(joint.axis), np.array(joint.offset)
    across = offset - axis * (axis @ offset)
    frame = np.stack([across / np.linalg.norm(across), np.cross(axis, across / np.linalg.norm(across))])
    phi = y[3 * two : 3 * two + 3]
    centre = frame @ (offset + float(belt.height) * (Rotation.from_rotvec(phi).apply(axis) - axis))
    N = engine.ratio[one]
    error = 0.0 if q is None else engine.error(q + xi)[0, one]
    theta = (N - 1) * xi[one] - error, engine.ratio[two] * xi[two] + axis @ phi
    return belt_lengths(centre, theta, (float(belt.driver_radius), float(belt.driven_radius)))


def slope(values: Callable[[float], Any], h: float = 1e-4) -> Any:
    """The derivative at 0, to the eighth order."""
    return sum(w * (values(n * h) - values(-n * h)) for n, w in EIGHTH_ORDER.items()) / h


@pytest.mark.slow
@pytest.mark.parametrize("error", [False, True])
def test_residual_with_belts_against_engine_and_drawing(error: bool) -> None:
    """Pinocchio's arm and the drawn belts together, in motion, damped, some spans slack."""
    rng = np.random.default_rng(4)
    for _ in range(3):
        arm = driven_arm(rng, 4, error=error, belts=True, parallel=True)
        loads = random_loads(rng, arm)
        engine, of = PinocchioMoving(arm, loads, elastic=True), multibody(arm, loads, elastic_belts=True)
        state = random_state(rng, 4, of.size)
        at = [jnp.asarray(part) for part in (state.y, state.yd, state.ydd)]
        at[0] = at[0].at[12:].multiply(0.01)
        y, yd, ydd = (np.array(part) for part in at)
        found = np.asarray(residual_of(of, Command(*map(jnp.asarray, state.command)), *at))
        expected = engine.residual(state.command, y, yd, ydd) + drawn_forces(engine, state.command, y, yd)
        source = "Pinocchio, and a drawing of the belts"  # measured: 8e-11, of the differences
        agrees(found, expected, "mechanics", "equations of motion with belts", source, largest=1e-9)


@eqx.filter_jit
def mass_and_stiffness(of: Multibody, command: Command, y: jax.Array) -> tuple[jax.Array, jax.Array]:
    """d residual/d ydd and d residual/dy of the arm at rest."""
    return jax.jacfwd(lambda x, a: residual(of, command, x, 0 * y, a), (1, 0))(y, 0 * y)


@pytest.mark.slow
@pytest.mark.parametrize("kinematic_error", [False, True])
def test_mass_and_stiffness_are_symmetric(kinematic_error: bool) -> None:
    """Not trivially: pins and bushings are coupled by both.

    Belt forces are to be those of an energy in the coordinates, through the errors of deviating pins as well.
    """
    _, arm = four_joints(pretension=1e6)
    of = multibody(arm.replace({f"{d.name}.error": 3e-3 * kinematic_error for d in arm.drives}), elastic_belts=True)
    rng = np.random.default_rng(1)
    q = jnp.asarray(rng.uniform(-1, 1, 4))
    M, K = map(
        np.asarray, mass_and_stiffness(of, Command(q, 0 * q, 0 * q), jnp.asarray(1e-3 * rng.normal(size=of.size)))
    )
    for A in (M, K):
        assert np.abs(A[:12, 12:]).max() > 1e-3
        assert np.abs(A - A.T).max() < 1e-12 * np.abs(A).max()
    assert np.linalg.eigvalsh((M + M.T) / 2)[0] > 0


@pytest.mark.slow
def test_machine_without_stretch_has_no_pin_coordinates() -> None:
    """The same arm on rigid belts is the elastic one at the command, less the belts' forces."""
    of, arm = four_joints()
    rigid = multibody(arm)
    rng = np.random.default_rng(9)
    state = random_state(rng, 4, rigid.size)
    command = Command(*map(jnp.asarray, state.command))
    more = [jnp.concatenate([jnp.asarray(x), jnp.zeros(3)]) for x in (state.y, state.yd, state.ydd)]
    limp = eqx.tree_at(lambda m: (m.belts.stiffness, m.belts.pretension), of, replace_fn=jnp.zeros_like)
    found = residual_of(limp, command, *more)[:12]
    expected = residual_of(rigid, command, *map(jnp.asarray, (state.y, state.yd, state.ydd)))
    np.testing.assert_allclose(found, expected, rtol=1e-13)
