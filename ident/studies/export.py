"""Write what was identified back into the arm's own description, or as JSON for other programs."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import InputError, Problem
from ident.studies.shared import as_file, with_numbers
from ident.text import one_line

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.identified import Identified
    from ident.studies.result import Result

FORM = "ident-export/1"
"""Format and version of the JSON file."""
ENDINGS = ".xml (MJCF), .urdf, .toml or .json"


def export(
    result: "Result | str | Path", path: str | Path, *, arm: "ArmFile | str | Path | None" = None
) -> tuple[Path, ...]:
    """Write the arm that was identified, in the format that a file's ending names, and return the paths written.

    `.xml`: the arm's MJCF with three passive hinges before each driven one, of its bushing's stiffness and damping.
    `.urdf`: the arm's URDF with the bushings as a comment. Beside both `.joints.toml`, by which ident reads them.
    `.toml`: the arm file with the identified numbers, of the origin `calibrated`. `.json`: the numbers with intervals.

    Args:
        result: of `ident.fit` or `ident.sample`, or its file; of a posterior the medians are written.
        path: the file to write; it is none of those that were read.
        arm: the description to write into; by default the one that was fitted, found by its hash.

    Raises:
        InputError: no such result, the arm's format is another, it has not these numbers, or nothing can be written.
    """
    found, changed, own = _identified(result, arm)
    path = Path(path)
    writers: Mapping[str, Callable[..., Mapping[Path, bytes]]] = {
        ".xml": _mjcf,
        ".urdf": _urdf,
        ".toml": _toml,
        ".json": _json,
    }
    if path.suffix not in writers:
        got = f"the ending {path.suffix}" if path.suffix else "no ending"
        raise InputError(Problem(one_line(str(path)), got, f"a file *{ENDINGS}", "name it so"))
    files = writers[path.suffix](path, own, with_numbers(own.arm, None, changed), found)
    for each in files:
        _check_other(each, (own.path, own.bushings.path if own.bushings else ""))
    return _write(files)


def _identified(
    result: "Result | str | Path", arm: "ArmFile | str | Path | None"
) -> "tuple[Identified, Mapping[str, float], ArmFile]":
    """Return what was identified, all numbers [SI] in which the arm differs from its file, and the file."""
    from ident.identify.identified import Identified
    from ident.identify.values import OTHER_ARM
    from ident.studies.fit import FitResult
    from ident.studies.load import load
    from ident.studies.rerun import found
    from ident.studies.sample import SampleResult

    read = load(result) if isinstance(result, str | Path) else result
    if not isinstance(read, FitResult | SampleResult):
        got, expected = f"a {type(read).__name__}", "a result of ident.fit or ident.sample, or its file"
        raise InputError(Problem("result", got, expected, "give that"))
    if read.options.soft_base is not None:
        got, remedy = "a base that gives, which no robot description has", "fit it without `soft_base`"
        raise InputError(Problem("result", got, "a rigid base", remedy))
    if arm is None:
        arm = found(read, Path(result).absolute().parent if isinstance(result, str | Path) else Path())["arm"]
    own = as_file(arm)
    fitted = read.fit if isinstance(read, FitResult) else read.sample.fitted
    values = read.parameters if isinstance(read, FitResult) else read.medians
    items = fitted.problem.parameters.items
    supported = {path for item, yes in zip(items, fitted.supported, strict=True) if yes for path in item.paths}
    by_path = {path: values[path if path in values else item.name] for item in items for path in item.paths}
    intervals = {path: read.intervals[item.name] for item in items for path in item.paths}
    sources = [("arm", own), *((word, each) for word, each in read.inputs.items() if word != "arm")]
    told = tuple((word, each.path, each.sha256) for word, each in sources if each is not None)
    other = () if own.sha256 == read.arm.sha256 else (OTHER_ARM,)
    identified = Identified(by_path, intervals, frozenset(supported), (*fitted.doubts, *other), told)
    held = _changed(read.arm.arm, fitted.fitted_arm)
    return identified, {**held, **by_path}, own


def _mjcf(path: Path, own: "ArmFile", arm: "Arm", found: "Identified") -> Mapping[Path, bytes]:
    from ident.description.mjcf_writing import mjcf_with_bushings

    _check_kind(path, own, "mujoco", "an arm that was read from MJCF")
    beside = _joints(path, own, arm)
    return {path: mjcf_with_bushings(own.path, arm, _comment(arm, found)), **beside}


def _urdf(path: Path, own: "ArmFile", arm: "Arm", found: "Identified") -> Mapping[Path, bytes]:
    from ident.description.xml_text import with_comment
    from ident.text import read_bytes

    _check_kind(path, own, "robot", "an arm that was read from URDF")
    beside = _joints(path, own, arm)
    return {path: with_comment(read_bytes(own.path, "a robot description (URDF)"), _comment(arm, found)), **beside}


def _joints(path: Path, own: "ArmFile", arm: "Arm") -> dict[Path, bytes]:
    """Return the file of bushings that goes beside a robot description, by which ident reads it again."""
    from ident.description.joints_file import beside, joints_text
    from ident.text import decode, read_bytes

    changed = _only_bushings(path, own, arm)
    assert own.bushings, "the arm was read from a robot description"
    where = one_line(own.bushings.path)
    text = decode(read_bytes(own.bushings.path, "the bushings of a robot (TOML)"), where)
    return {beside(str(path)): joints_text(text, changed, "calibrated", where).encode("utf-8")}


def _toml(path: Path, own: "ArmFile", arm: "Arm", found: "Identified") -> Mapping[Path, bytes]:
    from ident.description.file import update_file
    from ident.text import decode, read_bytes

    if own.bushings or not own.path:
        remedy = "write .xml or .urdf as it is, or .json"
        raise InputError(Problem(one_line(str(path)), f"the arm {one_line(own.path)}", "an arm file (TOML)", remedy))
    where = one_line(own.path)
    text = decode(read_bytes(own.path, "an arm description (TOML)"), where)
    return {path: update_file(text, _changed(own.arm, arm), origin="calibrated", where=where).encode("utf-8")}


def _json(path: Path, own: "ArmFile", arm: "Arm", found: "Identified") -> Mapping[Path, bytes]:
    import json

    from ident.present.text.units import unit_of

    document = {
        "format": FORM,
        "created": _date(),
        "arm": arm.name,
        "inputs": {word: {"path": name, "sha256": sha256} for word, name, sha256 in found.sources},
        "doubts": list(found.doubts),
        "numbers": [
            {
                "path": name,
                "value": value,
                "unit": unit_of(name),
                "low_95": found.intervals[name][0],
                "high_95": found.intervals[name][1],
                "supported": name in found.supported,
            }
            for name, value in found.values.items()
        ],
    }
    return {path: (json.dumps(document, indent=1, allow_nan=False) + "\n").encode("utf-8")}


def _comment(arm: "Arm", found: "Identified") -> list[str]:
    from ident.present.text.export import identified_lines

    return identified_lines(arm, found, _date())


def _date() -> str:
    from datetime import UTC, datetime

    return datetime.now(UTC).isoformat(timespec="seconds")


def _check_kind(path: Path, own: "ArmFile", kind: str, expected: str) -> None:
    from ident.description.robot_file import robot_kind
    from ident.text import read_bytes

    where = one_line(own.path)
    if own.bushings is None or robot_kind(read_bytes(own.path, expected), where) != kind:
        remedy = "name the robot's own format, or .json"
        raise InputError(Problem(one_line(str(path)), f"the arm {where or own.arm.name}", expected, remedy))


def _only_bushings(path: Path, own: "ArmFile", arm: "Arm") -> dict[str, float]:
    """Return the numbers in which an arm differs from its file, all of which belong to its bushings."""
    from ident.description.joints_file import BUSHING

    changed, joints = _changed(own.arm, arm), {joint.name for joint in arm.joints}
    others = [name for name in changed if name.split(".")[0] not in joints or name.split(".")[1] not in BUSHING]
    if others:
        got, remedy = f"{', '.join(others[:3])} besides", "hold them (--fix), or write .json"
        raise InputError(Problem(one_line(str(path)), got, "stiffness and damping of joints only", remedy))
    return changed


def _changed(own: "Arm", arm: "Arm") -> dict[str, float]:
    """Return the numbers [SI] of an arm that another one has otherwise."""
    before = own.numbers()
    return {name: float(value) for name, value in arm.numbers().items() if float(value) != float(before[name])}


def _check_other(path: Path, sources: tuple[str, ...]) -> None:
    if any(source and path.exists() and os.path.samefile(path, source) for source in sources):
        got, remedy = "the file that was read", "choose another name"
        raise InputError(Problem(one_line(str(path)), got, "a file of its own", remedy))


def _write(files: Mapping[Path, bytes]) -> tuple[Path, ...]:
    from ident.files import replace_file

    for path, data in files.items():
        replace_file(path, lambda file, data=data: file.write(data), make_folders=True)  # type: ignore[misc]
    return tuple(files)
