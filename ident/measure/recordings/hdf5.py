"""HDF5 files, MATLAB's version 7.3 among them, by h5py."""

import io
from pathlib import Path
from typing import Any

from ident.measure.recordings.recording import Channel, Contents, columns, damaged

SIGNATURE = b"\x89HDF\r\n\x1a\n"
UNITS = ("unit", "units")
"""Attributes that say the unit of a dataset."""


def read(path: Path, data: bytes) -> Contents:
    """Return the vectors, and the columns of matrices, of an HDF5 file; those in groups by `a/b`."""
    import h5py

    found: list[Channel] = []

    def visit(name: str, item: Any) -> None:
        text = _said(item, "MATLAB_class") in ("char", "cell")
        if isinstance(item, h5py.Dataset) and item.dtype.kind in "iuf" and not text and "#refs#" not in name:
            found.extend(columns(name, item[()], unit=next(filter(None, (_said(item, unit) for unit in UNITS)), "")))

    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            file.visititems(visit)
    except Exception as error:  # h5py lets OSError, KeyError and RuntimeError of damaged files through
        damaged(path, "an HDF5 file", error)
    return tuple(found), (), {}


def _said(item: Any, name: str) -> str:
    """Return what an attribute says, empty where there is none."""
    value = item.attrs.get(name, "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
