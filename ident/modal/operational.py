"""From the correlation functions of an ambient test to modes with their joint covariance: the one entry."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from threadpoolctl import threadpool_limits

from ident.errors import InputError, Problem
from ident.measure.speeds import Speed
from ident.modal.ambient_test import AmbientTest
from ident.modal.block_jackknife import Tracked, block_jackknife
from ident.modal.estimate import chosen_near
from ident.modal.frf import Place
from ident.modal.harmonics import SLIP, turning
from ident.modal.modal_parameters import ModalParameters, Rejected
from ident.modal.selection import SHARPEST
from ident.modal.stabilisation import Diagram, clustered, distance, physical
from ident.modal.subspace import realisations

MOST_STATES = 40
"""States of the highest order."""
DECAYS = 5.0
"""Decay times of the mode that calms down most slowly in a block."""
BLOCKS = (10, 40)
"""Blocks at least and at most."""
FASTEST = 100.0
"""Rate [1/s] by which a mode calms down at most."""
LEAST_DAMPED = 0.001
"""Damping ratio below which a pole is the line of something that turns."""
SURE = 2.0
"""Standard deviations by which a damping ratio has to lie above that, for a pole to be a mode."""
LIGHT = 0.01
"""Damping ratio below which the line of what turns may be taken for a mode."""
VAGUE = 0.5
"""Relative standard deviation of the damping ratio from which on a pole is no mode."""
CLOSE = 0.05
"""Difference of two modes that are close, as a share."""


@dataclass(frozen=True)
class OperationalModes(ModalParameters):
    """Modes of an ambient test. Shapes are not scaled, as no force is known: one is a response that has much of it.

    Attributes:
        test: of which they are.
        blocks: of the jackknife that the covariance comes from.
        decays: decay times, of the mode that calms down most slowly, in each of them.
        remarks: what a reader should know.
    """

    test: AmbientTest
    blocks: int
    decays: float
    remarks: tuple[str, ...]

    @property
    def responses(self) -> tuple[Place, ...]:
        """(O,) where and along what was measured."""
        return self.test.responses

    @property
    def band(self) -> tuple[float, float]:
        """[Hz] between which modes were sought."""
        return self.test.band

    @property
    def doubtful(self) -> bool:
        """Whether the record is too short for its blocks to be independent of each other."""
        return self.decays < DECAYS


@threadpool_limits.wrap(limits=1)  # matrices are small: threads of BLAS would mostly wait for each other
def operational_modes(test: AmbientTest, *, near: Sequence[float] | None = None) -> OperationalModes:
    """Identify the modes of an ambient test with their joint covariance.

    Poles by covariance-driven stochastic subspace identification over orders; those that last by themselves are
    clustered as of a hammer test. A mode is the median of its cluster; leaving out one block of the record at a time
    gives the covariance (`ident.modal.block_jackknife`).

    Args:
        test: the correlation functions.
        near: (m,) [Hz] overrules the choice of modes: for each the pole of the diagram that lies nearest.

    Raises:
        InputError: no mode is found.
    """
    diagram = _diagram(test)
    if near is not None:
        diagram = _only(diagram, near)
    slowest = _slowest(diagram)
    blocks = int(np.clip(test.correlations.duration * slowest / DECAYS, *BLOCKS))
    tracked = block_jackknife(test, diagram, blocks)
    kept, rejected = _sorted_out(test, diagram, tracked)
    if not kept:
        got, remedy = "responses without a mode that lasts over the orders", "look at the band, or record for longer"
        raise InputError(Problem("", got, "a resonance", remedy, "band"))
    found = tracked.pick(kept)
    decays = test.correlations.duration * slowest / blocks
    remarks = tuple(_remarks(test, found, rejected, decays))
    mode_values = found.frequency, found.damping, found.shape, found.covariance
    return OperationalModes(*mode_values, diagram, rejected, test, blocks, decays, remarks)


def _slowest(diagram: Diagram) -> float:
    """Return by what rate [1/s] the mode calms down that does so most slowly; lines of what turns never do."""
    if not len(diagram.chosen):
        got, remedy = "responses without a pole that lasts over the orders", "look at the band, or record for longer"
        raise InputError(Problem("", got, "a resonance", remedy, "band"))
    damped = diagram.damping[diagram.chosen] >= LEAST_DAMPED
    return float(np.min(-diagram.pole[diagram.chosen].real, where=damped, initial=FASTEST))


def _sorted_out(test: AmbientTest, diagram: Diagram, tracked: Tracked) -> tuple[list[int], tuple[Rejected, ...]]:
    """Return which poles are modes, and what the others are."""
    numbers = tracked.frequency, tracked.damping, *tracked.sigma, tracked.lost
    why = [_why(test.speeds, *pole) for pole in zip(*(each.tolist() for each in numbers), strict=True)]
    for i, j in combinations(range(len(why)), 2):
        if not (why[i] or why[j]) and _same(diagram, i, j):
            fewer, more = sorted((i, j), key=lambda k: (diagram.cluster == k).sum())
            why[fewer] = f"it is the mode at {tracked.frequency[more]:.4g} Hz once more"
    kept = [i for i, reason in enumerate(why) if not reason]
    others = [i for i, reason in enumerate(why) if reason]
    rejected = (Rejected(float(tracked.frequency[i]), float(tracked.damping[i]), why[i]) for i in others)
    return kept, tuple(rejected)


def _same(diagram: Diagram, i: int, j: int) -> bool:
    """Tell whether two clusters could just be those of one mode."""
    one, other = (diagram.chosen[[k]] for k in (i, j))
    poles, shapes = (diagram.pole[one], diagram.pole[other]), (diagram.shape[:, one], diagram.shape[:, other])
    return bool(distance(poles, shapes)[0, 0] < 1)


def _diagram(test: AmbientTest) -> Diagram:
    correlations = test.correlations
    outputs, inputs, lags = correlations.blocks.shape[1:]
    orders = range(4, min(MOST_STATES, (lags // 2 - 1) * min(outputs, inputs)) + 1, 2)
    by_order = {each.order: each for each in realisations(correlations.mean, correlations.step, orders)}
    every = tuple(each.pick(physical(each.pole, test.band)) for each in by_order.values())
    return clustered(list(by_order), [each.pole for each in every], [each.unit_shape for each in every])


def _only(diagram: Diagram, near: Sequence[float]) -> Diagram:
    """Return the diagram with the clusters chosen that have the poles nearest to some frequencies."""
    poles = chosen_near(diagram, near).chosen
    numbers = diagram.cluster[poles]
    if (numbers < 0).any():
        apart = float(diagram.frequency[poles[numbers < 0][0]])
        got, remedy = (
            f"no lasting pole near {apart:.4g} Hz",
            "name modes of which the diagram has poles in half the orders",
        )
        raise InputError(Problem("", got, "a pole that lasts", remedy, "modes"))
    order = np.unique(numbers)
    cluster = np.full(len(diagram.cluster), -1)
    for place, number in enumerate(order):
        cluster[diagram.cluster == number] = place
    return replace(diagram, cluster=cluster, chosen=diagram.chosen[order])


def _why(
    speeds: Sequence[Speed], frequency: float, damping: float, frequency_sd: float, damping_sd: float, lost: bool
) -> str:
    """Say why a pole is no mode; empty where it is one."""
    if damping < LEAST_DAMPED:
        what = turning(speeds, frequency)
        known = f"as of {what}" if what else "as of something that turns: name its speed (`harmonics`)"
        return f"damping ratio {100 * damping:.3f} %, {known}"
    if lost:
        return "it is lost where a part of the record is left out"
    if frequency_sd > frequency * max(damping, SHARPEST):
        return "its frequency is not known to within its resonance"
    if damping < LIGHT and damping - SURE * damping_sd < LEAST_DAMPED:
        uncertain = f"damping ratio {100 * damping:.2f} %, give or take {100 * damping_sd:.2f} %"
        return f"{uncertain}, may be that of something that turns: name its speed (`harmonics`), or record for longer"
    if damping_sd > VAGUE * damping:
        return f"its damping ratio is not known to within {100 * VAGUE:.0f} %"
    return ""


def _remarks(test: AmbientTest, found: Tracked, rejected: Sequence[Rejected], decays: float) -> Iterator[str]:
    frequency, damping = found.frequency, found.damping
    if decays < DECAYS:
        needed = test.correlations.duration * DECAYS / decays
        yield (
            f"WARNING: too short a record: a block has {decays:.1f} decay times of the slowest mode, {DECAYS:g} are "
            f"needed; standard deviations are not to be relied on below {needed:.0f} s"
        )
    if len(test.references) == 1:
        many = "one response" if len(test.responses) == 1 else "one reference"
        yield f"WARNING: {many} only: modes that coincide are seen as one, and what does not move there is not seen"
    for i in np.flatnonzero(np.diff(frequency) < CLOSE * frequency[1:]):
        if len(test.references) == 1:
            pair = f"{frequency[i]:.4g} and {frequency[i + 1]:.4g} Hz"
            yield f"WARNING: the close modes at {pair} are told apart by one reference: measure in a second direction"
    lines = [(line.frequency, f"{line}, which was taken out,") for line in test.harmonics]
    lines += [(pole.frequency, f"what turns at {pole.frequency:.4g} Hz") for pole in rejected if _sharp(pole)]
    for each, ratio in zip(frequency, damping, strict=True):
        for line, name in lines:
            if abs(line - each) < ratio * each:
                yield f"WARNING: {name} lies within the resonance of the mode at {each:.4g} Hz: repeat at another speed"
        what = turning(test.speeds, each) if ratio < LIGHT else ""
        if what and all(abs(line - each) > SLIP * each for line, _ in lines):
            yield f"WARNING: the mode at {each:.4g} Hz may be that of {what}: repeat at another speed"


def _sharp(pole: Rejected) -> bool:
    return pole.damping < LEAST_DAMPED
