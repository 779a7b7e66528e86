"""The files of a simulated motion: series as CSV and netCDF, and a summary as JSON, with where they come from."""

import json
from collections.abc import Iterator, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.assess.simulation import Simulation
from ident.files import replace_file
from ident.present.files import basis
from ident.present.files.document import plain
from ident.present.text.units import MM
from ident.text import one_line
from ident.vibrate.response.study import DIRECTIONS, Sizes
from ident.vibrate.signal.compare import Comparison

if TYPE_CHECKING:
    import xarray

FORMAT = "ident-simulate/2"
LESS = "displacement of the end point less the quasi-static deflection"
SPANS = ("upper", "lower")
DIGITS = "%.10g"


def origin(simulation: Simulation, options: Mapping[str, Any]) -> dict[str, Any]:
    """Say what a simulation was made from, with what and how."""
    head = basis.origin(FORMAT, simulation.basis, options)
    head["software"] |= {name: version(name) for name in ("diffrax", "ruckig", "xarray")}
    head["inputs"]["trace"] = basis.source(simulation.trace)
    return head


def simulate_document(simulation: Simulation, options: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a simulation in numbers as plain data, all SI; infinite and undefined ones become null."""
    motion, time = simulation.response.motion, simulation.time
    place = np.argmax(np.abs(simulation.vibration), axis=1)
    document = origin(simulation, options) | {
        **basis.motion_document(simulation.basis),
        "start": np.asarray(motion(motion.breaks[0])[0]),
        "end": np.asarray(motion(motion.breaks[-1])[0]),
        "method": simulation.response.method,
        "interrupted_at": simulation.study.interrupted,
        "vibration": _sizes(simulation.sizes)
        | {"time_of_peak": time[place], "posture_at_peak": np.asarray(simulation.response.posture)[:, place].T},
        "settling_tolerance": simulation.tolerance,
        "late_from": simulation.at,
        "difference_of_methods": simulation.study.difference,
        "draws": _drawn(simulation),
        "trace": _compared(simulation),
        "belts": list(_belts(simulation)),
        "bushings": list(_bushings(simulation)),
        **basis.values_document(simulation.basis),
    }
    return plain(document)


def write_csv(simulation: Simulation, options: Mapping[str, Any], path: Path) -> None:
    """Write the series as CSV, which `read_trace` reads: vibration in mm, units in the header.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    columns = dict(csv_columns(simulation))
    head = origin(simulation, options)
    notes = [
        f"{FORMAT} {head['created']} ident {head['software']['ident']}",
        f"arm: {one_line(simulation.basis.arm_file.path)} sha256 {simulation.basis.arm_file.sha256}",
        f"motion: {one_line(simulation.response.motion.name)}; load: {simulation.basis.load}",
        f"x, y, z: vibration of {simulation.point}: {LESS}; rotations include that",
    ]
    header = ",".join(columns)
    top = "".join(f"# {note}\n" for note in notes) + header + "\n"

    def write(file: Any) -> None:
        file.write(top.encode("utf-8"))
        np.savetxt(file, np.column_stack(list(columns.values())), fmt=DIGITS, delimiter=",")

    replace_file(path, write, make_folders=True)


def csv_columns(simulation: Simulation) -> Iterator[tuple[str, np.ndarray]]:
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


def dataset(simulation: Simulation, options: Mapping[str, Any]) -> "xarray.Dataset":
    """Return all series with their dimensions, units and origin; SI."""
    import xarray

    variables = dict(_variables(simulation))
    coordinates: dict[str, Any] = {
        "time": ("time", simulation.time, {"units": "s"}),
        "direction": list(DIRECTIONS),
        "axis": ("axis", list("xyz"), {"long_name": "axis of the joint's shaft"}),
        "joint": [joint.name for joint in simulation.arm.joints],
        "driven": [joint.name for joint in simulation.arm.driven],
    }
    if simulation.arm.belts:
        coordinates |= {"span": list(SPANS), "belt": [belt.name for belt in simulation.arm.belts]}
    if simulation.pulleys:
        coordinates["drive"] = list(simulation.pulleys)
    if simulation.draws:
        coordinates["parameter"] = list(simulation.draws.values)
    attributes = {name: json.dumps(plain(part)) for name, part in origin(simulation, options).items()}
    attributes |= {"motion": simulation.response.motion.name, "method": simulation.response.method}
    return xarray.Dataset(variables, coordinates, attributes | {"arrival": simulation.response.motion.arrival})


def write_netcdf(simulation: Simulation, options: Mapping[str, Any], path: Path) -> None:
    """Write all series as netCDF, compressed."""
    data = dataset(simulation, options)
    packed = {str(name): {"zlib": True, "complevel": 4} for name, part in data.data_vars.items() if part.dtype == float}
    data.to_netcdf(path, engine="h5netcdf", encoding=packed)


def size_rows(simulation: Simulation) -> list[dict[str, Any]]:
    """Return the sizes of the vibration as rows, one for each direction [m, s]; NaN for what does not apply."""
    sizes, place = simulation.sizes, np.argmax(np.abs(simulation.vibration), axis=1)
    columns = {
        "peak": sizes.peak,
        "time_of_peak": simulation.time[place],
        "rms": sizes.rms,
        "residual": sizes.residual,
        "settling_time": sizes.settling,
        "late_peak": sizes.late,
    }
    if simulation.draws:
        low, high = np.quantile(simulation.draws.sizes.peak, (0.05, 0.95), axis=1)
        columns |= {"peak_q05": low, "peak_q95": high}
    rows = zip(*(np.asarray(column, float).tolist() for column in columns.values()), strict=True)
    return [{"direction": d} | dict(zip(columns, row, strict=True)) for d, row in zip(DIRECTIONS, rows, strict=True)]


def _variables(simulation: Simulation) -> Iterator[tuple[str, tuple[Any, ...]]]:
    response, other = simulation.response, simulation.study.other
    moved = ("direction", "time")
    yield (
        "vibration",
        _variable(moved, simulation.vibration, "m", LESS),
    )
    if other is not None:
        values = np.full_like(simulation.vibration, np.nan)
        values[:, : len(other.time)] = np.asarray(other.vibration)[:, : values.shape[1]]
        yield f"vibration_{other.method}", _variable(moved, values, "m", f"the same by the {other.method} method")
    yield "displacement", _variable(moved, response.displacement, "m", "of the end point from the rigid arm's")
    yield (
        "quasi_static_deflection",
        _variable(moved, response.quasi_static, "m", "of the end point, part of the displacement"),
    )
    yield "path", _variable(moved, response.path, "m", "where the end point would be with rigid joints")
    yield "posture", _variable(("driven", "time"), response.posture, "rad", "commanded angles")
    by_joint = ("axis", "joint", "time")
    yield (
        "rotation",
        _variable(by_joint, simulation.phi, "rad", "rotation vectors of the bushings, quasi-static part included"),
    )
    yield "moment", _variable(by_joint, response.moment, "N m", "moments of the bushings, weight included")
    if simulation.arm.belts:
        yield "tension", _variable(("span", "belt", "time"), simulation.tension, "N", "tension of the belts' spans")
    if simulation.pulleys:
        angles, frequencies = zip(*simulation.pulleys.values(), strict=True)
        yield "pulley_angle", _variable(("drive", "time"), np.stack(angles), "rad", "angle of the pulleys")
        yield "pulley_frequency", _variable(("drive", "time"), np.stack(frequencies), "Hz", "turning frequency")
    if simulation.draws:
        drawn = np.moveaxis(simulation.draws.vibration, 2, 0)
        yield "vibration_draws", _variable(("draw", *moved), drawn, "m", "vibration by draws of the posterior")
        values = np.stack(list(simulation.draws.values.values()), 1)
        yield "parameter_draws", _variable(("draw", "parameter"), values, "SI", "the draws of the arm's numbers")


def _variable(dims: tuple[str, ...], values: Any, units: str, name: str) -> tuple[Any, ...]:
    return dims, np.asarray(values, float), {"units": units, "long_name": name}


def _sizes(sizes: Sizes) -> dict[str, Any]:
    return {
        "direction": list(DIRECTIONS),
        "peak": sizes.peak,
        "rms": sizes.rms,
        "residual": sizes.residual,
        "settling_time": sizes.settling,
        "late_peak": sizes.late,
    }


def _drawn(simulation: Simulation) -> dict[str, Any] | None:
    if simulation.draws is None:
        return None
    sizes = _sizes(simulation.draws.sizes)
    bands = {
        name: np.quantile(part, (0.05, 0.5, 0.95), axis=1, method="nearest").T
        for name, part in sizes.items()
        if name != "direction" and not np.isnan(part).any()
    }
    document = {"count": simulation.draws.vibration.shape[2], "quantiles": [0.05, 0.5, 0.95], **bands}
    if simulation.limit is not None:
        each, any_of = simulation.draws.exceeds(simulation.limit)
        document |= {"limit": simulation.limit, "exceeds": each, "exceeds_in_any": any_of}
    return document


def _compared(simulation: Simulation) -> dict[str, Any] | None:
    if not simulation.comparisons or simulation.trace is None:
        return None
    return {"kind": simulation.trace.kind} | {
        direction: {"band": list(comparison.band), "ratios": _ratios(comparison)} | dict(_both(comparison))
        for direction, comparison in simulation.comparisons.items()
    }


def _both(comparison: Comparison) -> Iterator[tuple[str, dict[str, Any]]]:
    for name in ("simulated", "measured"):
        size = getattr(comparison, name)
        dominant = size.dominant.frequency if size.dominant else None
        yield name, {"peak": size.peak, "rms": size.rms, "band_rms": size.band_rms, "dominant_frequency": dominant}


def _ratios(comparison: Comparison) -> dict[str, float]:
    return {"peak": comparison.peak_ratio, "rms": comparison.rms_ratio, "band_rms": comparison.band_rms_ratio}


def _belts(simulation: Simulation) -> Iterator[dict[str, Any]]:
    for b, belt in enumerate(simulation.arm.belts):
        for span, values in zip(SPANS, simulation.tension[:, b], strict=True):
            times = [[start, end] for i, name, start, end in simulation.slack if (i, name) == (b, span)]
            at = simulation.time[np.argmin(values)]
            yield {"belt": belt.name, "span": span, "smallest": values.min(), "at": at, "slack": times}


def _bushings(simulation: Simulation) -> Iterator[dict[str, Any]]:
    for joint, bending, torsion in zip(simulation.arm.joints, *simulation.moments, strict=True):
        yield {"joint": joint.name, "bending": bending.max(), "torsion": np.abs(torsion).max()}
