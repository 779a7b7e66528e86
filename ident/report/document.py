"""Result files: JSON, and netCDF of large arrays; PNG.

A file holds the provenance of a result (texts of the inputs, options, software), its numbers, and its report. It names
no class of the program: a later version reads it; a file of a newer version is refused in one line.
"""

import json
import math
import platform
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, is_dataclass
from datetime import UTC, datetime
from functools import cache, partial
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.errors import InputError, refusal
from ident.files import leads_away, replace_file, write_text
from ident.report.report import Finding, Report, Section, Table, Verdict, written
from ident.text import FIRST, LARGEST_BINARY, NEWEST, one_line, quoted, read_bytes, study_of
from ident.text import decode as decode_text

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

LIBRARIES = ("ident-arm", "jax", "optimistix", "emcee", "arviz", "ruckig", "xarray", "numpy", "scipy")
EXPECTED = "a result file of ident (.json or .nc)"
WIDTH = 160
"""Longest line of a file, except lines of numbers."""


def provenance(form: str, inputs: Mapping[str, Any], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the provenance of a result: the head of every result file.

    Args:
        form: format and version.
        inputs: inputs from files, with `path` and `sha256`, by name; None for inputs that were not given.
        options: in their recorded form.
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
    """Write a document completely or not at all."""
    write_text(path, _laid_out(document) + "\n")


def read_document(path: str | Path, expected: str) -> dict[str, Any]:
    """Return the content of a result file."""
    where = one_line(str(path))
    try:
        text = decode_text(read_bytes(path, expected, LARGEST_BINARY), where)
        document = json.loads(text, object_pairs_hook=_once, parse_constant=_no_number)
        if not isinstance(document, dict) or not isinstance(document.get("format"), str):
            raise ValueError
    except (ValueError, RecursionError):
        raise refusal(where, "other contents", expected, "give the file that ident wrote") from None
    return document


def _no_number(name: str) -> Any:
    raise ValueError(name)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return pairs as a mapping; a repeated name is ambiguous."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        raise ValueError
    return mapping


def read_record(path: str | Path) -> dict[str, Any]:
    """Return the record in a result file.

    Raises:
        InputError: no record, or of an unreadable version.
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
        form: the format in the file.
        study: the expected study.
        where: the file.
        expected: the expected file, in words.

    Raises:
        InputError: it does not match.
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
    """Return a value in JSON types.

    Args:
        value: numbers, text, arrays, paths, dataclasses, and containers of these.
        instead: replacement of an infinite or undefined number; null by default.
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
    """Return a value as JSON: a short value, or a row of numbers, on one line."""
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
    """Return a report in JSON types; an infinite number as the word that is printed for it."""
    return plain(report, written)


def report_of(data: Any) -> Report:
    """Return a report from the output of `report_data`.

    Raises:
        TypeError, KeyError, ValueError: the data are no report.
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
    lists = {name: tuple(map(_text, data[name])) for name in ("head", "forms")}
    rows, strong = tuple(map(tuple, data["rows"])), tuple(map(int, data["strong"]))
    if not all(isinstance(cell, str | float | int | None) for row in rows for cell in row):
        raise TypeError
    data = {name: value for name, value in data.items() if name != "links"}  # of earlier versions
    return Table(**{**data, **words, **lists, "rows": rows, "strong": strong})


# -------- netCDF
# Arrays for other tools, as netCDF; a result without a JSON file has its record in a group there.

RECORD = "ident"
"""Group, and variable, of the record as JSON."""
COMPRESSED = 1000
"""Numbers of a variable from which on it is compressed; assumed."""
MOST_BYTES = 4_000_000_000
"""Limit of a group's variables [bytes]: ten times a million draws of fifty unknowns."""


@dataclass(frozen=True)
class Variable:
    """An array of a netCDF file; a coordinate has the name of its only dimension.

    Attributes:
        dims: names of its dimensions.
        values: numbers, or texts.
        attrs: such as `units` and `long_name`.
    """

    dims: tuple[str, ...]
    values: Any
    attrs: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Group:
    """What a group of a netCDF file holds: the part of an `xarray.Dataset` that is written."""

    variables: Mapping[str, Variable]
    attrs: Mapping[str, Any] = field(default_factory=dict)


def write_netcdf(
    path: Path, groups: "Mapping[str, Group | xarray.Dataset]", record: Mapping[str, Any] | None = None
) -> None:
    """Write arrays for other tools, completely or not at all.

    HDF5 writes into memory: on a full disk it does not survive its own error. h5netcdf alone loads faster than
    xarray, which brings pandas.

    Args:
        path: path of the file.
        groups: the arrays by group, "/" at the root.
        record: the result's own, unless another file holds it.
    """
    import h5netcdf

    if record is not None:
        text = json.dumps(record, allow_nan=False, ensure_ascii=False).encode("utf-8", "surrogatepass")
        groups = {**groups, RECORD: Group({RECORD: Variable(("byte",), np.frombuffer(text, np.uint8))})}
    memory = BytesIO()
    with h5netcdf.File(memory, "w") as file:
        for name, group in groups.items():
            _write_group(file if name == "/" else file.create_group(name), group)
    replace_file(path, lambda out: out.write(memory.getbuffer()), make_folders=True)


def _write_group(place: Any, group: "Group | xarray.Dataset") -> None:
    import h5py

    place.attrs.update(group.attrs)
    for name, variable in group.variables.items():
        values = np.asarray(variable.values)
        place.dimensions.update(
            {d: n for d, n in zip(variable.dims, values.shape, strict=True) if d not in place.dimensions}
        )
        kind = h5py.string_dtype() if values.dtype.kind in "OU" else values.dtype
        packing = {"compression": "gzip", "compression_opts": 4} if values.size > COMPRESSED else {}
        made = place.create_variable(name, variable.dims, kind, **packing)
        made[...] = values
        made.attrs.update(variable.attrs)


def groups_in(file: BytesIO) -> tuple[str, ...]:
    """Return the groups of a netCDF file."""
    import h5py

    with h5py.File(file, "r") as opened:
        return tuple(opened)


def is_of_ident(path: str | Path) -> bool:
    """Whether ident has written a netCDF file; an unreadable file may well be one."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return "format" in file.attrs
    except Exception:  # any error of a damaged file: its reader reports it
        return True


def read_group(file: "str | Path | BytesIO", group: str | None = None, **how: Any) -> "xarray.Dataset":
    """Return a group of a netCDF file with all its variables; a few bytes may claim more than there is memory for.

    Raises:
        ValueError: it links to another file, or its variables are larger than `MOST_BYTES`; besides, any error of the
            libraries.
    """
    import h5netcdf
    import h5py
    import xarray

    h5netcdf.File._writable = False  # for one that it fails to open: h5netcdf asks for this on deletion
    with h5py.File(file, "r") as opened:  # any other file is refused here: h5netcdf would not fail quietly
        if away := leads_away(opened):
            raise ValueError(f"{away[0]}: {away[1]}")
    with xarray.open_dataset(file, group=group, engine="h5netcdf", **how) as data:
        if data.nbytes > MOST_BYTES:
            raise ValueError(f"{data.nbytes / 1e9:.3g} GB of numbers")
        return data.load()


@contextmanager
def whole(path: str | Path, got: str, expected: str, remedy: str) -> Iterator[None]:
    """Refuse a file if reading it fails inside this context: h5py and xarray raise anything for a damaged file.

    Raises:
        InputError: reading fails.
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
    """Write a figure as PNG, completely or not at all; like `Figure.savefig`, which draws it twice."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure.set_dpi(DPI)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        titled = partial(FigureCanvasAgg(figure).print_png, metadata={"Title": figure.get_suptitle()})
        replace_file(path, titled, make_folders=True)
