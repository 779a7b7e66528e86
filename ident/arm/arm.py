"""The arm as a value: rigid bodies, pins and elastic bushings in a serial chain.

All numbers are SI (m, kg, s, rad, N). In the zero posture (every pin at zero, no elastic rotation) all frames
are parallel to the base frame: z up, x along the unfolded arm, y to the left.
"""

from collections.abc import Iterator, Mapping
from operator import attrgetter
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ident.errors import InputError, Problem
from ident.text import did_you_mean

GRAVITY = (0.0, 0.0, -9.80665)
"""Standard gravity [m/s^2] in the base frame (CGPM 1901)."""

COMPONENTS = {"x": (0,), "y": (1,), "z": (2,), "xx": (0, 0), "yy": (1, 1), "zz": (2, 2)}
"""Names of vector and matrix components in a parameter's path."""
RANKS = {"com": 1, "offset": 1, "position": 1, "inertia": 2}
"""Number of component axes of the fields that are no scalars; any further axes are batch."""


class Body(eqx.Module):
    """A rigid body.

    Attributes:
        name: unique in its arm.
        mass: () [kg]
        com: (3,) [m] mass centre in the frame of the joint that carries the body.
        inertia: (3, 3) [kg m^2] about the mass centre, along the same frame's axes.
    """

    name: str = eqx.field(static=True)
    mass: Float[Array, ""]
    com: Float[Array, "3"]
    inertia: Float[Array, "3 3"]

    def __init__(self, name: str, mass: Any, com: Any = (0.0, 0.0, 0.0), inertia: Any = ((0.0,) * 3,) * 3):
        self.name = name
        self.mass, self.com, self.inertia = (
            jnp.asarray(mass, float),
            jnp.asarray(com, float),
            jnp.asarray(inertia, float),
        )

    def __check_init__(self) -> None:
        check_inertia(self.name, self.mass, self.inertia)


class Joint(eqx.Module):
    """A bushing (spherical, elastic), the shaft on it, and the pin about which the link turns.

    The bushing's moment is K phi with K = k_bend (1 - a a') + k_tors a a', a the axis, phi the rotation vector;
    its damping moment is C dphi/dt with the coefficients c = tau k.

    Attributes:
        name: unique in its arm.
        axis: (3,) unit vector of the pin.
        offset: (3,) [m] bushing centre in the frame of the link before (the base frame for the first joint).
        k_bend: () [N m/rad] bushing stiffness across the axis.
        k_tors: () [N m/rad] bushing stiffness about the axis.
        tau_bend: () [s] damping per stiffness across the axis.
        tau_tors: () [s] damping per stiffness about the axis.
        shaft: bodies before the pin.
        link: bodies after the pin.
        driven: False for an extra bushing that has no pin (flexibility of a link, the base or the fingers).
        limits: (lower, upper) [rad] of the pin angle.
    """

    name: str = eqx.field(static=True)
    axis: Float[Array, "3"]
    offset: Float[Array, "3"]
    k_bend: Float[Array, ""]
    k_tors: Float[Array, ""]
    tau_bend: Float[Array, ""]
    tau_tors: Float[Array, ""]
    shaft: tuple[Body, ...]
    link: tuple[Body, ...]
    driven: bool = eqx.field(static=True)
    limits: tuple[float, float] = eqx.field(static=True)

    def __init__(
        self,
        name: str,
        *,
        k_bend: Any,
        k_tors: Any,
        axis: Any = (0.0, 0.0, 1.0),
        offset: Any = (0.0, 0.0, 0.0),
        tau_bend: Any = 0.0,
        tau_tors: Any = 0.0,
        shaft: tuple[Body, ...] = (),
        link: tuple[Body, ...] = (),
        driven: bool = True,
        limits: tuple[float, float] = (-np.inf, np.inf),
    ):
        self.name, self.driven, self.limits = name, driven, limits
        self.axis, self.offset = jnp.asarray(axis, float), jnp.asarray(offset, float)
        self.k_bend, self.k_tors = jnp.asarray(k_bend, float), jnp.asarray(k_tors, float)
        self.tau_bend, self.tau_tors = jnp.asarray(tau_bend, float), jnp.asarray(tau_tors, float)
        self.shaft, self.link = tuple(shaft), tuple(link)


class Point(eqx.Module):
    """A named point fixed to a link, where deflection is read and loads are hung.

    Attributes:
        name: unique in its arm.
        joint: name of the joint whose link carries the point.
        position: (3,) [m] in that link's frame.
    """

    name: str = eqx.field(static=True)
    joint: str = eqx.field(static=True)
    position: Float[Array, "3"]

    def __init__(self, name: str, joint: str, position: Any):
        self.name, self.joint, self.position = name, joint, jnp.asarray(position, float)


class Payload(eqx.Module):
    """A rigid body that a load case may fix to a link, such as the glass.

    Attributes:
        joint: name of the joint whose link carries the payload.
        body: the body, in that link's frame; its name is the payload's.
    """

    joint: str = eqx.field(static=True)
    body: Body


class Arm(eqx.Module):
    """A serial chain of joints with their bodies, points and payloads.

    Attributes:
        name: what the arm is called.
        joints: from the base outwards, the undriven ones included.
        points: named points; the last one is the end point, by which mode shapes are drawn and labelled.
        payloads: bodies that a load case may add.
        gravity: (3,) [m/s^2] in the base frame.
    """

    name: str = eqx.field(static=True)
    joints: tuple[Joint, ...]
    points: tuple[Point, ...]
    payloads: tuple[Payload, ...]
    gravity: Float[Array, "3"]

    def __init__(
        self,
        name: str,
        joints: tuple[Joint, ...],
        points: tuple[Point, ...] = (),
        payloads: tuple[Payload, ...] = (),
        gravity: Any = GRAVITY,
    ):
        self.name = name
        self.joints, self.points, self.payloads = tuple(joints), tuple(points), tuple(payloads)
        self.gravity = jnp.asarray(gravity, float)

    def __check_init__(self) -> None:
        names = [part.name for part in self.parts()]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InputError(Problem(self.name, f"{twice[0]} twice", "unique names", "rename one of them"))

    @property
    def driven(self) -> tuple[Joint, ...]:
        """The joints that have a pin, in the order of the posture's angles."""
        return tuple(joint for joint in self.joints if joint.driven)

    def parts(self) -> Iterator[Joint | Body | Point]:
        """Everything that has a name."""
        for joint in self.joints:
            yield joint
            yield from joint.shaft + joint.link
        yield from self.points
        yield from (payload.body for payload in self.payloads)

    def get(self, path: str) -> Array:
        """Return the number at a path such as `joint1.k_bend`, `link2.mass` or `fingers.com.x`.

        Raises:
            InputError: the path names no number of this arm; the nearest names are suggested.
        """
        name, field, component = self._split(path)
        part = next(part for part in self.parts() if part.name == name)
        return getattr(part, field)[component]

    def replace(self, values: Mapping[str, Any]) -> "Arm":
        """Return an arm that has these numbers at these paths; differentiable in the numbers.

        A number may be an array `(*batch)`; `hold` then gives a chain for each of its entries.

        Raises:
            InputError: a path names no number of this arm.
        """
        by_part: dict[str, list[tuple[str, tuple[int, ...], Any]]] = {}
        for path, value in values.items():
            name, field, component = self._split(path)
            by_part.setdefault(name, []).append((field, component, value))

        def changed(node: Any) -> Any:
            name = getattr(node, "name", None)
            for field, component, value in by_part.get(name, ()) if name else ():
                old = getattr(node, field)
                new = (
                    _with_component(old, component, jnp.asarray(value, float))
                    if component
                    else jnp.asarray(value, float)
                )
                node = eqx.tree_at(attrgetter(field), node, new)
            return node

        def joint(old: Joint) -> Joint:
            bodies = tuple(changed(b) for b in old.shaft), tuple(changed(b) for b in old.link)
            return eqx.tree_at(lambda n: (n.shaft, n.link), changed(old), bodies)

        return eqx.tree_at(
            lambda arm: (arm.joints, arm.points, arm.payloads),
            self,
            (
                tuple(joint(j) for j in self.joints),
                tuple(changed(p) for p in self.points),
                tuple(eqx.tree_at(lambda n: n.body, p, changed(p.body)) for p in self.payloads),
            ),
        )

    def paths(self) -> tuple[str, ...]:
        """All paths that `get` and `replace` know."""
        found = []
        for part in self.parts():
            for field in ("mass", "com", "inertia", "offset", "position", *STIFFNESS, *DAMPING):
                if hasattr(part, field):
                    rank = RANKS.get(field, 0)
                    ends = [c for c, i in COMPONENTS.items() if len(i) == rank] if rank else [""]
                    found += [f"{part.name}.{field}.{end}".rstrip(".") for end in ends]
        return tuple(found)

    def _split(self, path: str) -> tuple[str, str, tuple[int, ...]]:
        if path not in self.paths():
            remedy = did_you_mean(path, self.paths(), "see `Arm.paths()`")
            raise InputError(Problem("", path, f"a number of the arm {self.name}", remedy))
        name, field, *end = path.split(".")
        return name, field, COMPONENTS[end[0]] if end else ()


STIFFNESS = ("k_bend", "k_tors")
DAMPING = ("tau_bend", "tau_tors")


def stiffness_paths(arm: Arm) -> tuple[str, ...]:
    """Paths of all bushing stiffnesses: bending of every joint, then torsion of every joint."""
    return tuple(f"{joint.name}.{field}" for field in STIFFNESS for joint in arm.joints)


def _with_component(old: Array, component: tuple[int, ...], value: Array) -> Array:
    batch = jnp.broadcast_shapes(old.shape[len(component) :], value.shape)
    spread = old.reshape(old.shape + (1,) * (len(component) + len(batch) - old.ndim))
    return jnp.broadcast_to(spread, old.shape[: len(component)] + batch).at[component].set(value)


def check_inertia(name: str, mass: Any, inertia: Any) -> None:
    """Refuse a mass or an inertia tensor that no body can have.

    A body's second moment tr(I)/2 - I of mass is positive semi-definite; this is the triangle inequality of its
    principal moments. Abstract values (under `jit` or `grad`) are not checked.

    Raises:
        InputError: the mass is negative or not finite, or the inertia is not symmetric or violates the inequality.

    References:
        Wensing, Kim, Slotine, "Linear matrix inequalities for physically consistent inertial parameter
        identification", IEEE RA-L 3(1), 2018, eq. 12.
    """
    if isinstance(mass, jax.core.Tracer) or isinstance(inertia, jax.core.Tracer):
        return
    m, tensor = np.asarray(mass), np.asarray(inertia)
    if m.shape != () or tensor.shape != (3, 3):
        return
    if not (np.isfinite(m) and m >= 0):
        raise InputError(Problem(name, f"mass {m}", "a mass >= 0 kg", "correct it", "mass"))
    size = max(np.abs(tensor).max(), 1e-300)
    if not np.isfinite(tensor).all() or np.abs(tensor - tensor.T).max() > 1e-9 * size:
        raise InputError(Problem(name, "an asymmetric inertia", "a symmetric tensor", "correct it", "inertia"))
    principal = np.linalg.eigvalsh(tensor)
    if principal[0] < -1e-9 * size or principal[2] > (principal[0] + principal[1]) * (1 + 1e-9) + 1e-12 * size:
        shown = ", ".join(f"{p:.4g}" for p in principal)
        raise InputError(
            Problem(
                name,
                f"principal moments {shown} kg m^2",
                "positive moments, none above the sum of the other two",
                "check units, signs and the reference point (the mass centre)",
                "inertia",
            )
        )
