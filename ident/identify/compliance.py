"""Static compliance of a loaded arm at one of its points, with its interval from draws."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture, carriers, link_axes
from ident.arm.compliance import point_compliance
from ident.arm.mechanics import point_positions, point_rotations, static_equilibrium
from ident.arm.rotations import matmul
from ident.errors import require
from ident.identify.binding import bind_loads, in_base_axes
from ident.identify.modal_analysis import ModalAnalysis, Servo, servo_of
from ident.programs import in_batches, jit
from ident.text import did_you_mean, quoted

TOGETHER = 64
"""Draws solved at a time: always the same number, for one compiled program."""
LEVELS = (0.05, 0.95)
"""Quantiles of a band."""


@dataclass(frozen=True)
class ToolCompliance:
    """By how much a small further force or moment moves and turns a point of a loaded arm; all arrays are NumPy's.

    Attributes:
        point: its name.
        frame: `base` or `tool`.
        matrix: (6, 6) [m/N, m/(N m); rad/N, rad/(N m)] displacement along and rotation about x, y and z of the frame,
            by force along and moment about them; symmetric.
        place: (3,) [m] of the point under the load, in the base frame.
        axes: (3, 3) directions of the frame, columns, in the base frame.
        draws: (6, 6, D) the same of the draws that have a stable equilibrium; None without draws.
    """

    point: str
    frame: str
    matrix: Float[np.ndarray, "6 6"]
    place: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    draws: Float[np.ndarray, "6 6 D"] | None = None

    @cached_property
    def band(self) -> Float[np.ndarray, "2 6 6"]:
        """5 and 95 % quantiles of each number; NaN without draws."""
        return np.full((2, 6, 6), np.nan) if self.draws is None else np.quantile(self.draws, LEVELS, axis=-1)

    @cached_property
    def largest(self) -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "2"]]:
        """Largest displacement by force [m/N], its direction in the frame, and 5 and 95 % quantiles along it."""
        values, directions = np.linalg.eigh(self.matrix[:3, :3])
        way = directions[:, -1] * np.sign(directions[np.abs(directions[:, -1]).argmax(), -1])
        drawn = np.full(2, np.nan) if self.draws is None else np.einsum("i,ijd,j", way, self.draws[:3, :3], way)
        return float(values[-1]), way, np.quantile(drawn, LEVELS)


def tool_compliance(
    analysis: ModalAnalysis,
    point: str = "",
    frame: str = "base",
    draws: Mapping[str, Float[np.ndarray, "D"]] | None = None,
) -> ToolCompliance:
    """Return the static compliance of an arm at a point, tangent about its loaded equilibrium.

    Args:
        analysis: of the arm at its posture and load.
        point: name of the point; by default the last one.
        frame: `base`, or `tool`: the axes of the link that carries the point, as it lies under the load.
        draws: numbers of the arm [SI], by path.

    Raises:
        InputError: a point that the arm does not have.
    """
    arm, posture, names = analysis.arm, analysis.posture, [each.name for each in analysis.arm.points]
    name = point or names[-1]
    remedy = did_you_mean(name, names, "correct the name, or add it to the arm file")
    require(name in names, "point", quoted(name), f"one of {', '.join(names)}", remedy)
    loads, held = bind_loads(arm, [in_base_axes(arm, posture, analysis.load)]), jax.device_put(np.array([posture]).T)

    def solved(numbers: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        each = _solve(arm.replace(numbers), held, loads, servo_of(analysis.drives))
        matrix, place, axes = (np.asarray(x)[..., names.index(name), :] for x in each)
        axes = axes if frame == "tool" else 0 * axes + np.eye(3)[:, :, None]
        blocks = matrix.reshape((2, 3, 2, 3, -1))
        return np.einsum("aid,sacbd,bjd->sicjd", axes, blocks, axes).reshape(matrix.shape), place, axes

    matrix, place, axes = (x[..., 0] for x in solved({}))
    own = ToolCompliance(name, frame, matrix, place, axes)
    if not draws:
        return own
    every = in_batches(solved, dict(draws), TOGETHER)[0]
    return replace(own, draws=every[..., np.isfinite(every).all((0, 1))])


@jit
def _solve(
    arm: Arm, posture: Float[Array, "driven 1"], loads: Loads, servo: Servo
) -> tuple[Float[Array, "6 6 P B"], Float[Array, "3 P B"], Float[Array, "3 3 P B"]]:
    """Return compliance, place and axes of each point in the base frame."""
    chain = at_posture(arm, posture, loads, servo)
    phi = static_equilibrium(chain).phi
    axes = link_axes(arm, posture)[:, :, np.array(carriers(arm), int)]
    return point_compliance(chain, phi), point_positions(chain, phi), matmul(point_rotations(chain, phi), axes)
