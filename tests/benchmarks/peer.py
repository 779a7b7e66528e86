"""The same predictions by MuJoCo and SciPy, one stiffness set at a time.

Coordinates are the rotation vectors p of the ball joints in the shafts' axes, so that the bushings' stiffness is a
constant diagonal. A ball joint's velocity is J_l(-p) dp/dt, J_l the left Jacobian.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np
import scipy.linalg as sl

sys.path.insert(0, str(Path(__file__).parents[1] / "support"))

from engines import MujocoArm

from ident.arm.arm import Arm, stiffness_paths

H = 1e-4
"""Step [rad] of the central differences: their error is about 1e-11 of the bushings' stiffness."""
CLOSE = 1e-13


class Peer:
    """A held arm in MuJoCo, its stiffness an argument."""

    def __init__(self, arm: Arm, posture: np.ndarray):
        engine = MujocoArm(arm, posture)
        self.model, self.data, self.held = engine.model, engine.data, engine.held
        self.q, self.v = engine.q_ball, engine.v_ball
        n = len(self.v)
        self.full, self.zero = np.zeros((self.model.nv, self.model.nv)), np.zeros(n)
        self.end = self.data.site("end")
        self.place(self.zero)
        self.rest = self.end.xpos.copy()
        axes = [np.abs(np.asarray(joint.axis)) for joint in arm.joints]
        if not all(np.isclose(axis.max(), 1) for axis in axes):
            raise ValueError("the peer takes axes along x, y or z only: stiffness is diagonal then")
        names = list(stiffness_paths(arm))
        self.pick = np.array(
            [
                names.index(f"{joint.name}.{'k_tors' if along > 0.5 else 'k_bend'}")
                for joint, axis in zip(arm.joints, axes, strict=True)
                for along in axis
            ]
        )

    def place(self, p: np.ndarray) -> None:
        self.data.qpos[:] = self.held
        for q, v in zip(self.q, p.reshape(-1, 3), strict=True):
            size = np.sqrt(v @ v)
            mujoco.mju_axisAngle2Quat(self.data.qpos[q : q + 4], v / max(size, 1e-300), size)
        mujoco.mj_forward(self.model, self.data)

    def rates(self, p: np.ndarray) -> np.ndarray:
        """J_l(-p) of all joints (N, 3, 3)."""
        v = p.reshape(-1, 3)
        t2 = np.maximum((v * v).sum(1), 1e-14)[:, None, None]
        t = np.sqrt(t2)
        S = np.zeros((len(v), 3, 3))
        S[:, 2, 1], S[:, 0, 2], S[:, 1, 0] = v.T
        S -= S.transpose(0, 2, 1)
        return np.eye(3) - 2 * np.sin(t / 2) ** 2 / t2 * S + (t - np.sin(t)) / (t2 * t) * (S @ S)

    def weight(self, p: np.ndarray) -> np.ndarray:
        self.place(p)
        return (self.rates(p) * self.data.qfrc_bias[self.v].reshape(-1, 3, 1)).sum(1).ravel()

    def mass_matrix(self) -> np.ndarray:
        mujoco.mj_fullM(self.model, self.data, self.full)
        return self.full[np.ix_(self.v, self.v)]

    def exact(self, stiffness: np.ndarray, count: int) -> tuple[np.ndarray, float]:
        """Lowest frequencies [Hz] about the exact equilibrium, and the end's drop [m]."""
        k = stiffness[self.pick]
        p = -self.weight(self.zero) / k
        for _ in range(30):  # stiffness is nearly all of the Hessian, so that Newton's method may use it alone
            move = (self.weight(p) + k * p) / k
            p = p - move
            if np.abs(move).max() < CLOSE:
                break
        slope = np.empty((len(p), len(p)))
        for a, e in enumerate(H * np.eye(len(p))):
            slope[a] = (self.weight(p + e) - self.weight(p - e)) / (2 * H)
        self.place(p)
        B = sl.block_diag(*self.rates(p))
        hessian, M = np.diag(k) + (slope + slope.T) / 2, B.T @ self.mass_matrix() @ B
        w = sl.eigh(hessian, M, eigvals_only=True, subset_by_index=[0, count - 1])
        return np.sqrt(w) / (2 * np.pi), self.rest[2] - self.end.xpos[2]

    def lean(self, stiffness: np.ndarray, count: int) -> tuple[np.ndarray, float]:
        """The same linearized at p = 0: no equilibrium, no stiffness of weight."""
        k = stiffness[self.pick]
        self.place(self.zero)
        p = -self.data.qfrc_bias[self.v] / k
        w = sl.eigh(np.diag(k), self.mass_matrix(), eigvals_only=True, subset_by_index=[0, count - 1])
        self.place(p)
        return np.sqrt(w) / (2 * np.pi), self.rest[2] - self.end.xpos[2]
