"""The vibration as a sum over what excites it, so that it is known for all phases of the turning masses at once.

The fast method is linear: M d2x/dt2 + D dx/dt + K x = f (see `fast`), M, D and K without what excites. f is a sum of

- what the motion itself asks for: -residual(y_r, dy_r/dt, d2y_r/dt2) without excitation;
- the forces of each turning mass, linear in m e u(theta + psi) = m e (u(theta) cos psi + u(theta + pi/2) sin psi);
- for each drive, `by_pin` times the deviation e sin(2 theta + chi) = e (sin 2 theta cos chi + cos 2 theta sin chi) of
  its pin and its two rates, each of which is linear in e.

So the vibration is v = v0 + sum over the phases that are not known of c cos psi + s sin psi. U of them are determined
by 2 U + 1 simulations: with all at 0, and with each alone at 90 and at 180 degrees. What is left out of the sum is of
second order:

- of m e^2 all but the moment of inertia about the axis, which is there whatever the phase, and part of v0;
- the end point's arc, of x^2 over the length of the arm: 1e-4 of the vibration and less.

The fast method itself leaves out, for any phases, what is of second order in the kinematic error:

- in the error's slope s = dq_pin/dtheta ratio = 1 + 2 ratio e cos(2 theta + chi), the square of s - 1 in centrifugal
  terms, which is e [rad] of the term of the acceleration, 4 ratio^2 e (dq/dt)^2; and M, D, K at the deviated pin;
- with elastic belts, (s - 1) times the torque at the pin: by the slope alone it would turn the belt. With rigid ones
  the pin's torque is the motor's, and nothing of first order is left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.vibrate.motion.motion import Motion
from ident.vibrate.response.each import numbers_of, vibrations
from ident.vibrate.response.simulate import RATE, fast_method, refuse_collapse

TOGETHER = 32
"""Sets of phases for which the vibration is computed together."""

Phases = Float[np.ndarray, "U *K"]
"""Phases [rad] of some drives' imbalance or kinematic error."""


@dataclass(frozen=True)
class Superposition:
    """The vibration of the end point as a sum over what excites it.

    Attributes:
        time: (T,) [s]
        unknown: paths of the U phases of imbalance and kinematic error that are not known.
        sure: (3, T) [m] whatever they are: by the motion itself, and by what excites with known phases.
        cosine: (U, 3, T) [m] what each adds with its phase at 0,
        sine: (U, 3, T) [m] and at 90 degrees.
    """

    time: Float[np.ndarray, "T"]
    unknown: tuple[str, ...]
    sure: Float[np.ndarray, "3 T"]
    cosine: Float[np.ndarray, "U 3 T"]
    sine: Float[np.ndarray, "U 3 T"]

    @cached_property
    def envelope(self) -> Float[np.ndarray, "3 T"]:
        """The largest magnitude over all phases at each time [m]: of each there are phases that reach it."""
        return np.asarray(largest_over_phases(self.sure, self.cosine, self.sine))

    @property
    def worst(self) -> Float[np.ndarray, "3"]:
        """The largest peak over all phases in each direction [m]."""
        return self.envelope.max(1)

    @property
    def division(self) -> Float[np.ndarray, "3 3"]:
        """What is sure, imbalance and kinematic error (first axis) make of the worst in each direction [m]."""
        of_error, each = np.array([is_of_error(path) for path in self.unknown], bool), np.hypot(self.cosine, self.sine)
        parts = np.stack([np.abs(self.sure), each[~of_error].sum(0), each[of_error].sum(0)])
        return np.take_along_axis(parts, self.envelope.argmax(1)[None, :, None], 2)[..., 0]

    def at(self, phases: Phases, factors: Phases | None = None) -> Float[np.ndarray, "3 T *K"]:
        """Return the vibration with some phases, and with what excites multiplied by factors [m]."""
        factors = np.ones_like(phases) if factors is None else factors
        turned = np.tensordot(self.cosine, np.cos(phases) * factors, ((0,), (0,)))
        turned += np.tensordot(self.sine, np.sin(phases) * factors, ((0,), (0,)))
        return turned + self.sure.reshape((*self.sure.shape, *(1,) * (phases.ndim - 1)))

    def peaks(
        self, phases: Float[np.ndarray, "U K"], factors: Float[np.ndarray, "U K"] | None = None
    ) -> Float[np.ndarray, "3 K"]:
        """Return the peak in each direction with each of some phases, see `at` [m]."""
        factors = np.ones_like(phases) if factors is None else factors
        groups = [slice(k, k + TOGETHER) for k in range(0, phases.shape[1], TOGETHER)]
        return np.concatenate([np.abs(self.at(phases[:, some], factors[:, some])).max(1) for some in groups], 1)

    def worst_phases(self, first: int = 0, direction: int | None = None) -> dict[str, float]:
        """Return phases, by path, with which the worst peak is reached [rad].

        Args:
            first: number of the sample from which on it counts.
            direction: of the peak; that of the largest when None.
        """
        late = self.envelope[:, first:]
        way = int(late.max(1).argmax()) if direction is None else direction
        place = first + int(late[way].argmax())
        sign = 1.0 if self.sure[way, place] >= 0 else -1.0
        cosine, sine = (sign * part[:, way, place] for part in (self.cosine, self.sine))
        return dict(zip(self.unknown, np.arctan2(sine, cosine).tolist(), strict=True))


def is_of_error(path: str) -> bool:
    """Tell whether a phase is that of a kinematic error, and not of an imbalance."""
    return path.endswith(".error_phase")


def superposition(
    arm: Arm,
    motion: Motion,
    unknown: Sequence[str],
    *,
    loads: Loads | None = None,
    elastic_belts: bool = False,
    rate: float = RATE,
    step: float | None = None,
) -> Superposition:
    """Return the vibration over a motion by what excites it, with the fast method.

    Args:
        arm: the arm, without batch axes.
        motion: the commanded motion, its pauses included.
        unknown: paths of the phases of imbalance and kinematic error that are not known.
        loads: what hangs on the arm.
        elastic_belts: whether belts stretch.
        rate: samples a second.
        step: longest time step [s]; see `fast.step_for` when None.

    Raises:
        InputError: see `simulate`.
        ModelError: the arm collapses.
    """
    solve = fast_method(arm, motion, loads, elastic_belts, rate, step)
    numbers = {path: np.asarray(x)[None] for path, x in numbers_of(arm).items()}
    members = np.asarray(vibrations(arm, numbers, solve, sets_of(unknown)))[..., 0]
    refuse_collapse(motion, members)
    return Superposition(np.asarray(solve.time)[: int(solve.samples)], tuple(unknown), *parts_of(members))


def sets_of(unknown: Sequence[str]) -> list[dict[str, float]]:
    """Return the phases [rad] of the simulations that determine a sum: all at 0, then each alone at 90, at 180 degrees.

    Without unknown phases it is the arm as it is.
    """
    alone = [dict.fromkeys(unknown, 0.0) | {path: turn} for turn in (np.pi / 2, np.pi) for path in unknown]
    return [dict.fromkeys(unknown, 0.0), *alone]


def parts_of(members: Float[np.ndarray, "*shape members"]) -> tuple[Any, Any, Any]:
    """Return what is sure `(*shape)`, and each phase's parts of cosine and sine `(U, *shape)`, see `sets_of`."""
    count = (members.shape[-1] - 1) // 2
    first, quarter, half = (np.moveaxis(x, -1, 0) for x in np.split(members, (1, 1 + count), -1))
    cosine = (first - half) / 2
    return first[0] - cosine.sum(0), cosine, quarter - first + cosine


def largest_over_phases(sure: Any, cosine: np.ndarray, sine: np.ndarray) -> Any:
    """Return the envelope of a `Superposition`."""
    return np.abs(sure) + np.hypot(cosine, sine).sum(0)


def rms_over_phases(sure: Any, cosine: np.ndarray, sine: np.ndarray) -> Any:
    """Return the root mean square over the phases at each time."""
    return np.sqrt(sure**2 + (cosine**2 + sine**2).sum(0) / 2)
