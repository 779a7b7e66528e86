"""The main job in one call: an arm and a campaign in, a fit out, with its warnings."""

from collections.abc import Callable, Collection, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import partial
from inspect import unwrap
from itertools import combinations
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from ident.arm.arm import Arm, stiffness_or_stiffest
from ident.arm.chain import Chain
from ident.arm.fields import STIFFNESS
from ident.arm.hinges import CutArm, cut
from ident.arm.mechanics import Phi, flat, potential_gradient, second_variations, static_equilibrium, unflatten
from ident.arm.modes import modes_about
from ident.arm.rotations import matvec, transpose
from ident.identify.conditions import Conditions
from ident.identify.damping import RATIO, Damping, Poles, damping_of
from ident.identify.hypotheses import KINDS
from ident.identify.mode_matching import FAR
from ident.identify.predict import ArmModel, Matching, chains, mode_choice, picked, read, vector_of
from ident.identify.problem import Posed, Ramp, check_values, pose, ramps_of, repeated, row_names
from ident.identify.unknowns import Unknowns, is_damping
from ident.inference.fit import FIT_STARTS, Fit, cross_predictions, fit, with_stretch
from ident.inference.information import ScoreTest, asked_for, score_tests
from ident.inference.optima import fixed_combinations
from ident.inference.problem import DISCREPANCY_PREFIX, InverseProblem
from ident.inference.scrutiny import SUSPICIOUS, Exchange, Moves, Pair, exchanges, robust_weights, weighted
from ident.inference.search import End, look, solve
from ident.measure import Campaign, Measurement
from ident.measure.load import SHAPES
from ident.programs import RUNS_ONCE, Progress, jit

if TYPE_CHECKING:
    from ident.identify.explanations import Explanations


# -------- Slopes
# How predictions change with what a fit assumes: with compliances at zero, and with given numbers.

Choices = tuple[Float[Array, "m R"], Float[Array, "m n"]]
"""The modes of the named and of the unnamed values, as `mode_choice` gives them."""
MANY = 64
"""States above which one amount is changed after the other, for the memory that all of them together would take."""
LONG = 24
"""Bushings above which that is done, too: an arm of 24 joints, cut at 49, would take 5 GB."""


class Slopes(NamedTuple):
    """A campaign's predictions [SI] and their derivatives; zero in the rows of shapes.

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
"""The same, for a campaign that is not looked at in many parts."""


def _of_mode(chain: Chain, phi: Phi, v: Phi, eigenvalue: Float[Array, "S"]) -> Float[Array, "S"]:
    """Return v' (H - l M) v."""
    H, M = second_variations(chain, phi, v)
    return H - eigenvalue * M


def _changed(cut: CutArm, amounts: Float[Array, "amounts"]) -> Arm:
    """Change the masses, the mass centres and the torsion of the joints that the arm had before."""
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


def _rows(frequency: Array, reads: Array, choice: Choices, conditions: Conditions) -> Float[Array, "D"]:
    named, unnamed, first = conditions.named, conditions.unnamed, conditions.named.frequencies
    labelled = picked(frequency[:, named.states[:first]], choice[0][:, :first])
    values = [labelled, jnp.zeros(named.shapes), picked(frequency[:, unnamed.states], choice[1]), reads]
    return jnp.concatenate(values)[conditions.order]


# -------- Assumptions
# What a fit of an arm assumes: rigid base and links, given masses, a servo that holds.


@dataclass(frozen=True)
class Assumption:
    """One assumption of a fit.

    Attributes:
        kind: one of `hypotheses.KINDS`.
        joint: name of the joint whose link or servo it is; empty for the base.
        test: what the plausible amount would move, and whether the data ask for it.
    """

    kind: str
    joint: str
    test: ScoreTest


@dataclass(frozen=True)
class Assumptions:
    """All assumptions of a fit.

    Attributes:
        items: each with its test.
        height: [m] below bushing 1 at which a base is thought to give.
    """

    items: tuple[Assumption, ...]
    height: float

    @property
    def asked_for(self) -> tuple[Assumption, ...]:
        """What the data ask for, most of all first."""
        return tuple(self.items[place] for place in asked_for([item.test for item in self.items]))


def assumptions(fit: Fit, posed: Posed) -> Assumptions:
    """Say of each assumption of a fit how far its violation might move the answer, and what evidence the data give.

    Shapes are left out, and rows with a servo on, where the arm has servos. An arm that has an undriven joint at its
    foot or within a link assumes nothing there. What a discrepancy factor scales is scaled here as well.

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
    """Return how the campaign's predictions change; part by part where it is large."""
    parts, each = ArmModel(fitted, conditions).in_parts(), []
    differentiated = slopes if len(parts.models) > 1 else slopes_once
    for part, own in zip(parts.models, parts.split(held), strict=True):
        # without the modes of motors that servos hold: the last where none is
        chosen = None if own is None else np.asarray(own.place)[: fitted.degrees_of_freedom]
        each.append(jax.device_get(differentiated(fitted, pieces, part.conditions, chosen)))
    joined = [np.concatenate(columns, -1)[..., parts.places] for columns in zip(*each, strict=True)]
    return Slopes(*joined)  # type: ignore[arg-type]  # fetched from jax


def _each(arm: Arm, pieces: CutArm, changed: Slopes) -> "list[tuple[tuple[str, str], Float[np.ndarray, 'D']]]":
    """Return what is assumed, by kind and joint, with the change of the predictions by each share."""
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
    """Return those of one kind."""
    return tuple(item for item in items if item.kind == kind)


# -------- Exchangeable
# Which values of a campaign may have been taken for each other, and which row each belongs to once exchanged.

MOST = 300
"""Values up to which all pairs are looked at; of more, those of the values that are farthest off."""


def exchangeable(campaign: Campaign, far_off: Sequence[int] = ()) -> Iterator[Pair]:
    """Yield the places of values of one kind that may be taken for each other: at one posture, or of one name.

    Frequencies without a label are never so at one posture, as their order alone tells them apart. Shapes are not, as
    what is predicted of one is scaled to what was measured.

    Args:
        campaign: what was measured.
        far_off: where there are more than `MOST` values, pairs must have one of these places.
    """
    rows = campaign.measurements
    if len(rows) <= MOST:
        pairs: Iterable[Pair] = combinations(range(len(rows)), 2)
    else:
        pairs = sorted({(min(i, j), max(i, j)) for i in far_off for j in range(len(rows)) if i != j})
    for i, j in pairs:
        a, b = rows[i], rows[j]
        if a.kind == b.kind and a.kind not in SHAPES and (_state(a) == _state(b)) != (_name(a) == _name(b)):
            yield i, j


def moves_of(campaign: Campaign) -> Callable[[Pair], Moves]:
    """Return what tells which row gets the value of which other one, where two values are exchanged.

    A frequency without a label may take another place in the order of its new state, and so move others there.
    """
    rows, states = campaign.measurements, [_state(m) for m in campaign]
    ascending: dict[tuple[object, ...], list[int]] = {}
    for i in sorted(range(len(rows)), key=lambda i: rows[i].value):
        if rows[i].kind == "frequency" and not rows[i].mode:
            ascending.setdefault(states[i], []).append(i)

    def moves(pair: Pair) -> Moves:
        source = {pair[0]: pair[1], pair[1]: pair[0]}
        for state in {states[i] for i in pair}:
            own = ascending.get(state, [])
            if set(pair) & set(own):
                values = sorted((source.get(i, i) for i in own), key=lambda i: rows[i].value)
                source |= dict(zip(own, values, strict=True))
        return source

    return moves


def _state(m: Measurement) -> tuple[object, ...]:
    return m.posture, m.load, m.reference_load, m.drives


def _name(m: Measurement) -> tuple[object, ...]:
    return m.mode, m.point, m.direction, m.joint, m.reference_point, m.reference_direction


# -------- Fit

FARTHEST = 20
"""Values farthest off of which it is asked, in a large campaign, whether they were taken for others."""
NAMED = 30
"""Rows that a remark names at most."""
ROUNDS, STILL = 4, 0.05
"""Fits at most while damped modes move by damping; standard deviations that count as none."""
LEAST_CHANGE = 0.1
"""Change of chi-squared that is worth a word; assumed."""


@dataclass(frozen=True)
class Loop(Ramp):
    """The loop that a ramp of loads went through.

    Attributes:
        width: [m or rad] what was read while unloading, less what was read at the same load while loading.
        largest: [m or rad] the largest value that was read.
    """

    width: float
    largest: float


@dataclass(frozen=True, kw_only=True)
class CampaignFit(Fit):
    """A fit of an arm to a campaign.

    Attributes:
        arm: with the numbers of its file.
        campaign: what was measured, damping ratios aside.
        assumptions: what it assumes, and what a violation may move; None where no optimum was reached.
        exchanges: which two values, exchanged, would make data fit that do not.
        weights: (D,) by which each value counts in a robust fit, see `ident.inference.scrutiny`; None in any other.
        explanations: what would reconcile the data, see `ident.identify.explanations`; None where that was not asked.
        damping: the law of damping given these stiffnesses; None where no damping ratio was measured.
        poles: what was taken of it for frequencies and shapes of damped modes.
    """

    arm: Arm
    campaign: Campaign
    assumptions: Assumptions | None = None
    exchanges: tuple[Exchange, ...] = ()
    weights: Float[np.ndarray, "D"] | None = None
    explanations: "Explanations | None" = None
    damping: Damping | None = None
    poles: Poles = field(default_factory=Poles)

    @property
    def off(self) -> Float[np.ndarray, "D"]:
        """(predicted - measured) / sigma, with the sigmas as they were said."""
        return self.residuals if self.weights is None else self.residuals / np.sqrt(self.weights)

    @property
    def standardised(self) -> Float[np.ndarray, "D"]:
        """(predicted - measured) / standard deviation of that, see `RowTests.z`, with the sigmas as they were said."""
        return self.row_tests.z if self.weights is None else self.row_tests.z / np.sqrt(self.weights)

    @property
    def farthest_off(self) -> tuple[int, ...]:
        """Places of the fitted measurements, that of the largest standardised residual first."""
        off = np.where(np.isfinite(np.asarray(self.problem.sigma)), np.abs(np.nan_to_num(self.standardised)), -1.0)
        order = np.argsort(-off, kind="stable")
        return tuple(order[off[order] >= 0].tolist())

    @property
    def suspicious(self) -> Bool[np.ndarray, "D"]:
        """Which values are too far off: for so many, or to count for more than half in a robust fit."""
        return self.outliers if self.weights is None else self.weights < SUSPICIOUS

    @property
    def p_value(self) -> float:
        """Chance of a larger chi-squared, see `Fit`; NaN of a robust fit, whose weights hide what is off."""
        return super().p_value if self.weights is None else np.nan

    @property
    def mislabelled(self) -> bool:
        """Whether the modes that fit best are not those that labels and values make most probable."""
        return not self.choice.settled

    @property
    def renamed(self) -> tuple[int, ...]:
        """Places of the measurements whose mode has another label on the fitted arm than was measured."""
        return tuple(np.flatnonzero(np.asarray(self.choice.cost) >= FAR).tolist())

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why no interval should be quoted from this fit; empty when there is no objection."""
        contradict = "the measured frequencies match other modes than their labels say: check the labels"
        return (*((contradict,) if self.mislabelled else ()), *super().doubts)

    @property
    def in_doubt(self) -> bool:
        """Whether there is any objection to the fit, or evidence against one of its assumptions."""
        return bool(self.doubts or (self.assumptions and self.assumptions.asked_for))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is odd about this fit, though it forbids no interval."""
        names = row_names(self.campaign)
        rows = _several([f"{names[i]} ('{self.campaign.measurements[i].mode}')" for i in self.renamed])
        mode = "this mode has another label: row" if len(self.renamed) == 1 else "these modes have other labels: rows"
        renamed = (f"on the fitted arm {mode} {rows}",) if rows else ()
        single = (self.blamed_in_words,) if self.blamed_in_words else ()
        alone = [names[i] for i in np.flatnonzero(self.row_tests.unchecked)]
        several = f"row{'s' * (len(alone) > 1)} {_several(alone)}"
        unchecked = (f"no other measurement can check {several}: an error would go unnoticed",) if alone else ()
        return (*super().remarks, *renamed, *single, *unchecked, *self.exchanges_in_words)

    @property
    def without_rounding(self) -> tuple[float, int]:
        """Chi-squared and degrees of freedom without how readings of one thing differ that a display has rounded.

        They may all be equal, however large their sigmas: the display's steps hide that they are not.
        """
        chi_squared, freedom = self.chi_squared, self.degrees_of_freedom
        if self.problem.correlation is not None or self.weights is not None:
            return chi_squared, freedom if self.weights is None else 0
        measured, sigma = np.asarray(self.problem.measured), np.asarray(self.problem.sigma)
        for rows in repeated(self.campaign):
            own = [i for i in rows if np.isfinite(sigma[i])]
            if len(own) > 1 and any(self.campaign.measurements[i].resolution for i in own):
                mean = np.average(measured[own], weights=sigma[own] ** -2)
                chi_squared -= float((((measured[own] - mean) / sigma[own]) ** 2).sum())
                freedom -= len(own) - 1
        return chi_squared, freedom

    @property
    def blamed_in_words(self) -> str:
        """Which rows may be wrong by themselves; nothing where there is but one such row, an outlier, or none."""
        if not self.blamed or (self.outliers.sum() < 2 and len(self.blamed) < 2):
            return ""
        names = row_names(self.campaign)
        units = (", ".join(names[i] for i in own) for own in self.blamed)
        each = " or ".join(f"row{'s' * (',' in unit)} {unit}" for unit in units)
        return f"without {each} no other value is an outlier: check it first"

    @property
    def exchanges_in_words(self) -> tuple[str, ...]:
        """Of each pair of rows, that the data would fit with its two values exchanged."""
        names, words = row_names(self.campaign), []
        for each in self.exchanges:
            one, other = (names[i] for i in each.rows)
            rows = [self.campaign.measurements[i] for i in each.rows]
            labels = all(m.mode for m in rows)
            what, check = ("labels", "check the mode shapes") if labels else ("values", "measure both again")
            better = self.chi_squared - each.chi_squared > LEAST_CHANGE
            change = f" (chi-squared {self.chi_squared:.3g} -> {each.chi_squared:.3g})" if better else ""
            words.append(f"the {what} of rows {one} and {other} are probably swapped{change}: swap them, or {check}")
        return tuple(words)

    @property
    def loops(self) -> tuple[Loop, ...]:
        """The loops of ramps of loads: how far what was read while unloading is from what was read while loading."""
        values = np.abs([m.value for m in self.campaign])
        return tuple(
            Loop(**vars(ramp), width=self.parameters[ramp.name], largest=float(values[list(ramp.rows)].max()))
            for ramp in ramps_of(self.campaign, self.problem, self.information.sd)
        )

    @property
    def fitted_arm(self) -> Arm:
        """The arm with the fitted numbers in place."""
        return self.posed.applied(self.parameters)[0]

    @property
    def posed(self) -> Posed:
        """The campaign posed to the arm."""
        return Posed(self.campaign, self.problem)


def _several(rows: Sequence[str]) -> str:
    """Return rows in a row, of many the first ones."""
    return ", ".join(rows[:NAMED]) + (f" and {len(rows) - NAMED} more" if len(rows) > NAMED else "")


def fit_campaign(
    arm: Arm,
    campaign: Campaign,
    unknowns: Unknowns | None = None,
    *,
    starts: int = FIT_STARTS,
    seed: int = 0,
    trusted: Collection[str] = (),
    robust: str | None = None,
    progress: Progress = iter,
) -> CampaignFit:
    """Fit the joint stiffnesses, and what else is freed, to a campaign; given these its damping to damping ratios.

    Frequencies and shapes of damped modes depend on both: their damping is that of a first search, and the fit is
    repeated with what it finds itself until no row moves.

    Args:
        arm: its stiffnesses are starting values and centres of the priors.
        campaign: the measurements.
        unknowns: what is unknown, and its priors.
        starts: number of starts.
        seed: of the starts.
        trusted: rows whose values are right though implausible, see `check_values`.
        robust: the loss by which values count less that are too far off.
        progress: wraps the numbers of the starts, to show a bar.

    Raises:
        InputError: campaign and arm, or the named parameters, do not fit together; implausible values.
        ModelError: no optimum was reached.
    """
    unknowns = unknowns or Unknowns()
    check_values(with_poles(arm, campaign, unknowns, _damping_of_file(arm, campaign)), trusted)
    search = partial(fit, starts=starts, seed=seed, progress=progress)
    posed, used, best = fit_with_poles(arm, campaign, unknowns, search)
    weights = None if robust is None else robust_weights(best, units_of(posed.campaign), robust)
    if weights is not None:
        best = fit(weighted(posed.problem, weights), starts=starts, seed=seed)
    if unknowns.with_prior != unknowns:
        weak = posed.with_unknowns(unknowns.with_prior).problem
        weak = weak if weights is None else weighted(weak, weights)
        compared, _ = cross_predictions(weak, [o.theta for o in best.optima], seed=seed)
        best = with_stretch(replace(best, cross_predictions=compared))
    granted = assumptions(best, posed) if best.best.converged else None
    known = {each.name: getattr(best, each.name) for each in fields(best)}
    damping = damping_given(arm, posed, best, campaign, unknowns)
    whole = CampaignFit(
        **known, arm=arm, campaign=posed.campaign, assumptions=granted, weights=weights, damping=damping, poles=used
    )
    whole = replace(whole, exchanges=_suspected(whole))
    widths = not whole.doubts
    return replace(whole, combinations=fixed_combinations(whole.problem, whole.end, whole.information, widths=widths))


def _damping_of_file(arm: Arm, campaign: Campaign) -> Poles:
    """Return the arm's own damping where rows depend on what is fitted of it: loss factors too, for one program."""
    coupled = any(m.kind == RATIO for m in campaign) and any(m.of for m in campaign)
    return Poles({path: float(arm.get(path)) for path in arm.paths() if is_damping(path)} if coupled else {})


def fit_with_poles(
    arm: Arm, campaign: Campaign, unknowns: Unknowns, search: Callable[[InverseProblem], Fit]
) -> tuple[Posed, Poles, Fit]:
    """Fit stiffnesses, the damping of damped modes being what their ratios say given these; see `fit_campaign`."""
    poles = _damping_of_file(arm, campaign)
    posed, coupled = with_poles(arm, campaign, unknowns, poles), bool(poles.numbers)
    if coupled and np.isfinite((first := solve(posed.problem, posed.problem.parameters.theta_start)).cost):
        poles = _poles(arm, campaign, unknowns, posed, first)
    for _ in range(ROUNDS):
        used, posed = poles, with_poles(arm, campaign, unknowns, poles)
        best = search(posed.problem)
        poles = _poles(arm, campaign, unknowns, posed, best.end) if coupled else poles
        if not coupled or _moved(arm, campaign, unknowns, (used, poles), best) < STILL:
            break
    return posed, used, best


def with_poles(arm: Arm, campaign: Campaign, unknowns: Unknowns, poles: Poles) -> Posed:
    """Pose a campaign to an arm whose damped modes are as their damping says."""
    posed = pose(poles.on(arm), campaign, unknowns)
    if not any(poles.apart):
        return posed
    return replace(posed, problem=posed.problem.with_sigma(np.hypot(np.asarray(posed.problem.sigma), poles.apart)))


def damping_given(arm: Arm, posed: Posed, end: End | Fit, campaign: Campaign, unknowns: Unknowns) -> Damping | None:
    """Return the law of damping where a fit, or a search, has ended; None where no ratio was measured.

    Args:
        arm: as its file has it.
        posed: the campaign and the arm as it was fitted.
        end: gives the stiffnesses and what is predicted.
        campaign: all rows.
        unknowns: what is unknown.
    """
    if not len(posed.ratios):
        return None
    parameters, theta = posed.problem.parameters, end.best.theta if isinstance(end, Fit) else end.theta
    values = parameters.by_path(parameters.values(np.asarray(theta)))
    own = {name: value for name, value in values.items() if not name.startswith(DISCREPANCY_PREFIX)}
    return damping_of(arm, posed.model, campaign, np.asarray(end.predicted), own, unknowns.named(arm))


def _poles(arm: Arm, campaign: Campaign, unknowns: Unknowns, posed: Posed, end: End) -> Poles:
    """Return the damping of the best law, and by how much rows differ by those that can't be told from it."""
    damping = damping_given(arm, posed, end, campaign, unknowns)
    assert damping is not None
    laws = [Poles(damping.numbers(law)) for law in (damping.best, *damping.rivals)]
    first, *others = (_predicted(arm, campaign, unknowns, poles, end) for poles in laws)
    apart = np.max([np.zeros_like(first), *(np.abs(other - first) for other in others)], 0)
    sigma = np.array([m.sigma for m in posed.campaign])
    return replace(laws[0], apart=tuple(np.where(apart > STILL * sigma, apart, 0.0).tolist()))


def _predicted(arm: Arm, campaign: Campaign, unknowns: Unknowns, poles: Poles, end: End) -> Float[np.ndarray, "D"]:
    return np.asarray(look(with_poles(arm, campaign, unknowns, poles).problem, end.theta, end.choice.held).predicted)


def _moved(arm: Arm, campaign: Campaign, unknowns: Unknowns, pair: tuple[Poles, Poles], best: Fit) -> float:
    """Return by how many sigma a row moves at most from one damping to the next."""
    before, now = (_predicted(arm, campaign, unknowns, poles, best.end) for poles in pair)
    apart = [np.array(poles.apart) if poles.apart else np.zeros(len(now)) for poles in pair]
    off = np.maximum(np.abs(now - before), np.abs(apart[1] - apart[0])) / np.asarray(best.problem.sigma)
    return float(off.max())


def units_of(campaign: Campaign) -> Int[np.ndarray, "D"]:
    """Return the number of each row's unit: rows of a group, and components of a vector, are one."""
    units: dict[Hashable, int] = {}
    rows = enumerate(campaign)
    return np.array([units.setdefault(m.group or vector_of(m) or i, len(units)) for i, m in rows], int)


def _suspected(fit: CampaignFit) -> tuple[Exchange, ...]:
    """Return which two values may have been exchanged, where data or labels do not fit."""
    odd = fit.mislabelled or fit.improbable or fit.outliers.any()
    if not (odd and fit.best.converged and fit.degrees_of_freedom > 0):
        return ()
    pairs = list(exchangeable(fit.campaign, [*fit.farthest_off[:FARTHEST], *fit.renamed[:FARTHEST]]))
    suspected = [pair for pair in pairs if set(pair) <= set(fit.renamed)]
    return exchanges(fit, pairs, suspected, moves_of(fit.campaign))
