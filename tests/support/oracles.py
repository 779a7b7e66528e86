"""Independent solutions of an arm's motion: another engine's M and bias, integrated by SciPy."""

import sys
from pathlib import Path

import numpy as np
from scipy.interpolate import PPoly

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import mujoco
from moving_engines import MovingArm, MujocoMoving
from mujoco_arm import MotionTable, command_at, displacement, integrate

from ident.vibrate.motion import Motion


class QuickMujoco(MujocoMoving):
    """M and bias from one evaluation of the engine."""

    def accelerations(self, command: np.ndarray, y: np.ndarray, yd: np.ndarray) -> np.ndarray:
        S, M = self.rates(command, y), np.zeros((self.nv, self.nv))
        force = S.T @ self.inverse(*self.motion(command, y, yd, np.zeros_like(y)))
        mujoco.mj_fullM(self.model, self.data, M)
        return -np.linalg.solve(S.T @ M @ S, force + self.springs(y, yd))


def table_of(motion: Motion) -> MotionTable:
    """The polynomials of a motion, evaluated by SciPy; only between its first break and its last."""
    path = PPoly(np.asarray(motion.coefficients), np.asarray(motion.breaks))
    parts = path, path.derivative(), path.derivative(2)
    return lambda t: tuple(part(t).T for part in parts)


def follow(
    engine: MovingArm, table: MotionTable, start: np.ndarray, times: np.ndarray, rtol: float
) -> tuple[np.ndarray, np.ndarray]:
    """Displacement of the end point (3, T) and states (2 n, T) from a state (2 n) at the first of the times."""
    n = len(start) // 2

    def flow(t: float, s: np.ndarray) -> np.ndarray:
        return np.concatenate([s[n:], engine.accelerations(command_at(table, t), s[:n], s[n:])])

    states = integrate(flow, start, times, rtol)
    return displacement(engine, table, times, states[:n]), states
