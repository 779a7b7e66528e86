"""How predictions change with what a fit takes for granted: with compliances at zero, and with given numbers."""

from inspect import unwrap
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import Chain
from ident.arm.equilibrium import StaticEquilibrium, static_equilibrium
from ident.arm.hinges import CutArm
from ident.arm.mechanics import (
    Phi,
    flat,
    potential_gradient,
    second_variations,
    unflatten,
)
from ident.arm.modes import Modes, modes_about
from ident.arm.parts import Body
from ident.arm.rotations import matvec, transpose
from ident.identify.conditions import Conditions
from ident.identify.mode_choice import mode_choice, pick
from ident.identify.predict import chains
from ident.identify.readings import read
from ident.jit import RUNS_ONCE, jit

Choices = tuple[Float[Array, "m R"], Float[Array, "m n"]]
"""The modes of the named and of the unnamed values, as `mode_choice` gives them."""
MANY = 64
"""States above which one amount is changed after the other, for the memory that all of them together would take."""
LONG = 24
"""Bushings above which that is done, too: an arm of 24 joints, cut at 49, would take 5 GB."""


class Slopes(NamedTuple):
    """A campaign's predictions [SI] and their derivatives; zero in the rows of damping ratios and shapes.

    Attributes:
        predicted: (D,) of the arm itself.
        bending, torsion: (H, D) by the compliance [rad/(N m)] of each hinge across its axis, and about it.
        mass: (N, D) by ln(mass) of what each joint carries behind its pin, the inertia with it.
        centre: (N, D) by the way of its mass centre along the link, as a share of its length.
        servo: (N, D) by compliance in series with each joint's torsion, as a share of the joint's own.
    """

    predicted: Float[Array, "D"]
    bending: Float[Array, "H D"]
    torsion: Float[Array, "H D"]
    mass: Float[Array, "N D"]
    centre: Float[Array, "N D"]
    servo: Float[Array, "N D"]


@jit
def slopes(
    arm: Arm, cut: CutArm, conditions: Conditions, chosen: Float[Array | np.ndarray, "m R"] | None = None
) -> Slopes:
    """Differentiate what a campaign would measure, exactly, by compliances at zero and by given numbers.

    A hinge of compliance c P, P a projector, turns by psi = -c P g, where g is the potential's gradient by psi. So,
    with H the Hessian of the arm without hinges, the static equilibrium moves by

        d psi_s/dc = -P g,    d phi_s/dc = -H^-1 (d grad V/d psi) d psi_s/dc,

    and a mass-normalised mode v of eigenvalue l, whose gradient at the hinge is m = ((H - l M) v)_psi, has

        dl/dc = -m' P m + the change of v' (H - l M) v along the equilibrium's move.

    A number x of the arm moves the equilibrium by -H^-1 d(grad V)/dx, and adds d(v' (H - l M) v)/dx. Nothing is solved
    but the arm as it is, so hinges between which there is no mass do no harm.

    Args:
        arm: the arm as it was fitted.
        cut: the same arm, cut at hinges.
        conditions: those of the campaign.
        chosen: one for the mode that each labelled value was taken for; by default as the labels alone have it.

    References:
        Lancaster, "On eigenvalues of matrices dependent on a parameter", Numer. Math. 6, 1964. For hinges: ours,
        compared with arms that have stiff bushings there in tests/identify/test_slopes.py.
    """
    at, modes, rest, shapes = _at_rest(arm, cut, conditions)
    still, own, n, count = chains(cut.arm, {}, conditions), np.array(cut.own), len(cut.arm.joints), len(cut.own)
    hinges, squared = np.array([hinge.place for hinge in cut.hinges], int), (2 * jnp.pi * modes.frequency) ** 2

    def of_mode(phi: Phi, v: Phi, eigenvalue: Float[Array, "S"]) -> Float[Array, ""]:
        return _of_mode(still, phi, v, eigenvalue).sum()

    by_phi, by_shape = jax.vmap(jax.grad(of_mode, (0, 1)), (None, 0, 0))(rest, shapes, squared)
    moment, gradient = by_shape[:, :, hinges] / 2, unflatten(potential_gradient(still, rest))[:, hinges]
    projectors = [K[:, :, hinges] for K in (still.bend, still.tors)]
    turns = jnp.concatenate([_one_each(-matvec(P, gradient), hinges, n) for P in projectors])
    turns = jnp.concatenate([turns, jnp.zeros((3 * count, *rest.shape))])
    amounts = jnp.concatenate([jnp.zeros((2 * len(hinges), 3 * count)), jnp.eye(3 * count)])

    def gradients(x: Array, phi: Phi) -> tuple[Float[Array, "n3 S"], Float[Array, "m S"]]:
        chain = chains(_changed(cut, x), {}, conditions)
        each = jax.vmap(lambda v, eigenvalue: _of_mode(chain, phi, v, eigenvalue))(shapes, squared)
        return potential_gradient(chain, phi), each

    def along(way: tuple[Array, Array]) -> Any:
        return jax.jvp(gradients, (jnp.zeros(3 * count), rest), way)[1]

    together = rest.shape[2] <= MANY and n <= LONG
    each_amount = jax.vmap(along) if together else lambda ways: jax.lax.map(along, ways)
    forces, change = each_amount((amounts, turns))
    yielded = jnp.concatenate([jnp.einsum("mahs,abhs,mbhs->hms", moment, P, moment) for P in projectors])
    moves = -jax.vmap(lambda force: _solve(at.W, unflatten(force)[:, own]))(forces)
    change = change.at[: len(yielded)].add(-yielded) + jnp.einsum("mans,eans->ems", by_phi[:, :, own], moves)
    hertz, ways = change / (8 * jnp.pi**2 * modes.frequency), turns.at[:, :, own].set(moves)
    readings = conditions.readings
    reads = jax.vmap(lambda way: jax.jvp(lambda phi: read(still, phi, readings), (rest,), (way,))[1])(ways)
    choice = mode_choice(conditions, modes, chosen)
    rows = jax.vmap(lambda f, r: _rows(f, r, choice, conditions))(hertz, reads)
    parts = np.cumsum([len(hinges), len(hinges), count, count])
    return Slopes(_rows(modes.frequency, read(still, rest, readings), choice, conditions), *jnp.split(rows, parts))


slopes_once = jit(unwrap(slopes), RUNS_ONCE)
"""The same, for a campaign that is not looked at in many parts."""


def _at_rest(
    arm: Arm, cut: CutArm, conditions: Conditions
) -> tuple[StaticEquilibrium, Modes, Phi, Float[Array, "m 3 n S"]]:
    """Return equilibrium and modes of the arm, and both in the coordinates of the one that is cut."""
    chain = chains(arm, {}, conditions)
    at = static_equilibrium(chain)
    modes, own = modes_about(chain, at), np.array(cut.own)
    rest = jnp.zeros((3, len(cut.arm.joints), *at.phi.shape[2:])).at[:, own].set(at.phi)
    shapes = jax.vmap(unflatten, 1)(modes.shape)
    return at, modes, rest, jnp.zeros((len(shapes), *rest.shape)).at[:, :, own].set(shapes)


def _of_mode(chain: Chain, phi: Phi, v: Phi, eigenvalue: Float[Array, "S"]) -> Float[Array, "S"]:
    """Return v' (H - l M) v."""
    H, M = second_variations(chain, phi, v)
    return H - eigenvalue * M


def _changed(cut: CutArm, amounts: Float[Array, "amounts"]) -> Arm:
    """Change the masses, the mass centres and the torsion of the joints that the arm had before."""
    mass, centre, servo = jnp.split(amounts, 3)
    joints = list(cut.arm.joints)
    for j, place in enumerate(cut.own):
        joints[place] = eqx.tree_at(lambda joint: joint.k_tors, joints[place], joints[place].k_tors / (1 + servo[j]))
        way, factor = centre[j] * cut.link_end(place), 1 + mass[j]
        for piece in cut.pieces(place):
            link = tuple(_heavier(body, factor, way) for body in joints[piece].link)
            joints[piece] = eqx.tree_at(lambda joint: joint.link, joints[piece], link)
    return eqx.tree_at(lambda arm: arm.joints, cut.arm, tuple(joints))


def _heavier(body: Body, factor: Array, way: Float[Array, "3"]) -> Body:
    numbers = body.mass * factor, body.com + way, body.inertia * factor
    return eqx.tree_at(lambda body: (body.mass, body.com, body.inertia), body, numbers)


def _one_each(turn: Float[Array, "3 H S"], hinges: np.ndarray, n: int) -> Float[Array, "H 3 n S"]:
    """Return for each hinge the turns of all bushings where only that one turns."""
    alone = np.equal.outer(hinges, np.arange(n)).astype(float)
    return jnp.einsum("ahs,hn->hans", turn, alone)


def _solve(W: Array, force: Phi) -> Phi:
    return unflatten(matvec(transpose(W), matvec(W, flat(force))))


def _rows(
    frequency: Float[Array, "m S"], reads: Float[Array, "r"], choice: Choices, conditions: Conditions
) -> Float[Array, "D"]:
    named, unnamed, first = conditions.named, conditions.unnamed, conditions.named.frequencies
    values = [
        pick(frequency, choice[0][:, :first], named.states[:first]),
        jnp.zeros(named.others),
        pick(frequency, choice[1], unnamed.states),
        reads,
    ]
    return jnp.concatenate(values)[conditions.order]
