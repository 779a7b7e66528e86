"""Amount of computation in a diagnosis."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class DiagnosisEffort:
    """Numbers of draws and of tried values; fewer of each save time and cost accuracy.

    Attributes:
        ess: effective samples of each unknown at which sampling stops: as many as there are draws for verification.
        steps: of the sampler, its upper limit.
        draws: of the posterior, at most.
        band_draws: of these, for the bands of natural frequencies.
        assessment_draws: of these, to assess vibration and remedies; all others serve the verification.
        speeds: tried speeds, as factors of the present one.
        values: tried values of a single number; 41 are steps of 3.5 % from half to twice as much.
        screened: points at which a search for several numbers looks for its start; a power of two.
        iterations: of a search, at most.
    """

    ess: float = 1000.0
    steps: int = 20000
    draws: int = 1100
    band_draws: int = 100
    assessment_draws: int = 100
    speeds: tuple[float, ...] = (0.5, 0.625, 0.75, 0.875, 1.0, 1.125, 1.25, 1.375, 1.5)
    values: int = 41
    screened: int = 64
    iterations: int = 60
