"""The page of `ident explore`: template, style and script as one file that loads nothing.

Names come from files of unknown authors. In the page's data every `<` is escaped, the script inserts words only as
text, and a content security policy admits this one script and this one style, by their hashes.
"""

import base64
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from ident.arm.fields import ALPHA, DAMPING, LOSS
from ident.arm.multibody import orders_of
from ident.measure.kinds import DIFFERENCES
from ident.report.templates import template_of
from ident.studies.basis import changes_in_words, values_in_words
from ident.studies.look.exploration import Exploration, added, mass_of
from ident.text import one_line
from ident.units import stiffness_unit

if TYPE_CHECKING:
    from ident.arm.chain import Moments
    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure import Measurement

# -------- Data
# Input of the page, as plain data in SI: a matrix row by row, angles in radians unless stated in degrees.

SOURCES = files("ident.studies.look") / "explorer"
"""The template, the style and the scripts of the page."""
NOT_SHOWN = ("damping_ratio", "shape")
"""Kinds of measurement that the page does not show."""


def page_data(exploration: Exploration) -> dict[str, Any]:
    """Return the data of a page.

    Args:
        exploration: the arm.
    """
    arm, carried = exploration.arm, exploration.carried
    size, unit = stiffness_unit()
    return {
        "name": one_line(arm.name),
        "gravity": _plain(arm.gravity),
        "alpha": float(arm.get(ALPHA)),
        "joints": [_joint(exploration, j) for j in range(len(arm.joints))],
        "points": [
            {"name": one_line(point.name), "joint": exploration.model.carrier[p]}
            | {word: _plain(getattr(exploration.model, word)[:, p]) for word in ("position", "force")}
            for p, point in enumerate(arm.points)
        ],
        "payload": {word: getattr(carried, word) for word in ("kind", "joint", "nominal", "largest", "present")}
        | {"name": one_line(carried.name), "unit": _moments(carried.unit, 0), "inertia": _plain(carried.inertia)},
        "fixed": one_line(str(exploration.fixed)) if exploration.fixed else "",
        "drives": [_drive(exploration, d) for d in range(len(arm.drives))],
        "stroke": _stroke(exploration),
        "readings": [_reading(exploration, m) for m in exploration.measured or () if m.kind not in NOT_SHOWN],
        "unit": {"name": unit, "size": size},
    }


def _joint(exploration: Exploration, j: int) -> dict[str, Any]:
    arm, model = exploration.arm, exploration.model
    joint = arm.joints[j]
    pins = [each.name for each in arm.driven]
    low, high = (math.degrees(x) if math.isfinite(x) else x * 180 for x in joint.limits)
    paths = [f"{joint.name}.k_bend", f"{joint.name}.k_tors"]
    return {
        "name": one_line(joint.name),
        "driven": joint.driven,
        "pin": pins.index(joint.name) if joint.driven else 0,
        "limits_deg": [max(low, -180.0), min(high, 180.0)],
        "axis": _plain(model.axis[:, j]),
        "offset": _plain(model.offset[:, j]),
        "stiffness": [float(arm.get(path)) for path in paths],
        "tau": [float(arm.get(f"{joint.name}.{field}")) for field in DAMPING],
        "loss": [float(arm.get(f"{joint.name}.{field}")) for field in LOSS],
        "paths": paths,
        "bands": [exploration.bands.get(path) for path in paths],
        "shaft": _moments(model.shaft, j),
        "link": _moments(model.link, j),
    }


def _moments(moments: "Moments", j: int) -> dict[str, Any]:
    first, second = _plain(moments.first[:, j]), _plain(moments.second[:, :, j])
    return {"mass": float(moments.mass[j]), "first": first, "second": second}


def _drive(exploration: Exploration, d: int) -> dict[str, Any]:
    arm, drives = exploration.arm, exploration.model.drives
    drive = arm.drives[d]
    j, pin = ([joint.name for joint in joints].index(drive.joint) for joints in (arm.joints, arm.driven))
    across = [_plain(drives.across[:, k, j]) for k in (0, 1)]
    numbers = {word: float(getattr(drives, word)[j]) for word in ("ratio", "imbalance", "height", "phase")}
    words = {"name": one_line(drive.name), "joint": j, "pin": pin, "orders": orders_of(arm)[drive.name]}
    return words | numbers | {"across": across}


def _stroke(exploration: Exploration) -> dict[str, Any] | None:
    stroke, speed = exploration.arm.stroke, exploration.stroke
    if stroke is None or speed is None:
        return None
    return {"direction": _plain(stroke.direction), "alpha": _plain(speed.alpha), "rate": _plain(speed.rate)}


def _reading(exploration: Exploration, m: "Measurement") -> dict[str, Any]:
    words = {"load": str(m.load), "point": m.point or "", "joint": m.joint or "", "mode": m.mode or ""}
    return {name: one_line(text) for name, text in words.items()} | {
        "kind": m.kind,
        "posture_deg": [math.degrees(angle) for angle in m.posture],
        "mass": mass_of(m.load, exploration.fixed, exploration.carried),
        "loads": _loads(exploration, m),
        "value": m.value,
        "sigma": m.sigma,
        "direction": list(m.direction or (0.0, 0.0, -1.0)),
    }


def _loads(exploration: Exploration, m: "Measurement") -> list[dict[str, Any]] | None:
    """Return the addition of each load case of a reading, the reference last; None if the page can't apply it."""
    cases = [m.load, *([m.reference_load] if m.kind in DIFFERENCES else [])]
    found = [added(case, exploration.fixed, exploration.carried) for case in cases]
    if any(each is None for each in found):
        return None
    named = zip(map(str, cases), found, strict=True)
    return [{"words": one_line(words), **each._asdict()} for words, each in named if each]


def _plain(values: Any) -> list[float]:
    numbers: list[float] = np.asarray(values, float).ravel().tolist()
    return numbers


# -------- Page

SCRIPTS = ("mechanics.js", "response.js", "readings.js", "drawing.js", "state.js", "sliders.js", "page.js", "views.js")
"""Parts of the script, in this order."""


@dataclass(frozen=True)
class Start:
    """Initial state of a page, and the options of its commands.

    Attributes:
        posture: (driven,) [deg]
        speed: [%] of full speed.
        soft_base: [m] height of a compliant base, or None.
        changed: numbers that were set, by path [SI].
    """

    posture: tuple[float, ...]
    speed: float = 10.0
    soft_base: float | None = None
    changed: Mapping[str, float] = field(default_factory=dict)


def explore_page(
    exploration: Exploration,
    arm_file: "ArmFile",
    start: Start,
    *,
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
) -> str:
    """Return the page as HTML; the same arm gives the same text.

    Args:
        exploration: the input of the page.
        arm_file: source of the arm.
        start: initial state.
        fit: fitted values of the arm.
        posterior: source of the marks.
    """
    script, style = _script(), _source("explore.css")
    sources = {"fit": fit, "posterior": posterior}
    data = page_data(exploration) | {
        "start": {"posture_deg": list(start.posture), "speed": start.speed},
        "command": list(_arguments(arm_file, start, sources)),
        "set": dict(start.changed),
    }
    # data as JSON in which nothing ends a script or starts a comment
    text = template_of("ident.studies.look", "explorer/page.html.jinja").render(
        title=exploration.arm.name,
        remarks=[line.strip() for line in _remarks(exploration, start, fit, posterior)],
        version=version("ident-arm"),
        files=_files({"arm": arm_file, **sources, "campaign": exploration.measured}),
        data=Markup(json.dumps(data, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")),
        script=Markup(script),
        style=Markup(style),
        script_hash=Markup(_hash(script)),
        style_hash=Markup(_hash(style)),
    )
    return f"{text}\n"


def _remarks(exploration: Exploration, start: Start, fit: "Values | None", posterior: "Values | None") -> Iterator[str]:
    yield "Drag, and see what the arm does."
    if exploration.arm.drives and not exploration.stroke:
        yield "The arm file has no [stroke]: how fast the pulleys turn is not known, so they are left out."
    if exploration.fixed:
        yield f"always on it: {exploration.fixed}"
    yield from values_in_words(fit, posterior)
    yield from changes_in_words(start.changed)


def _arguments(arm_file: "ArmFile", start: Start, sources: Mapping[str, "Values | None"]) -> Iterator[str]:
    """Yield the common first arguments of all commands for this arm."""
    yield arm_file.path or "arm.toml"
    for name, values in sources.items():
        if values is not None and values.path:
            yield f"--{name}={values.path}"
    if start.soft_base is not None:
        yield f"--soft-base={start.soft_base!r}"


def _files(sources: Mapping[str, Any]) -> str:
    known = {what: source for what, source in sources.items() if source is not None and source.path}
    return "; ".join(
        f"{what}: {source.path}" + (f", SHA-256 {source.sha256[:12]}…" if source.sha256 else "")
        for what, source in known.items()
    )


def _script() -> str:
    return "\n".join(['"use strict";', *map(_source, SCRIPTS)])


def _source(name: str) -> str:
    return (SOURCES / name).read_text("utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode("utf-8")).digest()).decode("ascii")
