"""Names of measured modes: draws of arms that come near all of them, and the probability of each name."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from ident.arm.arm import Arm
from ident.arm.modes import Label, labels_of_shares, torsion_share, vertical_share
from ident.errors import refusal
from ident.identify.modal_analysis import modal_solution
from ident.inference.parameters import Parameters
from ident.measure import OWN_WEIGHT, Load
from ident.modal.assignment import likelihoods, pair_probabilities
from ident.modal.finished import FinishedModes
from ident.modal.frf import Place
from ident.modal.parameters import ModalParameters
from ident.modal.poles import mac
from ident.text import one_line

# -------- Mode draws
# Arms that may be the one that was measured: draws of the prior that draw nearer to the modes of all postures.

FEWEST = 1 / 8
"""Share of the draws that count at least: else likelihoods are flattened until so many do; assumed."""
KERNEL = 0.5
"""Standard deviation of a new draw about an old one, over that of all; assumed."""
HALVINGS = 40
"""Steps in which the power is found by which likelihoods are flattened."""
DEFENSIVE = 0.1
"""Share of new draws that come from the prior again; assumed."""
NARROW = 1e-3
"""Least standard deviation of all draws along any direction, over the prior's."""


def prior_draws(parameters: Parameters, draws: int, rng: np.random.Generator) -> Float[np.ndarray, "P draws"]:
    """Return draws of the prior as theta; a number without a prior keeps its starting value."""
    uniform = rng.uniform(size=(len(parameters.items), draws))
    start = parameters.theta_start[:, None]
    return np.where(parameters.proper[:, None], np.asarray(parameters.from_uniform(jnp.asarray(uniform))), start)


def enough(logs: Float[np.ndarray, "D"]) -> bool:
    """Tell whether so many draws count by their likelihoods that these need not be flattened."""
    return _count(_flattened(logs, 1.0)) >= FEWEST * len(logs)


def shares(logs: Float[np.ndarray, "D"]) -> Float[np.ndarray, "D"]:
    """Return by how much each draw counts: by its likelihood, flattened where too few would count.

    As many count as equal ones would that have the same sum of squares (Kish). Where likelihoods differ by more than a
    few draws can resolve, one of them would decide alone, though by chance it is the nearest.
    """
    low, high = 0.0, 1.0
    if enough(logs):
        return _flattened(logs, 1.0)
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if _count(_flattened(logs, middle)) >= FEWEST * len(logs) else (low, middle)
    return _flattened(logs, low)


def nearer(
    parameters: Parameters, theta: Float[np.ndarray, "P D"], share: Float[np.ndarray, "D"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, "P D"], Float[np.ndarray, "D"]]:
    """Return as many new draws near those that count, and ln of the prior's density over that of drawing each so.

    Kernels about the old draws, shrunk towards their mean so that the whole grows no wider, beside some of the prior.

    References:
        Cappe, Guillin, Marin, Robert, "Population Monte Carlo", J. Comput. Graph. Stat. 13, 2004.
        Liu, West, in "Sequential Monte Carlo methods in practice", 2001 (shrinking).
    """
    moving = parameters.proper
    count = theta.shape[1]
    if not moving.any():
        return theta, np.zeros(count)
    old = theta[moving]
    mean = old @ share
    covariance = (old - mean[:, None]) * share @ (old - mean[:, None]).T
    covariance += np.diag((NARROW * parameters.normal_sd[moving]) ** 2)
    centres = mean[:, None] + np.sqrt(1 - KERNEL**2) * (old - mean[:, None])
    factor = KERNEL * np.linalg.cholesky(covariance)
    about = rng.choice(count, size=count, p=share)
    new = prior_draws(parameters, count, rng)
    near = rng.uniform(size=count) >= DEFENSIVE
    moved = centres[:, about] + factor @ rng.standard_normal(old.shape)
    new[np.ix_(np.flatnonzero(moving), np.flatnonzero(near))] = moved[:, near]
    # ln of the density by which draws are made, over the prior's
    off = np.linalg.solve(factor, (new[moving][:, :, None] - centres[:, None]).reshape(len(factor), -1))
    squared = (off**2).sum(0).reshape(count, -1)
    constant = np.log(np.diag(factor)).sum() + len(factor) / 2 * np.log(2 * np.pi)
    with np.errstate(divide="ignore"):
        kernels = logsumexp(np.log(share) - squared / 2, 1) - constant
    over = kernels - np.asarray(parameters.log_prior(new))
    return new, -np.logaddexp(np.log(1 - DEFENSIVE) + over, np.log(DEFENSIVE))


def _flattened(logs: Float[np.ndarray, "D"], power: float) -> Float[np.ndarray, "D"]:
    own = np.where(np.isfinite(logs), power * np.where(np.isfinite(logs), logs, 0.0), -np.inf)
    return np.exp(own - logsumexp(own))


def _count(share: Float[np.ndarray, "D"]) -> float:
    return float(1 / (share**2).sum())


# -------- Mode labels
# Labels of measured modes: their shapes at the accelerometers against those of arms that may be the measured one.

DRAWS = 128
"""Draws of an arm."""
FREQUENCY_SD = (0.3, 0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1)
"""How far computed frequencies are off, in ln, from round to round of drawing: at first as draws are sparse, at last by
what a model leaves out. There rounds end as soon as enough draws count."""
MORE = 3
"""Computed modes beyond the number of measured ones."""
MOST = 12
"""Computed modes at most, of which all sets are tried."""
CERTAIN = 0.95
"""Probability from which on a label is given."""
ALIKE = 0.9
"""MAC from which on two modes move alike where it is measured; assumed."""


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


class Measured(NamedTuple):
    """Modes of one posture.

    Attributes:
        posture: (driven,) [rad] of the test.
        modes: what was measured there.
        load: of the test.
    """

    posture: tuple[float, ...]
    modes: ModalParameters | FinishedModes
    load: Load = OWN_WEIGHT


def label_modes(
    arm: Arm, tests: Sequence[Measured], parameters: Parameters, *, draws: int = DRAWS, seed: int = 0
) -> tuple[ModeLabels, ...]:
    """Name the measured modes of all postures by their shapes, with the probability of each name.

    For each draw of an arm the shapes of the lowest modes are computed at the places of the responses, and the
    measured ones compared with them (`ident.modal.assignment`): no computed mode is two measured ones, none is matched
    by order. It is one arm in all postures: a draw counts by how probable it makes the modes of all of them. Draws of
    the prior are few and far from it, so that further ones are made near those that count, round after round
    (`ident.identify.mode_names`). What a mode of a draw is called counts for that draw alone, so that a mode named by a
    near draw has two names with a probability each.

    Args:
        arm: the arm, with the points at which was measured.
        tests: what was measured in each posture.
        parameters: the unknowns with their priors.
        draws: of an arm in each round.
        seed: of the draws.

    Raises:
        InputError: a response was measured at a point that the arm has not, or no draw stands in all postures.
    """
    rng = np.random.default_rng(seed)
    theta = np.concatenate([parameters.theta_start[:, None], prior_draws(parameters, draws, rng)], 1)
    weight = share = np.zeros(draws + 1)
    first = list[_Compared]()
    for sd in FREQUENCY_SD:
        if first:
            theta, weight = nearer(parameters, theta, share, rng)
        arms = arm.replace(parameters.by_path(np.asarray(parameters.values(theta))))
        compared = [_compared(arms, test, sd) for test in tests]
        log = sum((each.log for each in compared), weight)
        if not np.isfinite(log).any():
            got, expected = "no draw of the prior that stands in all postures of the tests", "one at least"
            remedy = "check postures and loads of the tests, and the arm's stiffnesses"
            raise refusal(one_line(arm.name), got, expected, remedy)
        share, first = shares(log), first or compared
        if sd == FREQUENCY_SD[-1] and enough(log):
            break
    return tuple(_verdict(each, share, own) for each, own in zip(compared, first, strict=True))


class _Compared(NamedTuple):
    """Measured modes of a posture beside those of each draw.

    Attributes:
        names: of the modes of each draw.
        pairs: (D, R, m) probability of each pair.
        log: (D,) ln(likelihood) of each draw; minus infinity where it has no stable equilibrium.
        mac: (R, m) of measured shapes with those of the first draw that has one.
        shapes: (O, m) of that draw.
        first: its place.
    """

    names: list[list[Label]]
    pairs: Float[np.ndarray, "D R m"]
    log: Float[np.ndarray, "D"]
    mac: Float[np.ndarray, "R m"]
    shapes: Float[np.ndarray, "O m"]
    first: int


def _compared(arms: Arm, test: Measured, frequency_sd: float) -> _Compared:
    modes = test.modes
    directions = _directions(arms, modes.responses)
    count = min(len(modes.frequency) + MORE, arms.degrees_of_freedom, MOST)
    computed = modal_solution(arms, test.posture, test.load).modes
    frequency, motion = (np.asarray(x) for x in (computed.frequency[:count], computed.motion[:, :, :count]))
    sound = np.isfinite(frequency).all(0)
    shapes = np.einsum("opc,cpmd->omd", directions, motion)
    own = shapes[..., sound], frequency[:, sound]
    each = zip(modes.shape.T, modes.frequency.tolist(), strict=True)
    logs = [likelihoods(y, modes.of_shape([r]), *own, f, frequency_sd) for r, (y, f) in enumerate(each)]
    pairs, log = np.zeros((len(sound), len(logs), count)), np.full(len(sound), -np.inf)
    band = modes.band
    pairs[sound], log[sound] = pair_probabilities(np.stack(logs, 1), ((own[1] > band[0]) & (own[1] < band[1])).T)
    first = int(np.argmax(sound))
    alike = mac(modes.shape, shapes[..., first].astype(complex))
    shares = (np.asarray(share(computed)).T for share in (torsion_share, vertical_share))
    names = [labels_of_shares(*own)[:count] for own in zip(*shares, strict=True)]
    return _Compared(names, pairs, log, alike, shapes[..., first], first)


def _directions(arm: Arm, places: Sequence[Place]) -> Float[np.ndarray, "O P 3"]:
    names = [point.name for point in arm.points]
    unknown = sorted({place.point for place in places} - set(names))
    if unknown:
        remedy = "add it to the arm, or correct the name of the place"
        raise refusal("", f"no point {unknown[0]}", f"one of {', '.join(names)}", remedy, "responses")
    out = np.zeros((len(places), len(names), 3))
    for row, place in zip(out, places, strict=True):
        row[names.index(place.point)] = place.direction
    return out


def _verdict(last: _Compared, weight: Float[np.ndarray, "D"], start: _Compared) -> ModeLabels:
    labels = tuple(sorted({label for draw in last.names for label in draw}, key=str))
    probability = np.zeros((last.pairs.shape[1], len(labels)))
    for draw, own, w in zip(last.names, last.pairs, weight, strict=True):
        for m, label in enumerate(draw):
            probability[:, labels.index(label)] += w * own[:, m]
    given, why, computed = [], [], tuple(start.names[start.first])
    for row in probability:
        first, second = np.argsort(row)[::-1][:2].tolist()
        sure = bool(row[first] >= CERTAIN)
        given.append(labels[first] if sure else None)
        why.append("" if sure else _doubt(labels, row, (first, second), start))
    return ModeLabels(labels, probability, start.mac, computed, tuple(given), tuple(why))


def _doubt(labels: Sequence[Label], row: np.ndarray, best: tuple[int, int], start: _Compared) -> str:
    """Return in words why a mode has no name, by the probability of each label."""
    none = 1 - row.sum()
    if none > row[best[0]]:
        return f"it moves like none of the arm's modes (probability {100 * none:.0f} %)"
    said = " or ".join(f"{labels[i]} ({100 * row[i]:.0f} %)" for i in best)
    computed, shapes = start.names[start.first], start.shapes.astype(complex)
    pair = [computed.index(labels[i]) for i in best if labels[i] in computed]
    if len(pair) == 2:
        alike = float(mac(shapes[:, pair[:1]], shapes[:, pair[1:]])[0, 0])
        if alike > ALIKE:
            return f"{said}: these move alike where it was measured (MAC {alike:.2f}); measure in another direction"
    return said
