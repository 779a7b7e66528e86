"""A turning mass on a held arm: steady vibration against the frequency-response function in closed form."""

from functools import cache, partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm
from conformance import agrees
from moving_engines import left_jacobian, skew
from numpy.polynomial import Polynomial
from runs import about, along, scaled, short
from scipy.linalg import eigvalsh
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import flat, point_positions, unflatten
from ident.arm.parts import Point
from ident.vibrate import exact
from ident.vibrate.fast import step_for
from ident.vibrate.motion import Motion
from ident.vibrate.simulate import fast_method

pytestmark = pytest.mark.slow

POSTURE = (20.0, -50.0, 40.0)
RATIO = 1e8
"""So that the pin turns by no more than 1e-6 rad."""
MASS, REACH, HEIGHT, PHASE, ROTOR = 0.5, 1e-4, 0.05, 0.3, 0.02
PLACES = range(5)
"""See `frequency`."""
PLACED = ("below mode 1", "at mode 1", "between modes", "at mode 2", "above mode 2")
LAST = 1.0
"""Seconds from whose samples amplitude and phase are found."""


@cache
def shaken() -> Arm:
    """The paper's arm, more damped, with a mass that turns on its second shaft."""
    arm = scaled(scaled(lcd_arm(), "tau_bend", 25.0), "tau_tors", 2.5)
    numbers = {"ratio": RATIO, "eccentric_mass": MASS, "eccentricity": REACH, "height": HEIGHT, "phase": PHASE}
    arm = arm.replace({f"drive2.{k}": v for k, v in numbers.items()} | {"drive2.rotor_inertia": ROTOR})
    return arm.replace({f"{drive}.eccentricity": 0.0 for drive in ("drive1", "drive3")})


def pointed(arm: Arm) -> Arm:
    """The arm with three points before its own: the place of the mass, and one beyond it along x and y of the shaft."""
    turned = Rotation.from_euler("z", -POSTURE[1], degrees=True).apply(np.eye(3))
    around = [
        Point(f"around{k}", "joint2", r + np.array([0, 0, HEIGHT])) for k, r in enumerate((np.zeros(3), *turned[:2]))
    ]
    return Arm(arm.name, arm.joints, (*around, *arm.points), arm.payloads, arm.gravity, arm.drives, arm.belts)


def spinning(rate: float, duration: float = 5.0) -> Motion:
    """The second pin so slow that its pulley turns at this rate [rad/s]."""
    return along(Polynomial([0, rate / RATIO]), duration, direction=(0, 1, 0), start=tuple(np.deg2rad(POSTURE)))


class Closed(NamedTuple):
    """Complex amplitudes, that of exp(i omega t), of the coordinates (9) and of the end point (3)."""

    y: np.ndarray
    tip: np.ndarray


class Held(NamedTuple):
    """About the equilibrium: mass, damping and stiffness, rotation vectors (3, joints), axes of the shafts (3, 3,
    joints), and how the points move with the coordinates (3, points, 9)."""

    M: np.ndarray
    C: np.ndarray
    H: np.ndarray
    phi: np.ndarray
    axes: np.ndarray
    slopes: np.ndarray


@cache
def at_equilibrium() -> Held:
    arm = pointed(shaken())
    lin = about(arm, spinning(0.0))

    @jax.jit
    def points(phi: jax.Array) -> tuple[jax.Array, jax.Array]:
        chain = at_posture(arm, jnp.deg2rad(jnp.asarray(POSTURE)))
        return chain.frame, jax.jacfwd(lambda p: point_positions(chain, unflatten(p)))(flat(phi))

    return Held(*(np.array(x) for x in (lin.M, lin.C, lin.H, lin.phi, *points(lin.phi))))


@cache
def frequency(place: int) -> float:
    """Below, at and between the two lowest, at the second, and above [rad/s]."""
    first, second = np.sqrt(eigvalsh(at_equilibrium().H, at_equilibrium().M)[:2])
    return float([0.6 * first, first, (first + second) / 2, second, 1.5 * second][place])


@cache
def closed(place: int) -> Closed:
    """(H - w^2 M + i w (C + G))^-1 F: m e w^2 outwards and m g down at the mass that turns, G the rotor's gyroscope."""
    w, gravity = frequency(place), np.asarray(shaken().gravity)
    M, C, H, phi, axes, slopes = at_equilibrium()
    first, second = (Rotation.from_rotvec(phi[:, k]).as_matrix() for k in range(2))
    x_axis, y_axis, z_axis = (first @ second @ axes[:, :, 1]).T
    outwards = w * w * slopes[:, 0].T @ (x_axis - 1j * y_axis)
    weight = (slopes[:, 1] - slopes[:, 0] - 1j * (slopes[:, 2] - slopes[:, 0])).T @ gravity
    F = MASS * REACH * (outwards + weight) * np.exp(1j * PHASE)
    S = np.hstack([left_jacobian(phi[:, 0]), first @ left_jacobian(phi[:, 1]), np.zeros((3, 3))])
    G = -ROTOR * w * S.T @ skew(z_axis) @ S
    x = np.linalg.solve(H - w * w * M + 1j * w * (C + G), F)
    return Closed(in_shafts(x.reshape(3, 3).T), slopes[:, -1] @ x)


def in_shafts(phi: np.ndarray) -> np.ndarray:
    """Rotation vectors (3, joints) as flat coordinates along the shafts' axes."""
    return np.einsum("abn,an->bn", at_equilibrium().axes, phi).T.ravel()


def fitted(time: np.ndarray, traces: np.ndarray, motion: Motion) -> np.ndarray:
    """Complex amplitudes, by the pulley's angle, of the traces in the last second."""
    late = time > time[-1] - LAST
    angle = RATIO * np.asarray(motion(time[late])[0])[1]
    basis = np.stack([np.ones(late.sum()), np.cos(angle), np.sin(angle)], 1)
    _, cosine, sine = np.linalg.lstsq(basis, traces[:, late].T, rcond=None)[0]
    return cosine - 1j * sine


def off(found: np.ndarray, right: np.ndarray) -> float:
    return float(np.abs(found - right).max() / np.abs(right).max())


@pytest.mark.parametrize("place", PLACES)
def test_fast(place: int) -> None:
    """From rest, after five seconds."""
    motion = spinning(frequency(place))
    response = short(shaken(), motion)
    time = np.asarray(response.time)
    tip, source = fitted(time, np.asarray(response.displacement), motion), "(H - w^2 M + i w (C + G))^-1 F"
    assert off(fitted(time, np.asarray(response.y), motion), closed(place).y) < 1e-3
    what = f"steady vibration by an imbalance {PLACED[place]}, fast"
    agrees(tip, closed(place).tip, "vibration", what, source, largest=1e-3, unit="m")


def test_exact() -> None:
    """At a resonance, from the closed form's own state, from which it would depart, were it not the solution."""
    motion, w, right = spinning(frequency(1)), frequency(1), closed(1).y
    rest = in_shafts(at_equilibrium().phi)
    now = right * np.exp(1j * RATIO * float(motion(0.0)[0][1]))
    start = rest + now.real, (1j * w * now).real
    method = partial(fast_method, shaken(), motion, None, False, 250.0)
    found = exact.integrate(shaken(), motion, method, step_for(shaken(), motion), start).y[:, :751]
    amplitude, source = fitted(np.arange(751) / 250, found, motion), "(H - w^2 M + i w (C + G))^-1 F"
    what = f"steady vibration by an imbalance {PLACED[1]}, exact"
    agrees(amplitude, right, "vibration", what, source, largest=1e-3, unit="rad")


def test_resonance_is_there() -> None:
    """The response at both resonances exceeds that below and above, so the phase turns too."""
    sizes = [np.abs(closed(place).y).max() for place in PLACES]
    assert min(sizes[1], sizes[3]) > 1.5 * sizes[0]
