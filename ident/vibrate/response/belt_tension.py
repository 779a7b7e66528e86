"""The tension of the belts while the arm moves."""

from collections.abc import Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.belts import stretch, tensions
from ident.arm.multibody import Multibody
from ident.arm.multibody_dynamics import drive_torques
from ident.arm.multibody_kinematics import Command, at_rest, bushing_rotations, deviations, pins
from ident.errors import InputError, Problem
from ident.jit import AnyArray, jit
from ident.vibrate.motion.command import command
from ident.vibrate.response.exact import acceleration
from ident.vibrate.response.response import Response

BATCH = 256
"""Times whose accelerations are computed together."""
TOGETHER = 4 * BATCH
"""Times that one call takes."""


def belt_tension(response: Response) -> Float[np.ndarray, "2 B T"]:
    """Return the tension of upper and lower span of each belt [N]; a single response, without batch axes.

    That of an elastic belt follows from its stretch and is never below zero. That of a rigid one is what it has to
    carry: the torque at the pulley that it drives, of the arm behind the harmonic drive and of the belts further out.
    Below zero, which no belt can do, the model does not hold.
    """
    model, count = response.model, len(response.time)
    if not model.belts.ends:
        return np.zeros((2, 0, count))
    of = _of_elastic_belts if model.belt_driven else _of_rigid_belts
    commanded = command(model, response.motion, response.time)
    states = tuple(np.asarray(part) for part in (*commanded, response.y, response.yd))
    parts = []
    for start in range(0, count, TOGETHER):
        some = [part[:, start : start + TOGETHER] for part in states]
        q, qd, qdd, y, yd = (np.pad(part, ((0, 0), (0, TOGETHER - part.shape[1])), mode="edge") for part in some)
        parts.append(np.asarray(of(model, Command(q, qd, qdd), y, yd)))
    return np.concatenate(parts, 2)[:, :, :count]


@jit
def _of_elastic_belts(model: Multibody, commanded: Command, *state: AnyArray) -> Float[Array, "2 B T"]:
    y, yd = map(jnp.asarray, state)
    error = pins(model, commanded, at_rest(deviations(model, y))).error

    def length(y: Array) -> Array:
        return stretch(model, bushing_rotations(model, y), deviations(model, y), error)

    return tensions(model, *jax.jvp(length, (y,), (yd,)))


@jit
def _of_rigid_belts(model: Multibody, commanded: Command, *state: AnyArray) -> Float[Array, "2 B T"]:
    y, yd = map(jnp.asarray, state)
    by_time = Command(*(part.T for part in commanded)), y.T, yd.T
    ydd = jax.lax.map(lambda now: acceleration(model, *now), by_time, batch_size=BATCH).T
    torque = list(drive_torques(model, commanded, y, yd, ydd) / model.drives.ratio)
    tension = [jnp.zeros_like(torque[0])] * len(model.belts.ends)
    for b, (driver, driven) in reversed(list(enumerate(model.belts.ends))):
        tension[b] = torque[driven] / model.belts.radius[1, b] / 2
        torque[driver] = torque[driver] + 2 * tension[b] * model.belts.radius[0, b]
    return model.belts.pretension + jnp.stack([jnp.stack(tension), -jnp.stack(tension)])


def slack(time: Float[AnyArray, "T"], tension: Float[AnyArray, "2 B T"]) -> Iterator[tuple[int, str, float, float]]:
    """Yield belt, span (`upper` or `lower`) and the times between which its tension is zero [s]."""
    is_slack, at = np.asarray(tension) <= 0, np.asarray(time)
    for span, belt in np.argwhere(is_slack.any(2)):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], is_slack[span, belt].astype(int), [0]])))
        for first, end in edges.reshape(-1, 2):
            yield int(belt), ("upper", "lower")[span], float(at[first]), float(at[end - 1])


def refuse_slack(response: Response, names: Sequence[str]) -> None:
    """Refuse a response on elastic belts with a slack span, which the linear equations of the fast method have pull on.

    Args:
        response: a single response.
        names: of the belts.

    Raises:
        InputError: some span is slack.
    """
    first = min(slack(response.time, belt_tension(response)), key=lambda span: span[2], default=None)
    if response.model.elastic and first is not None:
        belt, span, start, _ = first
        got = f"the {span} span of {names[belt]} slack at {start:.4g} s"
        remedy = "simulate it with `method` exact, raise the pretension, or take the belts as rigid"
        raise InputError(Problem("elastic_belts", got, "belts under tension, for the fast method", remedy))
