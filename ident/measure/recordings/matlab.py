"""MATLAB files: version 5 by scipy, version 7.3, which is HDF5, as such."""

import io
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from ident.measure.recordings import hdf5
from ident.measure.recordings.recording import Contents, array_channels, damaged
from ident.text import one_line

Vectors = list[tuple[str, np.ndarray]]
"""Arrays of a file by their names."""
HEAD, COMPRESSED = 128, 15
"""Bytes before the first variable, and the type of a compressed variable, which has a checksum."""
ASIDE = "import sys; from ident.measure.recordings import matlab; matlab.pass_on(sys.stdin.buffer, sys.stdout.buffer)"


def read(path: Path, data: bytes) -> Contents:
    """Return vectors, columns of matrices and frequency responses of a MATLAB file; those in structures as `a.b`."""
    if data[512:520] == hdf5.SIGNATURE or data.startswith(hdf5.SIGNATURE):
        return hdf5.read(path, data)
    try:
        found = vectors(data) if _has_checksums(data) else _aside(data)
    except ValueError as error:
        damaged(path, "a MATLAB file", str(error))
    return tuple(array_channels((name, value, "") for name, value in found)), (), {}


def vectors(data: bytes) -> Vectors:
    """Return the numeric arrays in a file of version 5; other content is described in a text.

    Raises:
        ValueError: scipy can't read it.
    """
    from scipy.io import loadmat

    try:
        variables = loadmat(io.BytesIO(data), simplify_cells=True)
    except Exception as error:  # scipy lets errors of zlib, struct and its own through
        raise ValueError(f"{type(error).__name__}: {one_line(str(error))[:80]}") from None
    named = [(name, value) for name, value in variables.items() if not name.startswith("__")]
    return [leaf for name, value in named for leaf in _leaves(name, value)]


def pass_on(source: IO[bytes], target: IO[bytes]) -> None:
    """Read a file and write its arrays as a NumPy archive; on an error, end with a line that describes it."""
    try:
        found = vectors(source.read())
    except ValueError as error:
        sys.exit(str(error))
    out = io.BytesIO()
    np.savez(out, np.array([name for name, _ in found], str), *[value for _, value in found])
    target.write(out.getvalue())


def _aside(data: bytes) -> Vectors:
    """Read a file in a separate process, since flipped bits may crash scipy's reader.

    It searches modules where this process does, but not in the current folder, which may hold recordings of others.

    Raises:
        ValueError: scipy crashes or can't read the file.
    """
    here = os.path.realpath(os.curdir)
    path = [*(each for each in sys.path if os.path.realpath(each) != here), str(Path(__file__).parents[3])]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path)}
    words = [sys.executable, "-P", "-c", ASIDE]
    done = subprocess.run(words, input=data, capture_output=True, env=environment, check=False)
    if done.returncode:
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()
        raise ValueError(said[-1][:100] if said and done.returncode > 0 else "scipy's reader crashes")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as kept:
        names, *values = (kept[key] for key in kept.files)
    return list(zip(names.tolist(), values, strict=True))


def _has_checksums(data: bytes) -> bool:
    """Whether all variables of the file are compressed."""
    order, at = "little" if data[126:128] == b"IM" else "big", HEAD
    while at < len(data):
        kind, size = (int.from_bytes(data[at + i : at + i + 4], order) for i in (0, 4))  # type: ignore[arg-type]
        if kind != COMPRESSED:
            return False
        at += 8 + size
    return True


def _leaves(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _leaves(f"{name}.{key}", inner)
    elif isinstance(value, np.ndarray) and value.dtype.kind in "iufc":
        yield name, value
    elif not np.isscalar(value) and not all(isinstance(each, str) for each in np.ravel(np.array(value, object))):
        yield name, np.array(hdf5.CONTAINER)
