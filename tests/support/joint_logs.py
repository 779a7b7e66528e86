"""Logs of one driven joint from the equations of its two masses, solved by SciPy: motor, link, spring with backlash."""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

from ident.measure.joint_log import JointLog

RATE = 250.0
SMOOTH = 2e-3
"""Speed [rad/s] over which friction changes its sign."""


@dataclass(frozen=True)
class Truth:
    """A joint: numbers in SI, by the names of what is estimated."""

    stiffness: float = 2e5
    damping: float = 150.0
    coulomb: float = 60.0
    viscous: float = 120.0
    backlash: float = 0.0
    delay: float = 3e-3
    motor: float = 30.0
    link: float = 120.0
    gravity: float = 800.0

    def expected(self, quantity: str, parted: bool) -> float:
        """Return what a log should say of a quantity."""
        mixed = self.viscous / self.stiffness if quantity == "delay" and not parted else 0.0
        return getattr(self, quantity) - mixed


def coloured(rng, count, sd, time):
    """Noise with a correlation time [s]."""
    keep, noise = np.exp(-1 / RATE / time), rng.normal(size=count) * sd
    values = np.empty(count)
    values[0] = noise[0]
    for i in range(1, count):
        values[i] = keep * values[i - 1] + np.sqrt(1 - keep**2) * noise[i]
    return values


def joint_log(truth=Truth(), seed=0, *, duration=20.0, channels=("motor", "link", "torque"), noise=1.0):
    """Return a log: a motor that is controlled along six random sines, encoders, torque, each with its errors.

    Noise: 2 urad of both encoders, 5 urad of 50 ms of the link's, whose disk is 30 urad off centre; 15 N m of torques.
    """
    rng = np.random.default_rng(seed)
    omega, phase = 2 * np.pi * rng.uniform(0.08, 0.8, 6), rng.uniform(0, 2 * np.pi, 6)
    size = 0.3 * rng.uniform(0.4, 1, 6) / omega
    total, bandwidth = truth.motor + truth.link, 8 * np.pi

    def wanted(t):
        return (size * np.sin(omega * t + phase)).sum(), (size * omega * np.cos(omega * t + phase)).sum()

    def drive(t, angle, speed):
        position, rate = wanted(t)
        push = -(size * omega**2 * np.sin(omega * t + phase)).sum()
        push += 0.3 * bandwidth**2 * (position - angle) + 0.5 * bandwidth * (rate - speed)
        return total * push + truth.gravity * np.cos(position) + truth.coulomb * np.tanh(rate / 0.01)

    def spring(motor, link, speed, link_speed):
        twist, half = motor - link, truth.backlash / 2
        free = np.sign(twist) * np.maximum(np.abs(twist) - half, 0.0)
        return truth.stiffness * free + (np.abs(twist) > half) * truth.damping * (speed - link_speed)

    def equations(t, state):
        motor, link, speed, link_speed = state
        inside = spring(motor, link, speed, link_speed)
        friction = truth.coulomb * np.tanh(speed / SMOOTH) + truth.viscous * speed
        left = drive(t, motor, speed) - friction - inside
        return [speed, link_speed, left / truth.motor, (inside - truth.gravity * np.cos(link)) / truth.link]

    time = np.arange(0, duration, 1 / RATE)
    start, rate = wanted(0.0)
    twist = truth.gravity * np.cos(start) / truth.stiffness
    state = [start, start - twist - truth.backlash / 2, rate, rate]
    limits = {"rtol": 1e-7, "atol": 1e-9, "max_step": 0.01}
    motor, link, speed, link_speed = solve_ivp(equations, (0, duration), state, "LSODA", t_eval=time, **limits).y
    delayed = CubicSpline(time, link)(time - truth.delay)
    count = len(time)
    off_centre = 3e-5 * np.sin(delayed + rng.uniform(0, 2 * np.pi))
    error = {
        "motor": 2e-6 * rng.normal(size=count),
        "link": 2e-6 * rng.normal(size=count) + coloured(rng, count, 5e-6, 0.05),
        "torque": coloured(rng, count, 15.0, 0.004),
        "load": coloured(rng, count, 15.0, 0.004),
    }
    values = {
        "motor": motor,
        "link": delayed + off_centre - 1e-3,
        "torque": np.array([drive(*each) for each in zip(time, motor, speed, strict=True)]),
        "load": spring(motor, link, speed, link_speed),
    }
    return JointLog("log.csv", "", time, {"joint": {name: values[name] + noise * error[name] for name in channels}})


def clamped_log(truth, seed=0):
    """Return a log of a joint whose link is clamped, in closed form: the torque that a given twist takes."""
    rng, time = np.random.default_rng(seed), np.arange(0, 20, 1 / RATE)
    angle = 4e-3 * np.sin(2 * np.pi * 0.3 * time) + 2e-3 * np.sin(2 * np.pi * 0.71 * time + 1)
    speed = CubicSpline(time, angle)(time, 1)
    free = np.sign(angle) * np.maximum(np.abs(angle) - truth.backlash / 2, 0.0)
    torque = truth.motor * CubicSpline(time, angle)(time, 2) + truth.coulomb * np.sign(speed)
    torque += (truth.viscous + truth.damping) * speed + truth.stiffness * free
    columns = {
        "motor": angle + 1e-6 * rng.normal(size=len(time)),
        "torque": torque + coloured(rng, len(time), 5.0, 0.004),
    }
    return JointLog("log.csv", "", time, {"joint": columns})
