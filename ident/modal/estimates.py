"""Frequency responses of several hits: H1, H2 and Hv with coherence, and what each hit contributes.

References:
    Bendat and Piersol, "Random Data", 4th ed. 2010, chapter 6 (H1, H2, coherence).
    Rocklin, Crowley, Vold, "A comparison of H1, H2 and Hv frequency response functions", IMAC III, 1985.
    Efron, "The Jackknife, the Bootstrap and Other Resampling Plans", 1982 (pseudo-values).
"""

import numpy as np

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
