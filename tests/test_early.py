"""What is loaded before it is asked for: what the last run used, in its order, and never a wrong program."""

import json
from threading import Event
from threading import enumerate as threads

import jax
import numpy as np
import pytest

from ident import jit as ident_jit
from ident import programs
from ident.early import MOST, Early
from ident.jit import ahead, jit
from ident.programs import Programs


def begun(tmp_path, names, load=lambda path: path.name):
    (tmp_path / "fit.last").write_text(json.dumps(names))
    early = Early()
    early.begin(tmp_path / "fit.last", load)
    return early


def last(tmp_path):
    return json.loads((tmp_path / "fit.last").read_text())


def test_what_was_used_is_loaded_and_what_is_used_is_kept(tmp_path):
    early = begun(tmp_path, ["a.program", "../b.program"], lambda path: path.relative_to(tmp_path))
    early.pool.submit(int).result()  # behind the two
    assert [str(early.take(f"{name}.program")) for name in "abc"] == ["a.program", "b.program", "None"]
    assert early.take("a.program") is None, "only once: it is in use"
    early.end()
    assert last(tmp_path) == ["a.program", "b.program", "c.program"]


def test_no_more_are_loaded_than_are_kept(tmp_path):
    names = [f"{i}.program" for i in range(2 * MOST)]
    early = begun(tmp_path, names)
    early.pool.submit(int).result()
    assert [early.take(name) for name in names] == names[:MOST] + MOST * [None]
    early.end()
    early = begun(tmp_path, [])
    assert [early.take(name) for name in names] == 2 * MOST * [None]
    early.end()
    assert last(tmp_path) == names[:MOST]


def test_a_program_that_waits_its_turn_is_not_waited_for(tmp_path):
    begins, go_on, loaded = Event(), Event(), []

    def load(path):
        begins.set()
        assert go_on.wait(60)
        loaded.append(path.name)
        return path.name

    early = begun(tmp_path, ["a.program", "b.program"], load)
    assert begins.wait(60)
    assert early.take("b.program") is None
    go_on.set()
    assert early.take("a.program") == "a.program"
    early.pool.submit(int).result()
    assert loaded == ["a.program"]
    early.end()


@pytest.mark.parametrize("text", ["", "[1, 2]", "{}", "no JSON", '{"a": 1}'])
def test_a_wrong_list_is_passed_over(tmp_path, text):
    def load(path):
        raise ValueError(path)

    (tmp_path / "fit.last").write_text(text)
    early = Early()
    early.begin(tmp_path / "fit.last", load)
    assert early.take("a.program") is None
    early.end()
    assert last(tmp_path) == ["a.program"]


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A program of the tests, kept, as an earlier process left it."""
    monkeypatch.setenv("IDENT_PROGRAMS", "on")
    monkeypatch.setattr(programs, "described", lambda value: "as it is")  # a function of the tests has no key
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    Programs(doubled, {}).find((np.arange(3.0),), {})
    yield next(programs.own_folder().glob("*.program"))
    jax.config.update("jax_compilation_cache_dir", before)


def doubled(x):
    return 2 * x


@pytest.mark.parametrize(("change", "early"), [({}, True), ({"key": "other"}, False), ({"options": {"a": 1}}, False)])
def test_a_program_is_used_only_under_its_own_key_and_options(kept, monkeypatch, change, early):
    head, _ = programs._loaded(kept)
    mine = Early()
    monkeypatch.setattr(programs, "EARLY", mine)
    mine.begin(kept.with_name("fit.last"), lambda path: None)
    mine.coming = {kept.name: mine.pool.submit(lambda: ({**head, **change}, lambda x: [3 * x]))}
    mine.pool.submit(int).result()
    found = Programs(doubled, {}).find((np.arange(3.0),), {})([np.arange(3.0)])
    np.testing.assert_array_equal(found, (3 if early else 2) * np.arange(3.0))
    mine.end()


@pytest.mark.parametrize(("cores", "store", "begins"), [(2, "on", True), (1, "on", False), (2, "off", False)])
def test_what_will_be_needed_is_made_ready_where_there_is_a_core_for_it(monkeypatch, cores, store, begins):
    monkeypatch.setenv("IDENT_PROGRAMS", store)
    monkeypatch.setattr(ident_jit, "cores", lambda: cores)
    called = Event()

    def first():
        called.set()
        raise ValueError("said again by whoever needs the answer")

    f = jit(doubled)
    ahead(f, first)
    for thread in threads():
        if thread.name == "ahead":
            thread.join(60)
    assert called.is_set() == begins
    f.known.loaded["its program"] = first
    called.clear()
    ahead(f, first)
    assert not called.is_set()
