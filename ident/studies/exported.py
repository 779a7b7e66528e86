"""What `ident export` writes: the arm that was identified, and where its numbers come from."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import InputError, Problem
from ident.studies.shared import as_file
from ident.text import one_line

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.fit import CampaignFit
    from ident.identify.identified import Identified
    from ident.studies.fit import FitResult
    from ident.studies.result import Result
    from ident.studies.sample import SampleResult


@dataclass(frozen=True)
class Exported:
    """What is written.

    Attributes:
        path: the file.
        own: the description of the arm, and the arm as it stands there.
        arm: the arm that was identified.
        found: what was identified of it.
        posture: [deg] where its MJCF is exact under weight; None for without weight.
    """

    path: Path
    own: "ArmFile"
    arm: "Arm"
    found: "Identified"
    posture: tuple[float, ...] | None

    @property
    def changed(self) -> Mapping[str, float]:
        """The numbers [SI] in which the arm differs from its file, inertias included."""
        before = self.own.arm.numbers()
        numbers = ((name, float(value)) for name, value in self.arm.numbers().items())
        return {name: value for name, value in numbers if name not in before or value != float(before[name])}

    @property
    def origins(self) -> Mapping[str, str]:
        """Origin of each quantity, as `link2.com`: `calibrated` of what was fitted or goes with it; none of a base."""
        old, changed = self.own.origins, self.changed
        goes = [path for path in changed if path in self.found.values or (path in old and ".inertia." in path)]
        kept = {_quantity(path): origin for path, origin in old.items() if path not in changed}
        return kept | {_quantity(path): "calibrated" for path in goes}


def exported(
    result: "Result | str | Path",
    path: Path,
    arm: "ArmFile | str | Path | None",
    posture: tuple[float, ...] | None,
    force: bool,
) -> Exported:
    """Return the arm that was identified, what was identified of it, and its file.

    Raises:
        InputError: the file describes another robot, unless that is forced.
    """
    from ident.arm.base import on_soft_base
    from ident.arm.checks import check_arm
    from ident.identify.uncertain import scaled_inertia
    from ident.identify.values import scaled_by
    from ident.studies.rerun import found

    read = _read(result)
    fitted = _fitted(read)
    if arm is None:
        arm = found(read, Path(result).absolute().parent if isinstance(result, str | Path) else Path())["arm"]
    own, height = as_file(arm), read.options.soft_base
    based = own.arm if height is None else on_soft_base(own.arm, height)
    identified = _identified(read, own)
    paths = set(based.paths())
    values = {name: value for name, value in identified.values.items() if name in paths}
    if strange := [name for name in fitted.arm.paths() if name in identified.values and name not in paths]:
        got, remedy = f"no {strange[0]}, which was fitted", "give the one that was fitted (`arm`)"
        raise InputError(Problem(one_line(own.path), got, "an arm that has it", remedy))
    where = one_line(str(result)) if isinstance(result, str | Path) else ""
    here = own if read.arm.arm.base is None else replace(own, arm=based)
    remark = _of_this_robot(read, where, here, values, force)
    identified = replace(identified, doubts=(*identified.doubts, *filter(None, (remark,))))
    bodies = tuple(name for name in scaled_by(fitted.problem) if f"{name}.mass" in values)
    changed = scaled_inertia(based, values, bodies).replace(values)
    check_arm(changed)
    return Exported(path, own, changed, identified, posture)


def _read(result: "Result | str | Path") -> "FitResult | SampleResult":
    from ident.studies.fit import FitResult
    from ident.studies.load import load
    from ident.studies.sample import SampleResult

    read = load(result) if isinstance(result, str | Path) else result
    if not isinstance(read, FitResult | SampleResult):
        got, expected = f"a {type(read).__name__}", "a result of ident.fit or ident.sample, or its file"
        raise InputError(Problem("result", got, expected, "give that"))
    return read


def _fitted(read: "FitResult | SampleResult") -> "CampaignFit":
    from ident.studies.fit import FitResult

    return read.fit if isinstance(read, FitResult) else read.sample.fitted


def _identified(read: "FitResult | SampleResult", own: "ArmFile") -> "Identified":
    """Return what was identified: numbers of the arm, and of what else was fitted."""
    from ident.identify.identified import Identified
    from ident.studies.fit import FitResult

    fitted, values = _fitted(read), read.parameters if isinstance(read, FitResult) else read.medians
    items = fitted.problem.parameters.items
    supported = {path for item, yes in zip(items, fitted.supported, strict=True) if yes for path in item.paths}
    by_path = {path: values[path if path in values else item.name] for item in items for path in item.paths}
    intervals = {path: read.intervals[item.name] for item in items for path in item.paths}
    sources = [("arm", own), *((word, each) for word, each in read.inputs.items() if word != "arm")]
    told = tuple((word, each.path, each.sha256) for word, each in sources if each is not None)
    return Identified(by_path, intervals, frozenset(supported), fitted.doubts, told)


def _of_this_robot(
    read: "FitResult | SampleResult", where: str, own: "ArmFile", numbers: Mapping[str, float], force: bool
) -> str:
    """Refuse to write what was identified into the description of another robot; if forced, return what differs."""
    import numpy as np

    from ident.identify.values import Robot, Values, of_this_robot

    values = Values(where, "", {name: np.asarray(value) for name, value in numbers.items()})
    robot = Robot.of(read.arm.arm, read.arm.sha256)
    return of_this_robot(values, robot, Robot.of(own.arm, own.sha256), force=force).remark


def _quantity(path: str) -> str:
    return ".".join(path.split(".")[:2])
