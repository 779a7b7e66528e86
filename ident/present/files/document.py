"""Result files as JSON (what a result was made from and how, its main numbers, all of it) and netCDF; PNG, PDF."""

import hashlib
import json
import math
import os
import platform
import shutil
import subprocess
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, is_dataclass
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import version
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.errors import InputError, ModelError, Problem
from ident.files import replace_file
from ident.measure.recordings.hdf5 import leads_away
from ident.text import LARGEST_BINARY, one_line, quoted, read_bytes
from ident.text import decode as decode_text

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure

LIBRARIES = ("ident-arm", "jax", "optimistix", "emcee", "arviz", "diffrax", "ruckig", "xarray", "numpy", "scipy")
EXPECTED = "a result file of ident (.json or .nc)"
RERUN = "run the command again; files of older versions are not read"
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


def digest(encoded: Any) -> str:
    """Return a hash of a result as `ident.codec` has written it: one that was changed by hand is no result of ident."""
    return hashlib.sha256(json.dumps(encoded, allow_nan=False).encode()).hexdigest()


def check_digest(said: Any, encoded: Any, path: str | Path) -> None:
    """Refuse a result that is not as it was written; files without a hash are taken as they are.

    Raises:
        InputError: it has changed.
    """
    if said not in (None, digest(encoded)):
        got = "a result that was changed after ident wrote it"
        raise InputError(Problem(one_line(str(path)), got, EXPECTED, "run the command again"))


def read_document(path: str | Path, expected: str) -> dict[str, Any]:
    """Return what a result file says."""
    where = one_line(str(path))
    try:
        document = json.loads(decode_text(read_bytes(path, expected, LARGEST_BINARY), where), object_pairs_hook=_once)
        if not isinstance(document, dict) or not isinstance(document.get("format"), str):
            raise ValueError
    except (ValueError, RecursionError):
        remedy = "give the file that ident wrote"
        raise InputError(Problem(where, "other contents", expected, remedy)) from None
    return document


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return pairs as a mapping; a name that is given twice means two things."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        raise ValueError
    return mapping


def read_result(path: str | Path) -> tuple[str, Any, Mapping[str, np.ndarray]]:
    """Return the format of a result file, the result as `ident.codec` has written it, and the arrays apart from it."""
    if Path(path).suffix == ".nc":
        return read_netcdf_result(path)
    document = read_document(path, EXPECTED)
    if "result" in document:
        check_digest(document.get("result_sha256"), document["result"], path)
    return document["format"], document.get("result"), {}


def check_format(form: str, wanted: str, where: str, expected: str) -> None:
    """Refuse the result of another study or version."""
    if form != wanted:
        study = wanted.removeprefix("ident-").partition("/")[0]
        old = form.startswith(f"ident-{study}/")
        remedy = RERUN if old else f"give the file that ident {study} wrote"
        raise InputError(Problem(where, f"the format {quoted(form)}", expected, remedy))


def plain(value: Any) -> Any:
    """Return a value as JSON knows it; infinite and undefined numbers become null."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "dtype"):
        return plain(np.asarray(value).tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Path):
        return str(value)
    return plain(asdict(value)) if is_dataclass(value) and not isinstance(value, type) else value


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


# -------- netCDF
# Result files as netCDF: arrays that other tools read, and in a group of its own the result to load again.

GROUP = "ident"
"""Group of the result: its fields as JSON, and what of them are large arrays."""
TREE = "tree"
PACKED = {"zlib": True, "complevel": 4}
"""How large variables are compressed."""
MOST_BYTES = 4_000_000_000
"""Bytes of a group's variables: ten times a million draws of fifty unknowns."""


def write_netcdf_result(
    form: str, encoded: Any, arrays: Mapping[str, np.ndarray], path: Path, groups: "Mapping[str, xarray.Dataset]"
) -> None:
    """Write a result with what other tools read beside it, whole or not at all.

    HDF5 writes into memory: where a disk is full it does not survive its own error.

    Args:
        form: format and version.
        encoded: the result, as `ident.codec` writes it.
        arrays: the large arrays apart from it.
        path: where the file goes.
        groups: what other tools read, by name, "/" at the root; how a variable is packed, its `encoding` says.
    """
    import xarray

    tree = json.dumps(encoded, allow_nan=False, ensure_ascii=False).encode("utf-8", "surrogatepass")
    parts = {**arrays, TREE: np.frombuffer(tree, np.uint8)}
    variables = {name: ([f"{name}_{i}" for i in range(part.ndim)], part) for name, part in parts.items()}
    data = xarray.Dataset(variables, attrs={"format": form, "result_sha256": digest(encoded)})
    for name in parts:
        data[name].encoding = PACKED
    file = BytesIO()
    for i, (group, own) in enumerate({**groups, GROUP: data}.items()):
        own.to_netcdf(file, mode="a" if i else "w", group=group, engine="h5netcdf")
    replace_file(path, lambda out: out.write(file.getbuffer()), make_folders=True)


def read_netcdf_result(path: str | Path) -> tuple[str, Any, Mapping[str, np.ndarray]]:
    """Return the format of a result file, the result as `ident.codec` has written it, and the arrays apart from it."""
    file = BytesIO(read_bytes(path, EXPECTED, LARGEST_BINARY))
    with whole(path, "no result to load", EXPECTED, RERUN):
        data = read_group(file, GROUP, mask_and_scale=False)
        arrays = {str(name): part.values for name, part in data.data_vars.items()}
        tree = json.loads(arrays.pop(TREE).tobytes().decode("utf-8", "surrogatepass"))
        check_digest(data.attrs.get("result_sha256"), tree, path)
        return str(data.attrs["format"]), tree, arrays


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
        raise InputError(Problem(one_line(str(path)), got, expected, remedy)) from None


# -------- PDF
# A page as PDF, printed by a browser that is on this machine.

NAMES = ("chromium", "chromium-browser", "google-chrome")
"""Programs that print pages, the first that is found."""
FLAGS = ("--headless", "--disable-gpu", "--no-first-run", "--disable-background-networking", "--no-pdf-header-footer")
LONGEST = 120.0
"""Seconds that printing may take."""


def find_browser() -> str:
    """Return the program that prints pages.

    Raises:
        InputError: there is none on the PATH.
    """
    if program := next(filter(None, map(shutil.which, NAMES)), None):
        return program
    remedy = "install Chromium, or print the page from another browser"
    raise InputError(Problem("pdf", "no browser that prints", f"{' or '.join(NAMES)} on the PATH", remedy))


def write_pdf(page: Path, path: Path) -> None:
    """Print a page as PDF, whole or not at all.

    Raises:
        InputError: no browser, or the file can't be written.
        ModelError: the browser fails.
    """
    program = find_browser()
    as_root = ("--no-sandbox",) if hasattr(os, "geteuid") and os.geteuid() == 0 else ()  # Chromium else refuses root

    with TemporaryDirectory() as profile:
        printed = Path(profile) / "printed.pdf"
        flags = [*FLAGS, *as_root, f"--user-data-dir={profile}", f"--print-to-pdf={printed}"]
        try:
            line = [program, *flags, page.absolute().as_uri()]
            subprocess.run(line, check=True, capture_output=True, timeout=LONGEST)
            content = printed.read_bytes()
        except (subprocess.SubprocessError, OSError) as error:
            raise ModelError(f"{page} could not be printed: {program} failed ({type(error).__name__})") from None
    replace_file(path, lambda file: file.write(content))


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
