"""A simulated motion, as report, files and figures share it."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.measure import Trace
from ident.studies.basis import alike
from ident.studies.scenario import Basis, OverPhases, over_phases
from ident.vibrate.compare import Comparison
from ident.vibrate.fast import LeavesTangentError
from ident.vibrate.response import Response, belt_tension, slack
from ident.vibrate.simulate import superposition
from ident.vibrate.study import Draws, Sizes, measures

if TYPE_CHECKING:
    from ident.vibrate.clock import Clock


@dataclass(frozen=True)
class Simulation:
    """A simulated motion, its inputs and results.

    Attributes:
        basis: arm and motion, and the sources of their numbers.
        response: by the exact method, unless the fast one alone was chosen.
        other: by the fast method, if both were chosen.
        settled: [m] below which the end has settled once it stays there.
        at: [s] start of the late peak's window; None for none.
        limit: [m] of the peak; None for none.
        draws: the vibration by draws of the basis' posterior.
        trace: a measured trace.
        comparisons: of the simulation with the trace, by direction.
        phases: the vibration over the unknown phases; None if all are known.
        clock: of the trace, if it was found.
    """

    basis: Basis
    response: Response
    other: Response | None
    settled: float
    at: float | None = None
    limit: float | None = None
    draws: Draws | None = None
    trace: Trace | None = None
    comparisons: Mapping[str, Comparison] | None = None
    phases: OverPhases | None = None
    clock: "Clock | None" = None

    @property
    def difference(self) -> Float[np.ndarray, "3"]:
        """Largest difference of the two methods in each direction, as a share of the peak; NaN with one method."""
        if self.other is None:
            return np.full(3, np.nan)
        ours, theirs = (np.asarray(response.vibration) for response in (self.response, self.other))
        largest = np.maximum(np.abs(ours).max(1), np.finfo(float).tiny)
        return np.abs(ours - theirs).max(1) / largest

    @property
    def arm(self) -> Arm:
        """The simulated arm."""
        return self.basis.arm

    @property
    def point(self) -> str:
        """Name of the end point."""
        return self.basis.point

    @cached_property
    def time(self) -> Float[np.ndarray, "T"]:
        """Times [s]."""
        return np.asarray(self.response.time)

    @cached_property
    def vibration(self) -> Float[np.ndarray, "3 T"]:
        """Displacement of the end point from its quasi-static position [m]."""
        return np.asarray(self.response.vibration)

    @cached_property
    def posture(self) -> Float[np.ndarray, "driven T"]:
        """Commanded joint angles [rad]."""
        return np.asarray(self.response.posture)

    @cached_property
    def path(self) -> Float[np.ndarray, "3 T"]:
        """Position of the end point with rigid joints, in the base frame [m]."""
        return np.asarray(self.response.path)

    @cached_property
    def sizes(self) -> Sizes:
        """Sizes of the vibration."""
        return measures(self.response, self.settled, self.at)

    @cached_property
    def phi(self) -> Float[np.ndarray, "3 N T"]:
        """Rotations of the bushings along their shafts' axes [rad]."""
        return np.asarray(self.response.phi)

    @cached_property
    def tension(self) -> Float[np.ndarray, "2 B T"]:
        """Tension of upper and lower span of each belt [N]."""
        return np.asarray(belt_tension(self.response))

    @cached_property
    def slack(self) -> tuple[tuple[int, str, float, float], ...]:
        """Belt, span (`upper` or `lower`) and the times [s] between which it is slack, the earliest first."""
        spans = slack(self.time, self.tension)
        return tuple(sorted(spans, key=lambda span: span[2]))

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


def simulated_over_phases(basis: Basis, elastic_belts: bool, rate: float, step: float | None) -> OverPhases | None:
    """Return the vibration over the unknown phases, by the fast method; None without.

    None too if the motion leaves the tangents of curved springs: superposition needs linearity.
    """
    unknown = basis.unknown
    if not unknown.phases:
        return None
    with suppress(LeavesTangentError):
        whole = superposition(
            basis.arm,
            basis.motion,
            unknown.phases,
            loads=basis.loads,
            elastic_belts=elastic_belts,
            rate=rate,
            step=step,
        )
        return over_phases(whole, unknown)
    return None


def joined(lines: Mapping[str, np.ndarray], comma: str = ", ", atol: float = 1e-6) -> dict[str, np.ndarray]:
    """Join coinciding lines under one name."""
    groups = alike(lines, lambda one, other: np.allclose(lines[one], lines[other], 1e-6, atol, equal_nan=True))
    return {comma.join(names): lines[names[0]] for names in groups}
