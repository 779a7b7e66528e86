"""Springs that are no straight lines, in motion: where the fast method may take their tangent, and what passes T1."""

from dataclasses import dataclass

import jax
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.springs import Spring
from ident.errors import InputError, Problem
from ident.jit import AnyArray
from ident.vibrate.response.response import Response

MISSED = 0.02
"""Share of a bushing's moment of vibration by which its tangent may miss its curve, for the fast method."""


class LeavesTangentError(InputError):
    """A vibration too large for the fast method, as it leaves the tangent of a curved spring."""


@dataclass(frozen=True)
class Passage:
    """A spring whose load passes T1 while the arm moves.

    Attributes:
        spring: name of the spring.
        torque1: [N m] T1.
        low: [N m] least load.
        high: [N m] largest load.
    """

    spring: str
    torque1: float
    low: float
    high: float


def refuse_curved(arm: Arm, missed: AnyArray | None) -> None:
    """Refuse a response by the fast method that leaves the tangents of curved springs; under `jit` it may.

    Args:
        arm: the arm.
        missed: (2 N, T, *batch) of the solution, None without curved springs, see `beyond_tangent`.

    Raises:
        LeavesTangentError: some bushing's moment of vibration is off by more than `MISSED` of it at its largest.
    """
    if missed is None or isinstance(missed, jax.core.Tracer):
        return
    off, whole = np.split(np.nan_to_num(np.asarray(missed)).max(1), 2)
    share = np.divide(off, whole, out=np.zeros_like(off), where=whole > 0)
    worst = np.unravel_index(np.argmax(share), share.shape)
    if share[worst] > MISSED:
        name = arm.joints[int(worst[0])].name
        got = f"a vibration by which {name}'s curved spring leaves its tangent by {share[worst]:.2g} of its moment"
        expected = f"{MISSED:g} at most, where springs are taken as straight about the quasi-static deflection"
        remedy = "simulate by the exact method (`method` exact), or take its [[spring]] out"
        raise LeavesTangentError(Problem(arm.name, got, expected, remedy))


def passages(arm: Arm, response: Response) -> tuple[Passage, ...]:
    """Return the springs whose load passes T1 during a response without batch axes."""
    places = {joint.name: place for place, joint in enumerate(arm.joints)}
    loads = spring_loads(response) if arm.springs else {}
    found = []
    for spring in arm.springs:
        if isinstance(spring, Spring):
            load, first = loads[spring.direction][places[spring.joint]], float(spring.torque1)
            if load.min() < first < load.max():
                found.append(Passage(spring.name, first, float(load.min()), float(load.max())))
    return tuple(found)


def spring_loads(response: Response) -> dict[str, Float[np.ndarray, "N T"]]:
    """Return the sizes of the bushings' spring moments [N m] by direction."""
    moment, axis = np.asarray(response.spring_moment), np.asarray(response.model.axis).reshape(3, -1, 1)
    torsion = (moment * axis).sum(0)
    return {"bending": np.linalg.norm(moment - axis * torsion, axis=0), "torsion": np.abs(torsion)}
