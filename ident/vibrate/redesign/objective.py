"""What a design minimises and keeps within limits: functions of scaled changes, with exact slopes."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.special import log_ndtr, logsumexp

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.jit import AnyArray, jit
from ident.vibrate.redesign.end_states import ends, worst_state
from ident.vibrate.redesign.evaluator import Evaluator
from ident.vibrate.redesign.variable import Variable, apply

BLUR = 0.05
"""Width in ln(amplitude) over which a draw passes from below the limit to above it, so that there is a slope."""
CACHED = 64
"""Results that are remembered: an optimiser asks for the same several times."""

Point = Float[np.ndarray, "V"]


@dataclass(frozen=True)
class Objective:
    """Functions of u: changes in units of the widest that is allowed.

    Attributes:
        evaluator: with a step that suits all of the bounds.
        scale: (V,) the widest change of each variable.
        low: (V,) lower bounds of u.
        high: (V,) upper bounds of u.
        cuts: sets of phases, each by path: the amplitude is the largest with any; without, with those of the arm.
    """

    evaluator: Evaluator
    scale: Point
    low: Point
    high: Point
    cuts: tuple[Mapping[str, float], ...] = ()

    @classmethod
    def of(cls, evaluator: Evaluator, cuts: tuple[Mapping[str, float], ...] = ()) -> "Objective":
        """Scale an evaluator's variables."""
        low, high = evaluator.bounds
        scale = np.maximum(np.abs(low), np.abs(high))
        evaluator = evaluator if evaluator.step else replace(evaluator, step=evaluator.step_for(evaluator.bounds))
        return cls(evaluator, scale, low / scale, high / scale, cuts)

    @cached_property
    def weight(self) -> Point:
        """Cost of changing each variable."""
        return np.array([variable.weight for variable in self.evaluator.variables])

    @cached_property
    def present(self) -> float:
        """Largest amplitude as it is [m]."""
        return self.largest(np.zeros(len(self.scale)))

    def squared_norm(self, u: Point) -> tuple[float, Point]:
        """Return the square of the change norm, and its slopes."""
        return float((self.weight * u**2).sum()), 2 * self.weight * u

    def change_norm(self, u: Point) -> float:
        """Return the change norm [-], see `design.Place`."""
        return float(np.sqrt(self.squared_norm(u)[0]))

    def largest(self, u: Point) -> float:
        """Return the largest amplitude of the arm itself [m]."""
        return float(self.parts(u)[0].max())

    def parts(self, u: Point) -> tuple[Float[np.ndarray, "J"], Float[np.ndarray, "J V"]]:
        """Return the parts of which that is the largest [m], and their slopes."""
        return self._remembered(Objective._parts, u.tobytes())

    def end_state(self, u: Point) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 V"]]:
        """Return first frequency [Hz] and deflection [m], and their slopes."""
        return self._remembered(Objective._end_state, u.tobytes())

    def log_odds(self, u: Point, limit: float) -> tuple[float, Point]:
        """Return the blurred log-odds that a draw exceeds the limit, and their slopes."""
        return self._remembered(Objective._log_odds, u.tobytes(), limit)

    @cached_property
    def _remembered(self) -> Callable[..., Any]:
        """Computes something at a place, or remembers it; searches side by side may share it."""
        return lru_cache(CACHED)(lambda compute, u, *more: compute(self, np.frombuffer(u), *more))

    def _parts(self, u: Point) -> tuple[Float[np.ndarray, "J"], Float[np.ndarray, "J V"]]:
        values, slopes = self.evaluator.slopes(u * self.scale, self.cuts or ({},))
        worst = values.argmax(2)[..., None]  # of each window: more rows than windows would slow the optimiser down
        values, slopes = np.take_along_axis(values, worst, 2), np.take_along_axis(slopes, worst[None], 3)
        return values.ravel(), slopes.reshape((len(u), -1)).T * self.scale

    def _end_state(self, u: Point) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 V"]]:
        e = self.evaluator
        values, slopes = _end_state_slopes(e.arm, e.variables, ends(e.motion), e.loads, u * self.scale)
        return np.asarray(values), np.asarray(slopes) * self.scale

    def _log_odds(self, u: Point, limit: float) -> tuple[float, Point]:
        values, slopes = self.evaluator.slopes_of_draws(u * self.scale)
        draws = values.shape[2]
        parts, slopes = values.reshape((-1, draws)), slopes.reshape((len(u), -1, draws))
        worst = parts.argmax(0), np.arange(draws)
        z = np.log(parts[worst] / limit) / BLUR
        dz = slopes[:, *worst] / parts[worst] / BLUR * self.scale[:, None]
        above, below = logsumexp(log_ndtr(z)), logsumexp(log_ndtr(-z))
        density = -(z**2) / 2 - np.log(2 * np.pi) / 2
        return float(above - below), (dz * (np.exp(density - above) + np.exp(density - below))).sum(1)


@jit
def _end_state_slopes(
    arm: Arm,
    variables: tuple[Variable, ...],
    posture: Float[AnyArray, "driven 2"],
    loads: Loads | None,
    changes: Float[AnyArray, "V"],
) -> tuple[Float[Array, "2"], Float[Array, "2 V"]]:
    """Return first frequency and deflection after changes, and their slopes."""

    def end_state(changes: Array) -> Array:
        return jnp.stack(worst_state(arm.replace(apply(arm.numbers(), variables, list(changes))), posture, loads))

    changes = jnp.asarray(changes)
    return end_state(changes), jax.jacfwd(end_state)(changes)
