"""Sensitivity of a fit to its assumptions: the shift of each value by each wrong assumption, and the evidence."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from inspect import unwrap
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm, stiffness_or_stiffest
from ident.arm.chain import Chain
from ident.arm.fields import STIFFNESS
from ident.arm.hinges import CutArm, cut
from ident.arm.mechanics import Phi, flat, potential_gradient, second_variations, static_equilibrium, unflatten
from ident.arm.modes import modes_about
from ident.arm.rotations import matvec, transpose
from ident.identify.conditions import Conditions
from ident.identify.hypotheses import KINDS
from ident.identify.predict import ArmModel, Matching, chains, mode_choice, picked, read
from ident.identify.problem import Posed
from ident.inference.fit import Fit
from ident.inference.information import ScoreTest, asked_for, score_tests
from ident.measure.kinds import SHAPES
from ident.programs import RUNS_ONCE, jit

Choices = tuple[Float[Array, "m R"], Float[Array, "m n"]]
"""The modes of the named and of the unnamed values, from `mode_choice`."""
MANY = 64
"""Number of states above which amounts are changed one after the other, to save memory."""
LONG = 24
"""Number of bushings above which the same holds: an arm of 24 joints, cut at 49, would take 5 GB."""


class Slopes(NamedTuple):
    """A campaign's predictions [SI] and their derivatives; zero in the rows of shapes.

    Attributes:
        predicted: (D,) of the arm itself.
        bending, torsion: (H, D) by the compliance [rad/(N m)] of each hinge across its axis, and about it.
        mass: (N, D) by ln(mass) of the body behind each joint's pin, the inertia scaled with it.
        centre: (N, D) by the displacement of its mass centre along the link, as a share of its length.
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
    """Differentiate a campaign's predictions, exactly, by compliances at zero and by given numbers.

    A hinge of compliance c P, P a projector, turns by psi = -c P g, where g is the potential's gradient by psi. So,
    with H the Hessian of the arm without hinges, the static equilibrium moves by

        d psi_s/dc = -P g,    d phi_s/dc = -H^-1 (d grad V/d psi) d psi_s/dc,

    and a mass-normalised mode v of eigenvalue l, whose gradient at the hinge is m = ((H - l M) v)_psi, has

        dl/dc = -m' P m + the change of v' (H - l M) v along the equilibrium's move.

    A number x of the arm moves the equilibrium by -H^-1 d(grad V)/dx, and adds d(v' (H - l M) v)/dx. Only the original
    arm is solved, so massless parts between hinges are allowed.

    Args:
        arm: the fitted arm.
        cut: the same arm, cut at hinges.
        conditions: of the campaign.
        chosen: 1 for the mode of each labelled value; by default from the labels alone.

    References:
        Lancaster, "On eigenvalues of matrices dependent on a parameter", Numer. Math. 6, 1964. For hinges: ours,
        compared with arms that have stiff bushings there in tests/identify/test_slopes.py.
    """
    chain = chains(arm, conditions)
    at = static_equilibrium(chain)
    modes = modes_about(chain, at)
    still, own, n, count = chains(cut.arm, conditions), np.array(cut.own), len(cut.arm.joints), len(cut.own)
    # equilibrium and modes in the coordinates of the arm that is cut
    rest = jnp.zeros((3, n, *at.phi.shape[2:])).at[:, own].set(at.phi)
    uncut = jax.vmap(unflatten, 1)(modes.shape)
    shapes = jnp.zeros((len(uncut), *rest.shape)).at[:, :, own].set(uncut)
    hinges, squared = np.array([hinge.place for hinge in cut.hinges], int), (2 * jnp.pi * modes.frequency) ** 2

    def of_mode(phi: Phi, v: Phi, eigenvalue: Float[Array, "S"]) -> Float[Array, ""]:
        return _of_mode(still, phi, v, eigenvalue).sum()

    by_phi, by_shape = jax.vmap(jax.grad(of_mode, (0, 1)), (None, 0, 0))(rest, shapes, squared)
    moment, gradient = by_shape[:, :, hinges] / 2, unflatten(potential_gradient(still, rest))[:, hinges]
    projectors = [K[:, :, hinges] for K in (still.bend, still.tors)]
    alone = np.equal.outer(hinges, np.arange(n)).astype(float)  # each hinge turns by itself
    turns = jnp.concatenate([jnp.einsum("ahs,hn->hans", -matvec(P, gradient), alone) for P in projectors])
    turns = jnp.concatenate([turns, jnp.zeros((3 * count, *rest.shape))])
    amounts = jnp.concatenate([jnp.zeros((2 * len(hinges), 3 * count)), jnp.eye(3 * count)])

    def gradients(x: Array, phi: Phi) -> tuple[Float[Array, "n3 S"], Float[Array, "m S"]]:
        chain = chains(_changed(cut, x), conditions)
        each = jax.vmap(lambda v, eigenvalue: _of_mode(chain, phi, v, eigenvalue))(shapes, squared)
        return potential_gradient(chain, phi), each

    def along(way: tuple[Array, Array]) -> Any:
        return jax.jvp(gradients, (jnp.zeros(3 * count), rest), way)[1]

    together = rest.shape[2] <= MANY and n <= LONG
    each_amount = jax.vmap(along) if together else lambda ways: jax.lax.map(along, ways)
    forces, change = each_amount((amounts, turns))
    yielded = jnp.concatenate([jnp.einsum("mahs,abhs,mbhs->hms", moment, P, moment) for P in projectors])
    W = at.W  # the inverse of the Hessian is W' W
    moves = -jax.vmap(lambda force: unflatten(matvec(transpose(W), matvec(W, flat(unflatten(force)[:, own])))))(forces)
    change = change.at[: len(yielded)].add(-yielded) + jnp.einsum("mans,eans->ems", by_phi[:, :, own], moves)
    hertz, ways = change / (8 * jnp.pi**2 * modes.frequency), turns.at[:, :, own].set(moves)
    readings = conditions.readings
    reads = jax.vmap(lambda way: jax.jvp(lambda phi: read(still, phi, readings), (rest,), (way,))[1])(ways)
    choice = mode_choice(conditions, modes, chosen)
    rows = jax.vmap(lambda f, r: _rows(f, r, choice, conditions))(hertz, reads)
    parts = np.cumsum([len(hinges), len(hinges), count, count])
    return Slopes(_rows(modes.frequency, read(still, rest, readings), choice, conditions), *jnp.split(rows, parts))


slopes_once = jit(unwrap(slopes), RUNS_ONCE)
"""The same, for a campaign that is not split into many parts."""


def _of_mode(chain: Chain, phi: Phi, v: Phi, eigenvalue: Float[Array, "S"]) -> Float[Array, "S"]:
    """Return v' (H - l M) v."""
    H, M = second_variations(chain, phi, v)
    return H - eigenvalue * M


def _changed(cut: CutArm, amounts: Float[Array, "amounts"]) -> Arm:
    """Change the masses, the mass centres and the torsion of the original arm's joints."""
    mass, centre, servo = jnp.split(amounts, 3)
    joints = list(cut.arm.joints)
    for j, place in enumerate(cut.own):
        if (k := joints[place].k_tors) is not None:
            joints[place] = eqx.tree_at(lambda joint: joint.k_tors, joints[place], k / (1 + servo[j]))
        way, factor = centre[j] * cut.link_end(place), 1 + mass[j]
        for piece in cut.pieces(place):
            each = [(b, (b.mass * factor, b.com + way, b.inertia * factor)) for b in joints[piece].link]
            link = tuple(eqx.tree_at(lambda b: (b.mass, b.com, b.inertia), *pair) for pair in each)
            joints[piece] = eqx.tree_at(lambda joint: joint.link, joints[piece], link)
    return eqx.tree_at(lambda arm: arm.joints, cut.arm, tuple(joints))


def _rows(
    frequency: Float[Array, "m S"], reads: Float[Array, "r"], choice: Choices, conditions: Conditions
) -> Float[Array, "D"]:
    named, unnamed, first = conditions.named, conditions.unnamed, conditions.named.frequencies
    labelled = picked(frequency[:, named.states[:first]], choice[0][:, :first])
    values = [labelled, jnp.zeros(named.shapes), picked(frequency[:, unnamed.states], choice[1]), reads]
    return jnp.concatenate(values)[conditions.order]


@dataclass(frozen=True)
class Assumption:
    """One assumption of a fit.

    Attributes:
        kind: one of `hypotheses.KINDS`.
        joint: name of the joint with this link or servo; empty for the base.
        test: shift by the plausible amount, and evidence for it in the data.
    """

    kind: str
    joint: str
    test: ScoreTest


@dataclass(frozen=True)
class Assumptions:
    """All assumptions of a fit.

    Attributes:
        items: each with its test.
        height: [m] assumed depth of the base's compliance below bushing 1.
    """

    items: tuple[Assumption, ...]
    height: float

    @property
    def asked_for(self) -> tuple[Assumption, ...]:
        """Assumptions with significant evidence against them, the strongest first."""
        return tuple(self.items[place] for place in asked_for([item.test for item in self.items]))


def assumptions(fit: Fit, posed: Posed) -> Assumptions:
    """Return for each assumption of a fit the shift of the answer by its violation, and the evidence in the data.

    Shapes are left out, as are rows with a servo on if the arm has servos. An arm with an undriven joint at its foot or
    within a link assumes nothing there. Discrepancy factors apply here as well.

    Args:
        fit: of the campaign.
        posed: the campaign and the arm.
    """
    fitted, conditions = posed.applied(fit.parameters)
    pieces, free = cut(fitted), replace(fitted, servos=())
    changed = _slopes(fit.choice.held, free, pieces, jax.device_get(replace(conditions, servo=None)))
    names, changes = zip(*_each(fitted, pieces, changed), strict=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        factor = np.where(changed.predicted != 0, fit.predicted / changed.predicted, 1.0)
    kinds, servos = [KINDS[kind] for kind, _ in names], bool(posed.arm.servos)
    amounts, positive = np.array([kind.plausible for kind in kinds]), [kind.positive for kind in kinds]
    without = np.array([m.kind in SHAPES or (servos and m.drives == "servo") for m in posed.campaign])
    tests = score_tests(fit, np.array(changes) * factor, amounts, positive, without)
    items = tuple(Assumption(kind, joint, test) for (kind, joint), test in zip(names, tests, strict=True))
    return Assumptions(items, pieces.height)


def _slopes(held: Matching | None, fitted: Arm, pieces: CutArm, conditions: Conditions) -> Slopes:
    """Return the derivatives of the campaign's predictions, part by part if it is large."""
    parts, each = ArmModel(fitted, conditions).in_parts(), []
    differentiated = slopes if len(parts.models) > 1 else slopes_once
    for part, own in zip(parts.models, parts.split(held), strict=True):
        # without the modes of motors on servos: the last ones where none is on
        chosen = None if own is None else np.asarray(own.place)[: fitted.degrees_of_freedom]
        each.append(jax.device_get(differentiated(fitted, pieces, part.conditions, chosen)))
    joined = [np.concatenate(columns, -1)[..., parts.places] for columns in zip(*each, strict=True)]
    return Slopes(*joined)  # type: ignore[arg-type]  # fetched from jax


def _each(arm: Arm, pieces: CutArm, changed: Slopes) -> "list[tuple[tuple[str, str], Float[np.ndarray, 'D']]]":
    """Return the assumptions, by kind and joint, with the change of the predictions by each share."""
    names = dict(zip(pieces.own, (joint.name for joint in arm.joints), strict=True))
    each: list[tuple[tuple[str, str], np.ndarray]] = []
    for hinge, bending, torsion in zip(pieces.hinges, changed.bending, changed.torsion, strict=True):
        beside = pieces.arm.joints[hinge.beside]
        fields = STIFFNESS[0], STIFFNESS[not hinge.link]
        across, about = (float(stiffness_or_stiffest(pieces.arm, beside, field)) for field in fields)
        kinds = ("link bends", "link twists") if hinge.link else ("base rocks", "base turns")
        name = names[hinge.beside] if hinge.link else ""
        each += [((kinds[0], name), bending / across), ((kinds[1], name), torsion / about)]
    rows = zip(arm.joints, changed.mass, changed.centre, changed.servo, strict=True)
    for joint, mass, centre, servo in rows:
        each += [(("mass", joint.name), mass), (("mass centre", joint.name), centre)] if joint.link else []
        each += [(("servo gives", joint.name), servo)] if joint.driven and joint.k_tors is not None else []
    return sorted(each, key=lambda pair: list(KINDS).index(pair[0][0]))


def of_kind(items: Sequence[Assumption], kind: str) -> tuple[Assumption, ...]:
    """Return the assumptions of one kind."""
    return tuple(item for item in items if item.kind == kind)
