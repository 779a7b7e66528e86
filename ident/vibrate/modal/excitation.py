"""The frequencies at which the pulleys of an arm excite it along a motion."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.vibrate.modal.branches import check, motion_times
from ident.vibrate.modal.modes_along_path import nominal
from ident.vibrate.motion.motion import Motion

ORDER_MAX = 1000
"""Highest multiple of a pulley's frequency, and most of them: time and memory grow with both. Teeth are fewer."""


@dataclass(frozen=True)
class Source:
    """What excites: a multiple of a pulley's turning frequency.

    Attributes:
        drive: name of the drive.
        joint: name of its joint.
        pulley: its number, that of the joint among the driven ones, from 1.
        order: multiple of the turning frequency: 1 the eccentric mass, 2 the kinematic error.
    """

    drive: str
    joint: str
    pulley: int
    order: int

    def __str__(self) -> str:
        return f"pulley {self.pulley}" + (f" x {self.order}" if self.order > 1 else "")


@dataclass(frozen=True)
class Excitation:
    """Frequencies that excite the arm along a motion.

    Attributes:
        sources: what excites.
        time: (T,) [s]
        frequency: (sources, T) [Hz]
        rate: (sources, T) [Hz/s] its change over time.
    """

    sources: tuple[Source, ...]
    time: Float[np.ndarray, "T"]
    frequency: Float[np.ndarray, "sources T"]
    rate: Float[np.ndarray, "sources T"]


def excitation(arm: Arm, motion: Motion, *, times: Any = None, orders: Sequence[int] | None = None) -> Excitation:
    """Return the frequencies that the pulleys of an arm excite along a motion.

    Args:
        arm: the arm; of a batch the median.
        motion: of its driven joints.
        times: (T,) [s] ascending; 1001 over the motion when None.
        orders: multiples of every pulley's turning frequency; when None, 1, and 2 where there is a kinematic error.
    """
    time = motion_times(motion, times)
    check(arm, motion)
    _check_orders(arm, orders)
    joints = [joint.name for joint in arm.driven]
    _, qd, qdd = (np.asarray(x) for x in motion(time))
    sources, frequency, rate = [], [], []
    for drive in nominal(arm).drives:
        j, turns = joints.index(drive.joint), abs(float(drive.ratio)) / (2 * np.pi)
        for order in orders or ((1, 2) if float(drive.error) else (1,)):
            sources.append(Source(drive.name, drive.joint, j + 1, int(order)))
            frequency.append(order * turns * np.abs(qd[j]))
            rate.append(order * turns * np.sign(qd[j]) * qdd[j])
    return Excitation(tuple(sources), time, np.stack(frequency), np.stack(rate))


def _check_orders(arm: Arm, orders: Sequence[int] | None) -> None:
    if not arm.drives:
        remedy = "add a [[drive]] with its ratio to the arm file"
        raise InputError(Problem(arm.name, "no drive", "one or more, whose pulleys excite the arm", remedy))
    if orders is not None and (not len(orders) or any(order < 1 or order != int(order) for order in orders)):
        got = ", ".join(f"{order:g}" for order in orders) or "none"
        raise InputError(Problem("orders", got, "whole numbers from 1", "1 is the eccentric mass, 2 the error"))
    if orders is not None and (max(orders) > ORDER_MAX or len(orders) > ORDER_MAX):
        got = f"{max(orders):g}" if max(orders) > ORDER_MAX else f"{len(orders)} of them"
        raise InputError(Problem("orders", got, f"at most {ORDER_MAX}", "leave out what turns so fast"))
