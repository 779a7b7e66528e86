"""Poles over orders, and which of them stay where they are: the stabilisation diagram, read without a person."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Complex, Float, Int
from scipy.optimize import linear_sum_assignment

from ident.modal.frf import Frf
from ident.modal.modal_model import ModalModel
from ident.modal.noise import Noise
from ident.modal.polynomial import Poles, PolynomialFit
from ident.modal.residues import model_of

MOST_POLES = 60
"""Poles of the highest order, about."""
ORDERS = (8, 40)
"""Highest order at least and at most."""
MOST_DAMPED = 0.2
"""Damping ratio beyond which a pole is none of a mode's."""
NEAR_POLE, NEAR_SHAPE = 0.01, 0.1
"""How far poles of one mode are apart, as a share of their size, and how far from one their shapes' MAC is."""
LASTING = 0.5
"""Share of the orders in which the pole of a mode is found at least."""
FEWEST = 3
"""Orders in which a pole that may be a mode's is found at least."""


@dataclass(frozen=True)
class Diagram:
    """Stable poles of all orders, and the cluster that each belongs to.

    Attributes:
        order: (n,) of the polynomial.
        transposed: (n,) whether responses took the place of references.
        pole: (n,) [rad/s] complex.
        shape: (O I, n) complex: residues of unit length.
        cluster: (n,) number of its cluster, ascending in frequency; -1 where it is in none that lasts.
        chosen: (m,) the pole that each cluster stands for.
        passing: (p,) one pole of each cluster that does not last, but was found more than twice.
    """

    order: Int[np.ndarray, "n"]
    transposed: np.ndarray
    pole: Complex[np.ndarray, "n"]
    shape: Complex[np.ndarray, "K n"]
    cluster: Int[np.ndarray, "n"]
    chosen: Int[np.ndarray, "m"]
    passing: Int[np.ndarray, "p"]

    @property
    def frequency(self) -> Float[np.ndarray, "n"]:
        """(n,) [Hz] undamped."""
        return np.abs(self.pole) / (2 * np.pi)

    @property
    def damping(self) -> Float[np.ndarray, "n"]:
        """(n,) [-] damping ratio."""
        return -self.pole.real / np.abs(self.pole)


def diagram_of(frf: Frf, noise: Noise) -> Diagram:
    """Find the poles of many orders and cluster them by frequency, damping and shape.

    From order to order each pole goes on with the one that it is most like, none with two. What is found in half of the
    orders at least is a cluster; it stands for the member that is nearest to the others. Where the responses
    and the references each tell, clusters of the second kind count where the first has none within the resonance.

    References:
        Reynders, Houbrechts, De Roeck, "Fully automated (operational) modal analysis", MSSP 29, 2012.
    """
    sides = sorted({True: len(frf.responses), False: len(frf.references)}.items(), key=lambda side: -side[1])
    diagrams = [_one_side(frf, noise, transposed, size) for transposed, size in sides]
    return _joined([diagram for diagram in diagrams if diagram is not None])


def mac(first: Complex[np.ndarray, "K n"], second: Complex[np.ndarray, "K m"]) -> Float[np.ndarray, "n m"]:
    """Return the modal assurance criterion of all pairs."""
    product = np.abs(first.conj().T @ second) ** 2
    return product / ((np.abs(first) ** 2).sum(0)[:, None] * (np.abs(second) ** 2).sum(0))


def highest_order(frf: Frf, size: int, others: int) -> int:
    """Return the highest order that the lines of the functions admit, for matrices of this size."""
    wanted = int(np.clip(MOST_POLES // size, *ORDERS))
    return min(wanted, len(frf.frequency) * others // (3 * (size + 1)))


def _one_side(frf: Frf, noise: Noise, transposed: bool, size: int) -> Diagram | None:
    others = len(frf.references) if transposed else len(frf.responses)
    highest = highest_order(frf, size, others)
    if highest < 2:
        return None
    fit = PolynomialFit(frf, noise, highest, transposed)
    solutions = [_physical(fit.poles(order), frf) for order in range(2, highest + 1)]
    shapes = [_residues(model_of(frf, noise, poles)) if len(poles.pole) else _none(frf) for poles in solutions]
    return clustered([each.order for each in solutions], [each.pole for each in solutions], shapes, transposed)


def clustered(
    orders: Sequence[int], poles: Sequence[np.ndarray], shapes: Sequence[np.ndarray], transposed: bool = False
) -> Diagram:
    """Return the diagram of the poles and shapes that were found with each order."""
    numbers = _tracked(poles, shapes)
    each = [np.full(len(own), order) for order, own in zip(orders, poles, strict=True)]
    order, pole, shape, number = (np.concatenate(x, -1) for x in (each, poles, shapes, numbers))
    cluster, chosen, passing = _lasting(pole, shape, number, len(orders))
    return Diagram(order, np.full(len(order), transposed), pole, shape, cluster, chosen, passing)


def _none(frf: Frf) -> np.ndarray:
    return np.zeros((len(frf.responses) * len(frf.references), 0), complex)


def physical(pole: Complex[np.ndarray, "n"], band: tuple[float, float]) -> Bool[np.ndarray, "n"]:
    """Tell which poles may be those of modes within a band [Hz]."""
    frequency, damping = np.abs(pole) / (2 * np.pi), -pole.real / np.abs(pole)
    inside = (frequency >= band[0]) & (frequency <= band[1]) & (pole.imag > 0)
    return inside & (damping > 0) & (damping < MOST_DAMPED)


def _physical(poles: Poles, frf: Frf) -> Poles:
    return poles.pick(physical(poles.pole, (frf.frequency[0], frf.frequency[-1])))


def _residues(model: ModalModel) -> Complex[np.ndarray, "K m"]:
    residue = (model.shape[:, None] * model.participation[None]).reshape(-1, len(model.pole))
    return residue / np.linalg.norm(residue, axis=0)


def distance(poles: tuple[np.ndarray, np.ndarray], shapes: tuple[np.ndarray, np.ndarray]) -> Float[np.ndarray, "n m"]:
    """Return how unlike poles with their shapes are: one where they could just be those of one mode."""
    apart = np.abs(poles[0][:, None] - poles[1]) / np.abs(poles[1])
    return (apart / NEAR_POLE + (1 - mac(*shapes)) / NEAR_SHAPE) / 2


def _tracked(every: Sequence[np.ndarray], shapes: Sequence[np.ndarray]) -> list[Int[np.ndarray, "n"]]:
    """Return the number of the cluster that each pole of each order goes on with."""
    last_pole, last_shape = every[0], shapes[0]
    numbers = [np.arange(len(last_pole))]
    for pole, shape in zip(every[1:], shapes[1:], strict=True):
        number = np.full(len(pole), -1)
        apart = distance((pole, last_pole), (shape, last_shape))
        for new, old in zip(*linear_sum_assignment(np.minimum(apart, 10.0)), strict=True):
            if apart[new, old] < 1:
                number[new] = old
        fresh = number < 0
        number[fresh] = len(last_pole) + np.arange(fresh.sum())
        last_pole = np.concatenate([last_pole, pole[fresh]])
        last_shape = np.concatenate([last_shape, shape[:, fresh]], 1)
        last_pole[number], last_shape[:, number] = pole, shape
        numbers.append(number)
    return numbers


def _lasting(
    pole: np.ndarray, shape: np.ndarray, number: np.ndarray, orders: int
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "m"], Int[np.ndarray, "p"]]:
    """Return the clusters that last, numbered by frequency, the pole that each stands for, and those that pass."""
    groups = [np.flatnonzero(number == n) for n in np.unique(number)]
    lasting = [members for members in groups if len(members) >= LASTING * orders]
    passing = [members for members in groups if FEWEST <= len(members) < LASTING * orders]
    lasting.sort(key=lambda members: np.median(np.abs(pole[members])))
    cluster = np.full(len(pole), -1)
    for i, members in enumerate(lasting):
        cluster[members] = i
    chosen, passed = ([_medoid(pole, shape, members) for members in each] for each in (lasting, passing))
    return cluster, np.array(chosen, int), np.array(passed, int)


def _medoid(pole: np.ndarray, shape: np.ndarray, members: np.ndarray) -> int:
    """Return the member that is nearest to the others."""
    own = pole[members], shape[:, members]
    return int(members[distance((own[0], own[0]), (own[1], own[1])).sum(0).argmin()])


def _joined(diagrams: Sequence[Diagram]) -> Diagram:
    first = diagrams[0]
    for second in diagrams[1:]:
        first = _with(first, second)
    return first


def _with(first: Diagram, second: Diagram) -> Diagram:
    """Return both, with the clusters of the second where the first has none within the resonance."""
    poles = first.pole[first.chosen]
    new = [
        i
        for i, pole in enumerate(second.pole[second.chosen])
        if not (np.abs(poles - pole) < 2 * (np.abs(poles.real) + np.abs(pole.real))).any()
    ]
    moved = np.full(len(second.chosen) + 1, -1)
    if len(poles):
        moved[:-1] = np.abs(second.pole[second.chosen][:, None] - poles).argmin(1)
    moved[new] = len(poles) + np.arange(len(new))
    chosen = np.concatenate([first.chosen, len(first.pole) + second.chosen[new]]).astype(int)
    fields = ("order", "transposed", "pole", "shape")
    order, transposed, pole, shape = (np.concatenate([getattr(first, f), getattr(second, f)], -1) for f in fields)
    cluster = np.concatenate([first.cluster, moved[second.cluster]])
    rank = np.argsort(np.abs(pole[chosen]))
    place = np.append(np.argsort(rank), -1)
    others = np.setdiff1d(np.arange(len(second.chosen)), new)
    passing = np.concatenate([first.passing, len(first.pole) + np.concatenate([second.passing, second.chosen[others]])])
    return Diagram(order, transposed, pole, shape, place[cluster], chosen[rank], passing.astype(int))
