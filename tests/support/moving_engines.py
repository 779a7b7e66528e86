"""The moving arm in Pinocchio and in MuJoCo, its results turned into ident's coordinates.

Each bushing is a spherical joint, each pin a hinge behind it, each pulley a hinge on a branch of its own; an engine's
velocities are w, the angular velocity of each shaft in its own axes, and the rates of pins and pulleys. With phi the
bushing's rotation vector, w = J_l(-phi) dphi/dt, J_l the left Jacobian. Let v = S dy/dt + (of the command): the
equations of motion are S' inverse_dynamics + springs and dampers = 0 by virtual work. All is written again in NumPy, so
that nothing of ident is used to judge ident.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
import pinocchio as pin
from engines import shift, skew
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm
from ident.arm.chain import Loads
from ident.arm.parts import Drive, Joint

SERIES = np.array([[(-1) ** n / math.factorial(2 * n + k) for n in range(15)] for k in (2, 3)])
"""(1 - cos t)/t^2 and (t - sin t)/t^3 in powers of t^2."""
STEP = 1e-30


class Lump(NamedTuple):
    """A rigid body: mass, mass centre, inertia about it; also one that is to be taken away, of negative mass."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray


class Turn(NamedTuple):
    """Angle, rate and acceleration of each joint's hinge."""

    angle: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray


def left_jacobian(p: np.ndarray) -> np.ndarray:
    """Analytic also at p = 0, so that a complex step differentiates it."""
    b, c = SERIES @ (p @ p) ** np.arange(SERIES.shape[1])
    return np.eye(3) + b * skew(p) + c * skew(p) @ skew(p)


def jacobian_rate(p: np.ndarray, v: np.ndarray) -> np.ndarray:
    """d/dt J_l(p) while p runs along v: exact to rounding."""
    return left_jacobian(p + 1j * STEP * v).imag / STEP


def steiner(mass: float, r: np.ndarray) -> np.ndarray:
    return mass * (r @ r * np.eye(3) - np.outer(r, r))


def lumped(parts: list[Lump]) -> Lump:
    """The sum of bodies."""
    mass = sum(part.mass for part in parts)
    com = sum(part.mass * part.com for part in parts) / mass
    about_origin = sum(part.inertia + steiner(part.mass, part.com) for part in parts)
    return Lump(mass, com, about_origin - steiner(mass, com))


def across(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions of the phases 0 and 90 degrees."""
    start = np.array([0.0, 1, 0]) if abs(axis[0]) > 1 - 1e-9 else np.array([1.0, 0, 0])
    first = start - axis * (axis @ start)
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first)


def turning_part(drive: Drive, axis: np.ndarray, bulk: float) -> tuple[Lump, Lump]:
    """What turns with the pulley at angle zero, and what the shaft must give for it.

    `bulk` is the rotor's inertia across the axis for one about it; that it turns cannot be seen from it.
    """
    m, e, h, phase = (float(getattr(drive, f)) for f in ("eccentric_mass", "eccentricity", "height", "phase"))
    J = float(drive.rotor_inertia)
    rotor = J * (bulk * np.eye(3) + (1 - bulk) * np.outer(axis, axis))
    first, second = across(axis)
    radial = e * (np.cos(phase) * first + np.sin(phase) * second)
    return Lump(m, h * axis + radial, rotor), Lump(-m, h * axis, -rotor)


class MovingArm:
    """What both engines have in common; a subclass fills the index of each ball, pin and pulley (or None) in q and v.

    Args:
        arm: with its drives; belts only say which pins may deviate.
        loads: payload shares, masses and forces at the points.
        elastic: whether belts stretch. Their forces are not here.
    """

    bulk = 0.6
    w_first = False
    nv: int

    def __init__(self, arm: Arm, loads: Loads | None = None, *, elastic: bool = False):
        self.arm, self.names = arm, [joint.name for joint in arm.joints]
        self.drives = [next((d for d in arm.drives if d.joint == name), None) for name in self.names]
        self.pinned = [n for n, joint in enumerate(arm.joints) if joint.driven]
        self.loose = [self.names.index(belt.driven) for belt in arm.belts] if elastic else []
        self.payload = np.zeros(len(arm.payloads)) if loads is None else np.asarray(loads.payload)
        self.masses = np.zeros(len(arm.points)) if loads is None else np.asarray(loads.mass)
        self.forces = np.zeros((3, len(arm.points))) if loads is None else np.asarray(loads.force)
        self.K = block_diag(*(tensor(joint, joint.k_bend, joint.k_tors) for joint in arm.joints))
        damping = ((j, j.k_bend * j.tau_bend, j.k_tors * j.tau_tors) for j in arm.joints)
        self.C = block_diag(*(tensor(*numbers) for numbers in damping))
        self.ratio = np.array([1.0 if d is None else float(d.ratio) for d in self.drives])
        self.errors = [[(2, 0.0, 0.0)] if d is None else waves(d) for d in self.drives]
        self.balls: list[tuple[int, int]] = []
        self.pins: list[tuple[int, int] | None] = []
        self.pulleys: list[tuple[int, int] | None] = []

    def shaft_parts(self, n: int) -> list[Lump]:
        joint, drive = self.arm.joints[n], self.drives[n]
        parts = [lump(body) for body in joint.shaft]
        return parts if drive is None else [*parts, turning_part(drive, np.asarray(joint.axis), self.bulk)[1]]

    def link_parts(self, n: int) -> list[Lump]:
        name = self.names[n]
        parts = [lump(body) for body in self.arm.joints[n].link]
        parts += [lump(p.body, s) for p, s in zip(self.arm.payloads, self.payload, strict=True) if p.joint == name]
        points = zip(self.arm.points, self.masses, strict=True)
        return parts + [Lump(m, np.asarray(p.position), np.zeros((3, 3))) for p, m in points if p.joint == name]

    def inverse(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def inertia(self, q: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def points(self, q: np.ndarray) -> np.ndarray:
        raise NotImplementedError

    def turns(self, command: np.ndarray, *deviation: np.ndarray) -> tuple[Turn, Turn]:
        """Turn the pins, by command, deviation and transmission error, and the pulleys; at any times."""
        total = np.zeros((3, len(self.names), *command.shape[2:]))
        total[:, self.pinned] = command
        for row, part in zip(total, deviation, strict=False):
            row[self.loose] += part
        (q, qd, qdd), ratio = total, column(self.ratio, total[0])
        (error, _, curve), slope = self.error(q), self.slope(q)
        pin_turn = Turn(q + error, slope * qd, slope * qdd + curve * qd**2)
        return pin_turn, Turn(*(ratio * part for part in total))

    def slope(self, q: np.ndarray) -> np.ndarray:
        """d pin / d q, q the angle of each pulley divided by the ratio."""
        return 1 + self.error(q)[1]

    def error(self, q: np.ndarray) -> np.ndarray:
        """The transmission error of each drive, its slope and its curvature over q, (3, N, ...)."""
        return np.stack([error_at(*each) for each in zip(self.errors, self.ratio, q, strict=True)], 1)

    def split(self, *flat: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray]]:
        bushings = 3 * len(self.names)
        return [x[:bushings].reshape(-1, 3) for x in flat], [x[bushings:] for x in flat]

    def configuration(self, command: np.ndarray, y: np.ndarray) -> np.ndarray:
        still = np.zeros_like(y)
        return self.motion(command, y, still, still)[0]

    def motion(self, command: np.ndarray, y: np.ndarray, yd: np.ndarray, ydd: np.ndarray) -> list[np.ndarray]:
        """q, v and a of the engine."""
        (phi, phid, phidd), xi = self.split(y, yd, ydd)
        turns = self.turns(command, *xi)
        q, v, a = np.zeros(self.nv + len(self.names)), np.zeros(self.nv), np.zeros(self.nv)
        for (at, rate), p, pd, pdd in zip(self.balls, phi, phid, phidd, strict=True):
            J, change = left_jacobian(-p), jacobian_rate(-p, -pd)
            q[at : at + 4] = Rotation.from_rotvec(p).as_quat(scalar_first=self.w_first)
            v[rate : rate + 3], a[rate : rate + 3] = J @ pd, J @ pdd + change @ pd
        for hinges, turn in zip((self.pins, self.pulleys), turns, strict=True):
            for index, angle, speed, acceleration in zip(hinges, *turn, strict=True):
                if index is not None:
                    q[index[0]], v[index[1]], a[index[1]] = angle, speed, acceleration
        return [q, v, a]

    def on_pins(self, command: np.ndarray, y: np.ndarray) -> np.ndarray:
        """dv / d(rate of the motor behind each pin), of pin and pulley together, (nv, N)."""
        total = np.zeros(len(self.names))
        total[self.pinned] = command[0]
        total[self.loose] += y[3 * len(self.names) :]
        P = np.zeros((self.nv, len(self.names)))
        for n, (slope, ratio) in enumerate(zip(self.slope(total), self.ratio, strict=True)):
            for index, value in ((self.pins[n], slope), (self.pulleys[n], ratio)):
                if index is not None:
                    P[index[1], n] = value
        return P

    def rates(self, command: np.ndarray, y: np.ndarray) -> np.ndarray:
        """S of the module's docstring."""
        S = np.zeros((self.nv, len(y)))
        for n, ((_, rate), p) in enumerate(zip(self.balls, self.split(y)[0][0], strict=True)):
            S[rate : rate + 3, 3 * n : 3 * n + 3] = left_jacobian(-p)
        S[:, 3 * len(self.names) :] = self.on_pins(command, y)[:, self.loose]
        return S

    def residual(self, command: np.ndarray, y: np.ndarray, yd: np.ndarray, ydd: np.ndarray) -> np.ndarray:
        out = self.rates(command, y).T @ self.inverse(*self.motion(command, y, yd, ydd))
        n = 3 * len(self.names)
        out[:n] += self.springs(y[:n], yd[:n])
        return out

    def springs(self, phi: np.ndarray, rate: np.ndarray) -> np.ndarray:
        return self.K @ phi + self.C @ rate

    def torques(self, command: np.ndarray, y: np.ndarray, yd: np.ndarray, ydd: np.ndarray) -> np.ndarray:
        return self.on_pins(command, y).T @ self.inverse(*self.motion(command, y, yd, ydd))

    def mass_matrix(self, command: np.ndarray, y: np.ndarray) -> np.ndarray:
        S = self.rates(command, y)
        return S.T @ self.inertia(self.configuration(command, y)) @ S

    def accelerations(self, command: np.ndarray, y: np.ndarray, yd: np.ndarray) -> np.ndarray:
        """d2y/dt2 as the arm moves by itself."""
        return -np.linalg.solve(self.mass_matrix(command, y), self.residual(command, y, yd, np.zeros_like(y)))


class PinocchioMoving(MovingArm):
    """Recursive algorithms; the rotor has inertia about its axis and none across."""

    bulk = 0.0

    def __init__(self, arm: Arm, loads: Loads | None = None, *, elastic: bool = False):
        super().__init__(arm, loads, elastic=elastic)
        model = pin.Model()
        model.gravity.linear = np.asarray(arm.gravity)
        parent, self.carrier = 0, {}
        for n, joint in enumerate(arm.joints):
            shaft = model.addJoint(parent, pin.JointModelSpherical(), shift(joint.offset), joint.name)
            parent, pulley, drive, axis = shaft, None, self.drives[n], np.asarray(joint.axis)
            if joint.driven:
                hinge = pin.JointModelRevoluteUnaligned(axis)
                parent = model.addJoint(shaft, hinge, pin.SE3.Identity(), f"{joint.name} pin")
            if drive is not None:
                hinge = pin.JointModelRevoluteUnaligned(axis)
                pulley = model.addJoint(shaft, hinge, pin.SE3.Identity(), drive.name)
                place(model, pulley, [turning_part(drive, axis, self.bulk)[0]])
            place(model, shaft, self.shaft_parts(n))
            place(model, parent, self.link_parts(n))
            self.carrier[joint.name] = parent
            self._joints = [*getattr(self, "_joints", []), (shaft, parent if parent != shaft else None, pulley)]
        self.model, self.data, self.nv = model, model.createData(), model.nv
        for triple, kind in zip(zip(*self._joints, strict=True), ("balls", "pins", "pulleys"), strict=True):
            at = [None if j is None else (model.joints[j].idx_q, model.joints[j].idx_v) for j in triple]
            setattr(self, kind, at)

    def _configuration(self, q: np.ndarray) -> np.ndarray:
        return q[: self.model.nq]

    def inverse(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        q, outside = self._configuration(q), pin.StdVec_Force()
        outside.extend([pin.Force.Zero() for _ in range(self.model.njoints)])
        pin.forwardKinematics(self.model, self.data, q)
        for point, force in zip(self.arm.points, self.forces.T, strict=True):
            body = self.carrier[point.joint]
            f = self.data.oMi[body].rotation.T @ force
            outside[body] += pin.Force(f, np.cross(np.asarray(point.position), f))
        return pin.rnea(self.model, self.data, q, v, a, outside).copy()

    def inertia(self, q: np.ndarray) -> np.ndarray:
        M = np.triu(pin.crba(self.model, self.data, self._configuration(q)))
        return M + np.triu(M, 1).T

    def points(self, q: np.ndarray) -> np.ndarray:
        pin.forwardKinematics(self.model, self.data, self._configuration(q))
        at = [self.data.oMi[self.carrier[p.joint]].act(np.asarray(p.position)) for p in self.arm.points]
        return np.stack(at, 1)

    def energy(self, command: np.ndarray, y: np.ndarray, yd: np.ndarray) -> float:
        """Kinetic energy, and that of weight, constant forces and bushings."""
        q, v, _ = self.motion(command, y, yd, np.zeros_like(y))
        phi = y[: 3 * len(self.names)]
        stored = phi @ self.K @ phi / 2 - (self.forces * self.points(q)).sum()
        q = self._configuration(q)
        return (
            pin.computeKineticEnergy(self.model, self.data, q, v)
            + pin.computePotentialEnergy(self.model, self.data, q)
            + stored
        )


class MujocoMoving(MovingArm):
    """Composite rigid bodies; the rotor is a flat disc, since no body has inertia about one axis only."""

    w_first = True

    def __init__(
        self,
        arm: Arm,
        loads: Loads | None = None,
        *,
        elastic: bool = False,
        added: Mapping[str, Sequence[tuple[float, complex, float]]] | None = None,
    ):
        """`added`: mass, place across the axis at pulley angle 0 as a complex number, height of bodies on drives."""
        super().__init__(arm, loads, elastic=elastic)
        self.added = added or {}
        spec = mujoco.MjSpec()
        spec.option.gravity = np.asarray(arm.gravity)
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        parent = spec.worldbody
        for n, joint in enumerate(arm.joints):
            shaft = parent.add_body(name=joint.name, pos=np.asarray(joint.offset))
            shaft.add_joint(name=f"{joint.name} ball", type=mujoco.mjtJoint.mjJNT_BALL)
            parent, drive, axis = shaft, self.drives[n], np.asarray(joint.axis)
            if joint.driven:
                parent = hinged(shaft, f"{joint.name} pin", axis)
                weigh(parent, lumped(self.link_parts(n)))
                weigh(shaft, lumped(self.shaft_parts(n)))
            else:
                weigh(shaft, lumped([*self.shaft_parts(n), *self.link_parts(n)]))
            if drive is not None:
                weigh(hinged(shaft, drive.name, axis), lumped(self.rotor_parts(n)))
            for point in arm.points:
                if point.joint == joint.name:
                    parent.add_site(name=point.name, pos=np.asarray(point.position))
        self.model = spec.compile()
        self.data, self.nv = mujoco.MjData(self.model), self.model.nv
        self.sites = [self.model.site(point.name).id for point in arm.points]
        self.balls = [self._at(f"{name} ball") for name in self.names]
        self.pins = [self._at(f"{joint.name} pin") if joint.driven else None for joint in arm.joints]
        self.pulleys = [None if d is None else self._at(d.name) for d in self.drives]

    def rotor_parts(self, n: int) -> list[Lump]:
        """What turns with a drive's pulley, at angle zero."""
        drive, axis = self.drives[n], np.asarray(self.arm.joints[n].axis)
        first, second = across(axis)
        bodies = [
            Lump(mass, height * axis + place.real * first + place.imag * second, np.zeros((3, 3)))
            for mass, place, height in self.added.get(drive.name, ())
        ]
        return [turning_part(drive, axis, self.bulk)[0], *bodies]

    def _at(self, joint: str) -> tuple[int, int]:
        found = self.model.joint(joint)
        return int(found.qposadr[0]), int(found.dofadr[0])

    def _place(self, q: np.ndarray) -> None:
        self.data.qpos[:] = q[: self.model.nq]
        mujoco.mj_fwdPosition(self.model, self.data)

    def inverse(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        self.data.qpos[:], self.data.qvel[:], self.data.qacc[:] = q[: self.model.nq], v, a
        mujoco.mj_inverse(self.model, self.data)
        out, J = self.data.qfrc_inverse.copy(), np.zeros((3, self.nv))
        for point, force in zip(self.arm.points, self.forces.T, strict=True):
            mujoco.mj_jacSite(self.model, self.data, J, None, self.model.site(point.name).id)
            out -= J.T @ force
        return out

    def inertia(self, q: np.ndarray) -> np.ndarray:
        self._place(q)
        M = np.zeros((self.nv, self.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        return M

    def points(self, q: np.ndarray) -> np.ndarray:
        self.data.qpos[:] = q[: self.model.nq]
        mujoco.mj_kinematics(self.model, self.data)
        return self.data.site_xpos[self.sites].T.copy()


def waves(drive: Drive) -> list[tuple[float, float, float]]:
    """Order, amplitude and phase of each of a drive's transmission errors."""
    further = [(e.order, float(e.amplitude), float(e.phase)) for e in drive.errors]
    return [(2, float(drive.error), float(drive.error_phase)), *further]


def error_at(errors: list[tuple[float, float, float]], ratio: float, q: np.ndarray) -> np.ndarray:
    """A sum of waves at q, and its two derivatives."""
    each = [(amplitude, order * ratio, order * ratio * q + phase) for order, amplitude, phase in errors]
    return np.sum([[a * np.sin(x), a * k * np.cos(x), -a * k * k * np.sin(x)] for a, k, x in each], 0)


def column(values: np.ndarray, like: np.ndarray) -> np.ndarray:
    return values.reshape((-1,) + (1,) * (like.ndim - 1))


def lump(body: object, share: float = 1.0) -> Lump:
    return Lump(share * float(body.mass), np.asarray(body.com), share * np.asarray(body.inertia))


def tensor(joint: Joint, bend: float, tors: float) -> np.ndarray:
    """bend across the axis, tors about it."""
    along = np.outer(joint.axis, joint.axis)
    return float(bend) * (np.eye(3) - along) + float(tors) * along


def place(model: pin.Model, joint: int, parts: list[Lump]) -> None:
    body = lumped(parts)
    model.appendBodyToJoint(joint, pin.Inertia(body.mass, body.com, body.inertia), pin.SE3.Identity())


def hinged(carrier: "mujoco.MjsBody", name: str, axis: np.ndarray) -> "mujoco.MjsBody":
    body = carrier.add_body(name=f"{name} body")
    body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
    return body


def weigh(body: "mujoco.MjsBody", mass: Lump) -> None:
    """Give a body its mass, the inertia along its principal axes."""
    moments, axes = np.linalg.eigh(mass.inertia)
    axes[:, 0] *= np.linalg.det(axes)
    body.mass, body.ipos, body.inertia = mass.mass, mass.com, moments
    body.iquat = Rotation.from_matrix(axes).as_quat(scalar_first=True)
    body.explicitinertial = True
