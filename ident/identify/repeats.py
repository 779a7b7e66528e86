"""Which rows of a campaign measured the same thing: it is predicted once, and named by what all of them say."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from ident.inference.parameters import AnyArray
from ident.inference.problem import Data
from ident.measure.campaign import ROUNDING

WIDTH = 8
"""Numbers that are added at once."""


class Repeats(eqx.Module):
    """Sums over the rows of each value.

    Attributes:
        first: (V,) the first row of each value.
        sums: tables of what is added: of rows, then of such sums, until there is one for each value; (C, 8), or (V, 1)
            where nothing was measured twice. One beyond the last stands for nothing.
    """

    first: Int[AnyArray, "V"]
    sums: tuple[Int[AnyArray, "_ _"], ...]

    def total(self, x: Float[AnyArray, "D *batch"]) -> Float[Array, "V *batch"]:
        """Add up what belongs to the rows of each value, in memory and time that grow with the rows alone.

        Not by a scatter: that of XLA on several cores (jax 0.10) does not give the same bits twice.
        """
        for table in self.sums:
            x = jnp.concatenate([x, jnp.zeros((1, *x.shape[1:]))])[table].sum(1)
        return jnp.asarray(x)

    def pooled(self, data: Data) -> Data:
        """Return the mean of the rows of each value, weighted by sigma^-2, and its standard deviation."""
        measured, sigma = (jnp.asarray(x)[self.first] for x in data)
        if self.sums[0].shape[1] == 1:
            return Data(measured, sigma)
        weight = jnp.asarray(data.sigma) ** -2.0
        total = self.total(weight)
        counts = total > 0
        known = jnp.where(counts, total, 1.0)
        mean = self.total(weight * data.measured) / known
        return Data(jnp.where(counts, mean, measured), jnp.where(counts, known**-0.5, jnp.inf))


def repeats(order: Int[np.ndarray, "D"], first: Int[np.ndarray, "V"]) -> Repeats:
    """Return how the rows of each value are added up.

    Args:
        order: the value that each row measured.
        first: the first row of each value.
    """
    owner, tables, count = np.asarray(order), list[np.ndarray](), len(first)
    width = 1 if len(owner) == count else WIDTH
    while not tables or len(owner) > count:
        each = np.bincount(owner, minlength=count)
        chunks = -(-each // width)
        ends, ascending = np.cumsum(chunks), np.argsort(owner, kind="stable")
        place = np.arange(len(owner)) - np.repeat(np.cumsum(each) - each, each)
        tables.append(np.full((chunks.sum(), width), len(owner)))
        tables[-1][(ends - chunks)[owner[ascending]] + place // width, place % width] = ascending
        owner = np.repeat(np.arange(count), chunks)
    return Repeats(np.asarray(first), tuple(tables))


def shared_error(
    order: Int[np.ndarray, "D"], sigma: Float[np.ndarray, "D"], resolution: Float[np.ndarray, "D"]
) -> Float[np.ndarray, "D"]:
    """Return standard deviations by which the mean of repeated readings is as sure as it is.

    Readings of one value share the error of the display's steps r, so that their mean has the variance

        1 / sum(1 / sigma^2) + r^2 / 12

    (a common error in weighted means: Cowan, "Statistical Data Analysis", 1998, 7.6). Each sigma is raised by the
    factor that gives this; the coarsest r counts. By the same factor counts less what single readings differ by; and
    where they differ by a tenth of r or more, their mean is better than that: both on the safe side.

    Args:
        order: the value that each row measured.
        sigma: [SI] of each row.
        resolution: [SI] of each row; zero for none.
    """
    count = int(order.max(initial=-1)) + 1
    weight, step = np.bincount(order, sigma**-2.0, count), np.zeros(count)
    np.maximum.at(step, order, resolution)
    return np.asarray(sigma * np.sqrt(1 + weight * (ROUNDING * step) ** 2)[order])


def roomy(count: int) -> int:
    """Return the next of 0, 4, 8, 16, 24, 32, 48, 64, 96, ...: few sizes, and not much more room.

    At most half as many again, where there are many; above 2048 a quarter.
    """
    if not count:
        return 0
    power = max(4, 1 << (count - 1).bit_length())
    if power > 2048:
        return -(-count // (power // 8)) * (power // 8)
    return 3 * power // 4 if power > 16 and count <= 3 * power // 4 else power


def room(group: np.ndarray) -> np.ndarray:
    """Return the entries of a group, the first one repeated at its end until their number is one of few."""
    return np.concatenate([group, np.repeat(group[:1], roomy(len(group)) - len(group))]).astype(int)
