"""Matching of labelled values to computed modes: renewed between the searches of a fit, kept within each.

Design. The label of a value is data: a person saw how the arm moved and named it. So it has a likelihood.

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
   step leads to where another naming is more probable, the search begins again there (`search.solve`).
5. A start that finds no end so goes on with the order of the modes that the best start so far found, and at last holds
   what it has: it ends in an optimum all the same, and the fit says that its labels contradict it.

References:
    Dempster, Laird, Rubin, J. R. Stat. Soc. B 39, 1977 (E-step, M-step; with the most probable choice in place of the
    weights: Celeux, Govaert, Comput. Stat. Data Anal. 14, 1992).
    Rabiner, Proc. IEEE 77, 1989, section III B. Ueda, Nakano, Neural Networks 11, 1998.
    Allemang, "The modal assurance criterion: twenty years of use and abuse", Sound and Vibration, 2003.
"""

import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import log_ndtr
from jaxtyping import Array, Bool, Float, Int

from ident.arm.modes import AMBIGUOUS, Label, Modes, torsion_share, vertical_share
from ident.inference.parameters import AnyArray
from ident.inference.problem import Data

NAMING_SD = AMBIGUOUS / 2
"""Standard deviation of a share as seen by a person: a name is ambiguous within two of them from one half."""
SHARES_MOVE = 3.0
"""Error of a share, as a multiple of the relative error of the frequencies, both due to wrong stiffnesses."""
FAR = 9.0
"""Largest evidence of one value for or against a mode, as a squared number of sigma; three sigma."""
AT_FIRST = 0.3
"""Relative error of the frequencies at a start: a factor of e in stiffness gives at most 0.5."""
NEVER = 1e12
"""Cost of the impossible."""

WORDS = (None, "vertical", "lateral"), (None, "torsion", "bending")
"""Words of a label for direction and for kind."""
NAMES = tuple((direction, kind) for direction in ("vertical", "lateral") for kind in ("bending", "torsion"))


class Named(eqx.Module):
    """Modal values with a label: frequencies, then shapes; repeated rows count as one value.

    Attributes:
        states: (R,) state of each.
        ordinals: (R,) the number in its label.
        words: (R, 2) direction and kind in its label, as indices in `WORDS`.
        places: (R,) place of its label in the table of labels, ordered by pattern and ordinal.
        largest: (patterns, S) largest ordinal of each pattern that was seen in each state.
        at: (labels, S) the frequency that has the label of each place in each state; -1 for none, as at the last.
        patterns: the different pairs of direction and kind, as places in `WORDS`.
        top: largest ordinal of each.
        shapes: how many of them, the last ones, are of shapes.
    """

    states: Int[AnyArray, "R"]
    ordinals: Int[AnyArray, "R"]
    words: Int[AnyArray, "R 2"]
    places: Int[AnyArray, "R"]
    largest: Int[AnyArray, "patterns S"]
    at: Int[AnyArray, "labels S"]
    patterns: tuple[tuple[int, int], ...] = eqx.field(static=True)
    top: tuple[int, ...] = eqx.field(static=True)
    shapes: int = eqx.field(static=True, default=0)

    @property
    def frequencies(self) -> int:
        """Number of frequencies among them."""
        return len(self.states) - self.shapes


def name_modes(labels: Sequence[Label], states: np.ndarray, count: int, shapes: int = 0) -> Named:
    """Collect the values that have labels.

    Args:
        labels: of frequencies, then of shapes.
        states: (R,) state of each.
        count: number of states.
        shapes: number of rows of shapes.
    """
    ordinals = np.array([label.ordinal for label in labels], int)
    says = [(WORDS[0].index(label.direction), WORDS[1].index(label.kind)) for label in labels]
    patterns = tuple(sorted(set(says)))
    own = np.array([patterns.index(pair) for pair in says], int)
    largest = np.zeros((len(patterns), count), int)
    np.maximum.at(largest, (own, states), ordinals)
    top = tuple(largest.max(1).tolist())
    places = np.concatenate([[0], np.cumsum(top, dtype=int)])[own] + ordinals - 1
    words = np.array(says, int).reshape(-1, 2)
    at, first = np.full((sum(top) + 1, count), -1), len(states) - shapes
    at[places[:first], states[:first]] = np.arange(first)
    return Named(states, ordinals, words, places, largest, at, patterns, top, shapes)


def name_costs(modes: Modes, off: Float[AnyArray, "*#batch"] | float = 0.0) -> dict[str, Float[Array, "m S *batch"]]:
    """Return -2 ln(probability) of each word for each mode, given the relative error of the frequencies."""
    sd = jnp.hypot(NAMING_SD, SHARES_MOVE * off)
    lean = {"vertical": (vertical_share(modes) - 0.5) / sd, "torsion": (torsion_share(modes) - 0.5) / sd}
    cost = {word: -2 * log_ndtr(x) for word, x in lean.items()}
    opposite = {"lateral": "vertical", "bending": "torsion"}
    return cost | {word: -2 * log_ndtr(-lean[other]) for word, other in opposite.items()}


def _fitting(values: Named, modes: Modes) -> Bool[Array, "m R *batch"]:
    """Return which modes have the direction and kind of each value's label."""
    fits = []
    for axis, share in enumerate((vertical_share(modes), torsion_share(modes))):
        which = jnp.stack([jnp.ones_like(share, bool), share > 0.5, ~(share > 0.5)])
        fits.append(which[values.words[:, axis], :, values.states])
    return jnp.moveaxis(fits[0] & fits[1], 0, 1)


def label_costs(values: Named, modes: Modes, chosen: Float[Array, "m R *batch"]) -> Float[Array, "R *batch"]:
    """Return the cost of each label where it is put: -2 ln(probability of its words), and `FAR` for a number.

    The number is wrong where not just so many modes up to there move as the label says rather than otherwise.
    """
    cost, rank = name_costs(modes), modes.frequency.ndim - 2
    words = [jnp.stack([cost[word] if word else jnp.zeros_like(modes.frequency) for word in axis]) for axis in WORDS]
    direction, kind = (words[axis][values.words[:, axis], :, values.states] for axis in (0, 1))
    count = (jnp.cumsum(_fitting(values, modes), 0) * chosen).sum(0)
    ordinal = jnp.reshape(values.ordinals, (-1,) + (1,) * rank)
    return (jnp.moveaxis(direction + kind, 0, 1) * chosen).sum(0) + FAR * (count != ordinal)


def most_probable(
    values: Named,
    modes: Modes,
    data: Data | None,
    off: Float[AnyArray, "*batch"] | float,
    *,
    hertz: Float[Array, "m R *batch"] | None = None,
) -> Float[Array, "m R *batch"]:
    """Return 1 for the mode of each labelled value by the most probable naming, 0 for the others.

    Args:
        values: the labelled values.
        modes: all modes of all states.
        data: measured values, the labelled ones first; None for the labels alone.
        off: relative error of the frequencies, see `rms_log_error`; zero if none is fitted.
        hertz: frequency of each mode as each value is defined; None for undamped ones.
    """
    modes, data, off, hertz = jax.lax.stop_gradient((modes, data, off, hertz))
    if data is not None:
        off = jnp.where(_fitted(values, data, modes.frequency.ndim - 2).any(0), off, 0.0)
    cost = name_costs(modes, off)
    names = jnp.stack([cost[direction] + cost[kind] for direction, kind in NAMES], 1)
    near = modes.frequency[:, values.states] if hertz is None else hertz
    residuals, rank = jnp.zeros_like(near), near.ndim - 2
    if data is not None:  # in sigma; of a shape there is none
        measured, sigma = _aligned(values, data, rank)
        squared = ((near - measured) / jnp.hypot(sigma, off * measured)) ** 2
        residuals = jnp.where(_are_frequencies(values, rank), jnp.minimum(squared, FAR), 0.0)
    against = jnp.concatenate([residuals, jnp.zeros_like(residuals[:, :1])], 1)[:, values.at]
    return _best_naming(values, names, against)[:, values.places, values.states]


def rms_log_error(
    values: Named, hertz: Float[Array, "m R *batch"], data: Data, chosen: Float[Array, "m R *batch"]
) -> Float[Array, "*batch"]:
    """Return the root mean square of ln(computed / measured) over the labelled frequencies that are fitted."""
    hertz = (hertz * chosen).sum(0)
    measured, _ = _aligned(values, data, hertz.ndim - 1)
    counts = _fitted(values, data, hertz.ndim - 1)
    squared = jnp.where(counts, jnp.log(jnp.where(counts, hertz / measured, 1.0)) ** 2, 0.0)
    return jax.lax.stop_gradient(jnp.sqrt(squared.sum(0) / jnp.maximum(counts.sum(0), 1)))


def _fitted(values: Named, data: Data, rank: int) -> Bool[Array, "R *batch"]:
    """Return which labelled values are frequencies that count in the fit."""
    _, sigma = _aligned(values, data, rank)
    return jnp.logical_and(_are_frequencies(values, rank), jnp.isfinite(sigma))


def _are_frequencies(values: Named, rank: int) -> Bool[np.ndarray, "R *ones"]:
    return np.reshape(np.arange(len(values.states)) < values.frequencies, (-1,) + (1,) * rank)


def _aligned(values: Named, data: Data, rank: int) -> tuple[Array, Array]:
    own = (x[: len(values.states)] for x in data)
    measured, sigma = (jnp.reshape(x, x.shape + (1,) * (1 + rank - x.ndim)) for x in own)
    return measured, sigma


def overlap(shapes: Float[Array, "n m R"], M: Float[Array, "n n R"], reference: Float[AnyArray, "n R"]) -> Array:
    """Return the squared overlap (m, R) of each value's reference shape with each mode: (v' M u)^2."""
    return (shapes * (M * reference[None]).sum(1)[:, None]).sum(0) ** 2


def _best_naming(values: Named, names: Float[Array, "m 4 *batch"], against: Float[Array, "m T *batch"]) -> Array:
    """Return one where a mode has the label of a place by the naming of least cost, zero for the others (m, T, *batch).

    The least cost of naming all modes from one on depends on the number of each name before it, and so is found from
    the last mode to the first one (Viterbi); the way back gives the names.
    """
    follow, given = _steps(values)
    shape, rank = names.shape[2:], names.ndim - 2
    # at which numbers of names a state has all the labels that were seen in it
    counts = np.indices([top + 1 for top in values.top]).reshape(len(values.top), -1)
    complete = jnp.all(counts[:, :, None] >= values.largest[:, None], 0)
    to_go = jnp.where(complete.reshape((-1, shape[0]) + (1,) * (rank - 1)), 0.0, NEVER)

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


def _steps(values: Named) -> tuple[np.ndarray, np.ndarray]:
    """Return, for each number of names before a mode and each name of it, these numbers after it (C, 4).

    And the places of the labels that it then has (C, 4, n), one that is none's where there are fewer. Beyond the
    largest ordinal that is asked for, numbers are all the same.
    """
    sizes = [top + 1 for top in values.top]
    first = np.concatenate([[0], np.cumsum(values.top)])
    nothing = int(first[-1])
    labels = [(WORDS[0][direction], WORDS[1][kind]) for direction, kind in values.patterns]
    borne = [[axis for axis, words in enumerate(labels) if {*words} <= {None, *name}] for name in NAMES]
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
