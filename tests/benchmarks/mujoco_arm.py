"""The shaken arm in MuJoCo, built for speed, and a converged solution of the exact equations by Pinocchio and SciPy.

    python tests/benchmarks/mujoco_arm.py

prints how far MuJoCo, Pinocchio and ident are from one another in a second of motion.
"""

import argparse
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

import mujoco
import numpy as np
from moving_engines import MujocoMoving, PinocchioMoving, hinged, left_jacobian, lumped, weigh
from mujoco import rollout
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm
from ident.arm.chain import Loads

MotionTable = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Angles of the pins and their rates (driven, T) at times (T)."""

ARMATURE = 1e12
"""Inertia [kg m^2] beside which all that the arm does to a pin is nothing."""


class Response(NamedTuple):
    """Times (T) [s], and how far the end point is from where the rigid arm would have it (3, T) [m]."""

    time: np.ndarray
    displacement: np.ndarray


class MujocoTransient:
    """The arm in MuJoCo's own terms: three hinges with stiffness and damping for each bushing.

    Pins and pulleys have a huge armature and a motor behind an integrator, whose input is the slope of the
    acceleration: the acceleration is linear between times of the table. Then the whole run is one call, by
    `mujoco.rollout`, and no Python runs between steps. Hinges in series are not a rotation vector: their springs
    differ from the bushing's by the square of small angles.

    Args:
        arm: its axes along x, y or z.
        table: the motion of the pins.
        duration: [s]
        loads: the load case.
        settled: start at the equilibrium of weight and springs; else straight.
        added: bodies on the drives, see `MujocoMoving`.
    """

    def __init__(
        self,
        arm: Arm,
        table: MotionTable,
        duration: float,
        *,
        loads: Loads | None = None,
        settled: bool = True,
        added: Mapping[str, Sequence[tuple[float, complex, float]]] | None = None,
    ):
        self.kinematics = MujocoMoving(arm, loads, added=added)
        self.table, self.duration, self._kept, self._rigid = table, duration, {}, {}
        self.model, self.elastic, self.motors = transient_model(self.kinematics)
        self.data = mujoco.MjData(self.model)
        at, rate, _ = (value[:, 0] for value in self._hinges(np.zeros(1)))
        self.qpos, self.qvel = np.zeros(self.model.nq), np.zeros(self.model.nv)
        self.qpos[self.motors], self.qvel[self.motors] = at, rate
        if settled:
            self._settle(self.model.jnt_stiffness[self.elastic])

    def run(self, timestep: float, every: int = 1) -> Response:
        """Integrate by RK4. What depends on the step alone is kept, so that a second run is but the integration.

        Args:
            timestep: [s]
            every: return every so many steps.
        """
        if (timestep, every) not in self._rigid:
            self._rigid[timestep, every] = self.rigid(self._prepared(timestep)[0][::every])
        times, tip = self.tip(timestep, every)
        return Response(times, (tip - self._rigid[timestep, every]).T)

    def tip(self, timestep: float, every: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Return times (T,) and where the end point is (T, 3), see `run`."""
        times, slopes, start = self._prepared(timestep)
        self.model.opt.timestep = timestep
        _, tip = rollout.rollout(self.model, self.data, start, slopes)
        return times[::every], tip[0, ::every]

    def _prepared(self, timestep: float) -> tuple[np.ndarray, ...]:
        """Return times and slopes of the accelerations of all steps, and the initial state.

        Sensors are read at the start of each step, hence one step more than the motion has.
        """
        if timestep not in self._kept:
            grid = np.arange(round(self.duration / timestep) + 1) * timestep
            acceleration = smoothed(self._hinges(grid)[2])
            slopes = np.diff(acceleration, append=acceleration[:, -1:]).T / timestep
            self._kept[timestep] = grid, slopes, self._state(acceleration[:, 0])
        return self._kept[timestep]

    def rigid(self, times: np.ndarray) -> np.ndarray:
        """Return the end point of the rigid arm (T, 3)."""
        return rigid_path(self.kinematics, self.table, times)

    def _state(self, acceleration: np.ndarray) -> np.ndarray:
        data = self.data
        mujoco.mj_resetData(self.model, data)
        data.qpos[:], data.qvel[:], data.act[:] = self.qpos, self.qvel, acceleration
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        state = np.zeros(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, data, state, kind)
        return state

    def _hinges(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return hinge_table(self.kinematics, self.table, times)

    def _settle(self, k: np.ndarray) -> None:
        """Equilibrium at rest, by Newton's method with the springs' stiffness alone."""
        data = self.data
        data.qpos[:], data.qvel[:] = self.qpos, 0.0
        for _ in range(60):
            mujoco.mj_forward(self.model, data)
            force = data.qfrc_bias - data.qfrc_passive
            data.qpos[self.elastic] -= force[self.elastic] / k
        self.qpos = data.qpos.copy()


class BushedTransient(MujocoTransient):
    """The same with the bushings' own springs and dampers, by a callback in Python, for two to three times the time.

    The rotation vector of hinges x, y, z in series is (x + yz/2, y - xz/2, z + xy/2) to the second order, J its slope;
    the hinges feel J' (k phi + c dphi/dt).
    """

    def __init__(self, arm: Arm, table: MotionTable, duration: float, **more: Any):
        super().__init__(arm, table, duration, settled=False, **more)
        stiffness, damping = (part[self.elastic] for part in (self.model.jnt_stiffness, self.model.dof_damping))
        self.springs = list(zip(stiffness.reshape(-1, 3).tolist(), damping.reshape(-1, 3).tolist(), strict=True))
        self.model.jnt_stiffness[self.elastic] = self.model.dof_damping[self.elastic] = 0.0
        with self._bushed():
            self._settle(stiffness)

    def tip(self, timestep: float, every: int = 1) -> tuple[np.ndarray, np.ndarray]:
        """Integrate by RK4; see `MujocoTransient`."""
        with self._bushed():
            return super().tip(timestep, every)

    @contextmanager
    def _bushed(self) -> Iterator[None]:
        mujoco.set_mjcb_passive(self._passive)
        try:
            yield
        finally:
            mujoco.set_mjcb_passive(None)

    def _passive(self, _: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Add the moments. In plain numbers: so few take NumPy five times as long."""
        angles, rates = data.qpos[self.elastic].tolist(), data.qvel[self.elastic].tolist()
        moments = []
        for n, ((kx, ky, kz), (cx, cy, cz)) in zip(range(0, len(angles), 3), self.springs, strict=True):
            (x, y, z), (u, v, w) = angles[n : n + 3], rates[n : n + 3]
            p = kx * (x + y * z / 2) + cx * (u + (z * v + y * w) / 2)
            q = ky * (y - x * z / 2) + cy * (v - (z * u + x * w) / 2)
            r = kz * (z + x * y / 2) + cz * (w + (y * u + x * v) / 2)
            moments += [p + (y * r - z * q) / 2, q + (z * p + x * r) / 2, r + (y * p - x * q) / 2]
        data.qfrc_passive[self.elastic] -= moments


def transient_model(arm: MujocoMoving) -> tuple[mujoco.MjModel, np.ndarray, np.ndarray]:
    """Return the model, and the places in q and v of the bushings' hinges and of pins and pulleys."""
    spec = mujoco.MjSpec()
    spec.option.gravity = np.asarray(arm.arm.gravity)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.disableflags = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    parent, driven = spec.worldbody, []
    for n, joint in enumerate(arm.arm.joints):
        shaft, axis, drive = parent.add_body(pos=np.asarray(joint.offset)), np.asarray(joint.axis), arm.drives[n]
        bushing(shaft, joint.name, arm.K[3 * n : 3 * n + 3, 3 * n : 3 * n + 3], arm.C[3 * n : 3 * n + 3])
        weigh(shaft, lumped(arm.shaft_parts(n) if joint.driven else [*arm.shaft_parts(n), *arm.link_parts(n)]))
        parent = shaft
        if joint.driven:
            parent = motor(spec, shaft, f"{joint.name} pin", axis)
            weigh(parent, lumped(arm.link_parts(n)))
            driven.append(f"{joint.name} pin")
        if drive is not None:
            weigh(motor(spec, shaft, drive.name, axis), lumped(arm.rotor_parts(n)))
            driven.append(drive.name)
        if joint.name == arm.arm.points[-1].joint:
            parent.add_site(name="end", pos=np.asarray(arm.arm.points[-1].position))
    kind = {"type": mujoco.mjtSensor.mjSENS_FRAMEPOS, "objtype": mujoco.mjtObj.mjOBJ_SITE}
    spec.add_sensor(name="end", objname="end", **kind)
    model = spec.compile()
    elastic = [int(model.joint(f"{j.name} {a}").dofadr[0]) for j in arm.arm.joints for a in "xyz"]
    return model, np.array(elastic), np.array([int(model.joint(name).dofadr[0]) for name in driven])


def bushing(shaft: "mujoco.MjsBody", name: str, stiffness: np.ndarray, damping: np.ndarray) -> None:
    """Three hinges, torsion last for an axis along z."""
    k, c = np.diag(stiffness), np.diag(damping[:, _columns(damping)])
    if np.abs(stiffness - np.diag(k)).max() > 1e-12 * k.max():
        raise ValueError("the axes of this model lie along x, y or z")
    for letter, direction, spring, damper in zip("xyz", np.eye(3), k, c, strict=True):
        kind = {"type": mujoco.mjtJoint.mjJNT_HINGE, "axis": direction}
        shaft.add_joint(name=f"{name} {letter}", stiffness=spring, damping=damper, **kind)


def _columns(rows: np.ndarray) -> slice:
    first = int(np.flatnonzero(np.abs(rows).sum(0))[0])
    return slice(first, first + 3)


def motor(spec: "mujoco.MjSpec", carrier: "mujoco.MjsBody", name: str, axis: np.ndarray) -> "mujoco.MjsBody":
    """A hinge whose acceleration is the state of its motor's integrator."""
    body = hinged(carrier, name, axis)
    body.joints[0].armature = ARMATURE
    drive = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    drive.dyntype, drive.gainprm[0] = mujoco.mjtDyn.mjDYN_INTEGRATOR, ARMATURE
    return body


def hinge_table(arm: MujocoMoving, table: MotionTable, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return angle, rate and acceleration of each pin and pulley, in the model's order, (hinges, T)."""
    pins, pulleys = arm.turns(np.stack(table(times)))
    rows = []
    for n, drive in enumerate(arm.drives):
        rows += [[part[n] for part in pins]] if n in arm.pinned else []
        rows += [[part[n] for part in pulleys]] if drive is not None else []
    return tuple(np.array(rows).transpose(1, 0, 2))


def smoothed(acceleration: np.ndarray) -> np.ndarray:
    """Return values between which lines have the accelerations' own integrals, to the fourth order in the step."""
    out = acceleration.copy()
    out[:, 1:-1] -= np.diff(acceleration, 2) / 12
    return out


def rigid_path(arm: MujocoMoving | PinocchioMoving, table: MotionTable, times: np.ndarray) -> np.ndarray:
    commands, straight = np.stack(table(times)), np.zeros(3 * len(arm.names))
    q = np.tile(arm.configuration(commands[..., 0], straight), (len(times), 1))
    for hinges, turn in zip((arm.pins, arm.pulleys), arm.turns(commands), strict=True):
        for index, angle in zip(hinges, turn.angle, strict=True):
            if index is not None:
                q[:, index[0]] = angle
    return np.stack([arm.points(each)[:, -1] for each in q])


class HingedBushings(PinocchioMoving):
    """The exact equations of what MuJoCo is given: three hinges in series, x, y, z, each with its spring and damper."""

    def springs(self, phi: np.ndarray, rate: np.ndarray) -> np.ndarray:
        n = 3 * np.arange(len(self.names))
        k, c = (np.diag(A).reshape(-1, 3) for A in (self.K, self.C))
        parts = zip(n, k, c, strict=True)
        return np.concatenate([_hinged(phi[i : i + 3], rate[i : i + 3], spring, damp) for i, spring, damp in parts])


def _hinged(phi: np.ndarray, rate: np.ndarray, k: np.ndarray, c: np.ndarray) -> np.ndarray:
    turn = Rotation.from_rotvec(phi)
    angles = turn.as_euler("XYZ")
    last = Rotation.from_euler("z", angles[2])
    second = Rotation.from_euler("y", angles[1]) * last
    x, y, z = np.eye(3)
    of_hinges = np.stack([second.inv().apply(x), last.inv().apply(y), z], 1)
    slope = np.linalg.solve(of_hinges, left_jacobian(-phi))
    return slope.T @ (k * angles + c * (slope @ rate))


def reference(
    arm: Arm,
    table: MotionTable,
    times: np.ndarray,
    *,
    loads: Loads | None = None,
    rtol: float = 1e-10,
    engine_of: type[PinocchioMoving] = PinocchioMoving,
) -> tuple[Response, np.ndarray]:
    """Solve the exact equations from equilibrium by Pinocchio's M and bias and DOP853: slow.

    Args:
        arm: the arm.
        table: the motion of its pins.
        times: when the response is wanted [s].
        loads: the load case.
        rtol: of the integration.
        engine_of: `HingedBushings` for the limit of `MujocoTransient`.

    Returns:
        The response, and the states (2 n, T): rotation vectors, then their rates.
    """
    engine = engine_of(arm, loads)
    n = engine.K.shape[0]

    def flow(t: float, s: np.ndarray) -> np.ndarray:
        return np.concatenate([s[n:], engine.accelerations(command_at(table, t), s[:n], s[n:])])

    start = np.concatenate([equilibrium(engine, command_at(table, times[0])), np.zeros(n)])
    states = integrate(flow, start, times, rtol)
    return Response(times, displacement(engine, table, times, states[:n])), states


def command_at(table: MotionTable, t: float) -> np.ndarray:
    return np.stack(table(np.array([t])))[:, :, 0]


def integrate(flow: Callable[..., np.ndarray], start: np.ndarray, times: np.ndarray, rtol: float) -> np.ndarray:
    span = (times[0], times[-1])
    tolerances = {"rtol": rtol, "atol": rtol * 1e-3, "first_step": min(1e-4, span[1] - span[0])}
    found = solve_ivp(flow, span, start, method="DOP853", t_eval=times, **tolerances)
    if not found.success:
        raise RuntimeError(found.message)
    return found.y


def equilibrium(engine: PinocchioMoving, command: np.ndarray) -> np.ndarray:
    """Return phi at which weight and springs balance, the pins standing still."""
    still, phi = command * np.array([[1.0], [0.0], [0.0]]), np.zeros(engine.K.shape[0])
    for _ in range(60):
        phi = phi - np.linalg.solve(engine.K, engine.residual(still, phi, 0 * phi, 0 * phi))
    return phi


def displacement(engine: PinocchioMoving, table: MotionTable, times: np.ndarray, phi: np.ndarray) -> np.ndarray:
    commands = np.moveaxis(np.stack(table(times)), -1, 0)
    tip = [engine.points(engine.configuration(c, p))[:, -1] for c, p in zip(commands, phi.T, strict=True)]
    return (np.stack(tip) - rigid_path(engine, table, times)).T


def cycloid(direction: tuple[float, ...], start: float, stop: float, duration: float) -> MotionTable:
    """Return the motion from one alpha to another [rad] on a cycloid."""

    def table(t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        w = 2 * np.pi / duration
        alpha = start + (stop - start) * (t / duration - np.sin(w * t) / (2 * np.pi))
        rate, change = (stop - start) / duration * (1 - np.cos(w * t)), (stop - start) / duration * w * np.sin(w * t)
        return tuple(np.outer(direction, part) for part in (alpha, rate, change))

    return table


def by_ident(arm: Arm, table: MotionTable, times: np.ndarray, start: np.ndarray, *, rtol: float = 1e-10) -> np.ndarray:
    """Return the states (2 n, T) that ident's residual leads to, by DOP853."""
    import jax
    import jax.numpy as jnp

    from ident.arm.multibody import Command, multibody, residual

    of, n = multibody(arm), len(start) // 2

    @jax.jit
    def flow(command: jax.Array, s: jax.Array) -> jax.Array:
        def force(ydd: jax.Array) -> jax.Array:
            return residual(of, Command(*command), s[:n], s[n:], ydd)

        none = jnp.zeros(n)
        return jnp.concatenate([s[n:], -jnp.linalg.solve(jax.jacfwd(force)(none), force(none))])

    return integrate(lambda t, s: np.asarray(flow(command_at(table, t), s)), start, times, rtol)


def main() -> None:
    """Compare the three in the first second of the paper's motion at 10 %."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    import jax

    jax.config.update("jax_enable_x64", True)
    from arms import lcd_arm

    arm, alpha = lcd_arm(), np.deg2rad([80, 70])
    table, times = cycloid((1, -2, 1), *alpha, 1.0), np.linspace(0, 1, 201)
    began = time.perf_counter()
    exact, states = reference(arm, table, times)
    print(f"reference: {time.perf_counter() - began:.1f} s")
    moved = exact.displacement - exact.displacement[:, :1]
    peak = np.abs(moved).max()
    print(f"peak displacement {peak:.4e} m beyond the static {np.abs(exact.displacement[:, 0]).max():.4e} m")
    looser, _ = reference(arm, table, times, rtol=1e-9)
    print(f"reference at rtol 1e-9: {np.abs(looser.displacement - exact.displacement).max() / peak:.1e} of the peak")
    began = time.perf_counter()
    mine = by_ident(arm, table, times, states[:, 0])
    tip = displacement(PinocchioMoving(arm), table, times, mine[: len(mine) // 2])
    print(
        f"ident: {time.perf_counter() - began:.1f} s, {np.abs(tip - exact.displacement).max() / peak:.1e} of the peak"
    )
    hinges, _ = reference(arm, table, times, engine_of=HingedBushings)
    transient = MujocoTransient(arm, table, 1.0)
    for step in (1e-3, 5e-4, 2.5e-4, 1.25e-4, 2e-5):
        found, began = transient.run(step, every=round(0.005 / step)), time.perf_counter()
        found = transient.run(step, every=round(0.005 / step))
        took = time.perf_counter() - began
        off, own = (np.abs(found.displacement - right.displacement).max() / peak for right in (exact, hinges))
        print(
            f"MuJoCo, step {step:.2e} s: {took:.3f} s, {off:.1e} of the peak, {own:.1e} from its hinges' exact motion"
        )


if __name__ == "__main__":
    main()
