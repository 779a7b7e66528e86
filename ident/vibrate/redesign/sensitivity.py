"""What to change first: percent of amplitude per percent of each number of the arm, and where its sign is not sure."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from ident.arm.arm import Arm
from ident.arm.fields import field_of
from ident.jit import cores
from ident.vibrate.redesign.evaluator import WIDTH, Evaluator
from ident.vibrate.redesign.variable import Variable, check_path
from ident.vibrate.response.exact import Progress

NEARBY = 0.1
"""Share of a number by which nearby arms differ in it, either way."""
FLAT = 0.002
"""Share of an amplitude below which a change is none: peaks are sampled."""


@dataclass(frozen=True)
class Sensitivities:
    """Elasticities of the amplitude.

    Attributes:
        paths: the numbers.
        present: (P,) [SI] as they are.
        amplitude: (3,) [m] as it is.
        elasticity: (P, 3) [-] percent of amplitude per percent of the number, in each direction.
        unsure: (P, 3) whether its sign is another for nearby arms: with draws, for more than 5 % of them; without,
            where `NEARBY` more or less of the number itself changes the amplitude the other way.
        draws: (P, 3, D) of the draws; None without.
    """

    paths: tuple[str, ...]
    present: Float[np.ndarray, "P"]
    amplitude: Float[np.ndarray, "3"]
    elasticity: Float[np.ndarray, "P 3"]
    unsure: Bool[np.ndarray, "P 3"]
    draws: Float[np.ndarray, "P 3 D"] | None = None

    @property
    def band(self) -> Float[np.ndarray, "2 P 3"]:
        """5 and 95 % quantiles over the draws."""
        assert self.draws is not None
        return _band(self.draws)

    @property
    def order(self) -> list[int]:
        """The numbers by their effect on the largest amplitude, the strongest first."""
        return np.argsort(-np.abs(self.elasticity[:, np.argmax(self.amplitude)])).tolist()


def changeable(arm: Arm) -> tuple[str, ...]:
    """Return the numbers that are studied: those that a redesign may change, and that are not zero."""
    redesigned = [path for path in arm.paths() if (field := field_of(path)) and field.redesigned]
    named = [path for path in redesigned if not _of_payload(arm, path)]
    return tuple(path for path in named if float(arm.get(path)) != 0)


def sensitivities(evaluator: Evaluator, paths: Sequence[str] | None = None, progress: Progress = iter) -> Sensitivities:
    """Return how the amplitude of an evaluator changes with numbers of the arm, by exact slopes.

    Where an amplitude is a peak, the slope is that of the largest window. Where phases are not known, each direction
    has those with which its peak is the worst: the slope of a largest value over phases is that with the phases kept
    (Danskin, "The theory of max-min", 1967). An RMS is with the phases of the arm. See `Evaluator`.

    With phases that are known, or drawn, a number that changes how fast a pulley turns also shifts its vibration in
    time: a peak that is sampled a little beside its top then has another slope. So slopes by ratios are rough there.

    Args:
        evaluator: arm, motion and measure; its own variables are not used.
        paths: the numbers; `changeable` if none are named.
        progress: shows how far it is, over groups of numbers.
    """
    paths = tuple(paths) if paths else changeable(evaluator.arm)
    for path in paths:
        check_path(evaluator.arm, path)
    worst = _worst_phases(evaluator)
    together = WIDTH * cores()
    groups = [paths[first : first + together] for first in range(0, len(paths), together)]
    own, drawn = [], []
    for k in progress(range(len(groups))):
        seen = replace(evaluator, variables=tuple(Variable((path,), -np.inf, np.inf) for path in groups[k]))
        nothing = np.zeros(len(groups[k]))
        parts, slopes = seen.slopes(nothing, worst or ({},))
        each = _elasticities(evaluator.arm, seen.variables, parts, slopes)
        own.append(np.diagonal(each, axis1=1, axis2=2) if worst else each[..., 0])
        if evaluator.draws:
            drawn.append(_elasticities(evaluator.arm, seen.variables, *seen.slopes_of_draws(nothing)))
    each, draws = np.concatenate(own), np.concatenate(drawn) if drawn else None
    present = np.array([float(evaluator.arm.get(path)) for path in paths])
    nothing = np.zeros((1, len(evaluator.variables)))
    amplitude = evaluator.alone.amplitudes(nothing)[:, 0, 0] if evaluator.unknown else parts[:, :, 0].max(1)
    unsure = _turning(evaluator, paths, each) if draws is None else _of_both_signs(draws)
    return Sensitivities(paths, present, amplitude, each, unsure, draws)


def _band(draws: Float[np.ndarray, "P 3 D"]) -> Float[np.ndarray, "2 P 3"]:
    return np.quantile(draws, (0.05, 0.95), axis=-1)


def _of_both_signs(draws: Float[np.ndarray, "P 3 D"]) -> Bool[np.ndarray, "P 3"]:
    low, high = _band(draws)
    return (low < 0) & (high > 0)


def _turning(
    evaluator: Evaluator, paths: Sequence[str], elasticity: Float[np.ndarray, "P 3"]
) -> Bool[np.ndarray, "P 3"]:
    """Tell where 10 % more or less of a number changes the amplitude, or makes the arm collapse, against its slope."""
    matters = [k for k, each in enumerate(elasticity) if np.abs(each).max() * NEARBY >= FLAT]
    variables = tuple(Variable((paths[k],), -np.inf, np.inf) for k in matters)
    signs, whole = (1.0, -1.0), replace(evaluator, variables=variables, draws={})
    ends = [[v.change(evaluator.arm, v.present(evaluator.arm) * (1 + s * NEARBY)) for v in variables] for s in signs]
    changes = np.concatenate([np.zeros((1, len(variables))), *(np.diag(np.array(end, float)) for end in ends)])
    stands = np.asarray(whole.end_states(changes).frequency) > 0
    amplitudes = np.full((3, len(changes)), np.nan)
    amplitudes[:, stands] = whole.amplitudes(changes[stands])[:, :, 0]
    more, less = np.split((amplitudes[:, 1:] / amplitudes[:, :1] - 1).T, 2)
    turning = np.zeros(elasticity.shape, bool)
    turning[matters] = _against(more, elasticity[matters]) | _against(-less, elasticity[matters])
    return turning


def _against(change: Float[np.ndarray, "V 3"], slope: Float[np.ndarray, "V 3"]) -> Bool[np.ndarray, "V 3"]:
    """Tell which changes are notable and have not the sign of their slope; a collapse has none."""
    return ~((np.abs(change) < FLAT) | (np.sign(change) == np.sign(slope)))


def _worst_phases(evaluator: Evaluator) -> list[dict[str, float]]:
    """Return the phases with which the peak of each direction is the worst; nothing where all phases are known."""
    if not evaluator.unknown or evaluator.measure == "rms":
        return []
    whole = evaluator.superposition(np.zeros(len(evaluator.variables)))
    return [whole.worst_phases(int(evaluator.amplitude.first), direction) for direction in range(3)]


def _elasticities(
    arm: Arm, variables: Sequence[Variable], parts: np.ndarray, slopes: np.ndarray
) -> Float[np.ndarray, "P 3 batch"]:
    """Return percent per percent at the largest window of each direction and arm."""
    worst = parts.argmax(1)[:, None]
    amplitude = np.take_along_axis(parts, worst, 1)[:, 0]
    slope = np.take_along_axis(slopes, worst[None], 2)[:, :, 0]
    scale = np.array([variable.present(arm) if variable.shifted else 1.0 for variable in variables])
    return slope / amplitude * scale[:, None, None]


def _of_payload(arm: Arm, path: str) -> bool:
    return path.split(".")[0] in {payload.body.name for payload in arm.payloads}
