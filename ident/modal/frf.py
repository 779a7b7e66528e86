"""Frequency response functions of a modal test, with the single hits behind their average.

Linearity checks: driving points and reciprocity.

Estimates from several hits: H1, H2 and Hv with coherence, and the contribution of each hit.

Windows of a hammer test: a force window around the pulse, and an exponential window on the whole record.

The window exp(-sigma t) on force and response alike shifts the response function H(s) to another line of the complex
plane, H(sigma + i omega): each pole p becomes p - sigma, exactly.

References:
    Ewins, "Modal Testing", 2nd ed. 2000, sections 3.4.2 (driving point), 3.7.4 (windows), 3.10 (reciprocity).
    Bendat and Piersol, "Random Data", 4th ed. 2010, chapter 6 (H1, H2, coherence).
    Rocklin, Crowley, Vold, "A comparison of H1, H2 and Hv frequency response functions", IMAC III, 1985.
    Efron, "The Jackknife, the Bootstrap and Other Resampling Plans", 1982 (pseudo-values).
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

from ident.errors import refusal
from ident.measure.load import Load


@dataclass(frozen=True)
class Place:
    """Point and direction of a force or a response.

    point: name of a point of the arm
    direction: (3,) [-] unit vector in the base frame, at the posture of the test
    """

    point: str
    direction: tuple[float, float, float]


@dataclass(frozen=True)
class Frf:
    """Accelerance (acceleration over force) at one posture of an arm.

    frequency: (F,) [Hz] lines, evenly spaced, ascending
    hits: (H, O, I, F) [1/kg] complex; response of each of H hits (of a shaker test: of each block) at O responses, by I
        references
    responses: (O,) point and direction of each acceleration
    references: (I,) point and direction of each force
    decay: [1/s] added to the decay rate of every pole by an exponential window; subtract it again
    """

    frequency: np.ndarray
    hits: np.ndarray
    responses: tuple[Place, ...]
    references: tuple[Place, ...]
    decay: float = 0.0

    def __post_init__(self) -> None:
        expected = (len(self.responses), len(self.references), len(self.frequency))
        if self.hits.ndim != 4 or self.hits.shape[1:] != expected:
            got, wanted = f"hits of shape {self.hits.shape}", f"shape (hits, {', '.join(map(str, expected))})"
            raise refusal("", got, wanted, "see `responses`, `references`", "hits")

    @property
    def mean(self) -> np.ndarray:
        """(O, I, F) [1/kg] the estimate: the average over hits (H1 where every hit has the same force spectrum)."""
        return self.hits.mean(axis=0)


@dataclass(frozen=True)
class ModeSet:
    """Modes of a test, ascending in frequency, with their joint covariance.

    Attributes:
        frequency: (m,) [Hz]
        damping: (m,) [-] damping ratio.
        shape: (O, m) complex motion of each response.
        covariance: (n, n) of frequencies, damping ratios, real and imaginary parts of the shapes mode by mode;
            n = 2 m + 2 O m.
        responses: (O,) point and direction of each.
        band: [Hz] limits of the search for modes.
    """

    frequency: Float[np.ndarray, "m"]
    damping: Float[np.ndarray, "m"]
    shape: Complex[np.ndarray, "O m"]
    covariance: Float[np.ndarray, "n n"]
    responses: tuple[Place, ...]
    band: tuple[float, float]

    @property
    def sigma(self) -> Float[np.ndarray, "2 m"]:
        """(2, m) [Hz, -] standard deviations of frequencies and damping ratios."""
        return np.sqrt(np.diag(self.covariance))[: 2 * len(self.frequency)].reshape(2, -1)

    def of_shape(self, modes: Sequence[int]) -> Float[np.ndarray, "k k"]:
        """Return the joint covariance of the shapes of some modes: real parts, then imaginary ones, mode by mode."""
        count, outputs = 2 * len(self.frequency), 2 * len(self.shape)
        at = np.concatenate([count + mode * outputs + np.arange(outputs) for mode in modes])
        return self.covariance[np.ix_(at, at)]


# -------- Checks
# Linearity of frequency responses: driving points and reciprocity.

ALONG = 0.999
"""Cosine of the angle from which two directions count as the same."""
SIGMAS = 3.0
"""Standard deviations by which a mobility may fall below zero; assumed."""
SHARE = 0.1
"""Acceptable share of such lines, weighted by their size; assumed."""
APART = 0.1
"""Relative difference of two reciprocal responses that triggers a warning; assumed."""


@dataclass(frozen=True)
class Check:
    """One check of a test.

    Attributes:
        name: `driving point` or `reciprocity`.
        places: of the force; for reciprocity of both forces.
        value: [-] for a driving point the share of lines that would feed energy into the hammer; for reciprocity the
            difference of both responses beyond their scatter, over the size of both driving points.
        limit: [-] largest acceptable value.
        remedy: what to check beyond the limit.
    """

    name: str
    places: tuple[Place, ...]
    value: float
    limit: float
    remedy: str

    @property
    def good(self) -> bool:
        """Whether the value is within its limit."""
        return bool(self.value <= self.limit)


def checks(frf: Frf) -> tuple[Check, ...]:
    """Return the checks possible with the places of a test."""
    return (*_driving_points(frf), *_reciprocity(frf))


def _driving_points(frf: Frf) -> Iterator[Check]:
    """Yield for each driving point the share of its mobility with a negative real part: a passive arm has none.

    With an exponential window all lines lie at Re s = decay > 0, where the mobility of a passive structure has a
    positive real part, too.
    """
    for o, i, sign in _same(frf.responses, frf.references):
        mobility = sign * frf.hits[:, o, i] / (frf.decay + 2j * np.pi * frf.frequency)
        mean, count = mobility.mean(0), len(mobility)
        error = mobility.real.std(0, ddof=1) / np.sqrt(count) if count > 1 else np.zeros(len(mean))
        below = mean.real < -SIGMAS * error
        share = float(abs(mean)[below].sum() / abs(mean).sum())
        remedy = "turn the direction of the force or the response, or check that both are at one point"
        yield Check("driving point", (frf.references[i],), share, SHARE, remedy)


def _reciprocity(frf: Frf) -> Iterator[Check]:
    """Yield the difference between the response at a to a force at b and the response at b to a force at a."""
    ends = list(_same(frf.responses, frf.references))
    mean = frf.mean
    for k, (o, i, sign) in enumerate(ends):
        for p, j, other in ends[k + 1 :]:
            if i == j:
                continue
            difference = sign * frf.hits[:, o, j] - other * frf.hits[:, p, i]
            count = len(difference)
            scatter = difference.var(0, ddof=1).sum() / count if count > 1 else 0.0
            beyond = np.sqrt(max((abs(difference.mean(0)) ** 2).sum() - scatter, 0.0))
            size = np.sqrt(np.linalg.norm(mean[o, i]) * np.linalg.norm(mean[p, j]))
            value = float(beyond / size) if size else 0.0
            both = frf.references[i], frf.references[j]
            yield Check("reciprocity", both, value, APART, "check points, directions and sensitivities of both")


def _same(responses: tuple[Place, ...], references: tuple[Place, ...]) -> Iterator[tuple[int, int, float]]:
    """Yield response, reference and sign of each driving point: both at one point along one line."""
    for o, response in enumerate(responses):
        for i, reference in enumerate(references):
            cosine = float(np.dot(response.direction, reference.direction))
            if response.point == reference.point and abs(cosine) > ALONG:
                yield o, i, float(np.sign(cosine))


# -------- Estimates
# H1, H2 and Hv of several hits, with coherence, and the contribution of each hit.

ESTIMATORS = ("h1", "h2", "hv")
"""Estimators: h1 for noise of the response, h2 for noise of the force, hv for both alike."""


def contributions(force: np.ndarray, response: np.ndarray, estimator: str = "h1") -> np.ndarray:
    """Return each hit's contribution to the frequency response: the mean is the estimate, the scatter its variance.

    These are the pseudo-values of the jackknife, H (n) - (n - 1) H without hit h, shifted so that their mean is the
    estimate itself.

    Args:
        force: (H, F) [N s] spectrum of the force of each hit.
        response: (H, O, F) [m/s] spectra of the responses.
        estimator: one of `ESTIMATORS`.

    Returns:
        (H, O, F) [1/kg] complex.
    """
    power = _powers(force, response)
    whole = _estimate([each.sum(0) for each in power], estimator)
    count = len(force)
    if count == 1:
        return whole[None]
    rest = _estimate([each.sum(0) - each for each in power], estimator)
    pseudo = count * whole - (count - 1) * rest
    return pseudo - pseudo.mean(0) + whole


def coherence(force: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Return the share of the response that is linear in the force, (O, F) [-]; one for a single hit.

    Args:
        force: (H, F) spectra of the force.
        response: (H, O, F) spectra of the responses.
    """
    ff, aa, af = (each.sum(0) for each in _powers(force, response))
    return np.minimum(abs(af) ** 2 / np.maximum(ff * aa, np.finfo(float).tiny), 1.0)


def _powers(force: np.ndarray, response: np.ndarray) -> list[np.ndarray]:
    """Return auto-powers of force (H, 1, F) and responses, and the cross-power (H, O, F), of each hit."""
    f = force[:, None]
    return [abs(f) ** 2, abs(response) ** 2, response * f.conj()]


def _estimate(power: list[np.ndarray], estimator: str) -> np.ndarray:
    ff, aa, af = power
    if estimator == "h1":
        return af / ff
    if estimator == "h2":
        return aa / af.conj()
    return af / abs(af) * np.sqrt(aa / ff)


# -------- Modal test
# A hammer test as a value, and the options of its processing.


@dataclass(frozen=True)
class Processing:
    """Options of the processing from records to frequency responses.

    Attributes:
        estimator: `h1`, `h2` or `hv`.
        window_end: [-] value of the exponential window at the end of a record; 1 for no window.
        rest: [s] least time between two hits of one record.
        band: [Hz] lowest and highest line; None for the band that the hammer excites.
    """

    estimator: str = "h1"
    window_end: float = 0.001
    rest: float = 1.0
    band: tuple[float, float] | None = None


@dataclass(frozen=True)
class Rejected:
    """A rejected hit.

    Attributes:
        file: its file.
        number: of the hit in its file, from 1.
        reason: why.
    """

    file: str
    number: int
    reason: str


@dataclass(frozen=True)
class HeldArm:
    """State of the arm in a test.

    Attributes:
        posture: (joints,) [rad]
        load: the load case, sensors included.
        drives: state of the drives.
        files: of the test.
    """

    posture: tuple[float, ...]
    load: Load
    drives: str
    files: tuple[str, ...]


MOVING = "the arm was still moving before"
"""Remark on a hit that began before the arm had calmed down."""


@dataclass(frozen=True)
class ModalTest(HeldArm):
    """Hammer test at one posture under one load.

    Attributes:
        frf: frequency responses with those of each hit.
        coherence: (O, I, F) [-]; ones for a single hit.
        duration: [s] of a record; 0 for finished frequency responses.
        rejected: rejected hits.
        checks: of driving points and reciprocity.
        remarks: other remarks for the report.
    """

    frf: Frf
    coherence: np.ndarray
    duration: float
    rejected: tuple[Rejected, ...]
    checks: tuple[Check, ...]
    remarks: tuple[str, ...]

    @property
    def responses(self) -> tuple[Place, ...]:
        """(O,) point and direction of each response."""
        return self.frf.responses

    @property
    def hits(self) -> int:
        """Number of accepted hits."""
        return len(self.frf.hits) * len(self.frf.references)

    @property
    def moving(self) -> tuple[str, ...]:
        """Remarks on hits that began before the arm had calmed down, one per file."""
        return tuple(remark for remark in self.remarks if MOVING in remark)

    @property
    def good(self) -> bool:
        """Whether the arm was at rest before each hit, and driving points and reciprocal responses agree."""
        return not self.moving and all(check.good for check in self.checks)


# -------- Windows
# The exponential window on the whole record.


def exponential_decay(duration: float, end: float, applied: float = 0.0) -> float:
    """Return the decay rate [1/s] of a window that ends at a given value, less that of a window already applied.

    Args:
        duration: [s] of the record.
        end: [-] value of the window at its end; 1 for no window.
        applied: [1/s] decay rate of the analyser's own window.
    """
    return max(-math.log(end) / duration - applied, 0.0)


def exponential_window(count: int, step: float, decay: float) -> np.ndarray:
    """Return exp(-decay t) at samples of a record, (T,) [-]."""
    return np.exp(-decay * step * np.arange(count))
