"""Values whose errors are correlated, in groups: what is measured of them is made independent, group by group.

With the correlation R of a group's errors and L L' = R, the numbers L^-1 (predicted - measured) / sigma are independent
with standard deviation 1 (whitening: generalised least squares, Aitken, Proc. R. Soc. Edinburgh 55, 1936).
"""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Bool, Float, Int

from ident.errors import InputError, Problem
from ident.inference.parameters import AnyArray, library

OWN_MIN = 1e-4
"""Least part of its standard deviation that an error has to itself, whatever others of its group are."""


class Block(eqx.Module):
    """Groups of one size.

    Attributes:
        rows: (G, n) places of each group's values.
        correlation: (G, n, n) of their errors.
        whitening: (G, n, n) inverse of its Cholesky factor over the values that count; zero for the others.
        log_det: (G,) half the logarithm of its determinant over these.
    """

    rows: Int[AnyArray, "G n"]
    correlation: Float[AnyArray, "G n n"]
    whitening: Float[AnyArray, "G n n"]
    log_det: Float[AnyArray, "G"]


class Correlation(eqx.Module):
    """Which values have correlated errors, and how.

    Attributes:
        single: (S,) places of the values that are in no group.
        blocks: groups, by size.
        order: (D,) where each value is among the single ones and those of the blocks, one after the other.
    """

    single: Int[AnyArray, "S"]
    blocks: tuple[Block, ...]
    order: Int[AnyArray, "D"]

    def whiten(self, x: Float[AnyArray, "D *batch"]) -> Any:
        """Return independent combinations, `(D, *batch)`, of what each value is off in its sigma: L^-1 x by group."""
        xp = library(x)
        parts = [x[self.single]]
        for block in self.blocks:
            mixed = xp.einsum("gij,gj...->gi...", block.whitening, x[block.rows])
            parts.append(mixed.reshape((-1, *x.shape[1:])))
        return xp.concatenate(parts)[self.order]

    def pull_back(self, x: Float[np.ndarray, "D *batch"]) -> Float[np.ndarray, "D *batch"]:
        """Return L'^-1 x for each group: what independent combinations say of each value, the adjoint of `whiten`."""
        parts = [x[np.asarray(self.single)]]
        for block in self.blocks:
            mixed = np.einsum("gji,gj...->gi...", np.asarray(block.whitening), x[np.asarray(block.rows)])
            parts.append(mixed.reshape((-1, *x.shape[1:])))
        return np.concatenate(parts)[np.asarray(self.order)]

    def color(self, x: Float[np.ndarray, "D *batch"]) -> Float[np.ndarray, "D *batch"]:
        """Return L x for each group: correlated numbers of independent ones."""
        parts = [x[np.asarray(self.single)]]
        for block in self.blocks:
            mixed = np.einsum("gij,gj...->gi...", np.linalg.cholesky(block.correlation), x[np.asarray(block.rows)])
            parts.append(mixed.reshape((-1, *x.shape[1:])))
        return np.concatenate(parts)[np.asarray(self.order)]

    def inverse_among(self, places: Int[np.ndarray, "N K"]) -> Float[np.ndarray, "N K K"]:
        """Return the elements of R^-1 that are between the values of each of several sets."""
        found = (places[:, :, None] == places[:, None]).astype(float)
        for block in self.blocks:
            W, rows = np.asarray(block.whitening), np.asarray(block.rows)
            inverse = np.einsum("gji,gjk->gik", W, W)
            group, member = np.full(len(self.order), -1), np.zeros(len(self.order), int)
            group[rows], member[rows] = np.arange(len(rows))[:, None], np.arange(rows.shape[1])
            own, at = group[places], member[places]
            both = own[:, :, None] == own[:, None]
            inside = inverse[own[:, :, None], at[:, :, None], at[:, None]]
            found = np.where(own[:, :, None] < 0, found, np.where(both, inside, 0.0))
        return found

    def moved(self, source: Int[np.ndarray, "D"]) -> "Correlation":
        """Return the same for values that come to other places, each with its error: place i gets that of source[i]."""
        to = np.argsort(source)
        single = to[np.asarray(self.single)]
        blocks = tuple(eqx.tree_at(lambda b: b.rows, block, to[np.asarray(block.rows)]) for block in self.blocks)
        grouped = np.concatenate([block.rows.ravel() for block in blocks])
        return Correlation(single, blocks, np.argsort(np.concatenate([single, grouped])))

    @property
    def precision(self) -> Float[np.ndarray, "D"]:
        """Diagonal of the inverse of the whole correlation; 0 of a value within a group that does not count."""
        parts = [np.ones(len(self.single))]
        parts += [(np.asarray(block.whitening) ** 2).sum(1).ravel() for block in self.blocks]
        return np.concatenate(parts)[np.asarray(self.order)]

    @property
    def log_det(self) -> Any:
        """Half the logarithm of the determinant of the whole correlation."""
        return sum(block.log_det.sum() for block in self.blocks)

    @property
    def groups(self) -> Int[np.ndarray, "D"]:
        """Number of each value's group, from 0; -1 for none."""
        found, number = np.full(len(self.order), -1), 0
        for block in self.blocks:
            for rows in np.asarray(block.rows):
                found[rows] = number
                number += 1
        return found

    def matrix(self, places: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n n"]:
        """Return the correlation of the errors of some values."""
        whole = np.eye(len(places))
        for block in self.blocks:
            for rows, R in zip(np.asarray(block.rows), np.asarray(block.correlation), strict=True):
                _, here, there = np.intersect1d(places, rows, assume_unique=True, return_indices=True)
                whole[np.ix_(here, here)] = R[np.ix_(there, there)]
        return whole

    def among(self, counts: Bool[np.ndarray, "D"]) -> "Correlation":
        """Return the same where only some values count; within a group the others are left out of its correlation."""
        return _made(len(self.order), [(block.rows, block.correlation) for block in self.blocks], counts)


def correlation(
    groups: Sequence[tuple[Sequence[int], Float[np.ndarray, "_ _"]]], counts: Bool[np.ndarray, "D"]
) -> Correlation | None:
    """Return the correlation of values.

    Args:
        groups: places of the values of each, and the correlation of their errors; a value is in one group at most.
        counts: (D,) values that are fitted.

    Returns:
        None where nothing is correlated.

    Raises:
        InputError: a correlation that no errors can have.
    """
    sizes = sorted({len(rows) for rows, _ in groups})
    of_size = [[each for each in groups if len(each[0]) == size] for size in sizes]
    blocks = [(np.array([rows for rows, _ in own], int), np.array([R for _, R in own], float)) for own in of_size]
    return _made(len(counts), blocks, counts) if blocks else None


def _made(count: int, blocks: Sequence[tuple[AnyArray, AnyArray]], counts: np.ndarray) -> Correlation:
    made = tuple(_block(np.asarray(rows), np.asarray(R), counts) for rows, R in blocks)
    grouped = np.concatenate([block.rows.ravel() for block in made])
    single = np.setdiff1d(np.arange(count), grouped)
    return Correlation(single, made, np.argsort(np.concatenate([single, grouped])))


def _block(rows: np.ndarray, R: np.ndarray, counts: np.ndarray) -> Block:
    used = counts[rows]
    both = used[:, :, None] & used[:, None, :]
    try:
        L = np.linalg.cholesky(np.where(both, R, np.eye(R.shape[-1])))
    except np.linalg.LinAlgError:
        expected = "a positive definite correlation in each group"
        raise InputError(
            Problem("", "errors that can't be so correlated", expected, "correct the covariance")
        ) from None
    own = np.diagonal(L, axis1=1, axis2=2)
    if (least := own.min(initial=1.0)) < OWN_MIN:
        got = f"an error that the others of its group fix to {least:.2g} of its standard deviation"
        remedy = "leave out the value that the others repeat, or correct the covariance"
        raise InputError(Problem("", got, f"at least {OWN_MIN:g}", remedy))
    log_det = np.log(own).sum(1)
    return Block(rows, R, np.where(both, np.linalg.inv(L), 0.0), log_det)
