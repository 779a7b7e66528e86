"""Files are written whole or not at all, also on a full disk; a folder is one run's at a time."""

import errno
import os
import subprocess
import sys

import numpy as np
import pytest
import xarray

from ident.errors import InputError
from ident.files import CLAIM, PART, claimed, remove_file, replace_file, together
from ident.report.document import read_record, write_json, write_netcdf


@pytest.fixture
def full_disk(monkeypatch):
    """Nothing more reaches the disk: the system says so when a file is flushed to it."""

    def refuse(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", refuse)


WRITERS = {
    "bytes": lambda path: replace_file(path, lambda file: file.write(b"new")),
    "netCDF": lambda path: write_netcdf(path, {"/": xarray.Dataset({"a": ("n", np.ones(3))})}),
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


LIMITED = """
import resource, signal, sys
from pathlib import Path
import numpy as np
import xarray
from ident.errors import InputError
from ident.report.document import write_netcdf

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
draws = np.random.default_rng(1).normal(size=100_000)
try:
    write_netcdf(Path(sys.argv[1]), {"/": xarray.Dataset({"x": ("n", draws)})})
except InputError as error:
    print(error)
"""


def test_a_netcdf_file_that_has_no_room_is_one_line(tmp_path):
    """HDF5 ends the process with a segmentation fault where the system refuses a write."""
    path = tmp_path / "draws.nc"
    done = subprocess.run([sys.executable, "-c", LIMITED, path], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith(f"{path}: got file too large, expected a file to write; choose a folder")
    assert done.stdout.count("\n") == 1
    assert os.listdir(tmp_path) == []


def test_groups_of_a_netcdf_file_come_back(tmp_path):
    path, numbers = tmp_path / "draws.nc", np.arange(1000.0)
    own = {"/": xarray.Dataset(attrs={"by": "us"}), "posterior": xarray.Dataset({"x": ("n", numbers)})}
    record = {"format": "ident-sample/10", "name": "é\udcff", "table": [1.5, None]}
    write_netcdf(path, own, record)
    assert xarray.load_dataset(path, engine="h5netcdf").attrs["by"] == "us"
    xarray.testing.assert_identical(xarray.load_dataset(path, group="posterior", engine="h5netcdf"), own["posterior"])
    assert read_record(path) == record


def contents(folder):
    return {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*") if path.is_file()}


def write(path, text="new"):
    replace_file(path, lambda file: file.write(text.encode()), make_folders=True)


def a_set(folder):
    """Write files over others, into a new folder and beside one that goes."""
    with together():
        write(folder / "a")
        write(folder / "b")
        remove_file(folder / "c")
        remove_file(folder / "none")
        assert contents(folder)["a"] == "old a", "nothing has happened yet"
        with together():
            write(folder / "new" / "deep" / "d")
        assert not (folder / "new" / "deep" / "d").exists()
        write(folder / "e")


def no_links(*_, **__):
    raise NotImplementedError


BEFORE = {"a": "old a", "b": "old b", "c": "old c"}


@pytest.fixture
def folder(tmp_path):
    for name, text in BEFORE.items():
        (tmp_path / name).write_text(text)
    return tmp_path


def test_the_files_of_a_set_appear_together(folder):
    a_set(folder)
    assert contents(folder) == {"a": "new", "b": "new", "new/deep/d": "new", "e": "new"}


@pytest.mark.parametrize("number", range(5))
def test_where_a_file_of_a_set_can_not_be_moved_all_are_as_before(folder, monkeypatch, number):
    """Whichever of the five it is; with links and where the file system has none."""
    move, moved = os.replace, []

    def failing(source, target):
        moved.append(target)
        if len(moved) == number + 1:
            raise OSError(errno.EACCES, os.strerror(errno.EACCES))
        move(source, target)

    monkeypatch.setattr(os, "replace", failing)
    if number % 2:
        monkeypatch.setattr(os, "link", no_links)
    with pytest.raises(InputError, match="got permission denied, expected a file to write"):
        a_set(folder)
    assert len(moved) > number
    assert contents(folder) == BEFORE
    assert sorted(os.listdir(folder)) == sorted(BEFORE)


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_where_a_set_is_not_completed_all_is_as_before(folder, error):
    def stopped():
        with together():
            a_set(folder)
            raise error

    with pytest.raises(error):
        stopped()
    assert contents(folder) == BEFORE
    assert sorted(os.listdir(folder)) == sorted(BEFORE)


def test_a_folder_in_the_place_of_one_file_stops_the_set(folder):
    (folder / "e").mkdir()
    with pytest.raises(InputError, match="e: got a folder, expected a file to write"):
        a_set(folder)
    assert contents(folder) == BEFORE


WRITES = """
import sys
from pathlib import Path
from ident.files import replace_file, together

with together():
    replace_file(Path(sys.argv[1]) / "a", lambda file: file.write(b"half"))
    print("written", flush=True)
    sys.stdin.read()
"""
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


def test_what_a_killed_process_has_left_goes_with_the_next_file_and_a_running_ones_stays(folder):
    others = "another machine, another user's process, names of no number"
    foreign = [
        f".ident-elsewhere-1-{'0' * 32}.part",
        f"{PART}1-{'0' * 32}.part",
        f"{PART}x.part",
        f"{PART}{9**99}-.part",
    ]
    for name in foreign:
        (folder / name).write_text(others)
    with python(WRITES, folder) as running, python(WRITES, folder) as killed:
        assert running.stdout.readline() == killed.stdout.readline() == b"written\n"
        killed.kill()
        killed.wait()
        left = {process: list(folder.glob(f"{PART}{process.pid}-*.part")) for process in (running, killed)}
        assert list(map(len, left.values())) == [1, 1]
        write(folder / "d")
        assert sorted(folder.glob(".ident-*")) == sorted([*left[running], *(folder / name for name in foreign)])
    assert (folder / "a").read_text() == "half"


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
