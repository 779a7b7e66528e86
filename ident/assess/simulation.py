"""A simulated motion as it is reported: all that the report, the files and the figures have in common."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.description.file import ArmFile
from ident.identify.values import Values
from ident.measure import Load, Log, Trace
from ident.vibrate.response.belt_tension import belt_tension
from ident.vibrate.response.response import Response
from ident.vibrate.response.study import Draws, SimulatedMotion, Sizes, measures
from ident.vibrate.signal.compare import Comparison


@dataclass(frozen=True)
class Simulation:
    """What was simulated, from what, and what came out.

    Attributes:
        arm_file: the arm as its file has it.
        arm: the arm as it was simulated.
        load: the load case.
        study: the simulated motion.
        tolerance: [m] of the settling time.
        at: [s] from when on the late peak counts; None for none.
        limit: [m] that the peak should not exceed; None for none.
        log: the joint path, if one was replayed.
        fit: values of a fit that the arm has taken over.
        posterior: draws of a posterior.
        draws: the vibration by these draws.
        changed: numbers that the user has set, by path.
        trace: a measured trace.
        comparisons: the simulation against it, by direction.
    """

    arm_file: ArmFile
    arm: Arm
    load: Load
    study: SimulatedMotion
    tolerance: float
    at: float | None = None
    limit: float | None = None
    log: Log | None = None
    fit: Values | None = None
    posterior: Values | None = None
    draws: Draws | None = None
    changed: Mapping[str, float] | None = None
    trace: Trace | None = None
    comparisons: Mapping[str, Comparison] | None = None

    @property
    def response(self) -> Response:
        """The response that is reported."""
        return self.study.response

    @property
    def point(self) -> str:
        """Name of the end point."""
        return self.arm.points[-1].name

    @cached_property
    def time(self) -> Float[np.ndarray, "T"]:
        """Times [s]."""
        return np.asarray(self.response.time)

    @cached_property
    def vibration(self) -> Float[np.ndarray, "3 T"]:
        """Displacement of the end point from where the sagging arm would be [m]."""
        return np.asarray(self.response.vibration)

    @cached_property
    def sizes(self) -> Sizes:
        """How large the vibration is."""
        return measures(self.response, self.tolerance, self.at)

    @cached_property
    def phi(self) -> Float[np.ndarray, "3 N T"]:
        """Rotations of the bushings along their shafts' axes [rad]."""
        return np.asarray(self.response.phi)

    @cached_property
    def tension(self) -> Float[np.ndarray, "2 B T"]:
        """Tension of upper and lower span of each belt [N]."""
        return np.asarray(belt_tension(self.response))

    @cached_property
    def pulleys(self) -> dict[str, tuple[Float[np.ndarray, "T"], Float[np.ndarray, "T"]]]:
        """Angle [rad] and turning frequency [Hz] of the pulley of each drive, by the drive's name."""
        names = [joint.name for joint in self.arm.driven]
        angle, frequency = (np.asarray(part) for part in self.response.pulley)
        places = {drive.name: names.index(drive.joint) for drive in self.arm.drives}
        return {name: (angle[place], frequency[place]) for name, place in places.items()}

    @cached_property
    def moments(self) -> tuple[Float[np.ndarray, "N T"], Float[np.ndarray, "N T"]]:
        """Bending (across the axis) and torsion (about it) of each bushing [N m]."""
        moment, axis = np.asarray(self.response.moment), np.asarray(self.response.model.axis).reshape(3, -1, 1)
        torsion = (moment * axis).sum(0)
        return np.linalg.norm(moment - axis * torsion, axis=0), torsion

    @property
    def arrived(self) -> bool:
        """Whether the response comes as far as the arrival."""
        return bool(self.time[-1] >= self.response.motion.arrival - 1e-9)


def alike(lines: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Join lines that lie on one another under one name."""
    groups: list[tuple[list[str], np.ndarray]] = []
    for name, values in lines.items():
        group = next(
            (names for names, others in groups if np.allclose(values, others, rtol=1e-6, atol=1e-6, equal_nan=True)),
            None,
        )
        if group is None:
            groups.append(([name], values))
        else:
            group.append(name)
    return {", ".join(names): values for names, values in groups}
