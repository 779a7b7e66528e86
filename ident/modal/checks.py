"""Whether frequency responses are those of one linear structure: driving points and reciprocity.

References:
    Ewins, "Modal Testing", 2nd ed. 2000, sections 3.4.2 (driving point) and 3.10 (reciprocity).
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ident.modal.frf import Frf, Place

ALONG = 0.999
"""Cosine of the angle of two directions that are the same."""
SIGMAS = 3.0
"""Standard deviations by which a mobility may fall below zero."""
SHARE = 0.1
"""Share of the lines, weighted by their size, that may do so."""
APART = 0.1
"""Difference of two responses that should be equal, as a share of their size, beyond which it is said."""


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
        s = frf.decay + 2j * np.pi * frf.frequency
        mobility = sign * frf.hits[:, o, i] / s
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
            size = np.sqrt(np.linalg.norm(mean[o, i]) * np.linalg.norm(mean[p, j]))
            value = float(_beyond_scatter(difference) / size) if size else 0.0
            both = frf.references[i], frf.references[j]
            yield Check("reciprocity", both, value, APART, "check points, directions and sensitivities of both")


def _beyond_scatter(difference: np.ndarray) -> float:
    """Return the size of a mean difference (H, F) that the scatter of the hits does not explain."""
    count = len(difference)
    scatter = difference.var(0, ddof=1).sum() / count if count > 1 else 0.0
    return float(np.sqrt(max((abs(difference.mean(0)) ** 2).sum() - scatter, 0.0)))


def _same(responses: tuple[Place, ...], references: tuple[Place, ...]) -> Iterator[tuple[int, int, float]]:
    """Yield response, reference and sign where both are at one point along one line."""
    for o, response in enumerate(responses):
        for i, reference in enumerate(references):
            cosine = float(np.dot(response.direction, reference.direction))
            if response.point == reference.point and abs(cosine) > ALONG:
                yield o, i, float(np.sign(cosine))
