"""Labels of measured modes: their shapes at the accelerometers against the arm's, over draws of the prior."""

from collections.abc import Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.arm.labels import Label, labels_of_shares, torsion_share, vertical_share
from ident.arm.modes import Modes as Computed
from ident.errors import InputError, Problem
from ident.identify.modal_analysis import modal_solution
from ident.inference.parameters import Parameters
from ident.measure import OWN_WEIGHT, Load
from ident.modal.assignment import likelihoods, pair_probabilities
from ident.modal.finished import FinishedModes
from ident.modal.frf import Place
from ident.modal.modal_parameters import ModalParameters
from ident.modal.stabilisation import mac

DRAWS = 128
"""Draws of the prior."""
MORE = 3
"""Computed modes beyond the number of measured ones."""
MOST = 12
"""Computed modes at most, of which all sets are tried."""
CERTAIN = 0.95
"""Probability from which on a label is given."""
ALIKE = 0.9
"""MAC from which on two modes move alike where it is measured."""


@dataclass(frozen=True)
class ModeLabels:
    """What each measured mode is called, and how sure.

    Attributes:
        labels: (L,) names that modes of the arm have.
        probability: (R, L) of each name for each measured mode; what is missing to one is that it is none of these.
        mac: (R, m) [-] modal assurance criterion of measured shapes with those of the arm as it is.
        computed: (m,) names of the arm's modes as it is.
        given: (R,) the name of each measured mode; None where none is certain.
        why: (R,) what is in doubt; empty where a name is given.
    """

    labels: tuple[Label, ...]
    probability: Float[np.ndarray, "R L"]
    mac: Float[np.ndarray, "R m"]
    computed: tuple[Label, ...]
    given: tuple[Label | None, ...]
    why: tuple[str, ...]


def label_modes(
    arm: Arm,
    posture: tuple[float, ...],
    modes: ModalParameters | FinishedModes,
    parameters: Parameters,
    load: Load = OWN_WEIGHT,
    *,
    draws: int = DRAWS,
    seed: int = 0,
) -> ModeLabels:
    """Name measured modes by their shapes, with the probability of each name.

    For each draw of the prior the shapes of the lowest modes are computed at the places of the responses, and the
    measured ones compared with them (`ident.modal.assignment`): no computed mode is two measured ones, none is matched
    by order. What a mode of a draw is called counts for that draw alone, so that a mode named by a near draw has two
    names with a probability each.

    Args:
        arm: the arm, with the points at which was measured.
        posture: (driven,) [rad] of the test.
        modes: what was measured there.
        parameters: the unknowns with their priors.
        load: of the test.
        draws: of the prior.
        seed: of the draws.

    Raises:
        InputError: a response was measured at a point that the arm has not.
    """
    directions = _directions(arm, modes.responses)
    count = min(len(modes.frequency) + MORE, 3 * len(arm.joints), MOST)
    computed = modal_solution(drawn_arms(arm, parameters, draws, seed), posture, load).modes
    hertz, motion = (np.asarray(x) for x in (computed.frequency[:count], computed.motion[:, :, :count]))
    sound = np.isfinite(hertz).all(0)
    shapes, frequency = np.einsum("opc,cpmd->omd", directions, motion)[..., sound], hertz[:, sound]
    logs = np.array(
        [
            likelihoods(y, modes.of_shape([r]), shapes, frequency, float(f))
            for r, (y, f) in enumerate(zip(modes.shape.T, modes.frequency, strict=True))
        ]
    ).transpose(2, 0, 1)
    band = modes.band
    pairs, weight = pair_probabilities(logs, ((frequency > band[0]) & (frequency < band[1])).T)
    names = _names(computed, count, np.flatnonzero(sound))
    labels, probability = _by_label(names, pairs, weight)
    return _verdict(
        labels, probability, mac(modes.shape, shapes[..., 0].astype(complex)), tuple(names[0]), shapes[..., 0]
    )


def drawn_arms(arm: Arm, parameters: Parameters, draws: int, seed: int) -> Arm:
    """Return the arm as it is and with numbers drawn from the prior, as a batch."""
    uniform = np.random.default_rng(seed).uniform(size=(len(parameters.items), draws))
    start = np.asarray(parameters.theta(parameters.column("start")))[:, None]
    theta = np.where(parameters.proper[:, None], np.asarray(parameters.from_uniform(jnp.asarray(uniform))), start)
    values = np.asarray(parameters.values(np.concatenate([start, theta], 1)))
    return arm.replace(parameters.by_path(values))


def _directions(arm: Arm, places: Sequence[Place]) -> Float[np.ndarray, "O P 3"]:
    names = [point.name for point in arm.points]
    unknown = sorted({place.point for place in places} - set(names))
    if unknown:
        remedy = "add it to the arm, or correct the name of the place"
        raise InputError(Problem("", f"no point {unknown[0]}", f"one of {', '.join(names)}", remedy, "responses"))
    out = np.zeros((len(places), len(names), 3))
    for row, place in zip(out, places, strict=True):
        row[names.index(place.point)] = place.direction
    return out


def _names(computed: Computed, count: int, draws: np.ndarray) -> list[list[Label]]:
    """Return what the lowest modes of each draw are called."""
    torsion, vertical = np.asarray(torsion_share(computed)), np.asarray(vertical_share(computed))
    return [labels_of_shares(torsion[:, d], vertical[:, d])[:count] for d in draws]


def _by_label(
    names: list[list[Label]], pairs: Float[np.ndarray, "D R m"], weight: Float[np.ndarray, "D"]
) -> tuple[tuple[Label, ...], Float[np.ndarray, "R L"]]:
    labels = tuple(sorted({label for draw in names for label in draw}, key=str))
    probability = np.zeros((pairs.shape[1], len(labels)))
    for draw, own, w in zip(names, pairs, weight, strict=True):
        for m, label in enumerate(draw):
            probability[:, labels.index(label)] += w * own[:, m]
    return labels, probability


def _verdict(
    labels: tuple[Label, ...],
    probability: Float[np.ndarray, "R L"],
    likeness: Float[np.ndarray, "R m"],
    computed: tuple[Label, ...],
    shapes: Float[np.ndarray, "O m"],
) -> ModeLabels:
    given, why = [], []
    for row in probability:
        first, second = np.argsort(row)[::-1][:2].tolist()
        sure = bool(row[first] >= CERTAIN)
        given.append(labels[first] if sure else None)
        why.append("" if sure else _doubt(labels, row, (first, second), computed, shapes))
    return ModeLabels(labels, probability, likeness, computed, tuple(given), tuple(why))


def _doubt(
    labels: tuple[Label, ...],
    row: Float[np.ndarray, "L"],
    best: tuple[int, int],
    computed: tuple[Label, ...],
    shapes: Float[np.ndarray, "O m"],
) -> str:
    """Return in words why a mode has no name."""
    none = 1 - row.sum()
    if none > row[best[0]]:
        return f"it moves like none of the arm's modes (probability {none:.0%})"
    said = " or ".join(f"{labels[i]} ({row[i]:.0%})" for i in best)
    pair = [computed.index(labels[i]) for i in best if labels[i] in computed]
    if len(pair) == 2:
        alike = float(mac(shapes[:, pair[:1]].astype(complex), shapes[:, pair[1:]].astype(complex))[0, 0])
        if alike > ALIKE:
            return f"{said}: these move alike where it was measured (MAC {alike:.2f}); measure in another direction"
    return said
