"""The same arm in MuJoCo and in Pinocchio, with its results turned into ident's coordinates.

An engine's spherical joint has a quaternion, and as velocity the angular velocity w in the axes of the body that it
carries. ident's phi is the rotation vector in base axes. With F the shaft's axes at phi = 0, phi' = F.T phi and J_l
the left Jacobian, w = J_l(-phi') dphi'/dt = B dphi/dt. The closed forms here are written again, in NumPy, so that
nothing of ident is used to judge ident.
"""

from typing import Protocol

import mujoco
import numpy as np
import pinocchio as pin
from scipy.linalg import block_diag
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm
from ident.arm.parts import Body, Joint

EIGHTH_ORDER = {1: 4 / 5, 2: -1 / 5, 3: 4 / 105, 4: -1 / 280}
"""Weights of the central difference that is exact for polynomials of degree eight."""


class Engine(Protocol):
    """A held arm; x is phi, joint by joint."""

    def frames(self) -> list[np.ndarray]: ...
    def mass_matrix(self, x: np.ndarray) -> np.ndarray: ...
    def gravity_gradient(self, x: np.ndarray) -> np.ndarray: ...
    def gravity_hessian(self, x: np.ndarray) -> np.ndarray: ...
    def point(self, x: np.ndarray) -> np.ndarray: ...
    def end_axes(self, x: np.ndarray) -> np.ndarray: ...


def title(engine: type) -> str:
    """The engine's own name."""
    return "MuJoCo" if "Mujoco" in engine.__name__ else "Pinocchio"


def skew(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


CROSS = np.stack([skew(e) for e in np.eye(3)], -1)


def left_jacobian(p: np.ndarray) -> np.ndarray:
    """Closed form of vectors `(..., 3)`, away from 0; analytic, so that a complex step differentiates it."""
    t, cross = np.sqrt((p * p).sum(-1))[..., None, None], np.tensordot(p, CROSS, (-1, 2))
    return np.eye(3) + 2 * (np.sin(t / 2) / t) ** 2 * cross + (t - np.sin(t)) / t**3 * cross @ cross


def jacobian_slope(p: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """d(J_l(p) moment)/dp by complex steps: exact to rounding."""
    columns = [(left_jacobian(p + 1e-30j * e) @ moment).imag / 1e-30 for e in np.eye(3)]
    return np.stack(columns, 1)


def stiffness(arm: Arm, engine: Engine) -> np.ndarray:
    """Stiffness matrix of all bushings in base axes, from the arm's numbers and the engine's shaft axes."""
    blocks = []
    for joint, F in zip(arm.joints, engine.frames(), strict=True):
        a = np.asarray(joint.axis)
        K = float(joint.k_bend) * (np.eye(3) - np.outer(a, a)) + float(joint.k_tors) * np.outer(a, a)
        blocks.append(F @ K @ F.T)
    return block_diag(*blocks)


def settled(engine: Engine, K: np.ndarray) -> np.ndarray:
    """Static equilibrium of an engine's arm on springs of a stiffness matrix, by MINPACK."""

    def gradient(x: np.ndarray) -> np.ndarray:
        return engine.gravity_gradient(x) + K @ x

    start, options = np.full(len(K), 1e-3), {"xtol": 1e-14}
    return root(gradient, start, jac=lambda x: engine.gravity_hessian(x) + K, options=options).x


def local(frames: list[np.ndarray], x: np.ndarray) -> np.ndarray:
    """Rotation vectors (N, 3) in the shafts' axes."""
    return np.einsum("nji,nj->ni", frames, x.reshape(-1, 3))


def rates(frames: list[np.ndarray], x: np.ndarray) -> np.ndarray:
    """B of the module's docstring, for all joints."""
    each, n = left_jacobian(-local(frames, x)) @ np.swapaxes(frames, 1, 2), len(frames)
    whole = np.zeros((n, 3, n, 3))
    whole[range(n), :, range(n)] = each
    return whole.reshape(3 * n, 3 * n)


class PinocchioArm:
    """Recursive algorithms, with analytic derivatives of the gravity moments."""

    def __init__(self, arm: Arm, posture: np.ndarray):
        model, angles = pin.Model(), iter(posture)
        model.gravity.linear = np.asarray(arm.gravity)
        parent, self.q_ball, self.v_ball, self.shafts, angle_at = 0, [], [], [], {}
        end = arm.points[-1]
        for joint in arm.joints:
            ball = model.addJoint(parent, pin.JointModelSpherical(), shift(joint.offset), joint.name)
            self.shafts.append(ball)
            self.q_ball.append(model.joints[ball].idx_q)
            self.v_ball += range(model.joints[ball].idx_v, model.joints[ball].idx_v + 3)
            parent = ball
            if joint.driven:
                pinned = pin.JointModelRevoluteUnaligned(np.asarray(joint.axis))
                parent = model.addJoint(ball, pinned, pin.SE3.Identity(), f"{joint.name} pin")
                angle_at[model.joints[parent].idx_q] = next(angles)
            for at, bodies in ((ball, joint.shaft), (parent, joint.link)):
                for body in bodies:
                    inertia = pin.Inertia(float(body.mass), np.asarray(body.com), np.asarray(body.inertia))
                    model.appendBodyToJoint(at, inertia, pin.SE3.Identity())
            if joint.name == end.joint:
                self.end_joint, self.end = parent, np.asarray(end.position)
        self.model, self.data = model, model.createData()
        self.held = pin.neutral(model)
        for index, angle in angle_at.items():
            self.held[index] = angle
        pin.forwardKinematics(self.model, self.data, self.held)
        self._frames = [self.data.oMi[ball].rotation.copy() for ball in self.shafts]

    def frames(self) -> list[np.ndarray]:
        return self._frames

    def _q(self, x: np.ndarray) -> np.ndarray:
        q = self.held.copy()
        turns = Rotation.from_rotvec(local(self._frames, x)).as_quat()
        for index, turn in zip(self.q_ball, turns, strict=True):
            q[index : index + 4] = turn
        return q

    def mass_matrix(self, x: np.ndarray) -> np.ndarray:
        M = np.triu(pin.crba(self.model, self.data, self._q(x)))
        M = (M + np.triu(M, 1).T)[np.ix_(self.v_ball, self.v_ball)]
        B = rates(self._frames, x)
        return B.T @ M @ B

    def _moments(self, x: np.ndarray) -> np.ndarray:
        return pin.computeGeneralizedGravity(self.model, self.data, self._q(x))[self.v_ball]

    def gravity_gradient(self, x: np.ndarray) -> np.ndarray:
        return rates(self._frames, x).T @ self._moments(x)

    def gravity_hessian(self, x: np.ndarray) -> np.ndarray:
        """Analytic: Pinocchio's slope of the moments, and the slope of B'."""
        frames, moments, q = self._frames, self._moments(x).reshape(-1, 3), self._q(x)
        slope = pin.computeGeneralizedGravityDerivatives(self.model, self.data, q)
        slope = slope[np.ix_(self.v_ball, self.v_ball)]
        turned = zip(frames, local(frames, x), moments, strict=True)
        chart = block_diag(*(F @ jacobian_slope(p, m) @ F.T for F, p, m in turned))
        B = rates(frames, x)
        return B.T @ slope @ B + chart

    def point(self, x: np.ndarray) -> np.ndarray:
        pin.forwardKinematics(self.model, self.data, self._q(x))
        return self.data.oMi[self.end_joint].act(self.end)

    def end_axes(self, x: np.ndarray) -> np.ndarray:
        pin.forwardKinematics(self.model, self.data, self._q(x))
        return self.data.oMi[self.end_joint].rotation.copy()


def shift(offset: np.ndarray) -> pin.SE3:
    return pin.SE3(np.eye(3), np.asarray(offset))


class MujocoArm:
    """Composite rigid bodies; the Hessian by differences of the eighth order."""

    def __init__(self, arm: Arm, posture: np.ndarray):
        spec, angles = mujoco.MjSpec(), iter(posture)
        spec.option.gravity = np.asarray(arm.gravity)
        spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
        parent = spec.worldbody
        end, held = arm.points[-1], {}
        for joint in arm.joints:
            shaft = parent.add_body(name=joint.name, pos=np.asarray(joint.offset))
            shaft.add_joint(name=joint.name, type=mujoco.mjtJoint.mjJNT_BALL)
            parent = shaft
            if joint.driven:
                parent = shaft.add_body(name=f"{joint.name} link")
                name, axis = f"{joint.name} pin", np.asarray(joint.axis)
                parent.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
                held[name] = next(angles)
            for carrier, bodies in ((shaft, joint.shaft), (parent, joint.link)):
                for body in bodies:
                    add_mass(turning(joint, carrier) if body.name.startswith("rotor") else carrier, body)
            if joint.name == end.joint:
                parent.add_site(name="end", pos=np.asarray(end.position))
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        balls = [self.model.joint(joint.name) for joint in arm.joints]
        self.q_ball = [int(ball.qposadr[0]) for ball in balls]
        self.v_ball = [int(ball.dofadr[0]) + a for ball in balls for a in range(3)]
        self.shafts = [self.model.body(joint.name).id for joint in arm.joints]
        self.held = self.model.qpos0.copy()
        for name, angle in held.items():
            self.held[int(self.model.joint(name).qposadr[0])] = angle
        self.data.qpos[:] = self.held
        mujoco.mj_forward(self.model, self.data)
        self._frames = [self.data.xmat[shaft].reshape(3, 3).copy() for shaft in self.shafts]

    def frames(self) -> list[np.ndarray]:
        return self._frames

    def _place(self, x: np.ndarray) -> None:
        self.data.qpos[:] = self.held
        turns = Rotation.from_rotvec(local(self._frames, x)).as_quat(scalar_first=True)
        for index, turn in zip(self.q_ball, turns, strict=True):
            self.data.qpos[index : index + 4] = turn
        mujoco.mj_forward(self.model, self.data)

    def mass_matrix(self, x: np.ndarray) -> np.ndarray:
        self._place(x)
        M = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, M)
        B = rates(self._frames, x)
        return B.T @ M[np.ix_(self.v_ball, self.v_ball)] @ B

    def gravity_gradient(self, x: np.ndarray) -> np.ndarray:
        self._place(x)
        return rates(self._frames, x).T @ self.data.qfrc_bias[self.v_ball]

    def gravity_hessian(self, x: np.ndarray) -> np.ndarray:
        """Differences over 0.04 rad: cut-off error near 0.04^8/630, rounding near 1e-15/0.04."""
        h, columns = 0.04, []
        for e in np.eye(len(x)):
            pairs = ((w, self.gravity_gradient(x + n * h * e)) for n, w in EIGHTH_ORDER.items())
            forward = sum(w * g for w, g in pairs)
            pairs = ((w, self.gravity_gradient(x - n * h * e)) for n, w in EIGHTH_ORDER.items())
            columns.append((forward - sum(w * g for w, g in pairs)) / h)
        return np.stack(columns, 1)

    def point(self, x: np.ndarray) -> np.ndarray:
        self._place(x)
        return self.data.site("end").xpos.copy()

    def end_axes(self, x: np.ndarray) -> np.ndarray:
        self._place(x)
        return self.data.site("end").xmat.reshape(3, 3).copy()


def turning(joint: Joint, shaft: "mujoco.MjsBody") -> "mujoco.MjsBody":
    """What turns on a shaft, about the axis of its pin."""
    rotor = shaft.add_body(name=f"{joint.name} turning")
    rotor.add_joint(name=f"{joint.name} rotor", type=mujoco.mjtJoint.mjJNT_HINGE, axis=np.asarray(joint.axis))
    return rotor


def add_mass(carrier: "mujoco.MjsBody", body: Body) -> None:
    """Weld a body to another one, its inertia given along its principal axes."""
    moments, axes = np.linalg.eigh(np.asarray(body.inertia))
    axes[:, 0] *= np.linalg.det(axes)
    carrier.add_body(
        name=body.name,
        mass=float(body.mass),
        ipos=np.asarray(body.com),
        inertia=moments,
        iquat=Rotation.from_matrix(axes).as_quat(scalar_first=True),
        explicitinertial=True,
    )
