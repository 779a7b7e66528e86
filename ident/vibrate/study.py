"""Studies of a motion: two methods against each other, draws of a posterior, a measured trace."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.programs import AnyArray, Progress, in_batches
from ident.text import no_such
from ident.vibrate.compare import Comparison, Trace, compare
from ident.vibrate.motion import Motion
from ident.vibrate.response import Response, peak, rms
from ident.vibrate.settling import settling_time
from ident.vibrate.simulate import RATE, simulate

DIRECTIONS = ("x", "y", "z")
METHODS = ("both", "fast", "exact")
BATCH = 16
"""Draws per batch of simulation: fewer are hardly slower per draw, more need memory."""


@dataclass(frozen=True)
class Sizes:
    """Size of a vibration in each direction, `(3, *draws)` each.

    Attributes:
        peak: [m] largest magnitude.
        rms: [m] over the whole time.
        residual: [m] largest magnitude after arrival; NaN where no sample is that late.
        settled: [s] from the start until it stays below a value for good, see `settling_time`.
        late: [m] largest magnitude from a time on; NaN where no time was given.
    """

    peak: Float[np.ndarray, "3 *draws"]
    rms: Float[np.ndarray, "3 *draws"]
    residual: Float[np.ndarray, "3 *draws"]
    settled: Float[np.ndarray, "3 *draws"]
    late: Float[np.ndarray, "3 *draws"]


@dataclass(frozen=True)
class Draws:
    """The vibration by draws of a posterior.

    Attributes:
        values: the draws by path, (draws,) [SI]
        vibration: (3, T, draws) [m]
        sizes: of each draw.
    """

    values: Mapping[str, Float[np.ndarray, "draws"]]
    vibration: Float[np.ndarray, "3 T draws"]
    sizes: Sizes

    @property
    def band(self) -> Float[np.ndarray, "2 3 T"]:
        """5 and 95 % quantiles of the vibration at each time [m]."""
        return np.quantile(self.vibration, (0.05, 0.95), axis=2)

    def exceeds(self, limit: float) -> tuple[Float[np.ndarray, "3"], float]:
        """Return the share of draws whose peak exceeds a limit [m]: in each direction, and in any."""
        beyond = self.sizes.peak > limit
        return beyond.mean(1), float(beyond.any(0).mean())


def simulate_motion(
    arm: Arm,
    motion: Motion,
    *,
    loads: Loads | None = None,
    method: str = "both",
    elastic_belts: bool = False,
    rate: float = RATE,
    step: float | None = None,
) -> tuple[Response, Response | None]:
    """Simulate a motion by the fast method, the exact one, or both.

    Returned is the response by the exact method unless the fast one alone was chosen, and that by the fast one if both
    were.

    Raises:
        InputError: no such method; see also `simulate`.
        ModelError: the arm collapses; see also `simulate`.
    """
    if method not in METHODS:
        raise no_such("", method, METHODS, "choose one of them", "method")
    how: Any = {"loads": loads, "elastic_belts": elastic_belts, "rate": rate, "step": step}
    fast, exact = (simulate(arm, motion, method=m, **how) if method in (m, "both") else None for m in ("fast", "exact"))
    response = exact or fast
    assert response is not None
    return response, fast if exact else None


def draw(
    arm: Arm,
    motion: Motion,
    values: Mapping[str, Float[np.ndarray, "draws"]],
    *,
    loads: Loads | None = None,
    elastic_belts: bool = False,
    rate: float = RATE,
    measure: Callable[[Response], Sizes],
    progress: Progress = iter,
) -> Draws:
    """Simulate a motion by the fast method for draws of some of the arm's numbers.

    Args:
        arm: has the other numbers.
        motion: the commanded motion.
        values: draws by path.
        loads: the load case.
        elastic_belts: whether belts stretch.
        rate: samples a second.
        measure: gives the sizes of a response, as `measures` does.
        progress: shows how far it is, over the batches of draws.

    Raises:
        ModelError: the arm collapses for some draw.
    """

    def simulated(some: dict[str, np.ndarray]) -> tuple[AnyArray, dict[str, np.ndarray]]:
        response = simulate(arm.replace(some), motion, loads=loads, elastic_belts=elastic_belts, rate=rate)
        return response.vibration, vars(measure(response))

    own = {path: np.asarray(column) for path, column in values.items()}
    vibration, sizes = in_batches(simulated, own, min(BATCH, len(next(iter(own.values())))), progress)
    return Draws(own, vibration, Sizes(**sizes))


def measures(response: Response, settled: float, at: float | None = None) -> Sizes:
    """Return the sizes of a response; settled below a value [m]."""
    vibration = response.vibration
    none = np.full((3, *vibration.shape[2:]), np.nan)
    end, arrival = float(response.time[-1]), response.motion.arrival
    arrived = end >= arrival - 1e-9
    residual = np.asarray(peak(response.after(arrival))) if arrived else none
    late = none if at is None or at > end + 1e-9 else np.asarray(peak(response.after(at)))
    return Sizes(
        np.asarray(peak(vibration)), np.asarray(rms(vibration)), residual, settling_time(response, settled), late
    )


def against(
    response: Response,
    time: Float[np.ndarray, "S"],
    values: Mapping[str, Float[np.ndarray, "S"]],
    kind: str,
    band: tuple[float, float],
) -> dict[str, Comparison]:
    """Compare a response with a measured trace, direction by direction.

    Args:
        response: without batch axes.
        time: (S,) [s] of the trace, on the clock of the motion.
        values: by direction `x`, `y`, `z` [m or m/s^2]
        kind: `displacement` or `acceleration`.
        band: [Hz] of the dominant frequency.
    """
    comparisons, at = {}, np.asarray(response.time)
    for direction, measured in values.items():
        ours = Trace(at, np.asarray(response.measured[DIRECTIONS.index(direction)]))
        theirs = Trace(time, measured, "acceleration" if kind == "acceleration" else "displacement")
        comparisons[direction] = compare(ours, theirs, band=band)
    return comparisons
