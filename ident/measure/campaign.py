"""Measurements in SI units, and the campaign that holds them."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

from ident.errors import Problem, refusal, refuse
from ident.measure.columns import Word
from ident.measure.covariance import Correlated, Covariance, correlated
from ident.measure.frames import NO_SETUPS, Setups
from ident.measure.kinds import (
    DEFINITIONS,
    DIFFERENCES,
    DRIVE_STATES,
    KINDS,
    POSITIONS,
    RAMPS,
    ROLES,
    ROTATIONS,
    SHAPES,
    TWISTS,
)
from ident.measure.load import AXES, OWN_WEIGHT, Load, Vector, unit_vector
from ident.measure.table import Findings
from ident.text import NAME, one_line, quoted, table_lines
from ident.units import QUANTITIES, asked_postures, si_factor

# -------- Cells
# Problems of a measurement: fields that its kind can't have or lacks, impossible numbers.

SHARPEST = 1e-6
"""Least relative standard deviation: no arm is that constant, and below it searches take minutes."""

ROLE_FIELDS = tuple(dict.fromkeys(name for fields in ROLES.values() for name in fields))
"""Fields that only some kinds have."""
_RANGES = {"frequency": (0.0, math.inf), "damping_ratio": (0.0, 1.0)}


def role_problems(kind: str, given: Mapping[str, str]) -> Iterator[Problem]:
    """Find the fields that a kind can't have or lacks.

    Args:
        kind: a name in `KINDS`.
        given: text of the filled fields, by field name.

    Yields:
        The problems, with the column and no row.
    """
    for name in ROLE_FIELDS:
        if name in given and name not in ROLES[kind]:
            expected = f"nothing, since a {kind} has no {name}"
            yield Problem("", quoted(given[name]), expected, "empty the cell or correct the kind", name)
    needed, turns = dict[str, tuple[str, str]](), kind in ROTATIONS
    if "point" in ROLES[kind]:
        needed["point"] = f"the point whose {'body turned' if turns else 'motion was read'}", "name a point of the arm"
    if kind in TWISTS:
        needed["joint"] = "the joint whose twist was read", "name a driven joint of the arm"
    for name in [name for name in ROLES[kind] if name not in ("of", "point")] if kind in SHAPES else ():
        needed[name] = f"the {name.replace('_', ' ')} of a shape", "fill the cell"
    if kind in (*ROTATIONS, *POSITIONS):
        axis = "the axis that the rotation is about, right-handed" if turns else "the axis that it is along"
        needed["direction"] = axis, "give one of x, -z, ... or three numbers"
    yield from (Problem("", "nothing", *words, name) for name, words in needed.items() if name not in given)


def load_problems(kind: str, load: Load, reference_load: Load) -> Iterator[Problem]:
    """Find a difference whose two loads are the same."""
    if kind in DIFFERENCES and load == reference_load:
        got = f"{quoted(str(reference_load))}, the load itself"
        remedy = "give the two loads of the difference"
        yield Problem("", got, "a reference load that differs from the load", remedy, "reference_load")


WORDS = {
    "of": Word(DEFINITIONS, "correct it, or leave it empty for undamped", "write {}"),
    "drives": Word(DRIVE_STATES, "correct it, or leave the row out if the motors turned freely", "write {}"),
    "ramp": Word(RAMPS, "correct it, or leave the cell empty", "write {}"),
}
"""Fields with a choice of words."""


def value_problems(kind: str, value: float, sigma: float) -> Iterator[Problem]:
    """Find impossible values and standard deviations [SI]."""
    unit = QUANTITIES[KINDS[kind]].si.removesuffix("1")
    lowest, highest = _RANGES.get(kind, (-math.inf, math.inf))
    if not lowest < value < highest:
        limits = f"between {lowest:g} and {highest:g}" if highest < math.inf else f"above {lowest:g}"
        expected = f"a finite {kind}" + (f" {limits}" if math.isfinite(lowest) else "")
        yield Problem("", f"{value:g} {unit}".strip(), expected, "correct the value or its unit", "value")
    sharp = 0 < sigma < SHARPEST * abs(value) < math.inf
    if sharp or not 0 < sigma < math.inf:
        least = f"a standard deviation of {SHARPEST:g} of the value, or more"
        expected = least if sharp else "a finite standard deviation above 0"
        yield Problem("", f"{sigma:g} {unit}".strip(), expected, "state how far the value may be off", "sigma")


# -------- Campaign

ROUNDING = 12**-0.5
"""Standard deviation of rounding to steps of one: uniform within half a step (JCGM 100:2008, F.2.2.1)."""

SHOWN, WIDEST = 12, 24
"""Rows of a printed campaign, and characters of a cell."""
GRAVITY_DIRECTION = AXES["-z"]
"""Default direction of a deflection."""


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One measured number; measurements compare by content, whatever file and unit they come from.

    Attributes:
        kind: `frequency` (natural frequency [Hz], see `of`), `deflection` [m], `deflection_difference` (under
            `load` minus under `reference_load` [m]), `position` [m], `rotation` [rad], `rotation_difference` [rad],
            `twist` [rad], `twist_difference` [rad], `damping_ratio` [-] or `shape` (how a mode moves `point` along
            `direction`, over how it moves `reference_point` along `reference_direction` [-], so that scale and sign do
            not matter).
        posture: (joints,) [rad] joint angles of the arm.
        value: () [Hz, m, rad or -] the measured number.
        sigma: () [as value] its standard deviation.
        mode: mode label such as `vertical bending 1`, in lower case; None to match modes in ascending order.
        of: definition of a damped mode's frequency, one of `DEFINITIONS`; None for undamped.
        point: point of the arm where a deflection was read; of a rotation, the point whose body turned.
        direction: (3,) [-] unit vector in the base frame, along a deflection (default -z) or about which a rotation
            counts, right-handed.
        reference_point: reference point of a mode shape.
        reference_direction: (3,) [-] unit vector in the base frame, likewise.
        joint: joint of a twist.
        setup: measurement setup, in whose frame the direction is given; empty for the base frame.
        ramp: one of `RAMPS`, branch of a load ramp on which it was read; empty for none.
        resolution: () [as value] step of the instrument's display, an error that repeated readings share; 0 for none.
        repeat: distinguishes repeated readings, such as a number.
        group: name of the rows with correlated errors; empty for none. See `Campaign.covariance`.
        member: its place in that group, from 1; 0 for none.
        load: the load case.
        reference_load: the load case subtracted in a difference.
        drives: state of the motors, one of `DRIVE_STATES`; `brake` by default.
        unit: unit in the file, such as `mm`.
        note: free text.
        where: `file:row` of its line; empty for values made in code.
    """

    kind: str
    posture: tuple[float, ...]
    value: float
    sigma: float
    mode: str | None = None
    of: str | None = None
    point: str | None = None
    direction: Vector | None = None
    reference_point: str | None = None
    reference_direction: Vector | None = None
    joint: str | None = None
    setup: str = ""
    ramp: str = ""
    resolution: float = 0.0
    repeat: str = ""
    group: str = ""
    member: int = 0
    load: Load = OWN_WEIGHT
    reference_load: Load = OWN_WEIGHT
    drives: str = DRIVE_STATES[0]
    unit: str = field(default="", compare=False)
    note: str = ""
    where: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        if self.setup and not re.fullmatch(NAME, self.setup):
            got, expected = quoted(self.setup), "a name such as tracker or tracker-2"
            raise refusal(self.where, got, expected, "use letters, digits, _ and -", "setup")
        if self.kind not in KINDS:
            raise refusal(self.where, quoted(self.kind), f"one of {', '.join(KINDS)}", "correct the kind", "kind")
        for name, value in _normalised(self).items():
            object.__setattr__(self, name, value)
        given = {name: str(getattr(self, name)) for name in ROLE_FIELDS if getattr(self, name)}
        problems = Findings(role_problems(self.kind, given))
        problems += [*load_problems(self.kind, self.load, self.reference_load), *reference_problems(self)]
        for name, rule in WORDS.items():
            problems.attempt("", name, rule, getattr(self, name) or rule.words[0])
        problems += value_problems(self.kind, self.value, self.sigma)
        if not 0 <= self.resolution < math.inf:
            remedy = "give the step of the display in the value's unit, or leave the cell empty"
            problems.append(Problem("", f"{self.resolution:g}", "a resolution above 0", remedy, "resolution"))
        if not self.posture or not all(map(math.isfinite, self.posture)):
            got = quoted(" ".join(map(str, self.posture)))
            problems.append(Problem("", got, "one finite angle for each joint", "correct the posture", "posture"))
        refuse(replace(problem, where=self.where) for problem in problems)

    @property
    def spread(self) -> float:
        """() [as value] standard deviation of this reading alone, its rounding included."""
        return math.hypot(self.sigma, self.resolution * ROUNDING) if self.resolution else self.sigma


@dataclass(frozen=True)
class Campaign:
    """The measurements on one arm and their source; campaigns with equal measurements are equal.

    Attributes:
        name: name of the campaign: the file's name without its ending.
        path: the file; empty for a campaign made in code.
        sha256: hash of the file's bytes.
        measurements: in the file's order, all with the same number of joints.
        covariance: error correlations within the groups; None where no row is in a group.
        setups: the frames of the setups that rows name.
    """

    name: str = field(default="", compare=False)
    path: str = field(default="", compare=False)
    sha256: str = field(default="", compare=False)
    measurements: tuple[Measurement, ...] = ()
    covariance: Covariance | None = None
    setups: Setups = NO_SETUPS

    def __post_init__(self) -> None:
        object.__setattr__(self, "measurements", tuple(self.measurements))
        expected, remedy = f"{self.joints}, as in the first measurement", "give every joint's angle"
        refuse(
            Problem(m.where, f"{len(m.posture)} joint angles", expected, remedy, "posture")
            for m in self.measurements
            if len(m.posture) != self.joints
        )
        known = self.covariance or Covariance(())
        expected, remedy = "a correlation of its errors", "give the campaign's covariance"
        refuse(
            Problem(m.where, f"the group {quoted(m.group)}", expected, remedy, "group")
            for m in self.measurements
            if m.group and not known.has(m.group, m.member)
        )

    def __str__(self) -> str:
        """Return a short table: the first rows, each with quantity, place, value and sigma."""
        places = f"{len(self.postures)} posture{'s' * (len(self.postures) != 1)}"
        lines = [f"{one_line(self.name or 'campaign')}: {len(self)} measurements at {places}"]
        cells = [_cells(m, i) for i, m in enumerate(self.measurements[:SHOWN], 1)]
        rows = [("row", "kind", "place", "posture [deg]", "load", "value", "sigma", "unit"), *cells]
        lines += table_lines(rows) if cells else []
        if len(self) > SHOWN:
            lines.append(f"and {len(self) - SHOWN} more")
        return "\n".join(lines)

    def __len__(self) -> int:
        return len(self.measurements)

    def __iter__(self) -> Iterator[Measurement]:
        return iter(self.measurements)

    @property
    def joints(self) -> int:
        """Number of joint angles in a posture; 0 for an empty campaign."""
        return len(self.measurements[0].posture) if self.measurements else 0

    @property
    def postures(self) -> tuple[tuple[float, ...], ...]:
        """The different postures [rad], in order of first appearance."""
        return tuple(dict.fromkeys(m.posture for m in self.measurements))

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks to check: postures in degrees that look like radians."""
        return tuple(f"{one_line(self.path or self.name)}: {note}" for note in asked_postures(self.postures))

    @property
    def correlated(self) -> tuple[Correlated, ...]:
        """Places of the rows of each group of several, and the correlation [-] of their errors."""
        return correlated([(m.group, m.member) for m in self.measurements], self.covariance)

    def of_kind(self, *kinds: str) -> "Campaign":
        """Return the campaign with only the measurements of these kinds."""
        return replace(self, measurements=tuple(m for m in self.measurements if m.kind in kinds))

    def without(self, *kinds: str) -> "Campaign":
        """Return the campaign without the measurements of these kinds."""
        return replace(self, measurements=tuple(m for m in self.measurements if m.kind not in kinds))


def _cells(m: Measurement, number: int) -> tuple[str, ...]:
    """Return the cells of a measurement for a short table, in the unit of its file."""
    size = si_factor(m.unit, KINDS[m.kind])
    posture = ", ".join(f"{math.degrees(angle) + 0.0:.4g}" for angle in m.posture)
    texts = (m.kind, m.mode or m.point or m.joint or "", posture, str(m.load))
    cells = [text if len(text := one_line(each)) <= WIDEST else f"{text[: WIDEST - 1]}…" for each in texts]
    return (m.where.rpartition(":")[2] or str(number), *cells, f"{m.value / size:.4g}", f"{m.sigma / size:.2g}", m.unit)


def reference_problems(m: Measurement) -> Iterator[Problem]:
    """Find a shape that is its own reference, or that has the wrong frequency definition."""
    if m.kind in SHAPES and m.of not in (None, "pole"):
        remedy = "leave the cell empty, or write pole"
        yield Problem("", quoted(m.of or ""), "undamped, or pole: a shape of the damped mode", remedy, "of")
    if m.kind in SHAPES and (m.point, m.direction) == (m.reference_point, m.reference_direction):
        remedy = "leave the row out: it would be one, whatever the arm"
        yield Problem("", "the reference itself", "another point or direction", remedy, "reference_point")


def _normalised(m: Measurement) -> dict[str, object]:
    downwards = KINDS[m.kind] == "length" and m.kind not in POSITIONS
    direction = m.direction or (GRAVITY_DIRECTION if downwards else None)
    return {
        **{name: float(getattr(m, name)) for name in ("value", "sigma", "resolution")},
        **{name: " ".join(getattr(m, name).split()) for name in ("repeat", "group")},
        **{name: (getattr(m, name) or "").strip() or None for name in ("point", "joint", "reference_point")},
        "posture": tuple(float(angle) for angle in m.posture),
        "mode": " ".join((m.mode or "").lower().split()) or None,
        "of": None if (of := " ".join((m.of or "").lower().split())) == "undamped" else of or None,
        "drives": m.drives.strip().lower() or DRIVE_STATES[0],
        "setup": m.setup.strip(),
        "ramp": m.ramp.strip().lower(),
        "direction": unit_vector(direction) if direction else None,
        "reference_direction": unit_vector(m.reference_direction) if m.reference_direction else None,
        "unit": m.unit.strip() or QUANTITIES[KINDS[m.kind]].si,
        "note": "\n".join(m.note.splitlines()).strip(),
    }
