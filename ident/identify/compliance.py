"""Static compliance and frequency response of a loaded arm at one of its points, with intervals from draws."""

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture, carriers, link_axes
from ident.arm.compliance import point_twists
from ident.arm.linalg import inverse_cholesky_factor
from ident.arm.mechanics import point_positions, point_rotations
from ident.arm.modes import linearize
from ident.arm.rotations import matmul, transpose
from ident.arm.structural import structural_damping
from ident.errors import require
from ident.identify.binding import bind_loads, in_base_axes
from ident.identify.modal_analysis import ModalAnalysis, Servo, servo_of
from ident.identify.receptance import PointSystem, Receptance, quantiles, receptance
from ident.programs import in_batches, jit
from ident.text import did_you_mean, quoted

TOGETHER = 64
"""Draws solved at a time: always the same number, for one compiled program."""
BEYOND = 1.3
"""Highest frequency of a response, by that of the highest mode."""


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
        arms: the equations of the arm and of each of these draws.
        top: highest frequency of the response [Hz].
    """

    point: str
    frame: str
    matrix: Float[np.ndarray, "6 6"]
    place: Float[np.ndarray, "3"]
    axes: Float[np.ndarray, "3 3"]
    draws: Float[np.ndarray, "6 6 D"] | None = None
    arms: tuple[PointSystem, ...] = ()
    top: float = 0.0

    @cached_property
    def response(self) -> Receptance | None:
        """Response to a harmonic force; None where a mode is not damped."""
        damped = all(each.is_damped(self.top) for each in self.arms)
        return receptance(self.arms[0], self.arms[1:], self.top) if damped else None

    @cached_property
    def band(self) -> Float[np.ndarray, "2 6 6"]:
        """5 and 95 % quantiles of each number; NaN without draws."""
        return quantiles(self.draws, (6, 6))

    @cached_property
    def largest(self) -> tuple[float, Float[np.ndarray, "3"], Float[np.ndarray, "2"]]:
        """Largest displacement by force [m/N], its direction in the frame, and 5 and 95 % quantiles along it."""
        values, directions = np.linalg.eigh(self.matrix[:3, :3])
        way = directions[:, -1] * np.sign(directions[np.abs(directions[:, -1]).argmax(), -1])
        drawn = None if self.draws is None else np.einsum("i,ijd,j", way, self.draws[:3, :3], way)
        return float(values[-1]), way, quantiles(drawn, ())


def tool_compliance(
    analysis: ModalAnalysis,
    point: str = "",
    frame: str = "base",
    draws: Mapping[str, Float[np.ndarray, "D"]] | None = None,
) -> ToolCompliance:
    """Return the static compliance and the frequency response of an arm at a point, about its loaded equilibrium.

    The response reaches to the highest of the modes of the analysis, and `BEYOND`.

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

    def solved(numbers: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray, PointSystem]:
        system, *each = _solve(arm.replace(numbers), held, loads, servo_of(analysis.drives))
        place, axes, J = (np.asarray(x)[..., names.index(name), :] for x in (*each, system.J))
        axes = axes if frame == "tool" else 0 * axes + np.eye(3)[:, :, None]
        turned = np.einsum("nsad,aid->nsid", J.reshape((-1, 2, 3, J.shape[-1])), axes)
        return place, axes, system._replace(J=turned.reshape(J.shape))

    columns = {path: np.append(arm.get(path), own) for path, own in (draws or {}).items()}
    place, axes, systems = in_batches(solved, columns, TOGETHER) if draws else solved({})
    matrix = np.einsum("nid,njd->ijd", systems.J, systems.J)
    stands = np.isfinite(matrix).all((0, 1))
    every = itertools.compress(zip(*(np.moveaxis(np.asarray(x), -1, 0) for x in systems), strict=True), stands)
    arms, top = tuple(PointSystem(*one) for one in every), BEYOND * float(analysis.modes.frequency[-1])
    drawn = matrix[..., 1:][..., stands[1:]] if draws else None
    return ToolCompliance(name, frame, matrix[..., 0], place[..., 0], axes[..., 0], drawn, arms, top)


@jit
def _solve(
    arm: Arm, posture: Float[Array, "driven 1"], loads: Loads, servo: Servo
) -> tuple[PointSystem, Float[Array, "3 P B"], Float[Array, "3 3 P B"]]:
    """Return the equations, J (n, 6, P, B) along the base's axes, and place and axes of each point."""
    chain = at_posture(arm, posture, loads, servo)
    phi, M, C, H, L = linearize(chain)
    C = C if L is None else C + structural_damping(M, H, L)
    W = inverse_cholesky_factor(H)
    M, C = (matmul(matmul(W, X), transpose(W)) for X in (M, C))
    axes = matmul(point_rotations(chain, phi), link_axes(arm, posture)[:, :, np.array(carriers(arm), int)])
    return PointSystem(M, C, point_twists(chain, phi, W)), point_positions(chain, phi), axes
