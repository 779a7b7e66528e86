"""Files are written whole or not at all, also on a full disk; a folder is one run's at a time."""

import errno
import os
import subprocess
import sys

import numpy as np
import pytest

from ident.errors import InputError
from ident.files import CLAIM, claimed, replace_file, replace_path
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


HOLD = """
import sys
from pathlib import Path
from ident.files import claimed

with claimed(Path(sys.argv[1])):
    print("mine", flush=True)
    sys.stdin.read()
"""
TURNS = """
import sys
from pathlib import Path
from ident.errors import InputError
from ident.files import claimed

folder, here = Path(sys.argv[1]), Path(sys.argv[1]).parent / "here"
won = 0
while won < 100:
    try:
        with claimed(folder):
            here.touch(exist_ok=False)  # two at once fail here
            here.unlink()
            won += 1
    except InputError:
        pass
"""


def python(text, folder):
    return subprocess.Popen([sys.executable, "-c", text, folder], stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def test_a_folder_that_another_process_has_is_refused_until_that_is_killed(tmp_path):
    folder = tmp_path / "out" / "part"
    with python(HOLD, folder) as other:
        assert other.stdout.readline() == b"mine\n"
        words = rf"part: got .*another run.* \(process {other.pid}\), expected one run"
        with pytest.raises(InputError, match=words), claimed(folder):
            pass
        other.kill()
    assert (folder / CLAIM).exists(), "what is killed leaves its file"
    with claimed(folder):
        pass
    assert os.listdir(tmp_path) == ["out"]


def test_a_claimed_folder_stays_only_with_something_in_it(tmp_path):
    folder = tmp_path / "a" / "b"
    with claimed(folder), pytest.raises(InputError, match="one run at a time"), claimed(folder):
        pass
    assert os.listdir(tmp_path) == []
    with claimed(folder):
        (folder / "kept").touch()
    assert os.listdir(folder) == ["kept"]


def test_of_several_at_once_one_has_the_folder(tmp_path):
    others = [python(TURNS, tmp_path / "part") for _ in range(3)]
    assert [other.wait(60) for other in others] == [0, 0, 0]


def test_what_is_no_folder_cannot_be_claimed(tmp_path):
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "part", tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match=r"a folder to write to; .*`folder`"), claimed(folder):
            pass
