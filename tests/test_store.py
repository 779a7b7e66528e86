"""A store: items whole or not at all, one run a folder, values to the last bit."""

import numpy as np
import pytest

from ident.codec import END, Store
from ident.errors import InputError
from ident.measure import Load

ONE = {"campaign": "one", "seed": "1"}
VALUE = {"name": "Gelenk ü", "loads": (Load.parse("5 kg @ tip"),), "big": np.arange(1000.0) / 3, "none": None}


def equal(a, b):
    return set(a) == set(b) and all(np.array_equal(a[name], b[name]) for name in a)


def test_items_come_back_in_another_run_of_the_same_identity(tmp_path):
    store = Store(tmp_path / "part", ONE)
    assert store.read("fit") is None
    store.write("fit", VALUE)
    again = Store(tmp_path / "part", ONE).read("fit")
    assert equal(again, VALUE)
    assert again["loads"] == VALUE["loads"]
    assert again["big"].dtype == np.float64


def test_an_item_is_replaced(tmp_path):
    store = Store(tmp_path, ONE)
    store.write("fit", 1)
    store.write("fit", 2)
    assert store.read("fit") == 2


def test_a_damaged_item_counts_as_not_there(tmp_path):
    """Each byte is inverted in turn, and the file cut short anywhere: nothing, or else the very same value."""
    store = Store(tmp_path, ONE)
    value = {"numbers": np.arange(600.0), "text": "posture"}
    store.write("fit", value)
    file = tmp_path / f"fit{END}"
    whole = file.read_bytes()
    unread = 0
    for i in range(0, len(whole), 1 if len(whole) < 2000 else 7):
        for damaged in (whole[:i] + bytes([whole[i] ^ 0xFF]) + whole[i + 1 :], whole[:i]):
            file.write_bytes(damaged)
            item = store.read("fit")
            unread += item is None
            assert item is None or equal(item, value)
    assert unread > len(whole) / 7


def test_what_is_no_value_of_ours_is_not_written(tmp_path):
    store = Store(tmp_path, ONE)
    with pytest.raises(Exception, match="can't be kept"):
        store.write("fit", object())
    assert store.read("fit") is None


@pytest.mark.parametrize("content", [None, "", "[1]", '{"campaign": "other", "seed": "1"}'])
def test_a_folder_of_another_run_is_refused_and_left_alone(tmp_path, content):
    Store(tmp_path, ONE).write("fit", 1)
    if content is not None:
        (tmp_path / "run.json").write_text(content)
    before = {file.name: file.read_bytes() for file in tmp_path.iterdir()}
    with pytest.raises(InputError, match=r"another campaign.*`restart`.*`folder`"):
        Store(tmp_path, {"campaign": "two", "seed": "1"})
    assert {file.name: file.read_bytes() for file in tmp_path.iterdir()} == before


def test_what_the_items_do_not_depend_on_may_change(tmp_path):
    store = Store(tmp_path, ONE)
    store.write("fit", 1)
    store.depends_on({"campaign": ONE["campaign"]})
    other = ONE | {"seed": "2"}
    assert Store(tmp_path, other).read("fit") == 1
    with pytest.raises(InputError, match="another seed"):
        Store(tmp_path, ONE)


def test_without_a_folder_nothing_is_kept():
    store = Store(None, ONE)
    store.write("fit", 1)
    assert store.read("fit") is None


def test_only_what_the_store_has_written_is_discarded(tmp_path):
    folder = tmp_path / "part"
    Store(folder, ONE).write("fit", 1)
    (folder / "notes.txt").write_text("mine")
    Store.discard(folder)
    assert [file.name for file in folder.iterdir()] == ["notes.txt"]
    Store.discard(folder)
    (folder / "notes.txt").unlink()
    Store(folder, ONE)
    Store.discard(folder)
    assert not folder.exists()
    Store.discard(folder)


def test_a_folder_that_cannot_be_written_is_one_clear_line(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="file to write"):
        Store(tmp_path / "file" / "folder", ONE)
