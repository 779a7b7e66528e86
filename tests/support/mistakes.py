"""Mistakes that people make in an arm file, one number at a time, and sound arms near a sound one."""

from collections.abc import Iterator

import numpy as np

from ident.arm.arm import Arm
from ident.arm.plausibility import oddities

VECTORS = ("offset", "com", "position")
STIFFNESS = ("k_bend", "k_tors")
KINDS = {
    "a length in mm, given as m": (VECTORS, 1000.0),
    "a length in m, given as mm": (VECTORS, 0.001),
    "a mass in g, given as kg": (("mass",), 1000.0),
    "a mass in kg, given as g": (("mass",), 0.001),
    "a stiffness 1000 times too high": (STIFFNESS, 1000.0),
    "a stiffness 1000 times too low": (STIFFNESS, 0.001),
    "a stiffness in N m/rad, given as N m/deg": (STIFFNESS, 57.3),
    "a stiffness in N m/deg, given as N m/rad": (STIFFNESS, 1 / 57.3),
    "a mass centre on the wrong side": (("com",), -1.0),
}
"""Fields, and the factor by which one of them is wrong."""
LEAST = 0.02
"""Length [m] below which a wrong one changes nothing that matters."""
SCATTER = {"k_bend": 0.7, "k_tors": 0.7, "mass": 0.3}
"""Standard deviation of the logarithm of numbers of other sound arms; lengths stay, and so do shapes."""


def mistaken(arm: Arm, fields: tuple[str, ...], factor: float) -> Iterator[tuple[str, Arm]]:
    """Yield the arm with one number, or all components of one vector, wrong by a factor."""
    for joint in arm.joints:
        parts = [joint, *joint.shaft, *joint.link, *(point for point in arm.points if point.joint == joint.name)]
        for part in parts:
            for field in fields:
                if hasattr(part, field) and (values := _components(arm, f"{part.name}.{field}")):
                    yield f"{part.name}.{field}", arm.replace({path: factor * x for path, x in values.items()})


def _components(arm: Arm, name: str) -> dict[str, float]:
    """Return the numbers of a field by path; none of a vector that is about zero."""
    values = {path: float(arm.get(path)) for path in arm.paths() if path == name or path.startswith(f"{name}.")}
    vector = len(values) > 1
    return values if not vector or np.linalg.norm(list(values.values())) > LEAST else {}


def found(arm: Arm, extents, fields: tuple[str, ...], factor: float) -> tuple[int, int, int]:
    """Return how many mistakes there were, how many were seen, and how many were named by their number."""
    every = [
        (path, {odd.path for odd in oddities(wrong, _moved(extents, arm, wrong))})
        for path, wrong in mistaken(arm, fields, factor)
    ]
    return len(every), sum(bool(odd) for _, odd in every), sum(path in odd for path, odd in every)


def _moved(extents, arm: Arm, wrong: Arm) -> dict[str, np.ndarray]:
    """Return where shapes are, which go with their mass centres."""
    return {
        name: box + np.array([float(wrong.get(f"{name}.com.{x}")) - float(arm.get(f"{name}.com.{x}")) for x in "xyz"])
        for name, box in extents.items()
    }


def sound(arm: Arm, rng: np.random.Generator) -> Arm:
    """Return another sound arm: stiffnesses and masses scattered by `SCATTER`, inertias with the masses."""
    factors = {
        path: np.exp(SCATTER[path.partition(".")[2]] * rng.standard_normal())
        for path in arm.paths()
        if path.partition(".")[2] in SCATTER
    }
    values = {path: factor * float(arm.get(path)) for path, factor in factors.items()}
    for path in arm.paths():
        name, _, rest = path.partition(".")
        if rest.startswith("inertia"):
            values[path] = factors[f"{name}.mass"] * float(arm.get(path))
    return arm.replace(values)
