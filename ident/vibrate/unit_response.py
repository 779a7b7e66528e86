"""What sensors on a moving arm see, as a sum over what excites it: imbalance and transmission error of each drive.

The vibration is linear in both components of each imbalance and of each transmission error (see `simulate`,
"Superposition"); a sensor sees it, or its derivatives, along a direction of the base or of a body.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.interpolate import BSpline, make_interp_spline

from ident.arm.arm import Arm
from ident.arm.chain import Loads, at_posture
from ident.arm.multibody import ERROR, IMBALANCE, ExcitingOrder
from ident.arm.parts import Point
from ident.errors import refusal
from ident.vibrate.fast import Fast, FastMethod, Linearised, by_time, each_of, end_point_of, numbers_of, refuse_collapse
from ident.vibrate.linear import between_nodes
from ident.vibrate.motion import Motion
from ident.vibrate.simulate import fast_method, parts_of, sets_of

RATE = 250.0
"""Samples a second at which responses are computed; between them a quintic spline errs by 1e-4 of a second derivative
at 10 Hz, by 1e-3 at 18 Hz."""
UNITS = {IMBALANCE: 1e-3, ERROR: float(np.deg2rad(1 / 3600))}
"""Amplitude of a unit source: 1 mm of eccentricity, 1 arc second at the pin."""
LIGHTEST = 1.0
"""Eccentric mass [kg] that a drive without any is given: only the product with its eccentricity counts."""


def unit_of(source: ExcitingOrder) -> float:
    """Return the amplitude [m or rad] of a unit source."""
    return UNITS[source.kind]


def with_units(arm: Arm, sources: Sequence[ExcitingOrder]) -> Arm:
    """Return an arm excited by unit sources, in phase zero."""
    numbers = {each.amplitude: unit_of(each) for each in sources} | dict.fromkeys((each.phase for each in sources), 0.0)
    light = [drive for drive in arm.drives if not float(drive.eccentric_mass) > 0]
    return arm.replace(numbers | {f"{drive.name}.eccentric_mass": LIGHTEST for drive in light})


def masses_of(arm: Arm, sources: Sequence[ExcitingOrder]) -> dict[str, float]:
    """Return the eccentric masses [kg] with which the eccentricities count, by drive."""
    return {drive.name: float(drive.eccentric_mass) for drive in with_units(arm, sources).drives}


def excited_by(sources: Sequence[ExcitingOrder], parts: Float[np.ndarray, "S 2"]) -> dict[str, float]:
    """Return amplitudes and phases, by path, of sources with these parts in phase with cosine and sine, in units."""
    sizes = {each.amplitude: float(np.hypot(*part)) * unit_of(each) for each, part in zip(sources, parts, strict=True)}
    return sizes | {each.phase: float(np.arctan2(b, a)) for each, (a, b) in zip(sources, parts, strict=True)}


@dataclass(frozen=True)
class Sensor:
    """Where a channel measures, and what.

    Attributes:
        point: name of the point.
        direction: (3,) [-] in the base frame, or at zero posture in that of the body that carries the point.
        body: whether it turns with the body.
        derivative: 0 for displacement, 1 for velocity, 2 for acceleration. A displacement or velocity is that of the
            vibration, an acceleration the whole one, the rigid arm's with it, less gravity, in axes that tilt with the
            arm, as an accelerometer feels it.
    """

    point: str
    direction: tuple[float, float, float]
    body: bool = False
    derivative: int = 0


@dataclass(frozen=True)
class Run:
    """A motion of the arm while sensors measured.

    Attributes:
        name: of the run.
        motion: the commanded motion, its dwell included.
        loads: the load case.
        sensors: what was measured.
    """

    name: str
    motion: Motion
    loads: Loads | None
    sensors: tuple[Sensor, ...]

    @property
    def points(self) -> tuple[str, ...]:
        """Names of the points that have a sensor."""
        return tuple(dict.fromkeys(sensor.point for sensor in self.sensors))


@dataclass(frozen=True)
class Response:
    """What all sensors of a run would see, as splines over time.

    Attributes:
        run: the run.
        time: (T,) [s] from the start of the motion.
        moved: by point: (3, T, K) [m] vibration of K members; at a point with an accelerometer 6 rows more: path with
            quasi-static deflection [m], and what gravity and tilt add to the acceleration [m/s^2].
        directions: of each sensor, (3, T) in the base frame.
    """

    run: Run
    time: Float[np.ndarray, "T"]
    moved: Mapping[str, Float[np.ndarray, "R T K"]]
    directions: tuple[Float[np.ndarray, "3 T"], ...]

    @cached_property
    def curves(self) -> tuple[tuple[BSpline, BSpline, BSpline | None], ...]:
        """Splines of each sensor's motion in base axes (T, 3 K), direction (T, 3), and gravity and tilt (T, 3 K)."""

        def spline(members: np.ndarray) -> BSpline:
            return make_interp_spline(self.time, np.moveaxis(members, 1, 0).reshape((len(self.time), -1)), k=5)

        found = []
        for sensor, direction in zip(self.run.sensors, self.directions, strict=True):
            moved, felt = self.moved[sensor.point], sensor.derivative == 2
            seen = spline(moved[:3] + moved[3:6] if felt else moved[:3])
            found.append((seen, make_interp_spline(self.time, direction.T, k=3), spline(moved[6:]) if felt else None))
        return tuple(found)

    def at(
        self, number: int, time: Float[np.ndarray, "S"], further: int = 0
    ) -> tuple[Float[np.ndarray, "S 3 K"], Float[np.ndarray, "S 3"]]:
        """Return what a sensor sees in base axes at some times, and its direction there.

        Args:
            number: of the sensor.
            time: (S,) [s] within the motion.
            further: derivatives by time of both, beyond that which the sensor measures.
        """
        seen, direction, felt = self.curves[number]
        values = seen(time, nu=self.run.sensors[number].derivative + further)
        if felt is not None:
            values = values + felt(time, nu=further)
        return values.reshape((len(time), 3, -1)), direction(time, nu=further)

    def along(self, number: int, time: Float[np.ndarray, "S"]) -> Float[np.ndarray, "S K"]:
        """Return what a sensor sees along its direction at some times."""
        return np.asarray(np.einsum("sik,si->sk", *self.at(number, time)))

    def rate(self, number: int, time: Float[np.ndarray, "S"]) -> Float[np.ndarray, "S K"]:
        """Return the derivative of that by time."""
        (values, direction), (change, turn) = self.at(number, time), self.at(number, time, 1)
        return np.asarray(np.einsum("sik,si->sk", change, direction) + np.einsum("sik,si->sk", values, turn))

    def reduced(self) -> "Response":
        """Return its parts by source instead of its members (see `superposition`): sure, cosines, sines."""
        moved = {}
        for point, members in self.moved.items():
            sure, cosine, sine = parts_of(members)
            pairs = np.stack([cosine, sine], 1).reshape((-1, *sure.shape))
            moved[point] = np.moveaxis(np.concatenate([sure[None], pairs]), 0, -1)
        return replace(self, moved=moved)


def unit_response(arm: Arm, run: Run, sources: Sequence[ExcitingOrder]) -> Response:
    """Return what the sensors see of a run: without any source, then of each unit source at 0 and at 90 degrees.

    Args:
        arm: the arm.
        run: the run.
        sources: what may excite it.

    Raises:
        InputError: see `simulate`.
        ModelError: the arm collapses.
    """
    return _response(with_units(arm, sources), run, sets_of([each.phase for each in sources])).reduced()


def changed_responses(
    arm: Arm,
    run: Run,
    sources: Sequence[ExcitingOrder],
    parts: Float[np.ndarray, "S 2"],
    numbers: Sequence[Mapping[str, float]],
) -> Response:
    """Return what the sensors see of a run with sources of these parts, for each change of the arm's numbers.

    Args:
        arm: the arm.
        run: the run.
        sources: what excites it.
        parts: in phase with cosine and sine, in units.
        numbers: changed numbers of each member, by path [SI].
    """
    return _response(with_units(arm, sources), run, [excited_by(sources, parts)], numbers)


def path_of(arm: Arm, run: Run, point: str) -> Float[np.ndarray, "3 T"]:
    """Return the path of a point with its quasi-static deflection [m], at the times of a `Response`."""
    pointed = _ending_at(arm, point)
    batch = {path: np.asarray(x, float)[None] for path, x in numbers_of(pointed).items()}
    path = each_of(pointed, batch, fast_method(pointed, run.motion, run.loads, False, RATE, None), _path)
    return np.asarray(path)[..., 0, 0]


def _response(
    arm: Arm, run: Run, sets: Sequence[Mapping[str, float]], numbers: Sequence[Mapping[str, float]] = ({},)
) -> Response:
    moved, time = {}, np.zeros(0)
    for point in run.points:
        pointed = _ending_at(arm, point)
        felt = any(sensor.derivative == 2 for sensor in run.sensors if sensor.point == point)
        solve = replace(fast_method(pointed, run.motion, run.loads, False, RATE, None), measured=True)
        keep = _path_and_turn if felt else FastMethod.vibration
        time = solve.samples.wanted
        own = numbers_of(pointed)
        batch = {path: np.stack([np.asarray(each.get(path, x), float) for each in numbers]) for path, x in own.items()}
        members = np.asarray(each_of(pointed, batch, solve, keep, sets))
        members = members.reshape((*members.shape[:2], -1)) if len(numbers) > 1 else members[..., 0]
        refuse_collapse(run.motion, members)
        if felt:  # (r x d).(a - g) of a sensor's direction d that is turned by r is d.((a - g) x r)
            path = make_interp_spline(time, members[3:6, :, 0].T, k=5)
            gravity = np.asarray(arm.gravity)[:, None, None]
            members[6:] = np.cross(path(time, nu=2).T[..., None] - gravity, members[6:], axis=0) - gravity
        moved[point] = members
    return Response(run, time, moved, tuple(_directions(arm, run, time)))


def _path(solve: FastMethod, arm: Arm, linear: Linearised, solved: Fast) -> Float[Array, "3 T"]:
    """Return the path of the end point with its quasi-static deflection [m]."""
    model = solve.model(arm)

    def at(time: Array, turn: Array) -> Array:
        rest, bent = (between_nodes(solve.grid, x, time)[0] for x in (linear.equations.quasi_static, linear.bent))
        return end_point_of(model, solve.motion, time, rest, turn)[0] + bent

    return by_time(at, *solve.samples[:2])


def _path_and_turn(solve: FastMethod, arm: Arm, linear: Linearised, solved: Fast) -> Float[Array, "9 T"]:
    """Return vibration and path with quasi-static deflection [m], and how the end point's link turns from it [rad]."""
    model = solve.model(arm)
    ends = [eqx.tree_at(lambda m: m.position, model, model.position + each[:, None, None]) for each in jnp.eye(3)]

    def at(time: Array, turn: Array) -> Array:
        """Half the sum of a x b, a an axis of the link on the path, b how it has moved."""
        y, _ = solved.at(solve.grid, time)
        here, *there = (jnp.stack(end_point_of(each, solve.motion, time, y, turn)) for each in (model, *ends))
        axes = jnp.stack(there) - here
        return jnp.cross(axes[:, 0], axes[:, 1], axis=1).sum(0) / 2

    turn, path = by_time(at, *solve.samples[:2]), _path(solve, arm, linear, solved)
    return jnp.concatenate([solve.vibration(arm, linear, solved), path, turn])


def _ending_at(arm: Arm, name: str) -> Arm:
    """Return an arm whose end point is another of its points."""
    chosen = [point for point in arm.points if point.name == name]
    if not chosen:
        expected = f"one of {', '.join(point.name for point in arm.points)}"
        raise refusal(arm.name, f"no point {name}", expected, "add it to the arm file, or name another")
    others = tuple(point for point in arm.points if point.name != name)
    return eqx.tree_at(lambda a: a.points, arm, (*others, *chosen))


def _directions(arm: Arm, run: Run, time: Float[np.ndarray, "T"]) -> Iterator[Float[np.ndarray, "3 T"]]:
    """Yield each sensor's direction in the base frame; a body's turns with the commanded angles."""
    joints = {point.name: point.joint for point in arm.points}
    posture = np.asarray(run.motion(time)[0])
    for sensor in run.sensors:
        if not sensor.body:
            yield np.broadcast_to(np.asarray(sensor.direction)[:, None], (3, len(time)))
            continue
        end, origin = (Point("end", joints[sensor.point], place) for place in (sensor.direction, (0.0, 0.0, 0.0)))
        there, here = (
            np.asarray(at_posture(eqx.tree_at(lambda a: a.points, arm, (each,)), jnp.asarray(posture)).position)
            for each in (end, origin)
        )
        yield (there - here)[:, 0]
