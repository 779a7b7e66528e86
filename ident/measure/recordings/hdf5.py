"""HDF5 files, MATLAB's version 7.3 among them, by h5py."""

import io
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError, refusal
from ident.files import leads_away
from ident.measure.recordings.recording import Array, Contents, array_channels, damaged
from ident.text import one_line

SIGNATURE = b"\x89HDF\r\n\x1a\n"
UNITS = ("unit", "units")
"""Attributes with the unit of a dataset."""
CONTAINER = "a cell array, a structure array or an object such as a table"
"""MATLAB's containers of vectors."""
COMPLEX = (("real", "imag"), ("r", "i"))
"""Names of the parts of a complex number, as MATLAB and others write it."""


def read(path: Path, data: bytes) -> Contents:
    """Return vectors, columns of matrices and frequency responses of an HDF5 file; those in groups as `a/b`.

    Raises:
        InputError: the file is damaged, or links to other files, which are not opened.
    """
    import h5py

    found: list[Array] = []

    def visit(name: str, item: Any) -> None:
        text = _said(item, "MATLAB_class") == "char"
        if isinstance(item, h5py.Dataset) and not text and not name.startswith("#"):  # what cells and objects refer to
            values, unit = _values(item), next(filter(None, (_said(item, unit) for unit in UNITS)), "")
            found.extend([(name, values, unit)] if values is not None else [])

    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            if away := leads_away(file):
                remedy = "export it again with all numbers in one file (h5repack)"
                name, got = map(one_line, away)
                raise refusal(one_line(str(path)), got, "a file that holds its own numbers", remedy, name)
            file.visititems(visit)
    except InputError:
        raise
    except Exception as error:  # h5py lets OSError, KeyError and RuntimeError of damaged files through
        damaged(path, "an HDF5 file", error)
    return tuple(array_channels(found)), (), {}


def _values(item: Any) -> np.ndarray | None:
    """Return the numbers of a dataset, real or complex; a text that describes any other content; None for words."""
    if "MATLAB_empty" in item.attrs:
        return None
    if "MATLAB_object_decode" in item.attrs or "ref" in (item.dtype.metadata or ()):
        return np.array(CONTAINER)
    if item.dtype.kind in "iufc":
        values = np.asarray(item[()])
    elif item.dtype.names in COMPLEX:
        real, imaginary = item.dtype.names
        pairs = item[()]
        values = np.asarray(pairs[real] + 1j * pairs[imaginary])
    else:
        return np.array("a table of records") if item.dtype.names else None
    return values.T if "MATLAB_class" in item.attrs else values  # MATLAB's axes, reversed


def _said(item: Any, name: str) -> str:
    """Return an attribute as text; empty if it is missing."""
    value = item.attrs.get(name, "")
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
