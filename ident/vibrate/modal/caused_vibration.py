"""The vibration that a resonance crossing causes: how far the end point moves by one pulley alone while it is near."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.modes import modes
from ident.jit import AnyArray, jit
from ident.vibrate.modal.modes_along_path import nominal
from ident.vibrate.modal.resonance import ResonanceCrossing
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.superposition import Superposition, superposition

RATE = 250.0
"""Samples a second: what is read off is an envelope, which changes slowly."""
TOGETHER = 32
"""Postures that are filled up to a multiple, so that one program serves nearly all motions."""
EXCITES = {1: ("eccentricity", "phase"), 2: ("error", "error_phase")}
"""What excites at each multiple of a pulley's frequency: its size, and its phase."""


def with_amplitudes(
    crossings: Sequence[ResonanceCrossing], arm: Arm, motion: Motion, loads: Loads | None = None
) -> tuple[ResonanceCrossing, ...]:
    """Return resonance crossings with the vibration that each causes, the largest first, each times its probability.

    While the pulley is near and the mode swells: the largest sqrt(c^2 + s^2) of its imbalance (order 1) or its
    kinematic error (order 2), see `superposition`, along the way in which the mode moves the end point. Other modes
    that the pulley excites meanwhile are in it as far as they move that way.

    Args:
        crossings: along the motion.
        arm: of a batch the median.
        motion: of its driven joints.
        loads: what hangs on the arm.

    Raises:
        InputError, ModelError: see `simulate`.
    """
    if not crossings:
        return ()
    arm = nominal(arm)
    whole = superposition(arm, motion, tuple(_phases(arm)), loads=loads, rate=RATE)
    ways = _ways(arm, crossings, loads)
    sizes = [
        _largest(whole, _phase(arm, crossing), crossing, way) for crossing, way in zip(crossings, ways, strict=True)
    ]
    found = (replace(crossing, amplitude=size) for crossing, size in zip(crossings, sizes, strict=True))
    return tuple(sorted(found, key=lambda crossing: (-crossing.amplitude * crossing.probability, crossing.start)))


def _phases(arm: Arm) -> Iterator[str]:
    """Yield the paths of the phases of all that excites the arm: the same for each motion, as the programs are."""
    for size, phase in EXCITES.values():
        yield from (f"{drive.name}.{phase}" for drive in arm.drives if float(getattr(drive, size)))


def _phase(arm: Arm, crossing: ResonanceCrossing) -> str:
    """Return the path of the phase of what excites; empty where nothing does at this order."""
    _, phase = EXCITES.get(crossing.source.order, ("", ""))
    path = f"{crossing.source.drive}.{phase}"
    return path if path in _phases(arm) else ""


def _largest(whole: Superposition, phase: str, crossing: ResonanceCrossing, way: Float[np.ndarray, "3"]) -> float:
    if not phase:
        return 0.0
    k = whole.unknown.index(phase)
    first, end = np.searchsorted(whole.time, (crossing.start, crossing.swells_until))
    inside = slice(max(int(first) - 1, 0), int(end) + 1)
    return float(np.hypot(way @ whole.cosine[k][:, inside], way @ whole.sine[k][:, inside]).max())


def _ways(arm: Arm, crossings: Sequence[ResonanceCrossing], loads: Loads | None) -> Float[np.ndarray, "crossings 3"]:
    """Return in which direction the mode of each crossing moves the end point."""
    count, posture = len(crossings), np.array([crossing.posture for crossing in crossings]).T
    filled = np.pad(posture, ((0, 0), (0, -count % TOGETHER)), mode="edge")
    frequency, motion = (np.asarray(x)[..., :count] for x in _modes(arm, filled, loads))
    natural = np.array([crossing.natural for crossing in crossings])
    mode = np.abs(frequency - natural).argmin(0)
    way = motion[:, mode, np.arange(len(crossings))].T
    return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))


@jit
def _modes(
    arm: Arm, posture: Float[AnyArray, "driven K"], loads: Loads | None
) -> tuple[Float[Array, "m K"], Float[Array, "3 m K"]]:
    """Return natural frequencies [Hz] and how each mode moves the end point."""
    each = modes(at_posture(arm, jnp.asarray(posture), loads))
    return each.frequency, each.motion[:, -1]
