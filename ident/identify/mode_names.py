"""Names of measured modes: draws of arms that match all of them, and the probability of each name."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from ident.arm.arm import Arm
from ident.arm.modes import Label, labels_of_shares, torsion_share, vertical_share
from ident.errors import refusal, require
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
# Plausible arms: draws of the prior, concentrated round after round near the modes of all postures.

FEWEST = 1 / 8
"""Least effective share of the draws: likelihoods are flattened until it is reached; assumed."""
KERNEL = 0.5
"""Standard deviation of a new draw about an old one, relative to that of all draws; assumed."""
HALVINGS = 40
"""Bisection steps for the flattening power of the likelihoods."""
DEFENSIVE = 0.1
"""Share of new draws from the prior; assumed."""
NARROW = 1e-3
"""Least standard deviation of all draws along any direction, relative to the prior's."""


def prior_draws(parameters: Parameters, draws: int, rng: np.random.Generator) -> Float[np.ndarray, "P draws"]:
    """Return draws of the prior as theta; a number without a prior keeps its starting value."""
    uniform = rng.uniform(size=(len(parameters.items), draws))
    start = parameters.theta_start[:, None]
    return np.where(parameters.proper[:, None], np.asarray(parameters.from_uniform(jnp.asarray(uniform))), start)


def enough(logs: Float[np.ndarray, "D"]) -> bool:
    """Whether the effective number of draws is large enough without flattening the likelihoods."""
    return _count(_flattened(logs, 1.0)) >= FEWEST * len(logs)


def shares(logs: Float[np.ndarray, "D"]) -> Float[np.ndarray, "D"]:
    """Return the weight of each draw: its likelihood, flattened if too few draws would count.

    The effective number is Kish's: that of equal weights with the same sum of squares. With likelihoods too different
    for the number of draws, one draw would decide alone, though it is the nearest only by chance.
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
    """Return as many new draws near those of large weight, and ln(prior density / proposal density) of each.

    The proposal is a kernel about each old draw, shrunk towards the mean so that the whole grows no wider, plus some
    draws of the prior.

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
    # ln(proposal density / prior density)
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
# Labels of measured modes: their shapes at the accelerometers against those of plausible arms.

DRAWS = 128
"""Number of draws of an arm."""
FREQUENCY_SD = (0.3, 0.3, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1)
"""Standard deviation of ln(computed frequency) by round: first for the sparseness of draws, finally for model errors.
At the final value rounds end as soon as enough draws count."""
MORE = 3
"""Computed modes beyond the number of measured ones."""
MOST = 12
"""Most computed modes; all their subsets are tried."""
CERTAIN = 0.95
"""Least probability of a reported label."""
ALIKE = 0.9
"""MAC above which two modes look alike at the measured points; assumed."""


@dataclass(frozen=True)
class ModeLabels:
    """Names of the measured modes, with their probability.

    Attributes:
        labels: (L,) names of the arm's modes.
        probability: (R, L) of each name for each measured mode; the rest to 1 is the probability of another mode.
        mac: (R, m) [-] modal assurance criterion of measured shapes with those of the arm as in its file.
        computed: (m,) names of that arm's modes.
        given: (R,) the name of each measured mode; None if none is certain.
        why: (R,) the reason for no name; empty if there is one.
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
        modes: measured there.
        load: of the test.
    """

    posture: tuple[float, ...]
    modes: ModalParameters | FinishedModes
    load: Load = OWN_WEIGHT


def label_modes(
    arm: Arm, tests: Sequence[Measured], parameters: Parameters, *, draws: int = DRAWS, seed: int = 0
) -> tuple[ModeLabels, ...]:
    """Name the measured modes of all postures by their shapes, with the probability of each name.

    For each draw of an arm the shapes of the lowest modes are computed at the response points, and compared with the
    measured ones (`ident.modal.assignment`): no computed mode matches two measured ones, and order does not matter. The
    arm is the same in all postures: a draw's weight is the likelihood of the modes of all of them. Draws of the prior
    are too sparse, so that further draws follow near those of large weight, round after round
    (`ident.identify.mode_names`). Each draw has its own mode names; so a mode may get two names, each with a
    probability, from neighbouring draws.

    Args:
        arm: the arm, with the response points.
        tests: measured modes of each posture.
        parameters: the unknowns with their priors.
        draws: of an arm in each round.
        seed: of the draws.

    Raises:
        InputError: a response at a point that the arm does not have, or no draw is stable in all postures.
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
        got, expected = "no draw of the prior that stands in all postures of the tests", "one at least"
        remedy = "check postures and loads of the tests, and the arm's stiffnesses"
        require(np.isfinite(log).any(), one_line(arm.name), got, expected, remedy)
        share, first = shares(log), first or compared
        if sd == FREQUENCY_SD[-1] and enough(log):
            break
    return tuple(_verdict(each, share, own) for each, own in zip(compared, first, strict=True))


class _Compared(NamedTuple):
    """Measured modes of a posture compared with those of each draw.

    Attributes:
        names: of the modes of each draw.
        pairs: (D, R, m) probability of each pair.
        log: (D,) ln(likelihood) of each draw; minus infinity without a stable equilibrium.
        mac: (R, m) of measured shapes with those of the first draw that has one.
        shapes: (O, m) of that draw.
        first: its index.
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
    """Write why a mode has no name, with the probability of each label."""
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
