"""Poles of frequency responses: the polynomial fit, stabilisation, residues, the modal model and the noise."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
import scipy.fft
import scipy.linalg
from jaxtyping import Bool, Complex, Float, Int
from scipy.ndimage import uniform_filter1d
from scipy.optimize import linear_sum_assignment
from scipy.stats import chi2

from ident.errors import require
from ident.modal.frf import Frf

# -------- Modal model
# Frequency response functions of modes, with residuals for modes outside the band, and their derivatives.

EXPONENTS = (-2, -1, 0, 2, 3, 4)
"""Powers of s in the accelerance of modes outside the band: s^2 / (s - p) in s / p for those above, in p / s below."""


@dataclass(frozen=True)
class ModalModel:
    """Accelerances of m modes, with residuals for modes outside the band, at s = i omega + decay.

    H(s) = s^2 sum_r [P_r / (2 i b_r (s - p_r)) + c.c.] + sum_e R_e s^e

    p = a + i b is a pole and P = shape participation' its residue; a real mode is P / (s^2 - 2 a s + a^2 + b^2). An
    exponential window multiplies every impulse response by exp(-decay t), which shifts s: the poles are those without
    a window.

    Attributes:
        pole: (m,) [rad/s] complex.
        shape: (O, m) [1/kg] complex: motion of each response, scaled so that the participation is one at a reference.
        participation: (I, m) [-] complex: motion of each reference.
        residual: (E, O, I) [s^e/kg] real, by the power of s: modes below the band act as a mass (0), with corrections
            near the band (-1, -2); modes above it act as a spring (2), with corrections near the band (3, 4).

    References:
        Ewins, "Modal Testing", 2nd ed. 2000, sections 2.4 (complex modes), 4.4 (residuals).
    """

    pole: Complex[np.ndarray, "m"]
    shape: Complex[np.ndarray, "O m"]
    participation: Complex[np.ndarray, "I m"]
    residual: Float[np.ndarray, "E O I"]

    @property
    def reference(self) -> np.ndarray:
        """(m,) driving point used for normalisation, where a mode's participation is one."""
        return np.argmin(np.abs(self.participation - 1), 0)

    def normalised(self) -> "ModalModel":
        """Return the model with shapes normalised to the reference of largest participation."""
        largest = np.argmax(np.abs(self.participation), 0)
        size = np.take_along_axis(self.participation, largest[None], 0)[0]
        return ModalModel(self.pole, self.shape * size, self.participation / size, self.residual)

    def inside(self, frequency: Float[np.ndarray, "F"]) -> Int[np.ndarray, "k"]:
        """Return the modes within a band [Hz], ascending in frequency; the others act as residuals near its ends."""
        hertz = np.abs(self.pole) / (2 * np.pi)
        order = np.argsort(hertz)
        return order[(hertz[order] >= frequency[0]) & (hertz[order] <= frequency[-1])]

    def without(self, mode: int) -> "ModalModel":
        """Return the model without a mode."""
        shape, participation = (np.delete(x, mode, -1) for x in (self.shape, self.participation))
        return ModalModel(np.delete(self.pole, mode), shape, participation, self.residual)

    def accelerance(self, s: Complex[np.ndarray, "F"]) -> Complex[np.ndarray, "O I F"]:
        """Return the frequency response functions at s."""
        own, mirror = _terms(self.pole, s)
        residue = self.shape[:, None] * self.participation[None]
        return residue @ own + residue.conj() @ mirror + np.einsum("eoi,ef->oif", self.residual, powers(s))

    def vector(self) -> Float[np.ndarray, "n"]:
        """Return all real numbers, by mode: pole, shape, participation without the reference; then the residuals."""
        numbers = []
        for r, reference in enumerate(self.reference):
            parts = self.pole[r : r + 1], self.shape[:, r], np.delete(self.participation[:, r], reference)
            numbers += [x for part in parts for x in (part.real, part.imag)]
        return np.concatenate([*numbers, self.residual.ravel()])

    def replace(self, vector: Float[np.ndarray, "n"]) -> "ModalModel":
        """Return the model with these numbers."""
        (outputs, modes), inputs = self.shape.shape, len(self.participation)
        table = vector[: modes * self.size].reshape(modes, self.size)
        pole = table[:, 0] + 1j * table[:, 1]
        shape = (table[:, 2 : 2 + outputs] + 1j * table[:, 2 + outputs : 2 + 2 * outputs]).T
        rest = table[:, 2 + 2 * outputs :]
        others = rest[:, : inputs - 1] + 1j * rest[:, inputs - 1 :]
        participation = np.ones((inputs, modes), complex)
        for r, reference in enumerate(self.reference):
            participation[np.arange(inputs) != reference, r] = others[r]
        residual = vector[modes * self.size :].reshape(-1, outputs, inputs)
        return ModalModel(pole, shape, participation, residual)

    @property
    def size(self) -> int:
        """Real numbers of a mode."""
        return 2 + 2 * len(self.shape) + 2 * (len(self.participation) - 1)

    def slopes(self, s: Complex[np.ndarray, "F"]) -> Complex[np.ndarray, "n O I F"]:
        """Return the derivative of the accelerances with respect to each number of the vector."""
        own, mirror = _terms(self.pole, s)
        (outputs, modes), inputs = self.shape.shape, len(self.participation)
        out = np.zeros((modes * self.size + self.residual.size, outputs, inputs, len(s)), complex)
        for r, reference in enumerate(self.reference):
            block = out[r * self.size : (r + 1) * self.size]
            self._mode_slopes(block, r, int(reference), (s, own[r], mirror[r]))
        residuals = out[modes * self.size :].reshape(-1, outputs * inputs, outputs * inputs, len(s))
        each = np.arange(outputs * inputs)
        residuals[:, each, each] = powers(s)[:, None]
        return out

    def _mode_slopes(self, block: np.ndarray, r: int, reference: int, terms: tuple[np.ndarray, ...]) -> None:
        s, own, mirror = terms
        pole, shape, part = self.pole[r], self.shape[:, r], self.participation[:, r]
        outputs, others = len(shape), np.delete(np.arange(len(part)), reference)
        residue = np.outer(shape, part)[..., None]
        by_own, by_mirror = own / (s - pole), mirror / (s - pole.conj())
        block[0] = residue * by_own + residue.conj() * by_mirror
        in_b = 1j * (residue * by_own - residue.conj() * by_mirror)
        block[1] = in_b - (residue * own + residue.conj() * mirror) / pole.imag
        each = np.arange(outputs)
        forward, back = part[:, None] * own, part.conj()[:, None] * mirror
        block[2 + each, each] = forward + back
        block[2 + outputs + each, each] = 1j * (forward - back)
        forward, back = shape[:, None] * own, shape.conj()[:, None] * mirror
        for k, i in enumerate(others):
            block[2 + 2 * outputs + k, :, i] = forward + back
            block[2 + 2 * outputs + len(others) + k, :, i] = 1j * (forward - back)


def powers(s: Complex[np.ndarray, "F"]) -> Complex[np.ndarray, "E F"]:
    """Return the powers of s in the residuals of modes outside the band."""
    return s ** np.array(EXPONENTS, float)[:, None]


def _terms(pole: Complex[np.ndarray, "m"], s: Complex[np.ndarray, "F"]) -> tuple[np.ndarray, np.ndarray]:
    """Return the factors on a residue and on its conjugate (m, F)."""
    pole = pole[:, None]
    factor = s**2 / (2j * pole.imag)
    return factor / (s - pole), -factor / (s - pole.conj())


# -------- Noise
# Scatter of frequency response functions, from the single hits: between channels, lines and along frequency.

FEWEST_HITS = 3
"""Fewest hits to estimate a scatter."""
SMOOTHED = 100
"""Least degrees of freedom of a smoothed variance."""
COURSE = 240
"""Degrees of freedom of the scatter's course over the record, at each of its times."""
STEADY = 1.5
"""Largest variance over the record, relative to the mean, up to which lines count as independent; assumed."""
WEIGHED = SMOOTHED / (SMOOTHED - 4)
"""Increase of the estimates' variance over its nominal value because the weights are estimated: E[1/x^2] / E[1/x] of
a chi-squared x."""
FAINTEST = 1e-3
"""Least variance of a part of the record, as a share of the largest."""


@dataclass(frozen=True)
class Noise:
    """The covariance of averaged frequency response functions, as a product of whitening factors.

    The scatter of the hits has a variance for each channel and line, a correlation between channels that is the same
    at all lines, and a correlation between lines that is the same in all channels: a window correlates neighbouring
    lines, since the noise level then varies over the record, as the inverse transform shows. Five hits alone give a
    covariance matrix of rank four. So variances are averaged over neighbouring lines and correlations over all lines,
    and correlations are shrunk towards zero as far as they are uncertain.

    Attributes:
        sd: (K, F) [1/kg] standard deviation of each channel of the average, E|n|^2 = sd^2.
        channels: (K, K) inverse Cholesky factor of the correlation between channels.
        course: (F,) standard deviation over the record, of mean square one.

    References:
        Schäfer, Strimmer, Stat. Appl. Genet. Mol. Biol. 4, 2005, section 2.4, target D (shrinkage).
        Pintelon, Schoukens, "System Identification", 2nd ed. 2012, chapter 2 (sample covariance of averaged spectra).
    """

    sd: Float[np.ndarray, "K F"]
    channels: Complex[np.ndarray, "K K"]
    course: Float[np.ndarray, "F"]

    def by_line(self, values: Complex[np.ndarray, "*rest K F"]) -> Complex[np.ndarray, "*rest K F"]:
        """Return values in standard deviations, with channels decorrelated."""
        return self.channels @ (values * (1 / self.sd))

    def whiten(self, values: Complex[np.ndarray, "*rest K F"]) -> Float[np.ndarray, "*rest N"]:
        """Return real and imaginary parts in turn, of unit covariance for values that scatter as the averages do."""
        moving = values.any(-1)  # a number of a mode moves few channels: the others need no transform
        rows = values[moving] * np.broadcast_to(math.sqrt(2) / self.sd, values.shape)[moving]
        if np.ptp(self.course):
            rows = scipy.fft.ifft(rows, norm="ortho", overwrite_x=True) * (1 / self.course)
        steady = np.zeros(values.shape, complex)
        steady[moving] = rows
        return (self.channels @ steady).reshape(*values.shape[:-2], -1).view(float)


def noise_of(frf: Frf) -> Noise:
    """Estimate the covariance of the averaged functions from the scatter of their hits.

    Raises:
        InputError: too few hits, or hits without scatter.
    """
    hits, count = channels_of(frf.hits), len(frf.hits)
    remedy = "give the single hits: without their scatter no standard deviation is known"
    require(count >= FEWEST_HITS, "", f"{count} hits", f"{FEWEST_HITS} or more", remedy, "hits")
    deviations = hits - hits.mean(0)
    raw = (np.abs(deviations) ** 2).sum(0) / (count - 1)
    scatters = (_average(raw, SMOOTHED) > 0).all()
    require(scatters, "", "hits without scatter", "hits that differ", "give measured hits", "hits")
    freedom = 2 * (count - 1)
    broad = deviations / np.sqrt(_average(raw, len(raw[0]) // 4))
    variance = smoothed(raw, freedom, alike=float((_course(broad) ** 4).mean()))
    scaled = deviations / np.sqrt(variance) * math.sqrt(count / (count - 1))
    return Noise(np.sqrt(variance / count), _channel_factor(scaled), _course(scaled))


def channels_of(values: Complex[np.ndarray, "*rest O I F"]) -> Complex[np.ndarray, "*rest K F"]:
    """Return responses by references as channels, K = O I."""
    return values.reshape(*values.shape[:-3], -1, values.shape[-1])


def smoothed(raw: Float[np.ndarray, "K F"], freedom: int, alike: float = 1.0) -> Float[np.ndarray, "K F"]:
    """Average variances over neighbouring lines; a prominent line (the mains) keeps its own variance.

    Args:
        raw: variances of single lines.
        freedom: degrees of freedom of each.
        alike: number of neighbouring lines with the information of one.
    """
    average = _average(raw, math.ceil(SMOOTHED * alike / freedom / 2) * 2 + 1)
    stands_out = raw > average * chi2.isf(1e-3 / raw.size, freedom) / freedom
    return np.where(stands_out, raw, average)


def _average(raw: Float[np.ndarray, "K F"], width: int) -> Float[np.ndarray, "K F"]:
    return uniform_filter1d(raw, max(1, min(width, raw.shape[-1])), axis=-1, mode="nearest")


def _channel_factor(scaled: Complex[np.ndarray, "H K F"]) -> Complex[np.ndarray, "K K"]:
    """Return the inverse Cholesky factor of the channel correlation, shrunk towards zero."""
    _, channels, _ = scaled.shape
    rows = np.moveaxis(scaled, 1, 0).reshape(channels, -1)
    count, squared = rows.shape[1], np.abs(rows) ** 2
    correlation = rows @ rows.conj().T / count
    spread = squared @ squared.T / count - np.abs(correlation) ** 2
    size = np.sqrt(np.real(np.diag(correlation)))
    correlation /= size[:, None] * size
    apart = ~np.eye(channels, dtype=bool)
    uncertain = (spread / (size[:, None] * size) ** 2)[apart].sum() / count
    shrunk = np.clip(uncertain / max((np.abs(correlation[apart]) ** 2).sum(), 1e-300), 0.0, 1.0)
    correlation[apart] *= 1 - shrunk
    factor = np.linalg.cholesky(correlation)
    return scipy.linalg.solve_triangular(factor, np.eye(channels), lower=True).astype(complex)


def _course(scaled: Complex[np.ndarray, "H K F"]) -> Float[np.ndarray, "F"]:
    """Return the course of the scatter over the record; constant where lines are independent."""
    power = (np.abs(scipy.fft.ifft(scaled, norm="ortho")) ** 2).mean((0, 1))
    freedom = 2 * (len(scaled) - 1) * scaled.shape[1]
    course = _average(power[None], 2 * math.ceil(COURSE / freedom / 2) + 1)[0]
    if course.max() < STEADY * course.mean():
        return np.ones(len(course))
    course = np.maximum(course, FAINTEST * course.max())
    return np.sqrt(course / course.mean())


# -------- Polynomial
# Poles of frequency response functions: the poly-reference least-squares complex frequency-domain estimator.

SPAN = 0.8
"""Share of the unit circle that the band covers: on the full circle its ends would be neighbours."""


@dataclass(frozen=True)
class Poles:
    """Poles of one order.

    Attributes:
        order: of the polynomial.
        pole: (n,) [rad/s] complex.
        participation: (I, n) [-] complex; (O, n) motion of the responses where `transposed`.
        transposed: whether responses took the place of references.
    """

    order: int
    pole: Complex[np.ndarray, "n"]
    participation: Complex[np.ndarray, "I n"]
    transposed: bool = False

    def pick(self, which: np.ndarray) -> "Poles":
        """Return some of the poles."""
        return Poles(self.order, self.pole[which], self.participation[:, which], self.transposed)


class PolynomialFit:
    """H = B A^-1 with matrix polynomials in z = exp(s T), by weighted linear least squares, over orders.

    The coefficients of B are eliminated for each response; the normal equations of the highest order hold those of all
    lower ones. Transposed, responses take the place of references: the motion of many of them tells close modes apart,
    also from a single reference. The lowest coefficient of A is the unit matrix, so that poles of no mode tend to be
    unstable.

    References:
        Peeters, Van der Auweraer, Guillaume, Leuridan, "The PolyMAX frequency-domain method", Shock and Vibration 11,
        2004. Cauberghe, Guillaume, Verboven, Parloo, Vanlanduit, "The secret behind clear stabilization diagrams",
        SEM 2005.
    """

    def __init__(self, frf: Frf, noise: Noise, highest: int, transposed: bool = False):
        mean, sd = _mean_and_sd(frf, noise, transposed)
        self.inputs, self.decay, self.transposed = mean.shape[1], frf.decay, transposed
        self.middle = np.pi * (frf.frequency[0] + frf.frequency[-1])
        self.interval = SPAN / (frf.frequency[-1] - frf.frequency[0])
        z = np.exp(1j * (2 * np.pi * frf.frequency - self.middle) * self.interval)
        self.blocks = list[tuple[np.ndarray, ...]]()  # X'X, X'Y, Y'Y of each response, Y by power and reference
        for weight, h in zip(1 / np.sqrt((sd**2).mean(1)), mean, strict=True):
            X = weight * z ** np.arange(highest + 1)[:, None]
            Y = -(X[:, None] * h).reshape(-1, len(z))
            self.blocks.append((X.conj() @ X.T, X.conj() @ Y.T, Y.conj() @ Y.T))

    def poles(self, order: int) -> Poles:
        """Return all poles of an order, of positive and negative frequency, stable and unstable."""
        size, inputs = order + 1, self.inputs
        total: Complex[np.ndarray, "n n"] = np.zeros((size * inputs, size * inputs), complex)
        for R, S, T in self.blocks:
            S, T = S[:size, : size * inputs], T[: size * inputs, : size * inputs]
            total += T - S.conj().T @ np.linalg.lstsq(R[:size, :size], S, rcond=None)[0]
        free, fixed = total[inputs:, inputs:], total[inputs:, :inputs]
        above = np.linalg.lstsq(free, -fixed, rcond=None)[0].reshape(order, inputs, inputs)
        # roots z of det(1 + sum_k A_k z^k) and left null vectors, by the companion matrix in 1/z
        companion = np.eye(order * inputs, k=-inputs, dtype=complex)
        companion[:inputs] = -np.concatenate(list(above.transpose(0, 2, 1)), 1)
        values, vectors = np.linalg.eig(companion)
        pole = np.log(1 / values) / self.interval + 1j * self.middle + self.decay
        return Poles(order, pole, vectors[-inputs:], self.transposed)


def _mean_and_sd(frf: Frf, noise: Noise, transposed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the averaged functions and their standard deviations, responses and references swapped or not."""
    mean, sd = frf.mean, noise.sd.reshape(frf.mean.shape)
    return (mean.swapaxes(0, 1), sd.swapaxes(0, 1)) if transposed else (mean, sd)


# -------- Residues
# Shapes of given poles, by linear least squares, with residuals of what lies outside the band.


def model_of(frf: Frf, noise: Noise, poles: Poles) -> ModalModel:
    """Fit shapes and residuals to the averaged functions, for known poles and participations.

    Of poles with the motion of the responses known (`poles.transposed`), the participations are fitted instead.

    References:
        Guillaume, Verboven, Vanlanduit, "Frequency-domain maximum likelihood identification of modal parameters with
        confidence intervals", ISMA 1998 (LSFD).
    """
    mean, sd = _mean_and_sd(frf, noise, poles.transposed)
    s = 2j * np.pi * frf.frequency + frf.decay
    fitted, residual = _least_squares(mean, 1 / np.sqrt((sd**2).mean((0, 1))), s, poles)
    if poles.transposed:
        return ModalModel(poles.pole, poles.participation, fitted, residual.swapaxes(1, 2)).normalised()
    return ModalModel(poles.pole, fitted, poles.participation, residual).normalised()


def _least_squares(
    mean: Complex[np.ndarray, "A B F"], weight: Float[np.ndarray, "F"], s: Complex[np.ndarray, "F"], poles: Poles
) -> tuple[np.ndarray, np.ndarray]:
    """Return the motion of each row of the functions in each mode, and residuals, for given motion of the columns."""
    rows, columns, lines = mean.shape
    own, mirror = _terms(poles.pole, s)
    forward = poles.participation[:, :, None] * own
    back = poles.participation.conj()[:, :, None] * mirror
    power = powers(s)
    size = np.abs(power).max(1)
    each = [np.eye(columns)[:, :, None] * x for x in power / size[:, None]]
    matrix = np.concatenate([weight * x for x in (forward + back, 1j * (forward - back), *each)], 1)
    A = np.moveaxis(matrix, 1, 2).reshape(columns * lines, -1)
    b = (mean * weight).reshape(rows, -1).T
    x = np.linalg.lstsq(np.concatenate([A.real, A.imag]), np.concatenate([b.real, b.imag]), rcond=None)[0]
    count = len(poles.pole)
    motion = (x[:count] + 1j * x[count : 2 * count]).T
    residual = x[2 * count :].reshape(len(size), columns, rows) / size[:, None, None]
    return motion, residual.swapaxes(1, 2)


# -------- Stabilisation
# Poles over orders, and which of them stay where they are: the stabilisation diagram, read without a person.

MOST_POLES = 60
"""Poles of the highest order, about."""
ORDERS = (8, 40)
"""Limits of the highest order."""
MOST_DAMPED = 0.2
"""Largest damping ratio of a mode's pole; assumed."""
NEAR_POLE, NEAR_SHAPE = 0.01, 0.1
"""Typical relative distance of poles of one mode, and of their shapes' MAC from one; assumed."""
LASTING = 0.5
"""Least share of the orders with a pole of a mode; assumed."""
FEWEST = 3
"""Fewest orders with a pole of a possible mode; assumed."""


@dataclass(frozen=True)
class Diagram:
    """Stable poles of all orders, and the cluster of each.

    Attributes:
        order: (n,) of the polynomial.
        pole: (n,) [rad/s] complex.
        shape: (O I, n) complex: residues of unit length.
        cluster: (n,) number of its cluster, ascending in frequency; -1 where it is in none that lasts.
        chosen: (m,) the pole that each cluster stands for.
        passing: (p,) one pole of each cluster that does not last, but was found more than twice.
    """

    order: Int[np.ndarray, "n"]
    pole: Complex[np.ndarray, "n"]
    shape: Complex[np.ndarray, "K n"]
    cluster: Int[np.ndarray, "n"]
    chosen: Int[np.ndarray, "m"]
    passing: Int[np.ndarray, "p"]

    @property
    def frequency(self) -> Float[np.ndarray, "n"]:
        """(n,) [Hz] undamped."""
        return np.abs(self.pole) / (2 * np.pi)

    @property
    def damping(self) -> Float[np.ndarray, "n"]:
        """(n,) [-] damping ratio."""
        return -self.pole.real / np.abs(self.pole)


def diagram_of(frf: Frf, noise: Noise) -> Diagram:
    """Find the poles of many orders and cluster them by frequency, damping and shape.

    From order to order each pole goes on with the one that it is most like, none with two. What is found in half of the
    orders at least is a cluster; it stands for the member that is nearest to the others. Where the responses
    and the references each tell, clusters of the second kind count where the first has none within the resonance.

    References:
        Reynders, Houbrechts, De Roeck, "Fully automated (operational) modal analysis", MSSP 29, 2012.
    """
    sides = sorted({True: len(frf.responses), False: len(frf.references)}.items(), key=lambda side: -side[1])
    diagrams = [_one_side(frf, noise, transposed, size) for transposed, size in sides]
    return reduce(_with, [diagram for diagram in diagrams if diagram is not None])


def mac(first: Complex[np.ndarray, "K n"], second: Complex[np.ndarray, "K m"]) -> Float[np.ndarray, "n m"]:
    """Return the modal assurance criterion of all pairs."""
    product = np.abs(first.conj().T @ second) ** 2
    return product / ((np.abs(first) ** 2).sum(0)[:, None] * (np.abs(second) ** 2).sum(0))


def _one_side(frf: Frf, noise: Noise, transposed: bool, size: int) -> Diagram | None:
    others = len(frf.references) if transposed else len(frf.responses)
    # as many as the lines of the functions admit
    highest = min(int(np.clip(MOST_POLES // size, *ORDERS)), len(frf.frequency) * others // (3 * (size + 1)))
    if highest < 2:
        return None
    fit = PolynomialFit(frf, noise, highest, transposed)
    band, channels = (frf.frequency[0], frf.frequency[-1]), len(frf.responses) * len(frf.references)
    every = [fit.poles(order) for order in range(2, highest + 1)]
    solutions = [poles.pick(physical(poles.pole, band)) for poles in every]
    shapes = []
    for poles in solutions:
        residue = np.zeros((channels, 0), complex)
        if len(poles.pole):
            model = model_of(frf, noise, poles)
            residue = (model.shape[:, None] * model.participation[None]).reshape(channels, -1)
        shapes.append(residue / np.linalg.norm(residue, axis=0))
    return clustered([each.order for each in solutions], [each.pole for each in solutions], shapes)


def clustered(orders: Sequence[int], poles: Sequence[np.ndarray], shapes: Sequence[np.ndarray]) -> Diagram:
    """Return the diagram of the poles and shapes of each order."""
    numbers = _tracked(poles, shapes)
    each = [np.full(len(own), order) for order, own in zip(orders, poles, strict=True)]
    order, pole, shape, number = (np.concatenate(x, -1) for x in (each, poles, shapes, numbers))
    cluster, chosen, passing = _lasting(pole, shape, number, len(orders))
    return Diagram(order, pole, shape, cluster, chosen, passing)


def physical(pole: Complex[np.ndarray, "n"], band: tuple[float, float]) -> Bool[np.ndarray, "n"]:
    """Return which poles may be modes within a band [Hz]."""
    frequency, damping = np.abs(pole) / (2 * np.pi), -pole.real / np.abs(pole)
    inside = (frequency >= band[0]) & (frequency <= band[1]) & (pole.imag > 0)
    return inside & (damping > 0) & (damping < MOST_DAMPED)


def distance(poles: tuple[np.ndarray, np.ndarray], shapes: tuple[np.ndarray, np.ndarray]) -> Float[np.ndarray, "n m"]:
    """Return the distance of poles with their shapes; up to one they may be the same mode."""
    apart = np.abs(poles[0][:, None] - poles[1]) / np.abs(poles[1])
    return (apart / NEAR_POLE + (1 - mac(*shapes)) / NEAR_SHAPE) / 2


def _tracked(every: Sequence[np.ndarray], shapes: Sequence[np.ndarray]) -> list[Int[np.ndarray, "n"]]:
    """Return the number of the cluster that each pole of each order continues."""
    last_pole, last_shape = every[0], shapes[0]
    numbers = [np.arange(len(last_pole))]
    for pole, shape in zip(every[1:], shapes[1:], strict=True):
        number = np.full(len(pole), -1)
        apart = distance((pole, last_pole), (shape, last_shape))
        for new, old in zip(*linear_sum_assignment(np.minimum(apart, 10.0)), strict=True):
            if apart[new, old] < 1:
                number[new] = old
        fresh = number < 0
        number[fresh] = len(last_pole) + np.arange(fresh.sum())
        last_pole = np.concatenate([last_pole, pole[fresh]])
        last_shape = np.concatenate([last_shape, shape[:, fresh]], 1)
        last_pole[number], last_shape[:, number] = pole, shape
        numbers.append(number)
    return numbers


def _lasting(
    pole: np.ndarray, shape: np.ndarray, number: np.ndarray, orders: int
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "m"], Int[np.ndarray, "p"]]:
    """Return the lasting clusters, numbered by frequency, the representative pole of each, and the passing poles."""
    groups = [np.flatnonzero(number == n) for n in np.unique(number)]
    lasting = [members for members in groups if len(members) >= LASTING * orders]
    passing = [members for members in groups if FEWEST <= len(members) < LASTING * orders]
    lasting.sort(key=lambda members: np.median(np.abs(pole[members])))
    cluster = np.full(len(pole), -1)
    for i, members in enumerate(lasting):
        cluster[members] = i
    chosen, passed = ([_medoid(pole, shape, members) for members in each] for each in (lasting, passing))
    return cluster, np.array(chosen, int), np.array(passed, int)


def _medoid(pole: np.ndarray, shape: np.ndarray, members: np.ndarray) -> int:
    """Return the member nearest to the others."""
    own = pole[members], shape[:, members]
    return int(members[distance((own[0], own[0]), (own[1], own[1])).sum(0).argmin()])


def _with(first: Diagram, second: Diagram) -> Diagram:
    """Merge two diagrams: add the second's clusters where the first has none within the resonance."""
    poles, others = first.pole[first.chosen], second.pole[second.chosen]
    apart = np.abs(others[:, None] - poles)
    new = np.flatnonzero(~(apart < 2 * (np.abs(poles.real) + np.abs(others.real)[:, None])).any(1))
    moved = np.full(len(others) + 1, -1)
    if len(poles):
        moved[:-1] = apart.argmin(1)
    moved[new] = len(poles) + np.arange(len(new))
    chosen = np.concatenate([first.chosen, len(first.pole) + second.chosen[new]]).astype(int)
    fields = ("order", "pole", "shape")
    order, pole, shape = (np.concatenate([getattr(first, f), getattr(second, f)], -1) for f in fields)
    cluster = np.concatenate([first.cluster, moved[second.cluster]])
    rank = np.argsort(np.abs(pole[chosen]))
    place = np.append(np.argsort(rank), -1)
    known = np.delete(second.chosen, new)
    passing = np.concatenate([first.passing, len(first.pole) + np.concatenate([second.passing, known])])
    return Diagram(order, pole, shape, place[cluster], chosen[rank], passing.astype(int))
