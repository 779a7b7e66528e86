"""Free decays after taps or releases: where they begin and end in the responses, without a measured force."""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Float
from scipy.ndimage import uniform_filter1d
from scipy.special import chdtri

from ident.modal.hammer import PULSE, REBOUND, runs

PAST = 60
"""Past samples, of all responses together, that predict the next one: the states of an arm and its noise; assumed."""
SETTLED = 8
"""Samples on either side of a contact that the filter of a recorder or of resampling smears; assumed."""
CONTACT = 5
"""Samples over which the power of innovations is averaged: a hand touches for some 20 ms, at 200 Hz; assumed."""
FALSE_CONTACT = 1e-10
"""False-alarm probability of a contact by noise alone, at one sample; assumed."""
FLOOR = 1e-9
"""Least noise of a response, as a share of its largest innovation: a simulation may have none; assumed."""


def innovations(parts: Sequence[Float[np.ndarray, "O _"]]) -> tuple[list[Float[np.ndarray, "O _"]], np.ndarray]:
    """Return what the responses' own past does not predict, and its standard deviation where nothing touches the arm.

    A free decay obeys y(t) = sum_k A_k y(t - k), so that only noise is left of it; a contact stands out, also while the
    arm still rings. A_k by least squares over all blocks, the deviation by the median.

    Args:
        parts: blocks of the same responses, without their mean.

    Returns:
        The innovations of each block, and (O,) their standard deviation.

    References:
        Ljung, "System Identification", 2nd ed. 1999, section 4.2 (autoregressive models).
    """
    lags = math.ceil(PAST / len(parts[0]))
    padded = [np.pad(part, ((0, 0), (lags, 0))) for part in parts]
    past = [np.concatenate([each[:, lags - k : each.shape[1] - k] for k in range(1, lags + 1)]) for each in padded]
    gram = sum(own @ own.T for own in past)
    cross = sum(own @ part.T for own, part in zip(past, parts, strict=True))
    predictor = np.linalg.lstsq(gram, cross, rcond=None)[0].T
    left = [part - predictor @ own for part, own in zip(parts, past, strict=True)]
    size = np.abs(np.concatenate(left, 1))
    return left, np.maximum(1.4826 * np.median(size, 1), FLOOR * size.max(1))


def free_decays(
    left: Sequence[Float[np.ndarray, "O _"]], noise: Float[np.ndarray, "O"], rest: int
) -> list[list[tuple[int, int]]]:
    """Return begin and end [samples] of the free decays in each block, by its innovations.

    A contact stands out of the noise and is at least a tenth as strong as the strongest one. Contacts closer than
    `rest` are one tap; its decay begins after the last of them and ends before the next contact. Within a decay what is
    `REBOUND` of the tap is a contact too.

    Args:
        left: innovations of each block.
        noise: their standard deviation.
        rest: least samples between two taps.
    """
    power = [((each / noise[:, None]) ** 2).mean(0) for each in left]
    sizes = [np.sqrt(uniform_filter1d(each, CONTACT, mode="constant")) for each in power]
    count = CONTACT * len(noise)
    quiet = float(np.sqrt(chdtri(count, FALSE_CONTACT) / count))
    level = max(quiet, PULSE * max(float(size.max()) for size in sizes))
    return [list(_decays(size, level, quiet, rest)) for size in sizes]


def _decays(size: Float[np.ndarray, "T"], level: float, quiet: float, rest: int) -> Iterator[tuple[int, int]]:
    taps = list[list[int]]()
    for begin, end in runs(size > level):
        if taps and begin - taps[-1][1] < rest:
            taps[-1][1] = end
        else:
            taps.append([begin, end])
    for (begin, end), until in zip(taps, [*(each[0] for each in taps[1:]), len(size)], strict=True):
        weak = max(quiet, REBOUND * float(size[begin:end].max()))
        start, stop = end, until
        for a, b in runs(size[end:until] > weak):
            if end + a - start >= rest:
                stop = end + a
                break
            start = end + b if a > SETTLED else start  # else it is the end of the same contact
        yield start + SETTLED, stop - SETTLED * (stop < len(size))
