"""WAV files, by scipy: whole numbers become shares of full scale, which a sensitivity makes quantities of."""

import io
import warnings
from pathlib import Path
from typing import Literal

import numpy as np

from ident.errors import refusal
from ident.measure.recordings.recording import Channel, Contents, damaged
from ident.text import one_line

KIND = "a WAV file"


def read(path: Path, data: bytes) -> Contents:
    """Return the channels of a WAV file, named 1, 2, ..., without unit; further chunks are passed over."""
    from scipy.io import wavfile

    order: Literal["little", "big"] = "big" if data.startswith(b"RIFX") else "little"
    promised = int.from_bytes(data[4:8], order) + 8
    if len(data) < promised - 1 and not data.startswith(b"RF64"):  # the last byte may be padding that was left out
        damaged(path, KIND, f"{len(data)} of {promised} bytes")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", wavfile.WavFileWarning)
            warnings.filterwarnings("ignore", "Chunk .* not understood", wavfile.WavFileWarning)
            rate, samples = wavfile.read(io.BytesIO(data))
            table = np.asarray(samples).reshape(len(samples), -1 if len(samples) else 1).T
    except Exception as error:  # scipy lets ValueError, struct and EOF errors, and its warnings, through
        damaged(path, KIND, error)
    for got, wrong in (("no sample", not table.size), ("a sampling rate of 0 Hz", not rate)):
        if wrong:
            raise refusal(one_line(str(path)), got, "samples at a rate above 0 Hz", "export it again")
    return tuple(Channel(str(i), _share(row)[None], "", 1 / rate) for i, row in enumerate(table, 1)), (), {}


def _share(samples: np.ndarray) -> np.ndarray:
    """Return samples as shares of full scale; floats are taken as they are."""
    if samples.dtype.kind == "f":
        return samples.astype(float)
    middle = 128.0 if samples.dtype.kind == "u" else 0.0
    return (samples - middle) / (-float(np.iinfo(samples.dtype).min) or 128.0)
