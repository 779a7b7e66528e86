"""Which computed mode each labelled value belongs to: found anew between the steps of a fit, held within each.

Design. The label of a value is data: somebody saw how the arm moved and named it. So it has a likelihood.

1. A computed mode is called `vertical` with probability Phi((v - 1/2) / sd), v its share of vertical motion at the end
   point, `torsion` likewise by its share of strain energy; never with probability zero, so that every label has a mode
   at every start. Modes of one frequency have no shapes of their own, but any choice among them fits as well.
2. The modes of a state are named independently, ascending; `vertical bending 2` is the second that bears the name.
3. E-step: of all ways to name the modes the most probable one picks a mode for each label, for different labels
   different ones: a chain whose state is the number of each name so far (Viterbi; Rabiner 1989). What was measured
   counts too, each value by no more than `FAR` (it may be an outlier): so data decide between names by a near draw and
   never overrule clear ones. Where the arm's numbers are off, so are shares and frequencies: the sd of both grow with
   the misfit of the last step, as where a variance is estimated along (annealing: Ueda, Nakano 1998). Without that, 9
   of 16 starts of a six-axis arm are lost; with it, none (tests/benchmarks/labels.py).
4. M-step: each value stays with the shape it has, known again by the largest overlap (v' M u)^2 (modal assurance
   criterion in the mass metric), so that a step is smooth least squares; no shape is differentiated. Where an accepted
   step leads to where another naming is more probable, the search begins anew there (`least_squares.solve`).
5. A start that finds no end so goes on with the order of the modes that the best start so far found, and at last holds
   what it has: it ends in an optimum all the same, and the fit says that its labels contradict it.

References:
    Dempster, Laird, Rubin, J. R. Stat. Soc. B 39, 1977 (E-step, M-step; with the most probable choice in place of the
    weights: Celeux, Govaert, Comput. Stat. Data Anal. 14, 1992).
    Rabiner, Proc. IEEE 77, 1989, section III B. Ueda, Nakano, Neural Networks 11, 1998.
    Allemang, "The modal assurance criterion: twenty years of use and abuse", Sound and Vibration, 2003.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr
from jaxtyping import Array, Bool, Float

from ident.arm.labels import AMBIGUOUS, Label, fits, torsion_share, vertical_share
from ident.arm.modes import Modes
from ident.identify.conditions import Conditions
from ident.inference.parameters import AnyArray
from ident.inference.problem import Data

NAMING_SD = AMBIGUOUS / 2
"""Standard deviation with which a person sees a share: where a name is a near draw, two of them from one half."""
SHARES_MOVE = 3.0
"""By how much a share is off where the frequencies are off by so many times less, as the stiffnesses then are."""
FAR = 9.0
"""Most that one value may say for or against a mode, as a squared number of sigma."""
AT_FIRST = 0.3
"""By how much the frequencies of a start may be off, as a fraction: a factor of e in stiffness makes 0.5 at most."""
NEVER = 1e12
"""Cost of what cannot be."""

NAMES = tuple((direction, kind) for direction in ("vertical", "lateral") for kind in ("bending", "torsion"))


class Labelled(NamedTuple):
    """The labelled values of a campaign: frequencies, then damping ratios.

    Attributes:
        labels: label of each.
        states: state of each.
        rows: its place in the campaign.
        is_frequency: whether it is a frequency.
        patterns: the different pairs of direction and kind.
        top: largest ordinal of each.
        places: place of each value's label in the table of labels, ordered by pattern and ordinal.
    """

    labels: tuple[Label, ...]
    states: np.ndarray
    rows: np.ndarray
    is_frequency: np.ndarray
    patterns: tuple[tuple[str | None, str | None], ...]
    top: tuple[int, ...]
    places: np.ndarray


def labelled(conditions: Conditions) -> Labelled:
    """Collect the labelled values."""
    found = [
        (label, state, row)
        for modal in (conditions.frequency, conditions.damping)
        for label, state, row in zip(modal.labels, modal.states, modal.rows, strict=True)
        if label
    ]
    labels, states, rows = zip(*found, strict=True) if found else ((), (), ())
    patterns = tuple(dict.fromkeys((label.direction, label.kind) for label in labels))
    top = tuple(max(la.ordinal for la in labels if (la.direction, la.kind) == pattern) for pattern in patterns)
    first = np.concatenate([[0], np.cumsum(top)])
    places = [first[patterns.index((la.direction, la.kind))] + la.ordinal - 1 for la in labels]
    frequency = np.isin(rows, conditions.frequency.rows)
    return Labelled(labels, np.array(states, int), np.array(rows, int), frequency, patterns, top, np.array(places, int))


def name_costs(modes: Modes, off: Float[AnyArray, "*#batch"] | float = 0.0) -> dict[str, Float[Array, "m S *batch"]]:
    """Return -2 ln(probability) of each word for each mode, as far as the arm's numbers may be off."""
    sd = jnp.hypot(NAMING_SD, SHARES_MOVE * off)
    lean = {"vertical": (vertical_share(modes) - 0.5) / sd, "torsion": (torsion_share(modes) - 0.5) / sd}
    cost = {word: -2 * log_ndtr(x) for word, x in lean.items()}
    opposite = {"lateral": "vertical", "bending": "torsion"}
    return cost | {word: -2 * log_ndtr(-lean[other]) for word, other in opposite.items()}


def label_costs(values: Labelled, modes: Modes) -> Float[Array, "m R *batch"]:
    """Return -2 ln(probability) that each mode bears the words of each value's label."""
    cost = name_costs(modes)
    words = [[word for word in (label.direction, label.kind) if word] for label in values.labels]
    return jnp.stack([sum(cost[w][:, s] for w in ws) for ws, s in zip(words, values.states, strict=True)], 1)


def said_costs(values: Labelled, modes: Modes, chosen: Float[Array, "m R *batch"]) -> Float[Array, "R *batch"]:
    """Return what speaks against each label where it is put: -2 ln(probability of its words), and `FAR` for a number.

    The number is wrong where not just so many modes up to there move as the label says rather than otherwise.
    """
    cost, rank = label_costs(values, modes), modes.frequency.ndim - 2
    likely = jnp.stack([fits(label, modes)[:, s] for label, s in zip(values.labels, values.states, strict=True)], 1)
    count = (jnp.cumsum(likely, 0) * chosen).sum(0)
    ordinal = np.array([label.ordinal for label in values.labels]).reshape((-1,) + (1,) * rank)
    return (cost * chosen).sum(0) + FAR * (count != ordinal)


def most_probable(
    values: Labelled, modes: Modes, data: Data | None, off: Float[AnyArray, "*batch"] | float
) -> Float[Array, "m R *batch"]:
    """Return one for the mode that each labelled value belongs to by the most probable naming, zero for the others.

    Args:
        values: the labelled values.
        modes: all modes of all states.
        data: what was measured; None for the labels alone.
        off: by how much the frequencies are off, as a fraction, see `how_far_off`; zero where none is fitted.
    """
    modes, data, off = jax.lax.stop_gradient((modes, data, off))
    if data is not None:
        off = jnp.where(_fitted(values, data, modes.frequency.ndim - 2).any(0), off, 0.0)
    cost = name_costs(modes, off)
    names = jnp.stack([cost[direction] + cost[kind] for direction, kind in NAMES], 1)
    against = jnp.zeros((len(names), sum(values.top) + 1, *names.shape[2:]))
    against = against.at[:, values.places, values.states].add(_misfits(values, modes, data, off))
    return _best_naming(values, names, against)[:, values.places, values.states]


def how_far_off(
    values: Labelled, modes: Modes, data: Data, chosen: Float[Array, "m R *batch"]
) -> Float[Array, "*batch"]:
    """Return the root mean square of ln(computed / measured) over the labelled frequencies that are fitted."""
    hertz = (modes.frequency[:, values.states] * chosen).sum(0)
    measured, _ = _aligned(values, data, hertz.ndim - 1)
    counts = _fitted(values, data, hertz.ndim - 1)
    squared = jnp.where(counts, jnp.log(jnp.where(counts, hertz / measured, 1.0)) ** 2, 0.0)
    return jax.lax.stop_gradient(jnp.sqrt(squared.sum(0) / jnp.maximum(counts.sum(0), 1)))


def _misfits(values: Labelled, modes: Modes, data: Data | None, off: AnyArray | float) -> Float[Array, "m R *batch"]:
    """Return the squared misfit of each labelled frequency with each mode, in sigma; zero for a damping ratio."""
    near = modes.frequency[:, values.states]
    if data is None:
        return jnp.zeros_like(near)
    measured, sigma = _aligned(values, data, near.ndim - 2)
    squared = ((near - measured) / jnp.hypot(sigma, off * measured)) ** 2
    frequency = values.is_frequency.reshape((-1,) + (1,) * (near.ndim - 2))
    return jnp.where(frequency, jnp.minimum(squared, FAR), 0.0)


def _fitted(values: Labelled, data: Data, rank: int) -> Bool[Array, "R *batch"]:
    """Return which labelled values are frequencies that count in the fit."""
    _, sigma = _aligned(values, data, rank)
    return jnp.logical_and(values.is_frequency.reshape((-1,) + (1,) * rank), jnp.isfinite(sigma))


def _aligned(values: Labelled, data: Data, rank: int) -> tuple[Array, Array]:
    measured, sigma = (jnp.reshape(x, x.shape + (1,) * (1 + rank - x.ndim))[values.rows] for x in data)
    return measured, sigma


def overlap(shapes: Float[Array, "n m R"], M: Float[Array, "n n R"], reference: Float[AnyArray, "n R"]) -> Array:
    """Return the squared overlap (m, R) of each value's reference shape with each mode: (v' M u)^2."""
    return (shapes * (M * reference[None]).sum(1)[:, None]).sum(0) ** 2


def _best_naming(values: Labelled, names: Float[Array, "m 4 *batch"], against: Float[Array, "m T *batch"]) -> Array:
    """Return one where a mode has the label of a place by the naming of least cost, zero for the others (m, T, *batch).

    The least cost of naming all modes from one on depends on the number of each name before it, and so is found from
    the last mode to the first one (Viterbi); the way back gives the names.
    """
    follow, given = _steps(values)
    shape, rank = names.shape[2:], names.ndim - 2
    to_go = jnp.where(_complete(values, shape[0]).reshape((-1, shape[0]) + (1,) * (rank - 1)), 0.0, NEVER)

    def name_one(to_go: Array, mode: tuple[Array, Array]) -> tuple[Array, Array]:
        cost = mode[0][None] + mode[1][given].sum(2) + to_go[follow]
        return cost.min(1), jnp.argmin(cost, 1)

    _, name = jax.lax.scan(name_one, jnp.broadcast_to(to_go, (len(follow), *shape)), (names, against), reverse=True)

    def walk(before: Array, name: Array) -> tuple[Array, Array]:
        own = jnp.take_along_axis(name, before[None], 0)[0]
        return jnp.asarray(follow)[before, own], jnp.asarray(given)[before, own]

    _, places = jax.lax.scan(walk, jnp.zeros(shape, int), name)
    numbers = np.arange(against.shape[1]).reshape((-1,) + (1,) * rank)
    return (jnp.moveaxis(places, -1, 1)[:, :, None] == numbers).any(1).astype(float)


def _steps(values: Labelled) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each number of names before a mode and each name of it, these numbers after it (C, 4).

    And the places of the labels that it then has (C, 4, n), one that is none's where there are fewer. Beyond the
    largest ordinal that is asked for, numbers are all the same.
    """
    sizes = [top + 1 for top in values.top]
    first = np.concatenate([[0], np.cumsum(values.top)])
    nothing = int(first[-1])
    borne = [[axis for axis, pattern in enumerate(values.patterns) if _bears(name, pattern)] for name in NAMES]
    follow = np.zeros((math.prod(sizes), len(NAMES)), int)
    given = np.full((*follow.shape, max(map(len, borne))), nothing)
    for before, count in enumerate(np.ndindex(*sizes)):
        for i, axes in enumerate(borne):
            after = np.array(count)
            for slot, axis in enumerate(axes):
                if count[axis] < values.top[axis]:
                    given[before, i, slot] = first[axis] + count[axis]
                    after[axis] += 1
            follow[before, i] = np.ravel_multi_index(tuple(after), sizes)
    return follow, given


def _bears(name: tuple[str, str], pattern: tuple[str | None, str | None]) -> bool:
    return all(word in (None, own) for word, own in zip(pattern, name, strict=True))


def _complete(values: Labelled, states: int) -> Bool[np.ndarray, "C S"]:
    """Return at which numbers of names a state has all the labels that were seen in it."""
    asked = np.zeros((len(values.patterns), states), int)
    for label, state in zip(values.labels, values.states, strict=True):
        place = values.patterns.index((label.direction, label.kind))
        asked[place, state] = max(asked[place, state], label.ordinal)
    counts = np.indices([top + 1 for top in values.top]).reshape(len(values.top), -1)
    enough: np.ndarray = np.all(counts[:, :, None] >= asked[:, None], 0)
    return enough
