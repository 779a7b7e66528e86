"""Springs that MuJoCo's hinges have in place of a bushing about one working point, exact there.

The energy of a bushing, phi' K phi / 2 of its rotation vector, has in the angles x of three hinges one after another
terms of third order, k_tors x_1 x_2 x_3 / 2 first, which no stiffness of theirs has. About the equilibrium of one
posture it is g'd + d'H d / 2: three springs along the eigenvectors of H, each a tendon over the three hinges.
"""

from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.equilibrium import equilibrium
from ident.arm.rotations import matmul, rotation, rotation_vector
from ident.description.mjcf import ENDS
from ident.description.mjcf_tree import numbers
from ident.errors import InputError, Problem
from ident.jit import jit

STEPS = 8
"""Of Newton's method from a rotation vector to the angles of three hinges, which are equal but for its square."""


@dataclass(frozen=True)
class Tangent:
    """Where the hinges of a bushing are.

    Attributes:
        name: of the joint.
        turn: (3, 3) axes of its hinges, columns, in the base frame at zero posture.
    """

    name: str
    turn: Float[np.ndarray, "3 3"]


def tendons(hinges: list[Tangent], arm: Arm, posture: tuple[float, ...]) -> Any:
    """Return tendons over the hinges of all bushings that are tangent to them where the arm's weight holds a posture.

    Args:
        hinges: of the arm's joints, in their order.
        arm: the arm.
        posture: [rad] of its driven joints.

    Raises:
        InputError: the arm has no stable equilibrium there.
    """
    phi, frame = (np.asarray(x) for x in _working_point(arm, jnp.asarray(posture)))
    if not np.isfinite(phi).all():
        got, expected = "no stable equilibrium under the arm's weight", "a posture in which the arm stands"
        raise InputError(Problem("posture", got, expected, "choose another one"))
    section = ElementTree.Element("tendon")
    for n, (hinge, joint) in enumerate(zip(hinges, arm.joints, strict=True)):
        k = np.array([joint.k_tors, joint.k_bend, joint.k_bend])
        at, slope, stiffness = _about(hinge.turn.T @ frame[:, :, n].T @ phi[:, n], k)
        values, ways = np.linalg.eigh(stiffness)
        for place, (value, way) in enumerate(zip(values, ways.T, strict=True), 1):
            spring = float(value), float(way @ at - way @ slope / value)
            section.append(_spring(f"{hinge.name}_tangent_{place}", hinge.name, spring, way))
    return section


PLAIN = {"damping": "0", "frictionloss": "0", "armature": "0", "limited": "false", "actuatorfrclimited": "false"}
"""What such a tendon has none of, whatever the file's defaults for tendons are."""


def _spring(name: str, joint: str, spring: tuple[float, float], way: Float[np.ndarray, "3"]) -> Any:
    stiffness, rest = (numbers([x]) for x in spring)
    tendon = ElementTree.Element("fixed", {"name": name, "stiffness": stiffness, "springlength": rest, **PLAIN})
    for end, share in zip(ENDS, way, strict=True):
        tendon.append(ElementTree.Element("joint", {"joint": f"{joint}_{end}", "coef": numbers([share])}))
    return tendon


def _about(
    phi: Float[np.ndarray, "3"], k: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"], Float[np.ndarray, "3 3"]]:
    """Return the angles of the hinges at a rotation vector, and slope and Hessian of the energy by them there."""
    at = np.array(phi)
    for _ in range(STEPS):
        vector, by_angles = _vector_and_slope(jnp.asarray(at))
        at = at - np.linalg.solve(np.asarray(by_angles), np.asarray(vector) - phi)
    slope, hessian = _derivatives(jnp.asarray(at), jnp.asarray(k))
    return at, np.asarray(slope), np.asarray(hessian)


def _vector(angles: Float[Array, "3"]) -> Float[Array, "3"]:
    """Return the rotation vector of three turns one after another, in the axes of the first, second and third."""
    one, two, three = (rotation(angle * jnp.eye(3)[n]) for n, angle in enumerate(angles))
    return rotation_vector(matmul(matmul(one, two), three))


def _energy(angles: Float[Array, "3"], k: Float[Array, "3"]) -> Float[Array, ""]:
    return (k * _vector(angles) ** 2).sum() / 2


_vector_and_slope = jit(lambda angles: (_vector(angles), jax.jacfwd(_vector)(angles)))
_derivatives = jit(lambda angles, k: (jax.grad(_energy)(angles, k), jax.hessian(_energy)(angles, k)))


@jit
def _working_point(arm: Arm, posture: Float[Array, "driven"]) -> tuple[Float[Array, "3 N"], Float[Array, "3 3 N"]]:
    """Return the rotation vectors of the bushings, and the axes of the shafts, in the base frame."""
    chain = at_posture(arm, posture)
    return equilibrium(chain), chain.frame
