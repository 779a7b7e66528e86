"""The names of an arm, for options and campaigns: joints, points, payloads and numbers."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ident.arm.fields import field_of
from ident.description.file import ArmFile
from ident.errors import ModelError
from ident.identify.modal_analysis import modal_analysis
from ident.studies.look.arm_view import home

MODES = 6
"""Number of named modes."""


@dataclass(frozen=True)
class Number:
    """A number of an arm.

    Attributes:
        path: its name, as in `link2.com.x`.
        value: in its unit, an SI unit.
        unit: the unit.
        origin: its source; empty if unknown.
        factor: whether it is fitted and changed by a factor, else by a difference.
    """

    path: str
    value: float
    unit: str
    origin: str
    factor: bool


@dataclass(frozen=True)
class ArmNames:
    """The names of an arm.

    Attributes:
        arm_file: the arm.
        numbers: all numbers with a path.
        posture: (driven,) [rad] at which modes are named.
        modes: name and natural frequency [Hz] of each, ascending; empty if the arm has no point or no equilibrium.
    """

    arm_file: ArmFile
    numbers: tuple[Number, ...]
    posture: tuple[float, ...]
    modes: tuple[tuple[str, float], ...]


def arm_names(arm_file: ArmFile) -> ArmNames:
    """Return the names of an arm, its modes at `home` under its own weight."""
    arm = arm_file.arm
    posture, modes = home(arm), ()  # type: tuple[float, ...], tuple[tuple[str, float], ...]
    if arm.points:
        with suppress(ModelError):
            analysis = modal_analysis(arm, posture, modes=MODES)
            modes = tuple(zip(map(str, analysis.labels), np.asarray(analysis.modes.frequency).tolist(), strict=True))
    return ArmNames(arm_file, tuple(_numbers(arm_file)), posture, modes)


def _numbers(arm_file: ArmFile) -> Iterator[Number]:
    for path, value in arm_file.arm.numbers().items():
        if field := field_of(path):
            yield Number(path, float(value), field.unit, arm_file.origins.get(path, ""), field.logarithmic)
