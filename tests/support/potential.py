"""The potential energy of an arm and of its curved springs: what gradients and Hessians of `ident.arm` are of."""

import jax.numpy as jnp
import numpy as np

from ident.arm.chain import Chain
from ident.arm.mechanics import forward_kinematics, point_positions
from ident.arm.parts import WIDTH, CurvedSprings, Curves
from ident.arm.rotations import matmul, matvec, skew


def potential_energy(chain: Chain, phi):
    """Return V = -sum_j m_j g.r_j - sum f.r - sum m.a(R) + sum_j phi_j' K_j phi_j / 2 [J], and what curved springs add.

    A moment m on a body that has turned by R works m.a(R), a(R) along the axis of R and as long as its angle's sine.
    So do two crosswise pairs of forces of fixed direction in the plane of m. It turns along by half the rotation; a
    moment that keeps its direction has no potential (Ziegler, "Principles of Structural Stability", 1968, 1.5:
    semitangential moments).
    """
    at = forward_kinematics(chain, phi)
    gravity = chain.gravity.reshape((3,) + (1,) * (phi.ndim - 1))
    moment = chain.mass * at.centre + matvec(at.axes, chain.moment)
    weight = (gravity * moment).sum((0, 1))
    pull = (chain.force * point_positions(chain, phi)).sum((0, 1))
    if chain.couple is not None:
        turned = at.axes[:, :, np.asarray(chain.carrier, dtype=int)]
        pull = pull + jnp.trace(matmul(turned, -skew(chain.couple) / 2)).sum(0)
    straight = (phi * matvec(chain.stiffness, phi)).sum((0, 1)) / 2 - weight - pull
    return straight if chain.curved is None else straight + of_springs(chain.curved, phi).sum(0)


def of_springs(springs: CurvedSprings, phi):
    """Return the energy of each bushing beyond that of its stiffness [N m]."""
    along = (springs.axis * phi).sum(0)
    across, energy = phi - springs.axis * along, jnp.zeros_like(along)
    if springs.bend is not None:
        energy = energy + of_curves(springs.bend, (across * across).sum(0))
    return energy if springs.tors is None else energy + of_curves(springs.tors, along * along)


def of_curves(curves: Curves, s):
    """Return the energy that is added [N m]: the area below both ramps, and that of the cube."""
    x = jnp.sqrt(jnp.maximum(s, (curves.angle / 2) ** 2))
    half = WIDTH * curves.angle
    u = x / half - 1 / WIDTH
    beyond, u = jnp.maximum(u - 1, 0.0), jnp.clip(u, -1.0, 1.0)
    area = (4 + 15 * u + 20 * u**2 + 10 * u**3 - u**5) / 80 + beyond + beyond**2 / 2
    return (curves.rise * half**2 * area).sum(0) + curves.cubic * s * s / 4
