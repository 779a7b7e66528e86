"""Result files: JSON, and netCDF of large arrays; PNG.

A file holds what a result was made from and how (texts of the inputs, options, software), its numbers, and its report.
It names no class of the program: a later version reads it, a newer one is refused in one line.
"""

import json
import math
import platform
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.errors import InputError, refusal
from ident.files import leads_away, replace_file
from ident.report.report import Finding, Report, Section, Table, Verdict, written
from ident.text import LARGEST_BINARY, one_line, quoted, read_bytes, study_of
from ident.text import decode as decode_text

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

LIBRARIES = ("ident-arm", "jax", "optimistix", "emcee", "arviz", "ruckig", "xarray", "numpy", "scipy")
EXPECTED = "a result file of ident (.json or .nc)"
FIRST, NEWEST = 10, 10
"""Versions of all formats that are read, the newest of which is written; those before named classes."""
WIDTH = 160
"""Longest line of a file, but for those of numbers."""


def provenance(form: str, inputs: Mapping[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Say what a result was made from, with what and how: the head of every result file.

    Args:
        form: format and version.
        inputs: what came from files, with `path` and `sha256`, by name; None for what was not given.
        options: as they are recorded.
    """
    sources = {
        name: None if source is None else {"path": source.path, "sha256": source.sha256}
        for name, source in inputs.items()
    }
    return {
        "format": form,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": _versions() | {"python": platform.python_version()},
        "options": plain(options),
        "inputs": sources,
    }


@cache
def _versions() -> dict[str, str]:
    return {name.removesuffix("-arm"): version(name) for name in LIBRARIES}


def write_json(document: Mapping[str, Any], path: Path) -> None:
    """Write a document whole or not at all."""
    text = _laid_out(document) + "\n"
    replace_file(path, lambda file: file.write(text.encode("utf-8", "backslashreplace")), make_folders=True)


def read_document(path: str | Path, expected: str) -> dict[str, Any]:
    """Return what a result file says."""
    where = one_line(str(path))
    try:
        text = decode_text(read_bytes(path, expected, LARGEST_BINARY), where)
        document = json.loads(text, object_pairs_hook=_once, parse_constant=_no_number)
        if not isinstance(document, dict) or not isinstance(document.get("format"), str):
            raise ValueError
    except (ValueError, RecursionError):
        remedy = "give the file that ident wrote"
        raise refusal(where, "other contents", expected, remedy) from None
    return document


def _no_number(name: str) -> Any:
    raise ValueError(name)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return pairs as a mapping; a name that is given twice means two things."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        raise ValueError
    return mapping


def read_record(path: str | Path) -> dict[str, Any]:
    """Return the record that a result file holds.

    Raises:
        InputError: it is none, or of a version that is not read.
    """
    where = one_line(str(path))
    if Path(path).suffix == ".nc":
        file = BytesIO(read_bytes(path, EXPECTED, LARGEST_BINARY))
        with whole(path, "no result to load", EXPECTED, "give the file that ident wrote"):
            if RECORD not in groups_in(file):
                root = str(json.loads(read_group(file).attrs["format"]))
                check_version(root, study_of(root), where)
                beside = one_line(Path(path).with_suffix(".json").name)
                got, remedy = f"the arrays of a result ({root})", f"load {beside} beside it"
                raise refusal(where, got, EXPECTED, remedy)
            data = read_group(file, RECORD, mask_and_scale=False)
            record: dict[str, Any] = json.loads(data[RECORD].values.tobytes().decode("utf-8", "surrogatepass"))
            form = str(record["format"])
    else:
        record = read_document(path, EXPECTED)
        form = record["format"]
    check_version(form, study_of(form), where)
    return record


def check_version(form: str, study: str, where: str, expected: str = EXPECTED) -> None:
    """Refuse the result of another study, of a version before `FIRST`, and of one after `NEWEST`.

    Args:
        form: the format that a file says.
        study: whose it shall be.
        where: the file.
        expected: what it shall be, in words.

    Raises:
        InputError: it is not.
    """
    number = form.rpartition("/")[2]
    known = form.startswith(f"ident-{study}/") and number.isdecimal() and len(number) < 6
    if known and FIRST <= int(number) <= NEWEST:
        return
    remedy = f"give the file that ident {study} wrote"
    if known:
        remedy = "update ident" if int(number) > NEWEST else f"run ident {study} again: files of this age are not read"
    raise refusal(where, f"the format {quoted(form)}", expected, remedy)


def plain(value: Any, instead: Callable[[float], str | None] = lambda number: None) -> Any:
    """Return a value as JSON knows it.

    Args:
        value: numbers, text, arrays, paths, dataclasses, and containers of these.
        instead: what stands for an infinite or undefined number; null by default.
    """
    if isinstance(value, Mapping):
        return {key: plain(item, instead) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item, instead) for item in value]
    if hasattr(value, "dtype"):
        return plain(np.asarray(value).tolist(), instead)
    if isinstance(value, float):
        return value if math.isfinite(value) else instead(value)
    if isinstance(value, Path):
        return str(value)
    return plain(asdict(value), instead) if is_dataclass(value) and not isinstance(value, type) else value


def _laid_out(value: Any, indent: str = "") -> str:
    """Return a value as JSON: what is short, and a row of numbers, on one line."""
    inner = indent + " "
    if isinstance(value, Mapping):
        parts = [f"{_laid_out(key)}: {_laid_out(item, inner)}" for key, item in value.items()]
        opening, closing = "{}"
    elif isinstance(value, list) and any(isinstance(item, list | Mapping) for item in value):
        parts = [_laid_out(item, inner) for item in value]
        opening, closing = "[]"
    else:
        return json.dumps(value, allow_nan=False, ensure_ascii=False)
    line = ", ".join(parts)
    if len(line) + len(indent) < WIDTH and "\n" not in line:
        return f"{opening}{line}{closing}"
    return f"{opening}\n{inner}" + f",\n{inner}".join(parts) + f"\n{indent}{closing}"


# -------- Reports
# A report as plain data and back, so that any width, the first screen or the details can be printed later.


def report_data(report: Report) -> Any:
    """Return a report as JSON knows it; an infinite number in the word that is printed for it."""
    return plain(report, written)


def report_of(data: Any) -> Report:
    """Return the report that `report_data` has written.

    Raises:
        TypeError, KeyError, ValueError: it is none.
    """
    verdict = Verdict(**_texts(data["verdict"])) if data["verdict"] is not None else None  # type: ignore[arg-type]
    findings = tuple(Finding(**_texts(each)) for each in data["findings"])
    details = tuple(Section(_text(each["title"]), _parts(each["parts"])) for each in data["details"])
    subject, remark, following = (_text(data[name]) for name in ("subject", "remark", "next"))
    return Report(subject, verdict, _parts(data["answer"]), findings, remark, following, details)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


def _texts(data: Mapping[str, Any]) -> dict[str, str]:
    return {name: _text(value) for name, value in data.items()}


def _parts(parts: Any) -> tuple[str | Table, ...]:
    return tuple(part if isinstance(part, str) else _table(part) for part in parts)


def _table(data: Mapping[str, Any]) -> Table:
    words = _texts({name: data[name] for name in ("caption", "note")})
    lists = {name: tuple(map(_text, data[name])) for name in ("head", "forms", "links")}
    rows, strong = tuple(map(tuple, data["rows"])), tuple(map(int, data["strong"]))
    if not all(isinstance(cell, str | float | int | None) for row in rows for cell in row):
        raise TypeError
    return Table(**{**data, **words, **lists, "rows": rows, "strong": strong})


# -------- netCDF
# Arrays that other tools read, as netCDF; where a result has no JSON file beside it, its record is a group of its own.

RECORD = "ident"
"""Group, and variable, of the record as JSON."""
PACKED = {"zlib": True, "complevel": 4}
"""How large variables are compressed."""
MOST_BYTES = 4_000_000_000
"""Bytes of a group's variables: ten times a million draws of fifty unknowns."""


def write_netcdf(path: Path, groups: "Mapping[str, xarray.Dataset]", record: Mapping[str, Any] | None = None) -> None:
    """Write arrays for other tools, whole or not at all.

    HDF5 writes into memory: where a disk is full it does not survive its own error.

    Args:
        path: where the file goes.
        groups: the arrays by group, "/" at the root; how a variable is packed, its `encoding` says.
        record: the result's own, where no other file holds it.
    """
    import xarray

    if record is not None:
        text = json.dumps(record, allow_nan=False, ensure_ascii=False).encode("utf-8", "surrogatepass")
        data = xarray.Dataset({RECORD: ("byte", np.frombuffer(text, np.uint8))})
        data[RECORD].encoding = PACKED
        groups = {**groups, RECORD: data}
    file = BytesIO()
    for i, (group, own) in enumerate(groups.items()):
        own.to_netcdf(file, mode="a" if i else "w", group=group, engine="h5netcdf")
    replace_file(path, lambda out: out.write(file.getbuffer()), make_folders=True)


def groups_in(file: BytesIO) -> tuple[str, ...]:
    """Return the groups of a netCDF file."""
    import h5py

    with h5py.File(file, "r") as opened:
        return tuple(opened)


def is_of_ident(path: str | Path) -> bool:
    """Tell whether ident has written a netCDF file; what can't be read may well be one."""
    try:
        return "format" in read_group(path).attrs
    except Exception:  # whatever the bytes of a damaged file lead to: who reads it says so
        return True


def read_group(file: "str | Path | BytesIO", group: str | None = None, **how: Any) -> "xarray.Dataset":
    """Return a group of a netCDF file with all its variables; a few bytes may claim more than there is memory for.

    Raises:
        ValueError: it leads to another file, or its variables are larger than `MOST_BYTES`; besides, whatever the
            libraries raise.
    """
    import h5netcdf
    import h5py
    import xarray

    h5netcdf.File._writable = False  # of one that it fails to open, and asks for this when that is thrown away
    with h5py.File(file, "r") as opened:  # what is no such file at all ends here: in h5netcdf it would not end quietly
        if away := leads_away(opened):
            raise ValueError(f"{away[0]}: {away[1]}")
    with xarray.open_dataset(file, group=group, engine="h5netcdf", **how) as data:
        if data.nbytes > MOST_BYTES:
            raise ValueError(f"{data.nbytes / 1e9:.3g} GB of numbers")
        return data.load()


@contextmanager
def whole(path: str | Path, got: str, expected: str, remedy: str) -> Iterator[None]:
    """Refuse a file in which reading fails within: damaged, h5py and xarray raise whatever its bytes lead to.

    Raises:
        InputError: it does.
    """
    try:
        yield
    except InputError:
        raise
    except Exception:
        raise refusal(one_line(str(path)), got, expected, remedy) from None


# -------- PNG
# Figures as PNG files.

DPI = 130


def save(figure: "Figure", path: Path) -> None:
    """Write a figure as PNG, whole or not at all; what `Figure.savefig` writes, which draws it twice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(DPI)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        replace_file(path, FigureCanvasAgg(figure).print_png, make_folders=True)
