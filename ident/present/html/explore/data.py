"""What a page knows of an arm, as plain data in SI: a matrix row by row, angles in radians unless said in degrees."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ident.arm.assembly import Moments
from ident.assess.exploration import Carried, Exploration, added, mass_of
from ident.measure import Measurement
from ident.measure.kinds import DIFFERENCES
from ident.text import one_line
from ident.units import stiffness_unit

NOT_SHOWN = ("damping_ratio", "shape")
"""Kinds of measurement that the page does not show beside what it computes."""


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
        "joints": [_joint(exploration, j) for j in range(len(arm.joints))],
        "points": [_point(exploration, p) for p in range(len(arm.points))],
        "payload": _payload(carried),
        "fixed": one_line(str(exploration.fixed)) if exploration.fixed else "",
        "drives": [_drive(exploration, d) for d in range(len(arm.drives))],
        "stroke": _stroke(exploration),
        "readings": _readings(exploration),
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
        "stiffness": [float(joint.k_bend), float(joint.k_tors)],
        "tau": [float(joint.tau_bend), float(joint.tau_tors)],
        "paths": paths,
        "bands": [exploration.bands.get(path) for path in paths],
        "shaft": _moments(model.shaft, j),
        "link": _moments(model.link, j),
    }


def _moments(moments: Moments, j: int) -> dict[str, Any]:
    return {
        "mass": float(moments.mass[j]),
        "first": _plain(moments.first[:, j]),
        "second": _plain(moments.second[:, :, j]),
    }


def _point(exploration: Exploration, p: int) -> dict[str, Any]:
    model, point = exploration.model, exploration.arm.points[p]
    return {
        "name": one_line(point.name),
        "joint": model.carrier[p],
        "position": _plain(model.position[:, p]),
        "force": _plain(model.force[:, p]),
    }


def _payload(carried: Carried) -> dict[str, Any]:
    return {
        "kind": carried.kind,
        "name": one_line(carried.name),
        "joint": carried.joint,
        "unit": _moments(carried.unit, 0),
        "nominal": carried.nominal,
        "inertia": _plain(carried.inertia),
        "largest": carried.largest,
        "present": carried.present,
    }


def _drive(exploration: Exploration, d: int) -> dict[str, Any]:
    arm, drives = exploration.arm, exploration.model.drives
    drive = arm.drives[d]
    j = [joint.name for joint in arm.joints].index(drive.joint)
    pin = [joint.name for joint in arm.driven].index(drive.joint)
    return {
        "name": one_line(drive.name),
        "joint": j,
        "pin": pin,
        "ratio": float(drives.ratio[j]),
        "imbalance": float(drives.imbalance[j]),
        "height": float(drives.height[j]),
        "phase": float(drives.phase[j]),
        "across": [_plain(drives.across[:, k, j]) for k in (0, 1)],
        "orders": [1, 2] if float(drive.error) else [1],
    }


def _stroke(exploration: Exploration) -> dict[str, Any] | None:
    stroke, speed = exploration.arm.stroke, exploration.stroke
    if stroke is None or speed is None:
        return None
    return {"direction": _plain(stroke.direction), "alpha": _plain(speed.alpha), "rate": _plain(speed.rate)}


def _readings(exploration: Exploration) -> list[Mapping[str, Any]]:
    measured, carried = exploration.measured, exploration.carried
    return [
        {
            "kind": m.kind,
            "posture_deg": [math.degrees(angle) for angle in m.posture],
            "load": one_line(str(m.load)),
            "mass": mass_of(m.load, exploration.fixed, carried),
            "loads": _loads(exploration, m),
            "value": m.value,
            "sigma": m.sigma,
            "mode": m.mode or "",
            "point": one_line(m.point or ""),
            "joint": one_line(m.joint or ""),
            "direction": list(m.direction or (0.0, 0.0, -1.0)),
        }
        for m in measured or ()
        if m.kind not in NOT_SHOWN
    ]


def _loads(exploration: Exploration, m: Measurement) -> list[dict[str, Any]] | None:
    """Return what each load case of a reading adds, the reference last; None where the page can't have it."""
    cases = [m.load, *([m.reference_load] if m.kind in DIFFERENCES else [])]
    found = [added(case, exploration.fixed, exploration.carried) for case in cases]
    if any(each is None for each in found):
        return None
    named = zip(map(str, cases), found, strict=True)
    return [{"words": one_line(words), **each._asdict()} for words, each in named if each]


def _plain(values: Any) -> list[float]:
    numbers: list[float] = np.asarray(values, float).ravel().tolist()
    return numbers
