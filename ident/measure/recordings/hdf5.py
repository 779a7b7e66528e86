"""HDF5 files, MATLAB's version 7.3 among them, by h5py."""

import io
from pathlib import Path
from typing import Any

from ident.measure.recordings.recording import Channel, Contents, columns, damaged, lacking

SIGNATURE = b"\x89HDF\r\n\x1a\n"
UNITS = ("unit", "units")
"""Attributes that say the unit of a dataset."""


def read(path: Path, data: bytes) -> Contents:
    """Return the vectors, and the columns of matrices, of an HDF5 file; those in groups by `a/b`."""
    try:
        import h5py
    except ImportError:
        lacking(path, "h5py")
    found: list[Channel] = []

    def visit(name: str, item: Any) -> None:
        text = item.attrs.get("MATLAB_class") in (b"char", b"cell")
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and not text and "#refs#" not in name:
            found.extend(columns(name, item[()], unit=_unit(item)))

    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            file.visititems(visit)
    except Exception as error:  # h5py lets OSError, KeyError and RuntimeError of damaged files through
        damaged(path, "an HDF5 file", error)
    return tuple(found), (), {}


def _unit(item: Any) -> str:
    """Return the unit that an attribute says, empty where none does."""
    value = next((item.attrs[name] for name in UNITS if name in item.attrs), "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
