"""Universal files (UFF, UNV): datasets 58 in ASCII and binary, 55, 15, 2411 and 151, read by pyuff.

References:
    I-DEAS universal file formats, University of Cincinnati, Structural Dynamics Research Laboratory.
"""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError, Problem
from ident.measure.recordings.recording import Channel, Contents, Shape, damaged, lacking
from ident.text import one_line

KIND = "a universal file (UFF)"
TAG = b"    -1"
"""Line that starts and ends a dataset."""
DIRECTIONS = {
    0: "S",
    **{sign * k: f"{'+' if sign > 0 else '-'}{name}" for k, name in enumerate(("X", "Y", "Z"), 1) for sign in (1, -1)},
    **{sign * (k + 3): f"{'+' if sign > 0 else '-'}R{name}" for k, name in enumerate("XYZ", 1) for sign in (1, -1)},
}
"""Words for the numbers of directions: translations 1 to 3, rotations 4 to 6, a scalar 0."""
QUANTITIES = {8: " displacement", 9: " force", 11: " velocity", 12: " acceleration", 13: " force"}
"""Words for what a function is of, by the number of its specific data type."""
TIME, RESPONSE = 1, 4
"""Numbers of the functions that are read: samples over time, frequency response."""
MODE = (2, 3, 7)
"""Kinds of analysis of a dataset 55 that are modes: real, and complex of first and second kind."""


def read(path: Path, data: bytes) -> Contents:
    """Return what a universal file holds; datasets of other numbers are passed over."""
    try:
        import pyuff
    except ImportError:
        lacking(path, "pyuff")
    _check_whole(path, data)
    try:
        sets = pyuff.UFF(str(path)).read_sets()
    except Exception as error:  # pyuff raises bare exceptions whatever is wrong
        damaged(path, KIND, error)
    sets = [sets] if isinstance(sets, dict) else sets
    functions = [_function(path, each) for each in sets if each.get("type") == 58]
    shapes = tuple(_shape(each) for each in sets if each.get("type") == 55 and each.get("analysis_type") in MODE)
    return tuple(_joined(path, filter(None, functions))), shapes, _places(sets)


def _check_whole(path: Path, data: bytes) -> None:
    """Refuse a file whose last dataset has no end: pyuff would leave it out in silence."""
    tags = [line.rstrip() == TAG for line in data.replace(b"\r\n", b"\n").split(b"\n") if line.startswith(TAG)]
    if not sum(tags):
        damaged(path, KIND, "no dataset in it")
    if not data.rstrip().endswith(TAG.strip()):
        damaged(path, KIND, "its last dataset has no end")


def _function(path: Path, dataset: Mapping[str, Any]) -> Channel | None:
    """Return a dataset 58 of samples over time or of a frequency response as a channel of one block."""
    kind, file = dataset["func_type"], one_line(str(path))
    if kind not in (TIME, RESPONSE):
        return None
    name = _degree_of_freedom(dataset, "rsp", "ordinate")
    if dataset["abscissa_spacing"] != 1:
        problem = Problem(file, f"{name} at uneven steps", "even steps", "resample it, then export it anew")
        raise InputError(problem)
    values, count = np.asarray(dataset["data"]), int(dataset["num_pts"])
    if len(values) != count:  # more where the header says another precision than the numbers have
        damaged(path, KIND, f"{len(values)} values of {name}, its header says {count}")
    step, start = float(dataset["abscissa_inc"]), float(dataset["abscissa_min"])
    unit = _label(dataset["ordinate_axis_units_lab"])
    if kind == TIME:
        return Channel(name, values[None].astype(float), unit, step, start)
    reference, below = _degree_of_freedom(dataset, "ref", "orddenom"), _label(dataset["orddenom_axis_units_lab"])
    numerator = unit.removesuffix(f"/{below}") if below else unit
    return Channel(name, values[None].astype(complex), numerator, step, start, reference, below)


def _degree_of_freedom(dataset: Mapping[str, Any], end: str, axis: str) -> str:
    """Return node, direction and quantity as a name: force and acceleration may be of one node and direction."""
    quantity = QUANTITIES.get(dataset[f"{axis}_spec_data_type"], "")
    return f"{dataset[f'{end}_node']}:{DIRECTIONS.get(dataset[f'{end}_dir'], '?')}{quantity}"


def _label(text: Any) -> str:
    text = str(text or "").strip()
    return "" if text.upper() == "NONE" else text


def _joined(path: Path, functions: Iterable[Channel]) -> list[Channel]:
    """Return the functions of one channel as its blocks, in the order of the file."""
    groups: dict[tuple[str, str], list[Channel]] = {}
    for each in functions:
        groups.setdefault((each.name, each.reference), []).append(each)
    return [_blocks(path, group) for group in groups.values()]


def _blocks(path: Path, group: list[Channel]) -> Channel:
    first = group[0]
    for each in group[1:]:
        if each.values.shape != first.values.shape or each.step != first.step or each.unit != first.unit:
            got = f"blocks of {first.name} that differ in length, sampling or unit"
            raise InputError(
                Problem(one_line(str(path)), got, "blocks that are alike", "put them into files of their own")
            )
    values = np.concatenate([each.values for each in group])
    return Channel(first.name, values, first.unit, first.step, first.start, first.reference, first.reference_unit)


def _shape(dataset: Mapping[str, Any]) -> Shape:
    """Return a dataset 55 of a mode; of a complex one frequency and damping are those of its pole."""
    if "eig" in dataset:
        pole = complex(dataset["eig"])
        frequency, ratio = abs(pole) / (2 * np.pi), -pole.real / abs(pole)
    else:
        frequency, ratio = float(dataset["freq"]), float(dataset.get("modal_damp_vis", 0.0))
    motion = {
        f"{int(node)}:{DIRECTIONS[k]}": complex(value)
        for k in (1, 2, 3)
        for node, value in zip(dataset["node_nums"], dataset.get(f"r{k}", ()), strict=False)
    }
    return Shape(frequency, ratio, motion, of="pole" if "eig" in dataset else "")


def _places(sets: Iterable[Mapping[str, Any]]) -> dict[str, tuple[float, float, float]]:
    """Return the coordinates of nodes of datasets 15 and 2411."""
    places: dict[str, tuple[float, float, float]] = {}
    for each in sets:
        if each.get("type") in (15, 2411):
            rows = zip(each["node_nums"], each["x"], each["y"], each["z"], strict=True)
            places |= {str(int(node)): (float(x), float(y), float(z)) for node, x, y, z in rows}
    return places
