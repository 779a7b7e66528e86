"""Entry point: from the correlation functions of an ambient test to modes with their joint covariance."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.linalg import block_diag, eigh, solve_triangular
from scipy.stats import t
from threadpoolctl import threadpool_limits

from ident.errors import refusal, require
from ident.measure.speeds import Speed
from ident.modal.ambient import SPEED_SLIP, AmbientTest, turning
from ident.modal.amplitude import AmplitudeTrend, amplitude_trend
from ident.modal.frf import ModeSet
from ident.modal.modes import SHARPEST, chosen_near
from ident.modal.parameters import ModalParameters, Rejected
from ident.modal.poles import Diagram, clustered, distance, physical

# -------- Subspace
# Covariance-driven stochastic subspace identification: poles and shapes of correlation functions, by order.


@dataclass(frozen=True)
class Realisation:
    """Poles and shapes of one order.

    Attributes:
        order: states.
        pole: (m,) [rad/s] complex, of positive frequency.
        shape: (O, m) complex, in the channels' units.
    """

    order: int
    pole: Complex[np.ndarray, "m"]
    shape: Complex[np.ndarray, "O m"]

    @property
    def unit_shape(self) -> Complex[np.ndarray, "O m"]:
        """(O, m) shapes of unit length."""
        return self.shape / np.linalg.norm(self.shape, axis=0)

    def pick(self, kept: np.ndarray) -> "Realisation":
        """Return some of the poles."""
        return Realisation(self.order, self.pole[kept], self.shape[:, kept])


def realisations(
    correlation: Float[np.ndarray, "O R K"], step: float, orders: Sequence[int]
) -> tuple[Realisation, ...]:
    """Return the poles of correlation functions of responses to white noise.

    R(k) = C A^(k - 1) G for lags k >= 1, so that the block Hankel matrix of R(1), R(2), ... is the product of
    observability and controllability; A follows from the shift of the observability by one block row. Lag 0 is not
    used: it contains sensor noise and the direct part of accelerations.

    Args:
        correlation: at lags 0 to K - 1; K even.
        step: [s] between lags.
        orders: numbers of states.

    Returns:
        One realisation for each order. Orders above the numerical rank of the Hankel matrix are limited to its rank,
        since smaller singular values are rounding: a quiet response has fewer states than a noisy one.

    References:
        Peeters, De Roeck, "Reference-based stochastic subspace identification for output-only modal analysis", MSSP 13,
        1999.
    """
    outputs, _, lags = correlation.shape
    rows = lags // 2
    lag = 1 + np.arange(rows)[:, None] + np.arange(rows)
    hankel = np.transpose(correlation[..., lag], (2, 0, 3, 1)).reshape(rows * outputs, -1)
    square = hankel @ hankel.T
    size = len(square)
    power, left = eigh(square, subset_by_index=(size - max(orders), size - 1))
    rank = int(np.sum(power > size * np.finfo(float).eps * power[-1]))
    observability = left[:, : -rank - 1 : -1] * power[: -rank - 1 : -1] ** 0.25
    first, triangle = np.linalg.qr(observability[:-outputs])
    shifted = first.T @ observability[outputs:]
    realised = []
    for n in np.minimum(orders, rank).tolist():
        transition = solve_triangular(triangle[:n, :n], shifted[:n, :n])
        root, vector = (each.astype(complex) for each in np.linalg.eig(transition))
        kept = root.imag > 0
        shape = (observability[:outputs, :n] @ vector)[:, kept]
        realised.append(Realisation(n, np.log(root[kept]) / step, shape))
    return tuple(realised)


# -------- Block jackknife
# The joint covariance of modes of an ambient test: repeat the estimate without each block of the record.

LOST = 3.0
"""Distance from which a pole is another mode, in units of the distance of one mode's poles in neighbouring orders;
assumed."""


@dataclass(frozen=True)
class Tracked(ModeSet):
    """The stable poles of a diagram as modes; shapes are accelerations, one at a response with large motion.

    Attributes:
        lost: (m,) whether leaving out some block turns the pole into another one.
        trend: with amplitude, of a test with taps.
    """

    lost: Bool[np.ndarray, "m"]
    trend: AmplitudeTrend | None

    def pick(self, kept: Sequence[int]) -> "Tracked":
        """Return some of the modes."""
        count, outputs = len(self.frequency), 2 * len(self.shape)
        shapes = [2 * count + i * outputs + k for i in kept for k in range(outputs)]
        at = [*kept, *(count + i for i in kept), *shapes]
        modes = self.frequency[kept], self.damping[kept], self.shape[:, kept], self.covariance[np.ix_(at, at)]
        return Tracked(*modes, self.responses, self.band, self.lost[kept], self.trend and self.trend.pick(kept))


def block_jackknife(test: AmbientTest, diagram: Diagram, blocks: int, amplitude: float | None = None) -> Tracked:
    """Return the stable poles of a diagram as modes with their joint covariance.

    Each number of a mode is the median over the orders in which its cluster has a pole. Without one block, the most
    similar poles of each order take the place of those of the whole record; Var = (B - 1) / B sum_b (x_b - mean)^2,
    widened by Student's t. As that matrix has only rank B - 1, its correlations are shrunk towards zero as far as they
    are uncertain, except those within a shape.

    Args:
        test: the correlation functions.
        diagram: of the whole record.
        blocks: B.
        amplitude: [m] at which free decays give the modes, as far as they cover it; by default in their middle.

    References:
        Kuensch, "The jackknife and the bootstrap for general stationary observations", Ann. Stat. 17, 1989.
        Schaefer, Strimmer, "A shrinkage approach to large-scale covariance matrix estimation", Stat. Appl. Genet. Mol.
        Biol. 4, 2005.
    """
    parts = test.correlations.joined(blocks)
    orders = sorted({int(order) for order in diagram.order[diagram.cluster >= 0]})

    def numbers(correlation: Float[np.ndarray, "O R K"]) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m"]]:
        by_order = dict(zip(orders, realisations(correlation, parts.step, orders), strict=True))
        return _numbers(test, diagram, by_order)

    ones = [numbers(parts.without(b)) for b in range(len(parts.blocks))]
    whole, _ = numbers(parts.mean)
    vectors = np.array([np.concatenate([each[:, 0], each[:, 1], each[:, 2:].ravel()]) for each, _ in ones])
    lost = np.array([apart for _, apart in ones]).max(0) > LOST
    modes, outputs = len(diagram.chosen), len(test.responses)
    shape = whole[:, 2 : 2 + outputs] + 1j * whole[:, 2 + outputs :]
    poles, beyond = whole[:, :2].T, np.zeros(2 * modes)
    trend: AmplitudeTrend | None = None
    if test.decays:
        trend = _trend(test, poles, shape.T)
        seen = trend.seen(poles)
        if amplitude is None:
            beyond = (seen / 2).ravel() ** 2
        else:
            at = np.clip(amplitude, trend.amplitude[2], trend.amplitude[0])
            shifts = [(trend.change(poles, at, slope) * (seen != 0)).ravel() for slope in trend.without]
            vectors[:, : 2 * modes] += shifts
            poles = poles + trend.change(poles, at) * (seen != 0)
    covariance = _covariance(vectors, 2 * modes, 2 * outputs)
    covariance[np.diag_indices(2 * modes)] += beyond
    return Tracked(poles[0], poles[1], shape.T, covariance, test.responses, test.band, lost, trend)


def _trend(test: AmbientTest, poles: Float[np.ndarray, "2 m"], shape: Complex[np.ndarray, "O m"]) -> AmplitudeTrend:
    """Return the trend of poles with amplitude along the free decays of a test."""
    frequency, damping = poles
    pole = 2 * np.pi * frequency * (-damping + 1j * np.sqrt(1 - damping**2))
    own = shape / (test.scale[:, None] * pole ** np.array(test.order)[:, None])
    size = np.linalg.norm(own, axis=0)
    moves = 2 * np.abs(shape).max(0) / size / np.abs(pole) ** 2
    return amplitude_trend(test.decays, pole - test.decay, own / size, moves, test.correlations.step)


def _numbers(
    test: AmbientTest, diagram: Diagram, by_order: Mapping[int, Realisation]
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m"]]:
    """Return frequency, damping ratio and shape (real parts first) of each mode, and the distance of its poles."""
    numbers, apart = [], []
    for i, chosen in enumerate(diagram.chosen):
        largest = int(np.argmax(np.abs(diagram.shape[:, chosen])))  # in the channels' units
        rows, unlike = [], []
        for k in np.flatnonzero(diagram.cluster == i).tolist():
            each = by_order[int(diagram.order[k])]
            far = distance((each.pole, diagram.pole[[k]]), (each.unit_shape, diagram.shape[:, [k]]))[:, 0]
            rows.append(_row(test, each, int(far.argmin()), largest))
            unlike.append(far.min())
        numbers.append(np.median(rows, axis=0))
        apart.append(np.median(unlike))
    return np.array(numbers), np.array(apart)


def _row(test: AmbientTest, each: Realisation, j: int, largest: int) -> Float[np.ndarray, "k"]:
    pole = each.pole[j] + test.decay
    motion = each.shape[:, j] * test.scale * pole ** np.array(test.order)  # in SI, as accelerations
    shape = motion / motion[largest]
    size = abs(pole)
    return np.concatenate([[size / (2 * np.pi), -pole.real / size], shape.real, shape.imag])


def _covariance(vectors: Float[np.ndarray, "B n"], poles: int, size: int) -> Float[np.ndarray, "n n"]:
    """Return the covariance of the estimate from its replicates without each block."""
    count = len(vectors)
    apart = vectors - vectors.mean(0)
    raw = (count - 1) / count * apart.T @ apart * (float(t.isf(0.025, count - 1)) / 1.959964) ** 2
    shapes = [raw[i : i + size, i : i + size] for i in range(poles, len(raw), size)]
    plain = block_diag(np.diag(np.diag(raw)[:poles]), *shapes)
    weight = _uncertain(apart[:, :poles])
    covariance: np.ndarray = (1 - weight) * raw + weight * plain
    return covariance


def _uncertain(apart: Float[np.ndarray, "B k"]) -> float:
    """Return the shrinkage of correlations: the sum of their variances over that of their squares."""
    count, size = apart.shape
    scaled = apart / np.sqrt((apart**2).mean(0))
    products = scaled[:, :, None] * scaled[:, None]
    mean, others = products.mean(0), ~np.eye(size, dtype=bool)
    variance = ((products - mean) ** 2).sum(0) / (count * (count - 1))
    return float(min(variance[others].sum() / (mean[others] ** 2).sum(), 1.0)) if size > 1 else 0.0


# -------- Operational

MOST_STATES = 40
"""States of the highest order."""
DECAYS = 5.0
"""Length of a block in decay times of the slowest mode."""
BLOCKS = (10, 40)
"""Fewest and most blocks."""
FASTEST = 100.0
"""Largest decay rate [1/s] of a mode."""
LEAST_DAMPED = 0.001
"""Damping ratio below which a pole is the line of a turning part."""
DAMPED_SDS = 2.0
"""Margin above that, in standard deviations of the damping ratio, for a pole to be a mode; assumed."""
LIGHT = 0.01
"""Damping ratio below which the line of a turning part may be mistaken for a mode; assumed."""
VAGUE = 0.5
"""Relative standard deviation of the damping ratio from which a pole is not a mode; assumed."""
FEW_TAPS = 4
"""Number of taps below which standard errors rest on too few of them; assumed."""
CLOSE = 0.05
"""Relative frequency difference of two close modes; assumed."""


@dataclass(frozen=True)
class OperationalModes(ModalParameters):
    """Modes of an ambient test. Shapes are unscaled, as the force is unknown: they are one at a large response.

    Attributes:
        test: the ambient test.
        blocks: number of blocks in the jackknife of the covariance.
        decays: length of a block in decay times of the slowest mode.
        trend: with amplitude, of a test with taps.
        remarks: for the report.
    """

    test: AmbientTest
    blocks: int
    decays: float
    trend: AmplitudeTrend | None
    remarks: tuple[str, ...]

    @property
    def doubtful(self) -> bool:
        """Whether the record is too short for its blocks to be independent of each other, or has too few taps."""
        return self.blocks < FEW_TAPS or (self.decays < DECAYS and not self.test.decays)


@threadpool_limits.wrap(limits=1)  # matrices are small: threads of BLAS would mostly wait for each other
def operational_modes(
    test: AmbientTest, *, near: Sequence[float] | None = None, amplitude: float | None = None
) -> OperationalModes:
    """Identify the modes of an ambient test with their joint covariance.

    Poles come from covariance-driven stochastic subspace identification over orders; stable ones are clustered as for a
    hammer test. A mode is the median of its cluster; leaving out one block of the record at a time gives the covariance
    (`ident.modal.operational`).

    Args:
        test: the correlation functions.
        near: (m,) [Hz] overrides the choice of modes: the nearest pole of the diagram for each.
        amplitude: [m] see `block_jackknife`.

    Raises:
        InputError: no mode.
    """
    diagram = _diagram(test) if near is None else _only(_diagram(test), near)
    remedy = "look at the band, or record for longer"
    got, any_pole = "responses without a pole that lasts over the orders", len(diagram.chosen)
    require(any_pole, "", got, "a resonance", remedy, "band")
    damped = diagram.damping[diagram.chosen] >= LEAST_DAMPED  # lines of turning parts never decay
    slowest = float(np.min(-diagram.pole[diagram.chosen].real, where=damped, initial=FASTEST))  # [1/s]
    blocks = len(test.decays) or int(np.clip(test.correlations.duration * slowest / DECAYS, *BLOCKS))
    tracked = block_jackknife(test, diagram, blocks, amplitude)
    kept, rejected = _sorted_out(test, diagram, tracked)
    require(kept, "", "responses without a mode that lasts over the orders", "a resonance", remedy, "band")
    found = tracked.pick(kept)
    decays = test.correlations.duration * slowest / blocks
    remarks = (*_remarks(test, found, rejected, decays), *_of_amplitude(found, amplitude))
    modes = found.frequency, found.damping, found.shape, found.covariance, found.responses, found.band
    return OperationalModes(*modes, diagram, rejected, test, blocks, decays, found.trend, remarks)


def _sorted_out(test: AmbientTest, diagram: Diagram, tracked: Tracked) -> tuple[list[int], tuple[Rejected, ...]]:
    """Return the poles that are modes, and the rejected ones."""
    numbers = tracked.frequency, tracked.damping, *tracked.sigma, tracked.lost
    why = [_why(test.speeds, *pole) for pole in zip(*(each.tolist() for each in numbers), strict=True)]
    for i, j in combinations(range(len(why)), 2):
        one, other = diagram.chosen[[i]], diagram.chosen[[j]]
        shapes = diagram.shape[:, one], diagram.shape[:, other]
        is_same = distance((diagram.pole[one], diagram.pole[other]), shapes)[0, 0] < 1
        if is_same and not (why[i] or why[j]):
            fewer, more = sorted((i, j), key=lambda k: (diagram.cluster == k).sum())
            why[fewer] = f"it is the mode at {tracked.frequency[more]:.4g} Hz once more"
    kept = [i for i, reason in enumerate(why) if not reason]
    others = [i for i, reason in enumerate(why) if reason]
    rejected = (Rejected(float(tracked.frequency[i]), float(tracked.damping[i]), why[i]) for i in others)
    return kept, tuple(rejected)


def _diagram(test: AmbientTest) -> Diagram:
    correlations = test.correlations
    outputs, inputs, lags = correlations.blocks.shape[1:]
    orders = range(4, min(MOST_STATES, (lags // 2 - 1) * min(outputs, inputs)) + 1, 2)
    by_order = {each.order: each for each in realisations(correlations.mean, correlations.step, orders)}
    every = tuple(each.pick(physical(each.pole, test.band)) for each in by_order.values())
    return clustered(list(by_order), [each.pole for each in every], [each.unit_shape for each in every])


def _only(diagram: Diagram, near: Sequence[float]) -> Diagram:
    """Return the diagram with a choice of the clusters nearest to some frequencies."""
    poles = chosen_near(diagram, near).chosen
    numbers = diagram.cluster[poles]
    if (numbers < 0).any():
        apart = float(diagram.frequency[poles[numbers < 0][0]])
        remedy = "name modes of which the diagram has poles in half the orders"
        raise refusal("", f"no lasting pole near {apart:.4g} Hz", "a pole that lasts", remedy, "modes")
    order = np.unique(numbers)
    cluster = np.full(len(diagram.cluster), -1)
    for place, number in enumerate(order):
        cluster[diagram.cluster == number] = place
    return replace(diagram, cluster=cluster, chosen=diagram.chosen[order])


def _why(
    speeds: Sequence[Speed], frequency: float, damping: float, frequency_sd: float, damping_sd: float, lost: bool
) -> str:
    """Return why a pole is not a mode; empty for a mode."""
    if damping < LEAST_DAMPED:
        what = turning(speeds, frequency)
        known = f"as of {what}" if what else "as of something that turns: name its speed (`harmonics`)"
        return f"damping ratio {100 * damping:.3f} %, {known}"
    if lost:
        return "it is lost where a part of the record is left out"
    if frequency_sd > frequency * max(damping, SHARPEST):
        return "its frequency is not known to within its resonance"
    if damping < LIGHT and damping - DAMPED_SDS * damping_sd < LEAST_DAMPED:
        uncertain = f"damping ratio {100 * damping:.2f} %, give or take {100 * damping_sd:.2f} %"
        return f"{uncertain}, may be that of something that turns: name its speed (`harmonics`), or record for longer"
    return f"its damping ratio is not known to within {100 * VAGUE:.0f} %" if damping_sd > VAGUE * damping else ""


def _remarks(test: AmbientTest, found: Tracked, rejected: Sequence[Rejected], decays: float) -> Iterator[str]:
    frequency, damping = found.frequency, found.damping
    if test.decays and len(test.decays) < FEW_TAPS:
        yield f"WARNING: {len(test.decays)} taps: their scatter hardly tells the standard errors: {FEW_TAPS} or more do"
    elif decays < DECAYS and not test.decays:
        needed = test.correlations.duration * DECAYS / decays
        yield (
            f"WARNING: too short a record: a block has {decays:.1f} decay times of the slowest mode, {DECAYS:g} are "
            f"needed; standard deviations are not to be relied on below {needed:.0f} s"
        )
    several = len(test.responses) > 1  # of one response nobody knows the direction
    few = ["one direction of taps"] if found.trend and found.trend.one_way and several else []
    if len(test.references) == 1:
        few.append("one response" if len(test.responses) == 1 else "one reference")
    for many in few:
        yield f"WARNING: {many} only: modes that coincide are seen as one, and what does not move there is not seen"
    for i in np.flatnonzero(np.diff(frequency) < CLOSE * frequency[1:]) if few else ():
        pair, do = f"{frequency[i]:.4g} and {frequency[i + 1]:.4g} Hz", "tap" if "taps" in few[0] else "measure"
        yield f"WARNING: the close modes at {pair} are not told apart by {few[0]}: {do} in a second direction"
    lines = [(line.frequency, f"{line}, which was taken out,") for line in test.harmonics]
    sharp = [pole.frequency for pole in rejected if pole.damping < LEAST_DAMPED]
    lines += [(line, f"what turns at {line:.4g} Hz") for line in sharp]
    for each, ratio in zip(frequency, damping, strict=True):
        for line, name in lines:
            if abs(line - each) < ratio * each:
                yield f"WARNING: {name} lies within the resonance of the mode at {each:.4g} Hz: repeat at another speed"
        what = turning(test.speeds, each) if ratio < LIGHT else ""
        if what and all(abs(line - each) > SPEED_SLIP * each for line, _ in lines):
            yield f"WARNING: the mode at {each:.4g} Hz may be that of {what}: repeat at another speed"


def _of_amplitude(found: Tracked, amplitude: float | None) -> Iterator[str]:
    """Yield whether free decays had the amplitude at work, or which modes change along them."""
    if found.trend is None:
        return
    high, early, late = 1e3 * found.trend.amplitude  # [mm]
    if amplitude is not None:
        met = (late <= 1e3 * amplitude) & (high >= 1e3 * amplitude)
        others = ", ".join(f"{hertz:.4g}" for hertz in found.frequency[~met])
        rest = f"; those at {others} Hz are given at the nearest one measured" * bool(others)
        yield f"{met.sum()} of {len(met)} modes were measured at the amplitude at work, {1e3 * amplitude:.3g} mm{rest}"
        return
    poles = np.array([found.frequency, found.damping])
    at = [poles + found.trend.change(poles, each / 1e3) for each in (early, late)]
    for i in np.flatnonzero(found.trend.seen(poles).any(0)):
        ends = zip(at, (early, late), strict=True)
        first, last = (f"{f[0, i]:.5g} Hz and {100 * f[1, i]:.3g} % at {size[i]:.2g} mm" for f, size in ends)
        yield f"a mode changes with amplitude: {first}, {last}: say the one at work (`amplitude`)"
