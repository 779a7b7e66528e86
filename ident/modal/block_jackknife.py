"""The joint covariance of modes of an ambient test: repeat the estimate without each block of the record."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float
from scipy.linalg import block_diag
from scipy.stats import t

from ident.modal.ambient_test import AmbientTest
from ident.modal.stabilisation import Diagram, distance
from ident.modal.subspace import Realisation, realisations

LOST = 3.0
"""Distance, in those of one mode's poles of neighbouring orders, from which on a pole is another one."""


@dataclass(frozen=True)
class Tracked:
    """The lasting poles of a diagram as modes.

    Attributes:
        frequency: (m,) [Hz]
        damping: (m,) [-]
        shape: (O, m) complex accelerations, one at a response that has much of the mode.
        covariance: (n, n) joint, in the order of `ident.modal.modal_parameters`.
        lost: (m,) whether a pole is another one where a block is left out.
    """

    frequency: Float[np.ndarray, "m"]
    damping: Float[np.ndarray, "m"]
    shape: Complex[np.ndarray, "O m"]
    covariance: Float[np.ndarray, "n n"]
    lost: Bool[np.ndarray, "m"]

    @property
    def sigma(self) -> Float[np.ndarray, "2 m"]:
        """(2, m) [Hz, -] standard deviations of frequencies and damping ratios."""
        return np.sqrt(np.diag(self.covariance))[: 2 * len(self.frequency)].reshape(2, -1)

    def pick(self, kept: Sequence[int]) -> "Tracked":
        """Return some of the modes."""
        count, outputs = len(self.frequency), 2 * len(self.shape)
        shapes = [2 * count + i * outputs + k for i in kept for k in range(outputs)]
        at = [*kept, *(count + i for i in kept), *shapes]
        covariance = self.covariance[np.ix_(at, at)]
        return Tracked(self.frequency[kept], self.damping[kept], self.shape[:, kept], covariance, self.lost[kept])


def block_jackknife(test: AmbientTest, diagram: Diagram, blocks: int) -> Tracked:
    """Return the lasting poles of a diagram as modes with their joint covariance.

    Each number of a mode is the median over the orders in which its cluster has a pole. For the correlation functions
    without one block, the poles of each order that are most like those of the whole record take their place;
    Var = (B - 1) / B sum_b (x_b - mean)^2, widened by Student's t. As that matrix has rank B - 1 only, its correlations
    are shrunk to none as far as they are uncertain; those within a shape are left.

    Args:
        test: the correlation functions.
        diagram: of the whole record.
        blocks: B.

    References:
        Kuensch, "The jackknife and the bootstrap for general stationary observations", Ann. Stat. 17, 1989.
        Schaefer, Strimmer, "A shrinkage approach to large-scale covariance matrix estimation", Stat. Appl. Genet. Mol.
        Biol. 4, 2005.
    """
    parts = test.correlations.joined(blocks)
    orders = sorted({int(order) for order in diagram.order[diagram.cluster >= 0]})

    def numbers(correlation: Float[np.ndarray, "O R K"]) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m"]]:
        by_order = dict(zip(orders, realisations(correlation, parts.step, orders), strict=True))
        return _numbers(test, diagram, by_order)

    ones = [numbers(parts.without(b)) for b in range(len(parts.blocks))]
    whole, _ = numbers(parts.mean)
    vectors = np.array([_vector(each) for each, _ in ones])
    lost = np.array([apart for _, apart in ones]).max(0) > LOST
    modes, outputs = len(diagram.chosen), len(test.responses)
    shape = whole[:, 2 : 2 + outputs] + 1j * whole[:, 2 + outputs :]
    covariance = _covariance(vectors, 2 * modes, 2 * outputs)
    return Tracked(whole[:, 0], whole[:, 1], shape.T, covariance, lost)


def _vector(numbers: Float[np.ndarray, "m k"]) -> Float[np.ndarray, "n"]:
    return np.concatenate([numbers[:, 0], numbers[:, 1], numbers[:, 2:].ravel()])


def _numbers(
    test: AmbientTest, diagram: Diagram, by_order: Mapping[int, Realisation]
) -> tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m"]]:
    """Return frequency, damping ratio and shape (real parts first) of each mode, and how far its poles are off."""
    numbers, apart = [], []
    for i, chosen in enumerate(diagram.chosen):
        largest = int(np.argmax(np.abs(diagram.shape[:, chosen])))  # of its own motion, whatever its unit
        pairs = [
            _like(by_order[int(diagram.order[k])], diagram, k) for k in np.flatnonzero(diagram.cluster == i).tolist()
        ]
        rows = [_row(test, each, j, largest) for each, j, _ in pairs]
        numbers.append(np.median(rows, axis=0))
        apart.append(np.median([far for _, _, far in pairs]))
    return np.array(numbers), np.array(apart)


def _like(each: Realisation, diagram: Diagram, k: int) -> tuple[Realisation, int, float]:
    """Return which pole of an order is most like one of the diagram, and how unlike it is."""
    shapes = each.unit_shape, diagram.shape[:, [k]]
    apart = distance((each.pole, diagram.pole[[k]]), shapes)[:, 0]
    return each, int(apart.argmin()), float(apart.min())


def _row(test: AmbientTest, each: Realisation, j: int, largest: int) -> Float[np.ndarray, "k"]:
    pole = each.pole[j]
    motion = _accelerations(test, pole, each.shape[:, j])
    shape = motion / motion[largest]
    size = abs(pole)
    return np.concatenate([[size / (2 * np.pi), -pole.real / size], shape.real, shape.imag])


def _accelerations(test: AmbientTest, pole: complex, shape: Complex[np.ndarray, "O"]) -> Complex[np.ndarray, "O"]:
    """Return a shape in SI, velocities and displacements differentiated."""
    return shape * test.scale * pole ** np.array(test.order)


def _covariance(vectors: Float[np.ndarray, "B n"], poles: int, size: int) -> Float[np.ndarray, "n n"]:
    """Return the covariance of the whole estimate, of its replicates without each block."""
    count = len(vectors)
    apart = vectors - vectors.mean(0)
    raw = (count - 1) / count * apart.T @ apart * (float(t.isf(0.025, count - 1)) / 1.959964) ** 2
    shapes = [raw[i : i + size, i : i + size] for i in range(poles, len(raw), size)]
    plain = block_diag(np.diag(np.diag(raw)[:poles]), *shapes)
    weight = _uncertain(apart[:, :poles])
    covariance: np.ndarray = (1 - weight) * raw + weight * plain
    return covariance


def _uncertain(apart: Float[np.ndarray, "B k"]) -> float:
    """Return by how much correlations are shrunk: the sum of their variances over that of their squares."""
    count, size = apart.shape
    scaled = apart / np.sqrt((apart**2).mean(0))
    products = scaled[:, :, None] * scaled[:, None]
    mean, others = products.mean(0), ~np.eye(size, dtype=bool)
    variance = ((products - mean) ** 2).sum(0) / (count * (count - 1))
    return float(min(variance[others].sum() / (mean[others] ** 2).sum(), 1.0)) if size > 1 else 0.0
