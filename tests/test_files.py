"""Files are written whole or not at all, also on a full disk."""

import errno
import os

import numpy as np
import pytest

from ident.errors import InputError
from ident.files import replace_file, replace_path
from ident.present.files.document import write_json


@pytest.fixture
def full_disk(monkeypatch):
    """Nothing more reaches the disk: the system says so when a file is flushed to it."""

    def refuse(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", refuse)


WRITERS = {
    "bytes": lambda path: replace_file(path, lambda file: file.write(b"new")),
    "path": lambda path: replace_path(path, lambda part: np.save(part.open("wb"), np.ones(3))),
    "json": lambda path: write_json({"new": 1}, path),
}


@pytest.mark.parametrize("kind", WRITERS)
def test_a_full_disk_is_one_line_and_what_was_there_stays(full_disk, tmp_path, kind):
    path = tmp_path / "result"
    path.write_text("old")
    with pytest.raises(
        InputError, match=r"result: got no space left on device, expected a file to write; choose a fol"
    ):
        WRITERS[kind](path)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["result"]


@pytest.mark.parametrize("kind", WRITERS)
def test_with_room_the_new_file_takes_its_place(tmp_path, kind):
    path = tmp_path / "result"
    path.write_text("old")
    WRITERS[kind](path)
    assert path.read_bytes() != b"old"
    assert os.listdir(tmp_path) == ["result"]
