"""Write identified numbers back into the arm's own description, or as JSON for other programs."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import refusal, require
from ident.studies.result import input_of
from ident.studies.shared import as_file, check_posture
from ident.text import one_line, study_of

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.fit import CampaignFit
    from ident.identify.values import Identified
    from ident.studies.result import Result
    from ident.studies.saved import Saved


# -------- Exported
# Content of an export: the identified arm, and the sources of its numbers.


@dataclass(frozen=True)
class Exported:
    """Content of an export.

    Attributes:
        path: the file.
        own: the description of the arm, and the arm in it.
        arm: the identified arm.
        found: the identified numbers.
        posture: [deg] at which its MJCF is exact under weight; None for without weight.
    """

    path: Path
    own: "ArmFile"
    arm: "Arm"
    found: "Identified"
    posture: tuple[float, ...] | None

    @property
    def changed(self) -> Mapping[str, float]:
        """Numbers [SI] in which the arm differs from its file, inertias included."""
        before = self.own.arm.numbers()
        numbers = ((name, float(value)) for name, value in self.arm.numbers().items())
        return {name: value for name, value in numbers if name not in before or value != float(before[name])}

    @property
    def origins(self) -> Mapping[str, str]:
        """Origin of each quantity, as `link2.com`: `calibrated` if fitted or derived from a fit; without a base's."""
        old, changed = self.own.origins, self.changed
        goes = [path for path in changed if path in self.found.values or (path in old and ".inertia." in path)]
        kept = {_quantity(path): origin for path, origin in old.items() if path not in changed}
        return kept | {_quantity(path): "calibrated" for path in goes}


def exported(
    read: "Result | Saved",
    path: Path | None,
    own: "ArmFile",
    posture: tuple[float, ...] | None,
    force: bool,
    where: str,
) -> Exported:
    """Return the identified arm, its identified numbers, and the file to write.

    Args:
        read: the result.
        path: the file to write; None for the name of the description.
        own: the description to write into.
        posture: see `export`.
        force: see `export`.
        where: the result's file; empty for none.

    Raises:
        InputError: the file describes another robot, and `force` is off.
    """
    import numpy as np

    from ident.arm.arm import check_arm, loss_paths, on_soft_base
    from ident.arm.fields import ALPHA
    from ident.identify.unknowns import scaled_inertia
    from ident.identify.values import Robot, Values, of_this_robot, scaled_by

    fitted, height, source = read.fitted, vars(read)["options"].soft_base, read.inputs["arm"]
    assert fitted, "a fit, or a posterior"
    based = own.arm if height is None else on_soft_base(own.arm, height)
    identified = _identified(read, fitted, own)
    paths = {*based.paths(), *loss_paths(based), ALPHA}
    values = {name: value for name, value in identified.values.items() if name in paths}
    if strange := [name for name in fitted.arm.paths() if name in identified.values and name not in paths]:
        got, remedy = f"no {strange[0]}, which was fitted", "give the one that was fitted (`arm`)"
        raise refusal(one_line(own.path), got, "an arm that has it", remedy)
    # the springs of another robot do not apply to this one
    numbers = Values(where, "", {name: np.asarray(value) for name, value in values.items()})
    here = own.arm if fitted.arm.base is None else based
    robots = Robot.of(fitted.arm, source.sha256 if source else ""), Robot.of(here, own.sha256)
    remark = of_this_robot(numbers, *robots, force=force).remark
    identified = replace(identified, doubts=(*identified.doubts, *filter(None, (remark,))))
    bodies = tuple(name for name in scaled_by(fitted.problem) if f"{name}.mass" in values)
    changed = scaled_inertia(based, values, bodies).replace(values)
    check_arm(changed)
    described = Path(own.path or f"{own.arm.name}.toml")
    return Exported(
        path or Path("out") / f"{described.stem}.fitted{described.suffix}", own, changed, identified, posture
    )


def _read(result: "Result | Saved | str | Path") -> "Result | Saved":
    from ident.studies.result import Result
    from ident.studies.saved import Saved, load

    read = load(result) if isinstance(result, str | Path) else result
    if not (isinstance(read, Result | Saved) and study_of(read.form) in ("fit", "sample")):
        got = f"a result of {study_of(read.form)}" if isinstance(read, Saved) else f"a {type(read).__name__}"
        raise refusal("result", got, "a result of ident.fit or ident.sample, or its file", "give that")
    return read


def _identified(read: "Result | Saved", fitted: "CampaignFit", own: "ArmFile") -> "Identified":
    """Return the identified numbers: those of the arm, and other fitted ones."""
    from ident.identify.values import Identified
    from ident.studies.saved import Saved

    items = fitted.problem.parameters.items
    names = [item.name for item in items]
    if study_of(read.form) == "fit":
        values = fitted.parameters
        intervals = {
            name: (float(low), float(high)) for name, (low, high) in zip(names, fitted.interval(), strict=True)
        }
    else:
        rows = {row["parameter"]: row for row in reversed(read.table())}  # rows about the best optimum come first
        values = {name: rows[name]["median"] for name in names}
        intervals = {name: (rows[name]["low_95"], rows[name]["high_95"]) for name in names}
    supported = {path for item, yes in zip(items, fitted.supported, strict=True) if yes for path in item.paths}
    by_path = {path: values[path if path in values else item.name] for item in items for path in item.paths}
    sources = [("arm", own), *((word, each) for word, each in read.inputs.items() if word != "arm")]
    told = tuple((word, each.path, each.sha256) for word, each in sources if each is not None)
    widths = {path: intervals[item.name] for item in items for path in item.paths}
    doubts = *fitted.doubts, *(read.moved if isinstance(read, Saved) else ())
    carried = fitted.damping.carried if fitted.damping else {}
    damping = {path: value for group, value in carried.items() for path in group}
    return Identified(damping | by_path, widths, frozenset(supported), doubts, told)


def _quantity(path: str) -> str:
    return ".".join(path.split(".")[:2])


# -------- Export

FORM = "ident-export/1"
"""Format and version of the JSON file."""
ENDINGS = ".xml (MJCF), .urdf, .toml or .json"


def export(
    result: "Result | Saved | str | Path",
    path: str | Path | None = None,
    *,
    arm: "ArmFile | str | Path | None" = None,
    posture: tuple[float, ...] | None = None,
    force: bool = False,
) -> tuple[Path, ...]:
    """Write the identified arm in the format of a file's ending, and return the paths written.

    `.xml`: the arm's MJCF with three passive hinges before each driven one, with the stiffness and damping of its
    bushing, and other fitted numbers; a soft base becomes such hinges of a body around the arm. `.urdf`: the arm's URDF
    with the bushings as a comment. Both come with `.joints.toml`, from which ident reads them. `.toml`: the arm file
    with the identified numbers, origin `calibrated`; for a robot description the whole arm. `.json`: numbers [SI] with
    intervals.

    Args:
        result: of `ident.fit` or `ident.sample`, or its file; for a posterior the medians are written.
        path: the file to write, none of the input files; by default `out/arm.fitted.toml`, with the name and the ending
            of the arm's description.
        arm: the description to write into; by default the fitted one, found by its hash.
        posture: joint angles [deg] at which MJCF springs are exact under the arm's weight.
        force: write into the description of another robot, too.

    Raises:
        InputError: no such result, another robot's description, one of another format or without these numbers, or a
            failed write.
    """
    from ident.files import replace_file, together
    from ident.studies.saved import files_of, reading

    read, where = _read(result), one_line(str(result)) if isinstance(result, str | Path) else ""
    with reading(read):
        if arm is None:
            inputs = {name: source for name, source in read.inputs.items() if input_of(name) == "arm"}
            arm = files_of(inputs, Path(result).absolute().parent if where else Path()).paths["arm"]  # type: ignore[arg-type]
        asked = exported(read, None if path is None else Path(path), as_file(arm), posture, force, where)
    path, own = asked.path, asked.own
    writers = {".xml": _mjcf, ".urdf": _urdf, ".toml": _toml, ".json": _json}
    got = f"the ending {path.suffix}" if path.suffix else "no ending"
    require(path.suffix in writers, one_line(str(path)), got, f"a file *{ENDINGS}", "name it so")
    if posture is not None:
        got, expected = "a posture for a file without springs", "a file *.xml"
        require(path.suffix == ".xml", "posture", got, expected, "write .xml, or leave it out")
        check_posture(posture, own.arm)
    files = writers[path.suffix](asked)
    sources = (own.path, own.bushings.path if own.bushings else "")
    for each in files:
        if any(source and os.path.exists(each) and os.path.samefile(each, source) for source in sources):
            raise refusal(one_line(str(each)), "the file that was read", "a file of its own", "choose another name")
    with together():
        for each, data in files.items():
            replace_file(each, lambda file, data=data: file.write(data), make_folders=True)  # type: ignore[misc]
    return tuple(files)


def _mjcf(asked: Exported) -> Mapping[Path, bytes]:
    from math import radians

    from ident.description.mjcf_writing import mjcf_with_bushings

    path, own = asked.path, asked.own
    _check_kind(path, own, "mujoco", "an arm that was read from MJCF")
    _check_held(asked, lambda name: name.startswith("tip."), "the place of `tip`")
    at = None if asked.posture is None else tuple(map(radians, asked.posture))
    written = mjcf_with_bushings(own.path, own.arm, asked.arm, _comment(asked), at)
    return {path: written, **_joints(asked)}


def _urdf(asked: Exported) -> Mapping[Path, bytes]:
    from ident.description.mjcf_writing import with_comment
    from ident.description.schema import BUSHING
    from ident.text import read_bytes

    path, own, arm = asked.path, asked.own, asked.arm
    _check_kind(path, own, "robot", "an arm that was read from URDF")
    beside = {arm.damping.name, *(point.name for point in arm.points if point.name != "tip")}
    beside |= {payload.body.name for payload in arm.payloads}
    joints = {joint.name for joint in own.arm.joints}

    def is_lost(name: str) -> bool:
        part, field, *_ = name.split(".")
        return part not in beside and (part not in joints or field not in BUSHING)

    _check_held(asked, is_lost, "what is no stiffness or damping of its joints")
    text = with_comment(read_bytes(own.path, "a robot description (URDF)"), _comment(asked))
    return {path: text, **_joints(asked)}


def _joints(asked: Exported) -> dict[Path, bytes]:
    """Return the file of bushings for a robot description, from which ident reads it again."""
    from ident.description.robot import beside, joints_text
    from ident.text import read_text

    own = asked.own
    assert own.bushings, "the arm was read from a robot description"
    where = one_line(own.bushings.path)
    text = read_text(own.bushings.path, "the bushings of a robot (TOML)")
    written = joints_text(text, own.arm, asked.arm, "calibrated", where)
    return {beside(str(asked.path)): written.encode("utf-8")}


def _toml(asked: Exported) -> Mapping[Path, bytes]:
    from ident.description.file import update_arm
    from ident.description.rewriting import arm_text
    from ident.text import read_text

    path, own = asked.path, asked.own
    got, remedy = f"the arm {one_line(own.arm.name)}, of no file", "write .json"
    require(own.path, one_line(str(path)), got, "an arm that was read from a file", remedy)
    if own.bushings:
        head = "\n".join(_comment(asked))
        said = {f"{joint.name}.{key}": "derived" for joint in own.arm.joints for key in ("axis", "limits")}
        origins = {**said, ".gravity": "derived", **asked.origins}
        return {path: arm_text(asked.arm, origin="assumed", head=head, origins=origins).encode("utf-8")}
    text = read_text(own.path, "an arm description (TOML)")
    return {path: update_arm(text, asked.arm, origin="calibrated", where=one_line(own.path)).encode("utf-8")}


def _json(asked: Exported) -> Mapping[Path, bytes]:
    import json

    from ident.report.words import unit_of

    found = asked.found
    document = {
        "format": FORM,
        "created": _date(),
        "arm": asked.arm.name,
        "inputs": {word: {"path": name, "sha256": sha256} for word, name, sha256 in found.sources},
        "doubts": list(found.doubts),
        "numbers": [
            {"path": name, "value": value, "unit": unit_of(name)}
            | dict(zip(("low_95", "high_95"), found.intervals.get(name, (None, None)), strict=True))
            | {"supported": name in found.supported}
            for name, value in found.values.items()
        ],
        "changed": {name: value for name, value in sorted(asked.changed.items()) if name not in found.values},
    }
    return {asked.path: (json.dumps(document, indent=1, allow_nan=False) + "\n").encode("utf-8")}


def _comment(asked: Exported) -> list[str]:
    from ident.studies.look.export_report import identified_lines

    return identified_lines(asked.arm, asked.found, _date(), asked.posture)


def _date() -> str:
    from datetime import UTC, datetime

    return datetime.now(UTC).isoformat(timespec="seconds")


def _check_kind(path: Path, own: "ArmFile", kind: str, expected: str) -> None:
    from ident.description.file import robot_kind
    from ident.text import read_bytes

    where = one_line(own.path)
    if own.bushings is None or robot_kind(read_bytes(own.path, expected), where) != kind:
        remedy = "name the robot's own format, .toml or .json"
        raise refusal(one_line(str(path)), f"the arm {where or own.arm.name}", expected, remedy)


def _check_held(asked: Exported, is_lost: Callable[[str], bool], words: str) -> None:
    """Refuse numbers in which the arm differs from its file, if the format has no place for them."""
    if lost := [name for name in asked.changed if is_lost(name)]:
        got, expected = f"{', '.join(lost[:3])} besides", f"an arm of other bushings alone: no place for {words}"
        raise refusal(one_line(str(asked.path)), got, expected, "write .toml or .json, or hold them (--fix)")
