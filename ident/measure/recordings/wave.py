"""WAV files, by scipy: whole numbers become shares of full scale, which a sensitivity makes quantities of."""

import io
import warnings
from pathlib import Path

import numpy as np

from ident.measure.recordings.recording import Channel, Contents, damaged


def read(path: Path, data: bytes) -> Contents:
    """Return the channels of a WAV file, named 1, 2, ..., without unit."""
    from scipy.io import wavfile

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", wavfile.WavFileWarning)
            rate, samples = wavfile.read(io.BytesIO(data))
    except Exception as error:  # scipy lets ValueError, struct and EOF errors, and its warnings, through
        damaged(path, "a WAV file", error)
    table = np.asarray(samples).reshape(len(samples), -1).T
    return tuple(Channel(str(i), _share(row)[None], "", 1 / rate) for i, row in enumerate(table, 1)), (), {}


def _share(samples: np.ndarray) -> np.ndarray:
    """Return samples as shares of full scale; floats are taken as they are."""
    if samples.dtype.kind == "f":
        return samples.astype(float)
    middle = 128.0 if samples.dtype.kind == "u" else 0.0
    return (samples - middle) / (-float(np.iinfo(samples.dtype).min) or 128.0)
