"""WAV files, by scipy: whole numbers become shares of full scale, which a sensitivity converts to quantities."""

import io
import warnings
from pathlib import Path
from typing import Literal

import numpy as np

from ident.errors import require
from ident.measure.recordings.recording import Channel, Contents, damaged
from ident.text import one_line

KIND = "a WAV file"


def read(path: Path, data: bytes) -> Contents:
    """Return the channels of a WAV file, named 1, 2, ..., without unit; skip further chunks."""
    from scipy.io import wavfile

    order: Literal["little", "big"] = "big" if data.startswith(b"RIFX") else "little"
    promised = int.from_bytes(data[4:8], order) + 8
    if len(data) < promised - 1 and not data.startswith(b"RF64"):  # the last byte may be a missing padding byte
        damaged(path, KIND, f"{len(data)} of {promised} bytes")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", wavfile.WavFileWarning)
            warnings.filterwarnings("ignore", "Chunk .* not understood", wavfile.WavFileWarning)
            rate, samples = wavfile.read(io.BytesIO(data))
            table = np.asarray(samples).reshape(len(samples), -1 if len(samples) else 1).T
    except Exception as error:  # scipy lets ValueError, struct and EOF errors, and its warnings, through
        damaged(path, KIND, error)
    for got, fine in (("no sample", table.size), ("a sampling rate of 0 Hz", rate)):
        require(fine, one_line(str(path)), got, "samples at a rate above 0 Hz", "export it again")
    if table.dtype.kind != "f":  # shares of full scale
        middle = 128.0 if table.dtype.kind == "u" else 0.0
        table = (table - middle) / (-float(np.iinfo(table.dtype).min) or 128.0)
    return tuple(Channel(str(i), row[None].astype(float), "", 1 / rate) for i, row in enumerate(table, 1)), (), {}
