"""Lines of a spectrum as sinusoids: frequency and amplitude by least squares in time, with their standard errors."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from ident.vibrate.spectra import Peak, Spectrum, window_samples

LOCAL = 12
"""Bins on either side of a line whose residual is its noise: noise, drift and sweeps differ along the spectrum."""
TAKEN = 3.0
"""Bins of noise that the fit of a line with three numbers takes out of the residual, with a Hann window (simulated)."""
STEPS = 6
"""Gauss-Newton steps; from a peak of a steady line three do."""


def refined(
    spectrum: Spectrum, values: Float[np.ndarray, "T"], found: Sequence[Peak], step_error: float = 0.0
) -> tuple[Peak, ...]:
    """Refine the peaks of a spectrum by least squares of sinusoids in time, all jointly; the largest first.

    minimise sum_t w(t) (x(t) - c - sum_k a_k cos(2 pi f_k t) - b_k sin(2 pi f_k t))^2

    The weights w are the spectrum's window (Hann for flattop), so that a slow motion leaks as little as in the
    spectrum, and amplitudes of lines that swell or sweep are those of the spectrum. Each frequency stays within a bin
    of its peak, and within half the distance to the next one. The covariance is (J'WJ)^-1 J'W^2J (J'WJ)^-1 times the
    variance of white noise that has the residual's density around the line: the Cramer-Rao bound for `boxcar`; with
    `hann` standard errors are 1.53 times (frequency) and 1.22 times that (amplitude). Peaks of averaged segments stay
    as they are, without standard errors.

    Args:
        spectrum: of one trace.
        values: (T,) [any] the trace.
        found: its peaks.
        step_error: relative standard error of the sampling interval, which is one of each frequency.

    References:
        Rife, Boorstyn, "Single-tone parameter estimation from discrete-time observations", IEEE Trans. Inform. Theory
        20 (1974), eqs. (16), (17). Stoica, Moses, "Spectral analysis of signals", 2005, section 4.3.
    """
    if not found or spectrum.segments > 1:
        return tuple(found)
    start, count, lines = np.array([peak.frequency for peak in found]) / spectrum.resolution, len(values), len(found)
    # the flat top's negative ends leave no curvature in frequency
    weights = window_samples("hann" if spectrum.window == "flattop" else spectrum.window, count)
    turn = 2 * np.pi * (np.arange(count) - (count - 1) / 2) / count
    nearest = np.abs(start[:, None] - start + np.diag(np.full(lines, np.inf))).min(1)
    reach, bins = np.minimum(1.0, nearest / 2), start
    for _ in range(STEPS):
        phase = bins[:, None] * turn
        design = np.concatenate([np.cos(phase), np.sin(phase), np.ones((1, count))])
        parts = np.linalg.pinv((design * weights) @ design.T, hermitian=True) @ (design * weights @ values)
        amplitude = np.maximum(np.hypot(parts[:lines], parts[lines:-1]), np.finfo(float).tiny)
        a, b = parts[:-1].reshape(2, lines) / amplitude
        # slopes are those of a unit amplitude, so that all columns are of one size
        slopes = turn * (b[:, None] * design[:lines] - a[:, None] * design[lines:-1])
        jacobian, residual = np.concatenate([design, slopes]), values - parts @ design
        inverse = np.linalg.pinv((jacobian * weights) @ jacobian.T, hermitian=True)
        change = (inverse @ (jacobian * weights @ residual))[-lines:] / amplitude
        bins = np.clip(bins + change, start - reach, start + reach)
    covariance = inverse @ ((jacobian * weights**2) @ jacobian.T) @ inverse
    sizes, both = np.diag(covariance), np.diag(covariance[:lines, lines : 2 * lines])
    of_amplitude = a**2 * sizes[:lines] + b**2 * sizes[lines : 2 * lines] + 2 * a * b * both
    power = np.abs(np.fft.rfft(weights * residual)) ** 2 / np.sum(weights**2)
    near = np.abs(np.arange(1, len(power)) - bins[:, None]) <= LOCAL
    fitted = TAKEN * (np.abs(bins - bins[:, None]) <= LOCAL).sum(1)
    noise = np.sqrt((near @ power[1:]) / np.maximum(near.sum(1) - fitted, 1.0))
    of_bins = noise * np.sqrt(sizes[-lines:]) / amplitude
    of_bins = np.where(np.abs(bins - start) < reach, of_bins, np.maximum(of_bins, reach))  # stopped: no sinusoid
    of_bins, of_amplitude = np.hypot(of_bins, step_error * bins), noise * np.sqrt(of_amplitude)
    rows = np.stack([spectrum.resolution * bins, amplitude, spectrum.resolution * of_bins, of_amplitude], axis=1)
    return tuple(sorted((Peak(*row) for row in rows.tolist()), key=lambda peak: -peak.amplitude))
