"""HDF5 files, MATLAB's version 7.3 among them, by h5py."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError, Problem
from ident.measure.recordings.recording import Contents, array_channels, damaged
from ident.text import one_line

SIGNATURE = b"\x89HDF\r\n\x1a\n"
UNITS = ("unit", "units")
"""Attributes that say the unit of a dataset."""
COMPLEX = (("real", "imag"), ("r", "i"))
"""Names of the parts of a complex number, as MATLAB and others write it."""


def read(path: Path, data: bytes) -> Contents:
    """Return vectors, columns of matrices and frequency responses of an HDF5 file; those in groups by `a/b`.

    Raises:
        InputError: the file is damaged, or leads to other files, which are not opened.
    """
    import h5py

    found: list[tuple[str, np.ndarray, str]] = []

    def visit(name: str, item: Any) -> None:
        if not isinstance(item, h5py.Dataset):
            return
        _check_own(path, name, item)
        text = _said(item, "MATLAB_class") in ("char", "cell")
        if not text and "#refs#" not in name and (values := _values(item)) is not None:
            found.append((name, values, next(filter(None, (_said(item, unit) for unit in UNITS)), "")))

    def away(name: bytes, link: Any) -> bytes | None:  # what it raised, h5py would turn into an error of its own
        own = link.type in (h5py.h5l.TYPE_HARD, h5py.h5l.TYPE_SOFT)  # a soft one is of this file, and is not followed
        return None if own else name

    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            if (name := file.id.links.visit(away, info=True)) is not None:
                _leads_away(path, name.decode("utf-8", "replace"), "a link to another file")
            file.visititems(visit)
    except InputError:
        raise
    except Exception as error:  # h5py lets OSError, KeyError and RuntimeError of damaged files through
        damaged(path, "an HDF5 file", error)
    return tuple(array_channels(found)), (), {}


def _check_own(path: Path, name: str, item: Any) -> None:
    """Refuse a dataset whose numbers lie in another file, before one is read: it could be any file of the machine."""
    if item.id.get_create_plist().get_external_count():
        _leads_away(path, name, "numbers stored in another file")
    if item.is_virtual and any(source.file_name != "." for source in item.virtual_sources()):
        _leads_away(path, name, "numbers of another file (a virtual dataset)")


def _leads_away(path: Path, name: str, got: str) -> None:
    remedy = "export it again with all numbers in one file (h5repack)"
    raise InputError(Problem(one_line(str(path)), got, "a file that holds its own numbers", remedy, one_line(name)))


def _values(item: Any) -> np.ndarray | None:
    """Return the numbers of a dataset, real or complex ones; None where it holds others."""
    if item.dtype.kind in "iufc":
        values = np.asarray(item[()])
    elif item.dtype.names in COMPLEX:
        real, imaginary = item.dtype.names
        pairs = item[()]
        values = np.asarray(pairs[real] + 1j * pairs[imaginary])
    else:
        return None
    return values.T if values.dtype.kind == "c" and "MATLAB_class" in item.attrs else values  # MATLAB's axes, reversed


def _said(item: Any, name: str) -> str:
    """Return what an attribute says, empty where there is none."""
    value = item.attrs.get(name, "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
