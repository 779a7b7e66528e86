"""Broken inputs, drawn from a seed: texts, bytes, documents and options, each some mistakes from a good one."""

import copy
import re
import struct
from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

NUMBERS = (
    *("", "0", "-0", "-1", "1", "2", "0.5", "1e-12", "1e-300", "-1e-300", "5e-324", "1e15", "1e300", "-1e300"),
    *("1e999", "nan", "-nan", "inf", "-inf", "1_000", "1,5", "1.2.3", "0x10", "1e", "٣", "1" * 400, "abc", "1%", "½"),
)
"""What stands where a number is meant."""
WORDS = (
    *("", " ", "abc", "#", "#N/A", "''", '"', '"a\nb"', "é" * 300, "x" * 5000, "\0", "\ufeff", "\u202e", "\x1b[31m"),
    *(
        "[",
        "]",
        "{",
        "}",
        "[[",
        "=",
        ";",
        ",",
        "\t",
        "true",
        "null",
        "../..",
        "$(ls)",
        "%s",
        "own weight",
        "1 kg @ tip",
    ),
)
"""What stands where a word is meant."""
VALUES = (
    *(None, True, False, 0, -1, 1e-300, 1e300, 10**400, "", "x", "nan", "7e5", [], {}, [[]], [1], ["a"], [None]),
    *({"a": 1}, {"class": "arm.arm:Arm"}, {"class": "os:system"}, {"same": 1}, {"numpy": [1, [2]]}, {"float": "x"}),
)
"""What stands where a document has something else."""
ARRAYS = (
    *(np.zeros(0), np.zeros(64), np.full(64, np.nan), np.full(64, np.inf), np.ones(63), np.ones((64, 2)), np.ones(1)),
    *(np.ones((2, 3, 4)), np.arange(64), np.arange(64) % 2 == 1, np.exp(1j * np.arange(64)), np.full(64, 1e300)),
    *(1.0, np.nan, "text", "", ["a", "b"], {"x": np.ones(64)}, np.array([1.0, "a"], object), np.array([], object)),
    *(np.arange(64)[::-1] / 200.0, np.zeros((0, 64)), np.full(64, -1e300), np.arange(64, dtype=np.uint8)),
)
"""What stands in a file of arrays where 64 samples are meant."""
PROPERTIES = (*(0.0, -1.0, float("nan"), float("inf"), 1e300, 1e30, 5e-324, 1, 10**9, "", "x", "0.005", "m/s2"), True)
"""What stands where a channel's step, start or unit is meant."""
NUMBER, WORD = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"), re.compile(r"[A-Za-z_]+")


def broken_texts(rng: np.random.Generator, text: str, count: int) -> Iterator[bytes]:
    """Yield texts that are one to three mistakes from a good one."""
    for _ in range(count):
        broken = text
        for _ in range(rng.integers(1, 4)):
            broken = _MISTAKES[rng.integers(len(_MISTAKES))](rng, broken)
        yield broken.encode("utf-8", "surrogatepass") if rng.random() < 0.95 else broken.encode("utf-16")


def broken_bytes(rng: np.random.Generator, data: bytes, count: int) -> Iterator[bytes]:
    """Yield bytes of which some bits are flipped, or the end or a part is missing."""
    for i in range(count):
        broken = bytearray(data)
        if i % 4 == 3:
            start, end = sorted(rng.integers(0, len(data), 2))
            broken = broken[:start] + (broken[end:] if i % 8 == 7 else bytearray())
        else:
            for place in rng.integers(0, len(data), rng.integers(1, 20)):
                broken[place] ^= 1 << rng.integers(8)
        yield bytes(broken)


def broken_documents(rng: np.random.Generator, document: Any, count: int) -> Iterator[Any]:
    """Yield documents in which something, high up or deep, is another value, or missing."""
    for _ in range(count):
        broken = copy.deepcopy(document)
        holder, key = _some_place(rng, broken)
        if rng.random() < 0.2:
            del holder[key]
        else:
            holder[key] = copy.deepcopy(VALUES[rng.integers(len(VALUES))])
        yield broken


def damaged(rng: np.random.Generator, document: Any, count: int) -> Iterator[Any]:
    """Yield documents in which one place, each as likely as any other, is another value, or missing."""
    for _ in range(count):
        broken = copy.deepcopy(document)
        holder, key = pick(rng, list(_places(broken)))
        if rng.random() < 0.15:
            del holder[key]
        else:
            holder[key] = copy.deepcopy(pick(rng, (*VALUES, 3.5)))
        yield broken


def _places(document: Any) -> Iterator[tuple[Any, Any]]:
    for key in document if isinstance(document, dict) else range(len(document)):
        yield document, key
        if isinstance(document[key], dict | list):
            yield from _places(document[key])


def broken_mat(rng: np.random.Generator, good: dict[str, np.ndarray], count: int) -> Iterator[bytes]:
    """Yield MAT files in which one to three arrays are other ones, or have another name."""
    for _ in range(count):
        broken: dict[str, Any] = dict(good)
        for name in rng.choice(list(good), rng.integers(1, 4)):
            other = pick(rng, ("time", "freq", "H", "x_1", "Fs"))
            broken[str(name) if rng.random() < 0.8 else other] = pick(rng, ARRAYS)
        file = BytesIO()
        savemat(file, broken, do_compression=True)  # with checksums: others are read in a process of their own
        yield file.getvalue()


def broken_wav(rng: np.random.Generator, samples: bytes, count: int) -> Iterator[bytes]:
    """Yield WAV files of which one to three fields of the header are other ones, or with further chunks."""
    small, large = (0, 1, 2, 3, 4, 7, 8, 16, 24, 32, 64, 255, 65534, 65535), (0, 1, 4, 7, 8000, 2**31, 2**32 - 1)
    for _ in range(count):
        head: list[int] = [1, 1, 8000, 16000, 2, 16, len(samples)]  # PCM, channels, rate, bytes a second, frame, bits
        for place in rng.integers(0, len(head), rng.integers(1, 4)):
            head[place] = pick(rng, large if place in (2, 3, 6) else small)
        own = b"fmt " + struct.pack("<IHHIIHH", 16, *head[:6]), b"data" + struct.pack("<I", head[6]) + samples
        more = [pick(rng, (b"bext", b"iXML", b"cue ", b"LIST", b"\0\0\0\0")) + struct.pack("<I", 4) + b"abcd"]
        chunks = [*own, *more * int(rng.integers(0, 2))]
        body = b"WAVE" + b"".join(chunks[i] for i in rng.permutation(len(chunks)))
        yield b"RIFF" + struct.pack("<I", len(body)) + (body if rng.random() < 0.9 else body[: rng.integers(len(body))])


def broken_tdms(rng: np.random.Generator, count: int) -> Iterator[bytes]:
    """Yield TDMS files of two channels whose samples or properties are other ones."""
    kept = [each for each in ARRAYS if isinstance(each, np.ndarray) and each.ndim == 1 and each.dtype.kind in "fiu"]
    names = ("wf_increment", "wf_start_offset", "unit_string", "wf_start_time", "wf_samples")
    for _ in range(count):
        good = {"wf_increment": 0.005, "unit_string": "N"}
        broken = good | {pick(rng, names): pick(rng, PROPERTIES) for _ in range(rng.integers(0, 3))}
        data = [pick(rng, kept) if rng.random() < 0.4 else np.ones(64) for _ in range(2)]
        file = BytesIO()
        other = pick(rng, ("b", "", "a/b"))
        with TdmsWriter(file) as writer:
            writer.write_segment([ChannelObject("g", "a", data[0], broken), ChannelObject("g", other, data[1], good)])
        yield file.getvalue()


def pick(rng: np.random.Generator, among: Any) -> Any:
    """Return one of some."""
    return among[rng.integers(len(among))]


def _some_place(rng: np.random.Generator, document: Any) -> tuple[Any, Any]:
    """Return a place in a document, on each level as likely as on the next."""
    holder = document
    while True:
        key = pick(rng, list(holder) if isinstance(holder, dict) else range(len(holder)))
        if not isinstance(holder[key], dict | list) or not holder[key] or rng.random() < 0.25:
            return holder, key
        holder = holder[key]


def _lines(change: Any) -> Any:
    def mistake(rng: np.random.Generator, text: str) -> str:
        lines = text.splitlines(keepends=True) or [""]
        change(rng, lines, rng.integers(len(lines)))
        return "".join(lines)

    return mistake


def _instead(pattern: re.Pattern[str], words: tuple[str, ...]) -> Any:
    def mistake(rng: np.random.Generator, text: str) -> str:
        found = list(pattern.finditer(text))
        if not found:
            return text
        place = pick(rng, found)
        return text[: place.start()] + pick(rng, words) + text[place.end() :]

    return mistake


def _cut(rng: np.random.Generator, text: str) -> str:
    return text[: rng.integers(len(text) + 1)]


def _inserted(rng: np.random.Generator, text: str) -> str:
    place = rng.integers(len(text) + 1)
    return text[:place] + pick(rng, WORDS) + text[place:]


def _other_delimiter(rng: np.random.Generator, text: str) -> str:
    return text.replace(",", pick(rng, ";\t |"), int(rng.integers(1, 30)))


_MISTAKES = (
    *(_instead(NUMBER, NUMBERS), _instead(WORD, WORDS), _instead(NUMBER, WORDS), _inserted, _other_delimiter),
    *(_instead(NUMBER, NUMBERS), _instead(NUMBER, NUMBERS), _cut),
    _lines(lambda rng, lines, i: lines.pop(i)),
    _lines(lambda rng, lines, i: lines.insert(i, lines[rng.integers(len(lines))])),
    _lines(lambda rng, lines, i: lines.insert(0, lines.pop(i))),
)
