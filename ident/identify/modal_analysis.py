"""Modes, damping and static deflection of an arm at one posture under one load."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ident.arm.arm import Arm
from ident.arm.chain import Chain, Loads, at_posture
from ident.arm.mechanics import Phi, deflection, forward_kinematics, motion_of, point_positions, static_equilibrium
from ident.arm.modes import Label, Modes, damped_eigenvalues, is_ambiguous, linearize, mode_labels, modes_about
from ident.errors import ModelError, refusal, require
from ident.identify.binding import bind_loads, in_base_axes
from ident.measure import DRIVE_STATES, OWN_WEIGHT, Load
from ident.programs import jit

MODES = 4
"""Default number of modes."""
SLACK = 1e-9
"""Rounding [rad] accepted beyond a joint limit."""


@dataclass(frozen=True)
class ModalAnalysis:
    """An arm held at a posture under a load; all arrays are NumPy's.

    Attributes:
        arm: the arm.
        posture: (driven,) [rad]
        load: the load case.
        modes: the lowest modes, ascending.
        labels: (m,) their names.
        ambiguous: (m,) whether a mode's name is ambiguous.
        damping_ratio: (m,) [-]
        deflection: (3,) [m] in the base frame by point name, counted from the arm without elastic rotation.
        equilibrium: (3, N) [rad] the bushings' rotation vectors under the load.
        drives: what holds the motors, `brake` or `servo`.
    """

    arm: Arm
    posture: tuple[float, ...]
    load: Load
    modes: Modes
    labels: tuple[Label, ...]
    ambiguous: Bool[np.ndarray, "m"]
    damping_ratio: Float[np.ndarray, "m"]
    deflection: dict[str, Float[np.ndarray, "3"]]
    equilibrium: Float[np.ndarray, "3 N"]
    drives: str = DRIVE_STATES[0]

    @cached_property
    def outline(self) -> tuple[Float[np.ndarray, "3 K"], Float[np.ndarray, "3 K m"]]:
        """The arm as a line [m] through its bushings to its end point, and that line's displacement by each mode.

        A mode has no amplitude: only the ratios of its displacements are meaningful.
        """
        posture, phi, shapes = map(jnp.asarray, (self.posture, self.equilibrium, self.modes.shape))
        line, displacement = _outline(self.arm, posture, phi, shapes, servo_of(self.drives))
        return np.asarray(line), np.asarray(displacement)

    def beyond_limits(self) -> Iterator[tuple[str, float, tuple[float, float]]]:
        """Yield name, angle and limits [rad] of the joints outside their limits."""
        for joint, angle in zip(self.arm.driven, self.posture, strict=True):
            low, high = joint.limits
            if not low - SLACK <= angle <= high + SLACK:
                yield joint.name, angle, joint.limits


def modal_analysis(
    arm: Arm, posture: tuple[float, ...], load: Load = OWN_WEIGHT, modes: int = MODES, drives: str = DRIVE_STATES[0]
) -> ModalAnalysis:
    """Return modes, damping and deflection of an arm held at a posture under a load.

    Args:
        arm: the arm.
        posture: (driven,) [rad] joint angles.
        load: the load case.
        modes: number of modes; all if the arm has fewer.
        drives: what holds the motors, `brake` or `servo`.

    Raises:
        InputError: a posture of the wrong length, a payload or point that the arm does not have, an arm without any
            point, or a servo on that it does not have.
        ModelError: the arm has no stable equilibrium there.
    """
    expected = f"{len(arm.driven)}, one for each driven joint of {arm.name}"
    got = f"{len(posture)} joint angle" + "s" * (len(posture) != 1)
    require(len(posture) == len(arm.driven), "", got, expected, "give one angle for each joint", "posture")
    remedy = "add a [[point]] at the arm's end: modes are named by how it moves"
    require(arm.points, arm.name, "no point", "at least one", remedy)
    if drives != DRIVE_STATES[0] and not arm.servos:
        remedy = "describe what holds the motors in the arm file, as [[servo]]"
        raise refusal("", drives, "brake, as the arm has no servo", remedy, "drives")
    angles = ", ".join(f"{math.degrees(angle):g}" for angle in posture)
    require(all(map(math.isfinite, posture)), "", f"({angles}) deg", "finite angles", "correct the posture", "posture")
    posture = tuple(map(float, posture))
    solved = jax.tree.map(lambda x: x[..., 0], modal_solution(arm, posture, load, drives))
    solution = jax.device_get(solved)
    known = solution.modes
    if not np.isfinite(known.frequency).all():
        angles = ", ".join(f"{math.degrees(q):.4g}" for q in posture)
        raise ModelError(
            f"{arm.name} has no stable equilibrium at ({angles}) deg under {load}: its bushings are too soft for what"
            " they carry; check stiffnesses, masses and their units"
        )
    shape, bend, tors = (x[:, :modes] for x in (known.shape, known.bend, known.tors))
    cut = known.frequency[:modes], shape, bend, tors, known.motion[:, :, :modes]
    lowest = eqx.tree_at(lambda m: (m.frequency, m.shape, m.bend, m.tors, m.motion), known, cut)
    ambiguous, ratio = solution.ambiguous[:modes], solution.ratio[:modes]
    moved = {point.name: solution.moved[:, i] for i, point in enumerate(arm.points)}
    labels = tuple(mode_labels(solved.modes)[:modes])
    return ModalAnalysis(arm, posture, load, lowest, labels, ambiguous, ratio, moved, solution.phi, drives)


Servo = Float[Array | np.ndarray, ""] | None


def servo_of(drives: str) -> Servo:
    """Return the servo argument of `at_posture` for the state of the drives."""
    return np.array(1.0) if drives == "servo" else None


@jit
def _outline(
    arm: Arm, posture: Float[Array, "driven"], phi: Phi, shapes: Float[Array, "n m"], servo: Servo
) -> tuple[Float[Array, "3 K"], Float[Array, "3 K m"]]:
    chain = at_posture(arm, posture, None, servo)

    def line(chain: Chain, phi: Phi) -> Array:
        centres, ends = forward_kinematics(chain, phi).centre, point_positions(chain, phi)[:, -1:]
        return jnp.concatenate([centres, ends], 1)

    return jax.vmap(lambda shape: motion_of(line, chain, phi, shape), 1, (None, 2))(shapes)


class ModalSolution(eqx.Module):
    """All modes of an arm, or of a batch of arms, at a posture; NaN where there is no stable equilibrium.

    Attributes:
        phi: (3, N, B) [rad] the bushings' rotation vectors under the load.
        modes: all of them, ascending.
        ambiguous: (m, B) whether a mode's name is ambiguous.
        ratio: (m, B) [-] damping ratios.
        moved: (3, P, B) [m] static deflection of the named points in the base frame.
        M: (n, n, B) [kg m^2] mass matrix.
    """

    phi: Float[Array, "3 N B"]
    modes: Modes
    ambiguous: Bool[Array, "m B"]
    ratio: Float[Array, "m B"]
    moved: Float[Array, "3 P B"]
    M: Float[Array, "n n B"]


def modal_solution(arm: Arm, posture: tuple[float, ...], load: Load, drives: str = DRIVE_STATES[0]) -> ModalSolution:
    """Return all modes of an arm, or of a batch of arms, held at a posture (driven,) [rad] under a load."""
    loads = bind_loads(arm, [in_base_axes(arm, posture, load)])
    return _solve(arm, jax.device_put(np.array([posture], float).T), loads, servo_of(drives))


@jit
def _solve(arm: Arm, posture: Float[Array, "driven 1"], loads: Loads, servo: Servo) -> ModalSolution:
    """Compute everything in one compiled function, whatever the number of modes."""
    chain = at_posture(arm, posture, loads, servo)
    at = static_equilibrium(chain)
    shapes, linear = modes_about(chain, at), linearize(chain, at)
    s = damped_eigenvalues(linear)[: len(shapes.frequency)]
    ratio = -s.real / jnp.abs(s)
    return ModalSolution(at.phi, shapes, is_ambiguous(shapes), ratio, deflection(chain, at.phi), linear.M)
