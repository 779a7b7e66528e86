"""What a picture of an arm shows, the names of its numbers, and an example campaign that could be measured on it."""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from ident.arm.arm import Arm, stiffness_paths
from ident.arm.fields import field_of
from ident.arm.parts import Body
from ident.arm.plausibility import Oddity, behaviour_oddities, oddities, reach_of
from ident.description.file import ArmFile
from ident.errors import ModelError
from ident.identify.modal_analysis import ModalAnalysis, modal_analysis
from ident.measure import Campaign, Load, Measurement
from ident.units import to_si

# -------- Arm view
# What a picture of an arm shows: joints, bodies, points, drives and belts in place, first modes, what looks odd.

CORNERS = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3, indexing="ij")).reshape(3, 8)
"""Corners of a cube about the origin."""
SHOWN_MODES = 4
"""First modes of an arm that is drawn."""


@dataclass(frozen=True)
class Hinge:
    """A bushing, with the pin on it if it is driven.

    Attributes:
        name: of the joint.
        centre: (3,) [m] of the bushing.
        axis: (3,) direction of the pin.
        frame: (3, 3) axes of the link behind it, columns.
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
    """An arm as it is drawn; all places in the base frame.

    Attributes:
        arm_file: the arm, and where it comes from.
        posture: (driven,) [rad]
        hinges: from the base outwards.
        solids: shafts, links and payloads.
        points: (3,) [m] named points, by name.
        drives: (3,) [m] the bushing on which each drive sits, by its name.
        belts: belts.
        analysis: modes and static deflection; None where there are none.
        failure: why there are none; empty where there are.
        oddities: what looks odd.
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
    """Return the posture [rad] in which an arm is drawn unless another is asked for: all zero, if it can be."""
    if arm.workspace.postures:
        return arm.workspace.postures[0]
    return tuple(float(np.clip(0.0, *joint.limits)) for joint in arm.driven)


def arm_view(arm_file: ArmFile, posture: tuple[float, ...] | None = None) -> ArmView:
    """Return an arm as it is drawn at a posture [rad], by default `home`, with its first modes and what looks odd.

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


# -------- Arm names
# Every name of an arm that a command, an option or a campaign takes.

MODES = 6
"""Modes that are named."""


@dataclass(frozen=True)
class Number:
    """A number of an arm.

    Attributes:
        path: its name, as in `link2.com.x`.
        value: in its unit, the SI one.
        unit: the unit.
        origin: where it comes from; empty where that is not known.
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
        numbers: all that have a path.
        posture: (driven,) [rad] at which modes are named.
        modes: name and natural frequency [Hz] of each, ascending; none where the arm has no point or no equilibrium.
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


# -------- Example
# A campaign as it could have been measured on an arm, simulated from stated stiffnesses: an example to begin with.

EXAMPLE_POSTURES, EXAMPLE_MODES = 6, 4
"""Postures of the campaign, and frequencies in each."""
FACTORS = (1.25, 0.8, 1.15, 0.85, 1.1, 0.9)
"""What the stated stiffnesses are, over those of the arm's file: bending of each joint in turn, then torsion."""
SIGMA = 0.005
"""Standard deviation of a frequency as a fraction of its value."""
SIGMA_DIAL, SIGMA_READ = 0.001, 0.01
"""Standard deviation of a dial gauge: in mm, or as a fraction of what it reads, whichever is more."""
SHARE = 0.1
"""Test mass as a share of the arm's mass, in whole kilograms."""
SEED = 1
WIDEST = math.radians(90)
"""Angle of a pin up to which the arm is measured."""


@dataclass(frozen=True)
class Example:
    """A simulated campaign, and the truth behind it.

    Attributes:
        campaign: what was measured, noise included.
        truth: [N m/rad] the stiffnesses that it was simulated with, by path.
    """

    campaign: Campaign
    truth: Mapping[str, float]

    @property
    def comments(self) -> tuple[str, ...]:
        """What the file says of itself."""
        stated = [f"{path} = {value:g}" for path, value in self.truth.items()]
        return (
            "EXAMPLE NUMBERS, simulated by ident and not measured on any robot. Replace the rows by your own.",
            "",
            "One row a number. q1, q2, ...: angles of the pins. A frequency has the name of its mode, or none where",
            "one can't tell; a deflection has its point, its direction and what hangs on the arm. Then value, unit and",
            "standard deviation. What to measure is said by `ident plan campaign.csv`, what it tells by `ident check`.",
            "",
            "Simulated with these stiffnesses [N m/rad], which are not those of arm.toml; a fit should find them:",
            *(f"    {', '.join(stated[i : i + 3])}" for i in range(0, len(stated), 3)),
            f"Noise: normal, {100 * SIGMA:g} % of a frequency; {SIGMA_DIAL:g} mm of a deflection, "
            f"{100 * SIGMA_READ:g} % of one above {SIGMA_DIAL / SIGMA_READ:g} mm; numpy default_rng({SEED}).",
        )


def example(arm: Arm) -> Example:
    """Return a campaign on an arm whose stiffnesses differ from those of its file by `FACTORS`.

    In each of some postures: the lowest natural frequencies, named as two accelerometers would tell them where the name
    is clear, and by how much a test mass lowers the end point.
    """
    paths = stiffness_paths(arm)
    factors = [FACTORS[i % len(FACTORS)] for i in range(len(paths))]
    truth = {path: float(f"{factor * float(arm.get(path)):.3g}") for path, factor in zip(paths, factors, strict=True)}
    return Example(Campaign(measurements=tuple(_measured(arm.replace(truth)))), truth)


def _measured(arm: Arm) -> Iterator[Measurement]:
    rng, point = np.random.default_rng(SEED), arm.points[-1].name
    test_mass = max(1, round(SHARE * sum(float(body.mass) for body in arm.bodies)))
    load = Load.parse(f"{test_mass} kg @ {point}")
    for posture in _postures(arm):
        bare, loaded = (modal_analysis(arm, posture, each, EXAMPLE_MODES) for each in (Load(), load))
        for label, f, unclear in zip(bare.labels, bare.modes.frequency.tolist(), bare.ambiguous, strict=True):
            value = round(f * (1 + SIGMA * rng.standard_normal()), 3)
            mode = None if unclear else str(label)
            sigma = round(SIGMA * value, 3)
            yield Measurement(kind="frequency", posture=posture, value=value, sigma=sigma, mode=mode)
        down = 1e3 * float(bare.deflection[point][2] - loaded.deflection[point][2])
        sigma = max(SIGMA_DIAL, SIGMA_READ * down)
        value, sigma = (to_si(round(each, 4), "mm", "length") for each in (down + sigma * rng.standard_normal(), sigma))
        kind = "deflection_difference"
        yield Measurement(kind=kind, posture=posture, value=value, sigma=sigma, point=point, load=load)


def _postures(arm: Arm) -> Iterator[tuple[float, ...]]:
    """Yield `home`, and postures spread evenly between the limits (Halton, 1960), in whole degrees."""
    from scipy.stats import qmc  # long to import, and seldom needed

    yield home(arm)
    bounds = [(max(low, -WIDEST), min(high, WIDEST)) for low, high in (joint.limits for joint in arm.driven)]
    low, high = np.degrees(bounds).T
    for share in qmc.Halton(len(bounds), scramble=False).random(EXAMPLE_POSTURES)[1:]:
        yield tuple(to_si(float(angle), "deg", "angle") for angle in np.round(low + share * (high - low)))
