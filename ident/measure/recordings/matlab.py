"""MATLAB files: version 5 by scipy, version 7.3, which is HDF5, as such."""

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ident.measure.recordings import hdf5
from ident.measure.recordings.recording import Channel, Contents, columns, damaged


def read(path: Path, data: bytes) -> Contents:
    """Return the vectors, and the columns of matrices, of a MATLAB file; those in structures by `a.b`."""
    from scipy.io import loadmat

    if data[512:520] == hdf5.SIGNATURE or data.startswith(hdf5.SIGNATURE):
        return hdf5.read(path, data)
    try:
        variables = loadmat(io.BytesIO(data), simplify_cells=True)
    except Exception as error:  # scipy lets errors of zlib, struct and its own through
        damaged(path, "a MATLAB file", error)
    named = [(name, value) for name, value in variables.items() if not name.startswith("__")]
    return tuple(channel for name, value in named for channel in _channels(name, value)), (), {}


def _channels(name: str, value: Any) -> Iterator[Channel]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _channels(f"{name}.{key}", inner)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
        yield from columns(name, value)
