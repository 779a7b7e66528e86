"""Read fitted values and draws from result files; nothing is posed or evaluated."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.identify.values import BEST_ONLY, Draws, Robot, Values, remark_on
from ident.report.document import check_version, read_document, read_group, whole
from ident.text import LARGEST_BINARY, one_line, read_bytes

if TYPE_CHECKING:
    import xarray

    from ident.arm.arm import Arm

FIT = "a result file of ident fit (.fit.json)"
UNSOUND = ("NOT USABLE", "DOUBTFUL")
"""Verdicts of `ident source` whose numbers are unreliable."""
POSTERIOR = "a posterior of ident sample (.sample.nc) or source (.source.json)"


def read_fit(
    path: str | Path, arm: "Arm", document: Mapping[str, Any] | None = None
) -> tuple[Values, Robot, float | None]:
    """Return the fitted values of a result file, the robot of the fit, and the height [m] of its soft base.

    Args:
        path: the file.
        arm: numbers are matched to this arm.
        document: content of the file, if already read.
    """
    where = one_line(str(path))
    document = document or read_document(path, FIT)
    check_version(document["format"], "fit", where, FIT)
    with whole(path, "other contents", FIT, "give the file that ident fit wrote"):
        damping = document["summary"].get("damping", {})
        parameters: dict[str, Any] = document["summary"]["parameters"] | (damping or {})
        best: dict[tuple[str, ...], float] = {(name,): _number(value) for name, value in parameters.items()}
        doubts, fitted = document["summary"]["doubts"], document["inputs"]["arm"]["sha256"]
        scaled = tuple(map(str, document["summary"]["scaled"]))
        remark, base = remark_on(doubts, damping is not None), document["options"]["soft_base"]
        soft_base = None if base is None else _number(base)
        robot = Robot.read(document.get("robot"), str(fitted or ""))
    sha256_of_fit = hashlib.sha256(read_bytes(path, FIT, LARGEST_BINARY)).hexdigest()
    return Values.of_arm(best, arm, where, sha256_of_fit, remark, scaled), robot, soft_base


def _number(value: Any) -> float:
    """Return a number of the file; text and booleans are refused."""
    if isinstance(value, bool | str):
        raise TypeError
    return float(value)


def read_posterior(path: str | Path) -> Draws:
    """Return the draws of a file of `ident sample`, of `ident source`, or of any tool that writes InferenceData."""
    where = one_line(str(path))
    if Path(path).suffix == ".json":
        return _of_source(path, where)
    data = read_bytes(path, POSTERIOR, LARGEST_BINARY)
    with whole(path, "other contents", POSTERIOR, "give the file that ident sample wrote"):
        root = read_group(path)
        own = str(json.loads(root.attrs.get("format", '""')))
        ours = own.startswith("ident-sample/")
        of_ident = own.startswith("ident-")
        arm_sha256 = str(json.loads(root.attrs["inputs"])["arm"]["sha256"]) if of_ident else ""
        doubts = json.loads(root.attrs.get("trust", "{}")).get("doubts", []) if of_ident else []
        chains, remark = _best(path)
        group = read_group(path, "posterior")
        by_paths = dict(_variables(group, chains))
        scaled = tuple(map(str, json.loads(group.attrs.get("scaled", "[]"))))
        document = json.loads(root.attrs.get("robot", "null")) if of_ident else None
        robot = Robot.read(document, arm_sha256)
        draws = Draws(by_paths, where, hashlib.sha256(data).hexdigest(), remark, scaled, robot)
    if ours:
        check_version(own, "sample", where, POSTERIOR)
    return draws.doubted(tuple(map(str, doubts)))


def _of_source(path: str | Path, where: str) -> Draws:
    """Return the draws of a result of `ident source`."""
    document = read_document(path, POSTERIOR)
    check_version(document["format"], "source", where, POSTERIOR)
    with whole(path, "other contents", POSTERIOR, "give the file that ident source wrote"):
        draws = draws_of(document["summary"]["draws"])
        robot = Robot.read(document.get("robot"), str(document["inputs"]["arm"]["sha256"] or ""))
        sound = document["verdict"] not in UNSOUND
    remark = "" if sound else "the runs that it is from are not usable: see ident show of that file"
    sha256 = hashlib.sha256(read_bytes(path, POSTERIOR, LARGEST_BINARY)).hexdigest()
    return Draws(draws, where, sha256, remark, (), robot)


def draws_of(drawn: Mapping[str, Any]) -> dict[tuple[str, ...], np.ndarray]:
    """Return the draws of a result of `ident source`.

    Raises:
        ValueError, TypeError, AttributeError, OverflowError: not numbers, or different counts.
    """
    draws = np.array(list(drawn.values()), float).reshape(len(drawn) or 1, -1)
    return {(name,): own for name, own in zip(drawn, draws, strict=False)}


def _variables(posterior: "xarray.Dataset", chains: slice | np.ndarray) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """Yield the paths and the draws of each variable, chain by chain."""
    for name, variable in posterior.data_vars.items():
        if variable.dims == ("chain", "draw"):
            paths = variable.attrs.get("paths")
            own = tuple(map(str, json.loads(paths))) if paths else (str(name),)
            yield own, np.asarray(variable.values, float)[chains].ravel()


def _best(path: str | Path) -> tuple[slice | np.ndarray, str]:
    """Return the chains about the best optimum, and a remark if there are others."""
    try:
        optimum = np.asarray(read_group(path, "sample_stats")["optimum"].values)
    except (OSError, ValueError, KeyError):
        return slice(None), ""
    best = optimum == optimum.min()
    return best, "" if best.all() else BEST_ONLY
