"""Frequency response functions of a modal test, with the single hits that they are averaged from.

Whether frequency responses are those of one linear structure: driving points and reciprocity.

Frequency responses of several hits: H1, H2 and Hv with coherence, and what each hit contributes.

Windows of a hammer test: about the pulse for the force, and one that fades all of it out.

The window exp(-sigma t) on force and response alike makes of the response function H(s) the same function on
another line of the complex plane, H(sigma + i omega): each pole p becomes p - sigma, exactly.

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
    """Where and along what a force acts or a response is measured.

    point: name of a point of the arm
    direction: (3,) [-] unit vector in the base frame, at the posture of the test
    """

    point: str
    direction: tuple[float, float, float]


@dataclass(frozen=True)
class Frf:
    """Accelerance, acceleration by force, of one posture of an arm.

    frequency: (F,) [Hz] lines, evenly spaced, ascending
    hits: (H, O, I, F) [1/kg] complex; response of each of H hits (of a shaker test: of each block) at O responses, by I
        references
    responses: (O,) where and along what acceleration is measured
    references: (I,) where and along what the force acts
    decay: [1/s] what an exponential window has added to the decay rate of every pole; to be taken off again
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
        responses: (O,) where and along what was measured.
        band: [Hz] between which modes were sought.
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
# Whether frequency responses are those of one linear structure: driving points and reciprocity.

ALONG = 0.999
"""Cosine of the angle of two directions that are the same."""
SIGMAS = 3.0
"""Standard deviations by which a mobility may fall below zero; assumed."""
SHARE = 0.1
"""Share of the lines, weighted by their size, that may do so; assumed."""
APART = 0.1
"""Difference of two responses that should be equal, as a share of their size, beyond which it is said; assumed."""


@dataclass(frozen=True)
class Check:
    """One check of a test.

    Attributes:
        name: `driving point` or `reciprocity`.
        places: of the force, and of reciprocity of the other one.
        value: [-] what was found: of a driving point the share of lines that would feed energy into the hammer, of
            reciprocity the difference of both responses beyond their scatter, by the size of both driving points.
        limit: [-] beyond which it is doubtful.
        remedy: what to look at then.
    """

    name: str
    places: tuple[Place, ...]
    value: float
    limit: float
    remedy: str

    @property
    def good(self) -> bool:
        """Whether it is within its limit."""
        return bool(self.value <= self.limit)


def checks(frf: Frf) -> tuple[Check, ...]:
    """Return the checks that the places of a test allow."""
    return (*_driving_points(frf), *_reciprocity(frf))


def _driving_points(frf: Frf) -> Iterator[Check]:
    """Yield for each driving point the share of its mobility whose real part is below zero: a passive arm has none.

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
    """Yield how much the response at a by a force at b differs from that at b by a force at a."""
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
    """Yield response, reference and sign where both are at one point along one line."""
    for o, response in enumerate(responses):
        for i, reference in enumerate(references):
            cosine = float(np.dot(response.direction, reference.direction))
            if response.point == reference.point and abs(cosine) > ALONG:
                yield o, i, float(np.sign(cosine))


# -------- Estimates
# H1, H2 and Hv of several hits, with coherence, and what each hit contributes.

ESTIMATORS = ("h1", "h2", "hv")
"""Estimators: h1 for noise of the response, h2 for noise of the force, hv for both alike."""


def contributions(force: np.ndarray, response: np.ndarray, estimator: str = "h1") -> np.ndarray:
    """Return what each hit says of the frequency response: their mean is the estimate, their scatter its variance.

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
# What a hammer test is, as a value, and how its records are processed.


@dataclass(frozen=True)
class Processing:
    """How records become frequency responses.

    Attributes:
        estimator: `h1`, `h2` or `hv`.
        window_end: [-] share to which the exponential window fades a record; 1 for none.
        rest: [s] between two hits of one record, at least.
        band: [Hz] lowest and highest line that is kept; None for what the hammer excites.
    """

    estimator: str = "h1"
    window_end: float = 0.001
    rest: float = 1.0
    band: tuple[float, float] | None = None


@dataclass(frozen=True)
class Rejected:
    """A hit that does not count.

    Attributes:
        file: where it is.
        number: of the hit in its file, from 1.
        reason: why.
    """

    file: str
    number: int
    reason: str


@dataclass(frozen=True)
class HeldArm:
    """How an arm was held in a test.

    Attributes:
        posture: (joints,) [rad]
        load: the load case, sensors included.
        drives: what held the motors.
        files: that tell of the test.
    """

    posture: tuple[float, ...]
    load: Load
    drives: str
    files: tuple[str, ...]


MOVING = "the arm was still moving before"
"""What is said of a hit before which the arm had not calmed down."""


@dataclass(frozen=True)
class ModalTest(HeldArm):
    """What was measured at one posture under one load.

    Attributes:
        frf: frequency responses with those of each hit.
        coherence: (O, I, F) [-]; ones for a single hit.
        duration: [s] of a record; 0 for finished frequency responses.
        rejected: hits that do not count.
        checks: of driving points and reciprocity.
        remarks: what else a reader should know.
    """

    frf: Frf
    coherence: np.ndarray
    duration: float
    rejected: tuple[Rejected, ...]
    checks: tuple[Check, ...]
    remarks: tuple[str, ...]

    @property
    def responses(self) -> tuple[Place, ...]:
        """(O,) where and along what was measured."""
        return self.frf.responses

    @property
    def hits(self) -> int:
        """Hits that count."""
        return len(self.frf.hits) * len(self.frf.references)

    @property
    def moving(self) -> tuple[str, ...]:
        """Of each file before which of its hits the arm had not calmed down, where there are such."""
        return tuple(remark for remark in self.remarks if MOVING in remark)

    @property
    def good(self) -> bool:
        """Whether the arm was at rest before each hit, and driving points and reciprocal responses agree."""
        return not self.moving and all(check.good for check in self.checks)


# -------- Windows
# Of a hammer test: about the pulse for the force, and one that fades all of it out.

MARGIN = 3.0
"""Duration of the force window's flat part behind the pulse and of its fall, each, in durations of the pulse."""


def exponential_decay(duration: float, end: float, applied: float = 0.0) -> float:
    """Return by how much a window is still to fade a record [1/s] so that it ends at a share of its start.

    Args:
        duration: [s] of the record.
        end: [-] the share; 1 for no window.
        applied: [1/s] what the analyser's own window has faded already.
    """
    return max(-math.log(end) / duration - applied, 0.0)


def exponential_window(count: int, step: float, decay: float) -> np.ndarray:
    """Return exp(-decay t) at samples of a record, (T,) [-]."""
    return np.exp(-decay * step * np.arange(count))


def force_window(count: int, begin: int, end: int) -> np.ndarray:
    """Return a window (T,) [-] that is one up to some time behind a pulse, from there on falls as a cosine to zero.

    Args:
        count: samples T.
        begin: first sample of the pulse.
        end: first sample after it.
    """
    width = max(math.ceil(MARGIN * (end - begin)), 2)
    window = np.zeros(count)
    flat = min(end + width, count)
    window[:flat] = 1.0
    fall = np.cos(np.linspace(0.0, np.pi / 2, width)) ** 2
    window[flat : flat + width] = fall[: count - flat]
    return window
