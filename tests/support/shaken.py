"""Hammer tests of an arm by its equations of motion, linearised, with their dampers: frequency responses with noise."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import point_motion
from ident.arm.modes import linearize
from ident.modal.frf import Frf, Place

LINES = np.arange(1.0, 24.0, 0.05)
PLACES = tuple(Place(point, axis) for point in ("tip", "elbow") for axis in ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))
HITS = 5


@dataclass(frozen=True)
class Shaken:
    """An arm at a posture as a linear system."""

    M: np.ndarray
    C: np.ndarray
    H: np.ndarray
    rows: np.ndarray

    @property
    def poles(self):
        """[rad/s] with positive imaginary part."""
        n = len(self.M)
        lower = [-np.linalg.solve(self.M, self.H), -np.linalg.solve(self.M, self.C)]
        poles = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], lower]))
        return poles[poles.imag > 0]

    def accelerance(self, frequency):
        """B s^2 (s^2 M + s C + H)^-1 B', responses by references by lines."""
        s = 2j * np.pi * frequency[:, None, None]
        moved = np.linalg.solve(s**2 * self.M + s * self.C + self.H, self.rows.T[None])
        return np.moveaxis(s**2 * (self.rows @ moved), 0, -1)[:, :2]


def hammered(structure: Shaken, noise: float, rng: np.random.Generator) -> Frf:
    """Return the hits of a test, with noise as a share of the largest response of each accelerometer."""
    clean = structure.accelerance(LINES)
    size = noise * np.sqrt((np.abs(clean) ** 2).mean(-1)).max(1)[:, None, None]
    scatter = rng.normal(size=(HITS, *clean.shape, 2)) @ np.array([1, 1j]) / np.sqrt(2)
    return Frf(LINES, clean + size * scatter, PLACES, PLACES[:2], 0.0)


def shaken(arm: Arm, posture: tuple[float, ...]) -> Shaken:
    """Return the arm's equations at a posture and how its coordinates move the places."""
    names = [point.name for point in arm.points]
    found = linearized(arm, jnp.asarray(posture))
    rows = [np.asarray(found[1])[:, names.index(place.point)].T @ np.array(place.direction) for place in PLACES]
    return Shaken(*(np.asarray(each) for each in found[0]), np.array(rows))


@jax.jit
def linearized(arm: Arm, posture):
    """Return M, C, H and how each coordinate moves the points (3, P, n)."""
    chain = at_posture(arm, posture)
    linear = linearize(chain)
    unit = jnp.eye(len(linear.M))
    return (linear.M, linear.C, linear.H), jax.vmap(lambda v: point_motion(chain, linear.phi, v), 1, 2)(unit)
