"""Content of an arm's picture: hinges, solids, belts, modes."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm
from ident.arm.parts import Body
from ident.arm.plausibility import Oddity, behaviour_oddities, oddities
from ident.arm.sizes import reach_of
from ident.description.file import ArmFile
from ident.errors import ModelError
from ident.identify.modal_analysis import ModalAnalysis, modal_analysis

# -------- Arm view
# Joints, bodies, points, drives and belts in place, first modes, plausibility checks.

CORNERS = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij")).reshape(3, 8)
"""Corners of a cube about the origin."""
SHOWN_MODES = 4
"""Number of first modes in the picture."""


@dataclass(frozen=True)
class Hinge:
    """A bushing, with the pin on it if it is driven.

    Attributes:
        name: of the joint.
        centre: (3,) [m] of the bushing.
        axis: (3,) direction of the pin.
        frame: (3, 3) axes of the following link, columns.
        driven: whether it has a pin.
    """

    name: str
    centre: Float[np.ndarray, "3"]
    axis: Float[np.ndarray, "3"]
    frame: Float[np.ndarray, "3 3"]
    driven: bool


@dataclass(frozen=True)
class Solid:
    """A body in place.

    Attributes:
        name: of the body.
        kind: `shaft`, `link` or `payload`.
        mass: [kg]
        centre: (3,) [m] mass centre.
        corners: (3, 8) [m] of its shape's box, or of the box of the same inertia.
        shaped: whether its shape is known.
    """

    name: str
    kind: str
    mass: float
    centre: Float[np.ndarray, "3"]
    corners: Float[np.ndarray, "3 8"]
    shaped: bool


@dataclass(frozen=True)
class Run:
    """A belt in place.

    Attributes:
        name: of the belt.
        ends: (3, 2) [m] centres of its pulleys.
        radii: (2,) [m]
    """

    name: str
    ends: Float[np.ndarray, "3 2"]
    radii: Float[np.ndarray, "2"]


@dataclass(frozen=True)
class ArmView:
    """An arm in place for drawing; all positions in the base frame.

    Attributes:
        arm_file: the arm, and its source.
        posture: (driven,) [rad]
        hinges: from the base outwards.
        solids: shafts, links and payloads.
        points: (3,) [m] named points, by name.
        drives: (3,) [m] the bushing of each drive, by its name.
        belts: belts.
        analysis: modes and static deflection; None if there are none.
        failure: why there are none; empty otherwise.
        oddities: implausible numbers.
    """

    arm_file: ArmFile
    posture: tuple[float, ...]
    hinges: tuple[Hinge, ...]
    solids: tuple[Solid, ...]
    points: dict[str, Float[np.ndarray, "3"]]
    drives: dict[str, Float[np.ndarray, "3"]]
    belts: tuple[Run, ...]
    analysis: ModalAnalysis | None
    failure: str
    oddities: tuple[Oddity, ...]

    @property
    def arm(self) -> Arm:
        """The arm itself."""
        return self.arm_file.arm

    @property
    def reach(self) -> float:
        """Length of the stretched arm [m]."""
        return reach_of(self.arm)

    @property
    def mass(self) -> float:
        """Mass [kg] of the arm without payloads."""
        return sum(solid.mass for solid in self.solids if solid.kind != "payload")

    def line(self) -> Float[np.ndarray, "3 K"]:
        """Return the arm as a line [m] through its bushings to the end point."""
        return np.stack([*(hinge.centre for hinge in self.hinges), *list(self.points.values())[-1:]], 1)


def home(arm: Arm) -> tuple[float, ...]:
    """Return the posture [rad] in which an arm is drawn by default: all zero, if possible."""
    if arm.workspace.postures:
        return arm.workspace.postures[0]
    return tuple(float(np.clip(0.0, *joint.limits)) for joint in arm.driven)


def arm_view(arm_file: ArmFile, posture: tuple[float, ...] | None = None) -> ArmView:
    """Return an arm in place at a posture [rad], by default `home`, with its first modes and plausibility checks.

    Raises:
        InputError: a posture of the wrong length.
    """
    arm = arm_file.arm
    posture = home(arm) if posture is None else posture
    found = oddities(arm, arm_file.extents)
    analysis, failure = None, "the arm has no point: add a [[point]] at its end, by whose motion modes are named"
    if arm.points:
        try:
            analysis, failure = modal_analysis(arm, posture, modes=SHOWN_MODES), ""
        except ModelError as error:
            failure = str(error)
    if analysis:
        named = {each.path for each in found}
        energy = np.stack([np.asarray(analysis.modes.bend)[:, 0], np.asarray(analysis.modes.tors)[:, 0]])
        sag = float(np.linalg.norm(analysis.deflection[arm.points[-1].name]))
        behaviour = np.asarray(analysis.modes.frequency), analysis.damping_ratio, energy, sag
        found += tuple(each for each in behaviour_oddities(arm, *behaviour) if each.path not in named)
    hinges = tuple(_hinges(arm, posture))
    by_name = {hinge.name: hinge for hinge in hinges}
    return ArmView(
        arm_file,
        posture,
        hinges,
        tuple(_solids(arm_file, hinges)),
        {p.name: (at := by_name[p.joint]).centre + at.frame @ np.asarray(p.position) for p in arm.points},
        {drive.name: by_name[drive.joint].centre for drive in arm.drives},
        tuple(_runs(arm, by_name)),
        analysis,
        failure,
        found,
    )


def _hinges(arm: Arm, posture: tuple[float, ...]) -> Iterator[Hinge]:
    angles, frame, centre = iter(posture), np.eye(3), np.zeros(3)
    for joint in arm.joints:
        centre = centre + frame @ np.asarray(joint.offset)
        axis = np.asarray(joint.axis)
        turn = Rotation.from_rotvec(axis * (next(angles) if joint.driven else 0.0)).as_matrix()
        direction, frame = frame @ axis, frame @ turn
        yield Hinge(joint.name, centre, direction, frame, joint.driven)


def _solids(arm_file: ArmFile, hinges: tuple[Hinge, ...]) -> Iterator[Solid]:
    before, frames = np.eye(3), {}
    for joint, hinge in zip(arm_file.arm.joints, hinges, strict=True):
        frames[joint.name] = hinge.centre, hinge.frame
        for body in joint.shaft:
            yield _solid(arm_file, body, "shaft", hinge.centre, before)
        for body in joint.link:
            yield _solid(arm_file, body, "link", hinge.centre, hinge.frame)
        before = hinge.frame
    for payload in arm_file.arm.payloads:
        yield _solid(arm_file, payload.body, "payload", *frames[payload.joint])


def _solid(arm_file: ArmFile, body: Body, kind: str, origin: np.ndarray, frame: np.ndarray) -> Solid:
    com, extent = np.asarray(body.com), arm_file.extents.get(body.name)
    if extent is not None:
        corners = com[:, None] + (extent[1] - extent[0])[:, None] / 2 * CORNERS
    else:
        corners = com[:, None] + _of_inertia(float(body.mass), np.asarray(body.inertia))
    places = origin[:, None] + frame @ np.column_stack([com, corners])
    return Solid(body.name, kind, float(body.mass), places[:, 0], places[:, 1:], extent is not None)


def _of_inertia(mass: float, inertia: np.ndarray) -> np.ndarray:
    """Return the corners (3, 8) [m] about the mass centre of the uniform box of a mass and inertia.

    A box of half edges a has the second moments m a^2/3.
    """
    second, axes = np.linalg.eigh(np.trace(inertia) / 2 * np.eye(3) - inertia)
    half = np.sqrt(3 * np.clip(second, 0.0, None) / mass) if mass else np.zeros(3)
    return axes @ (half[:, None] * CORNERS)


def _runs(arm: Arm, hinges: dict[str, Hinge]) -> Iterator[Run]:
    for belt in arm.belts:
        one, other = hinges[belt.driver], hinges[belt.driven]
        lift = (float(belt.height) + (other.centre - one.centre) @ other.axis) * one.axis
        ends = np.stack([one.centre + lift, other.centre + float(belt.height) * other.axis], 1)
        yield Run(belt.name, ends, np.array([float(belt.driver_radius), float(belt.driven_radius)]))


# -------- Example
# A campaign as it could have been measured on an arm, simulated from stated stiffnesses: a starting example.

EXAMPLE_POSTURES, EXAMPLE_MODES = 6, 4
"""Postures of the campaign, and frequencies in each."""
SIGMA_DIAL, SIGMA_READ = 0.001, 0.01
"""Standard deviation of a dial gauge: in mm, or as a fraction of its reading, whichever is larger."""
