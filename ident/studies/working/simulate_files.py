"""A simulated motion as files: series as CSV and netCDF, with their provenance."""

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.files import replace_file
from ident.measure.table import csv_text, guarded
from ident.report.document import Group, Variable
from ident.report.words import MM
from ident.vibrate.study import DIRECTIONS

if TYPE_CHECKING:
    from ident.studies.working.simulation import Simulation


LESS = "displacement of the end point less the quasi-static deflection and the gears' own error"
SPANS = ("upper", "lower")
DIGITS = "%.10g"


def write_csv(simulation: "Simulation", head: Mapping[str, Any], path: Path) -> None:
    """Write the series as CSV, the format of `read_trace`: vibration in mm, units in the header."""
    columns = dict(csv_columns(simulation))
    notes = [
        f"{head['format']} {head['created']} ident {head['software']['ident']}",
        f"arm: {guarded(simulation.basis.arm_file.path)} sha256 {simulation.basis.arm_file.sha256}",
        f"motion: {guarded(simulation.response.motion.name)}; load: {guarded(str(simulation.basis.load))}",
        f"x, y, z: vibration of {simulation.point}: {LESS}; rotations include that",
    ]
    top = csv_text(list(columns), (), notes)

    def write(file: Any) -> None:
        file.write(top.encode("utf-8"))
        np.savetxt(file, np.column_stack(list(columns.values())), fmt=DIGITS, delimiter=",")

    replace_file(path, write, make_folders=True)


def csv_columns(simulation: "Simulation") -> Iterator[tuple[str, np.ndarray]]:
    """Yield header and values of each column."""
    yield "time [s]", simulation.time
    for direction, values in zip(DIRECTIONS, simulation.vibration, strict=True):
        yield f"{direction} [mm]", MM * values
    for direction, values in zip(DIRECTIONS, np.asarray(simulation.response.displacement), strict=True):
        yield f"displacement.{direction} [mm]", MM * values
    for joint, angle in zip(simulation.arm.driven, np.asarray(simulation.response.posture), strict=True):
        yield f"{joint.name} [deg]", np.degrees(angle)
    for n, joint in enumerate(simulation.arm.joints):
        for axis, values in zip("xyz", simulation.phi[:, n], strict=True):
            yield f"{joint.name}.rotation.{axis} [deg]", np.degrees(values)
    for b, belt in enumerate(simulation.arm.belts):
        for span, values in zip(SPANS, simulation.tension[:, b], strict=True):
            yield f"{belt.name}.{span} [N]", values
    for name, (angle, frequency) in simulation.pulleys.items():
        yield f"{name}.frequency [Hz]", frequency
        yield f"{name}.angle [rad]", angle


def simulate_groups(simulation: "Simulation", head: Mapping[str, Any]) -> dict[str, Group]:
    """Return all series as the root of a netCDF file, with their dimensions, units and origin; SI."""
    series = {
        name: Variable(dims, np.asarray(values, float), {"units": units, "long_name": words})
        for name, dims, values, units, words in _variables(simulation)
    }
    names: dict[str, Sequence[str]] = {
        "direction": DIRECTIONS,
        "axis": "xyz",
        "joint": [joint.name for joint in simulation.arm.joints],
        "driven": [joint.name for joint in simulation.arm.driven],
    }
    if simulation.arm.belts:
        names |= {"span": SPANS, "belt": [belt.name for belt in simulation.arm.belts]}
    if simulation.pulleys:
        names["drive"] = list(simulation.pulleys)
    if simulation.draws:
        names["parameter"] = list(simulation.draws.values)
    coordinates = {name: Variable((name,), list(values)) for name, values in names.items()}
    coordinates["time"] = Variable(("time",), simulation.time, {"units": "s"})
    attributes = {name: json.dumps(part) for name, part in head.items()}
    attributes |= {"motion": simulation.response.motion.name, "method": simulation.response.method}
    return {"/": Group(coordinates | series, attributes | {"arrival": simulation.response.motion.arrival})}


def _variables(simulation: "Simulation") -> Iterator[tuple[str, tuple[str, ...], Any, str, str]]:
    """Yield name, dimensions, values, unit and meaning of each series."""
    response, other = simulation.response, simulation.other
    moved = ("direction", "time")
    yield "vibration", moved, simulation.vibration, "m", LESS
    if other is not None:
        yield "vibration_fast", moved, other.vibration, "m", "the same by the fast method"
    if simulation.phases is not None:
        words = "largest magnitude of the vibration over the phases that are not known"
        yield "vibration_worst_phases", moved, simulation.phases.envelope, "m", words
    yield "displacement", moved, response.displacement, "m", "of the end point from the rigid arm's"
    yield "quasi_static_deflection", moved, response.quasi_static, "m", "of the end point, part of the displacement"
    yield "gear_error", moved, response.gear_error, "m", "of the end point at rest, part of the displacement"
    yield "path", moved, response.path, "m", "where the end point would be with rigid joints"
    yield "posture", ("driven", "time"), response.posture, "rad", "commanded angles"
    by_joint = ("axis", "joint", "time")
    yield "rotation", by_joint, simulation.phi, "rad", "rotation vectors of the bushings, quasi-static part included"
    yield "moment", by_joint, response.moment, "N m", "moments of the bushings, weight included, loss factors not"
    if simulation.arm.belts:
        yield "tension", ("span", "belt", "time"), simulation.tension, "N", "tension of the belts' spans"
    if simulation.pulleys:
        angles, frequencies = zip(*simulation.pulleys.values(), strict=True)
        yield "pulley_angle", ("drive", "time"), np.stack(angles), "rad", "angle of the pulleys"
        yield "pulley_frequency", ("drive", "time"), np.stack(frequencies), "Hz", "turning frequency"
    if simulation.draws:
        drawn = np.moveaxis(simulation.draws.vibration, 2, 0)
        yield "vibration_draws", ("draw", *moved), drawn, "m", "vibration by draws of the posterior"
        values = np.stack(list(simulation.draws.values.values()), 1)
        yield "parameter_draws", ("draw", "parameter"), values, "SI", "the draws of the arm's numbers"
