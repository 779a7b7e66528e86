"""The paper's arm and motions for the tests of simulation, of the same shapes, so that few programs are compiled."""

from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from arms import lcd_arm
from jaxtyping import Array
from numpy.polynomial import Polynomial

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.modes import Linearized, linearize
from ident.vibrate.motion import Motion, stroke
from ident.vibrate.response import Response
from ident.vibrate.simulate import simulate

PIECES, POWERS = 8, 4
"""Of a stroke; every motion here has as many."""
STEPS = 1000
"""Of every short run: five panels of 200."""
SAMPLES = 2500


def named(motion: Motion) -> Motion:
    """The same motion under the one name that programs are compiled for."""
    return Motion("run", motion.breaks, motion.coefficients, 0.0)


def along(alpha: Polynomial, duration: float, direction: tuple[float, ...] = (1, -2, 1), start: tuple = (0, 0, 0)):
    """q = start + alpha(t) direction, a polynomial of degree three at most, over so many seconds."""
    breaks = np.linspace(0, duration, PIECES + 1)
    powers = [np.array([alpha.deriv(n)(t) for t in breaks[:-1]]) / max(n * (n - 1), 1) for n in range(POWERS)]
    coefficients = np.stack(powers[::-1])[..., None] * np.asarray(direction, float)
    coefficients[-1] += np.asarray(start, float)
    return Motion("run", breaks, coefficients, 0.0)


def swing(duration: float = 5.0) -> Motion:
    """The first seconds of a way from rest to rest over 33 degrees in 5 s, that brings pulley 2 to 6.6 Hz."""
    return along(np.deg2rad(80) - np.deg2rad(33) * Polynomial([0, 0, 3 / 25, -2 / 125]), duration)


def hold_still(q: object, seconds: float) -> Motion:
    """A posture [rad] for some time, arrived at the start."""
    return Motion("held still", [0.0, seconds], np.asarray(q, float)[None, None], arrival=0.0)


def held(q: tuple[float, ...], duration: float = 5.0) -> Motion:
    """A posture [deg]."""
    return along(Polynomial([0.0]), duration, start=tuple(np.deg2rad(q)))


def short(arm: Arm, motion: Motion, **options) -> Response:
    """Simulate a motion of any duration in a thousand steps by the fast method."""
    duration = float(motion.breaks[-1])
    return simulate(arm, motion, rate=SAMPLES / duration, step=duration / STEPS, **options)


@cache
def paper(
    percent: float, method: str, elastic: bool = False, error: float = 0.0, step: float | None = None
) -> Response:
    """The paper's run and half a second of dwell: with transmission errors it has no more intervals than a swing."""
    motion = named(stroke(lcd_arm().stroke, percent=percent, dwell=0.5))
    return simulate(with_error(error), motion, method=method, elastic_belts=elastic, step=step)


def with_error(arcsec: float) -> Arm:
    arm, radians = lcd_arm(), np.deg2rad(arcsec / 3600)
    return arm.replace({f"{drive.name}.error": radians for drive in arm.drives}) if arcsec else arm


def scaled(arm: Arm, field: str, factor: float) -> Arm:
    """The arm with a number of every joint or drive multiplied."""
    paths = [path for path in arm.paths() if path.endswith(f".{field}")]
    return arm.replace({path: factor * arm.get(path) for path in paths})


def undamped(arm: Arm) -> Arm:
    return scaled(scaled(arm, "tau_bend", 0.0), "tau_tors", 0.0)


def still(arm: Arm) -> Arm:
    """Without what shakes it."""
    return scaled(arm, "eccentricity", 0.0)


def about(arm: Arm, motion: Motion) -> Linearized:
    """The equations about the equilibrium at the start of a motion, from the statics."""
    return _at(arm, motion(jnp.zeros(()))[0])


@eqx.filter_jit
def _at(arm: Arm, q: Array) -> Linearized:
    return linearize(at_posture(arm, q))


def off(mine: np.ndarray, other: np.ndarray) -> float:
    """Largest difference in any direction, as a part of the largest of the other."""
    return float(np.abs(mine - np.asarray(other)).max() / np.abs(np.asarray(other)).max())


def apart(a, b, axis: int = 1) -> np.ndarray:
    """Largest difference in each direction, as a part of b's largest value there."""
    a, b = np.asarray(a), np.asarray(b)
    return np.abs(a - b).max(axis) / np.abs(b).max(axis)


def vibration_at(whole, phases, factors=1.0):
    """The vibration of a superposition with some phases, its responses multiplied by factors, (3, T, ...) [m]."""
    turned = np.tensordot(whole.cosine, np.cos(phases) * factors, ((0,), (0,)))
    turned += np.tensordot(whole.sine, np.sin(phases) * factors, ((0,), (0,)))
    return turned + whole.sure.reshape((*whole.sure.shape, *(1,) * (phases.ndim - 1)))
