"""Traced programs that are kept: the same numbers without tracing, and never a wrong or a foreign program."""

import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from threading import Barrier
from time import sleep

import jax
import numpy as np
import pytest

from ident import programs
from ident.programs import NotKeptError, Programs, circumstances, described, environment, own_folder, sources

SUPPORT = Path(__file__).parent / "support"


def in_another_process(cache: Path, **environment: str) -> dict:
    line = [sys.executable, str(SUPPORT / "kept_program.py"), str(cache)]
    own = {**os.environ, "IDENT_PROGRAMS": "on", **environment}
    done = subprocess.run(line, env=own, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_a_known_program_is_not_traced_again_and_gives_the_same_bits(tmp_path):
    plain = in_another_process(tmp_path, IDENT_PROGRAMS="off")
    first, second = in_another_process(tmp_path), in_another_process(tmp_path)
    assert plain["kept"] is None
    assert [name.partition("-")[0] for name in first["kept"]] == ["modes", "static_equilibrium"], "not the lambda"
    assert first["numbers"] == second["numbers"] == plain["numbers"]
    assert first["trees"] == second["trees"] == plain["trees"]
    assert second["traced"] == first["traced"] - 2, "neither of the two"


@pytest.fixture
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("IDENT_PROGRAMS", "on")
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def test_programs_lie_where_only_the_user_writes(cache):
    folder = own_folder()
    assert folder.parent == cache / "ident-programs"
    assert own_folder() == folder
    for place in (folder, folder.parent):
        place.chmod(0o777)
        assert own_folder() is None
        place.chmod(0o700)
    folder.rmdir()
    folder.symlink_to(cache)
    assert own_folder() is None


def test_programs_of_other_versions_are_thrown_away_when_they_are_old(cache):
    young, old, other = (cache / "ident-programs" / name for name in (24 * "a", 24 * "b", "mine"))
    for folder, age in ((young, 0.9), (old, 1.1), (other, 1.1)):
        folder.mkdir(parents=True)
        (folder / "a.program").write_bytes(b"x")
        then = folder.stat().st_mtime - age * programs.OLD
        os.utime(folder, (then, then))
    own_folder()
    assert young.exists()
    assert other.exists(), "not of ours"
    assert not old.exists()


def test_a_link_in_the_place_of_the_folder_is_left_alone(cache):
    elsewhere = cache / "elsewhere" / (24 * "a")
    elsewhere.mkdir(parents=True)
    elsewhere.parent.chmod(0o755)
    os.utime(elsewhere, (0, 0))
    (cache / "ident-programs").symlink_to(elsewhere.parent)
    assert own_folder() is None
    assert elsewhere.exists()
    assert elsewhere.parent.stat().st_mode & 0o777 == 0o755


def known(programs, x):
    """What computes a function of one array, as `ident.programs` calls it; None where there is none."""
    found = programs.find((x,), {})
    return found and (lambda x: found([x]))


def test_a_file_that_was_changed_or_cut_is_passed_over(cache, monkeypatch):
    monkeypatch.setattr(programs, "described", lambda value: "as it is")  # a function of the tests has no key
    x, places = np.arange(3.0), Programs(lambda x: (2 * x, x), {})
    np.testing.assert_array_equal(known(places, x)(x)[0], 2 * x)
    (file,) = own_folder().iterdir()
    whole = file.read_bytes()
    assert b"as it is" in whole
    for changed in (whole.replace(b"array", b"Array"), whole.replace(b"as it is", b"as it was"), whole[:-100]):
        assert changed != whole
        file.write_bytes(changed)
        np.testing.assert_array_equal(known(Programs(lambda x: (2 * x, x), {}), x)(x)[0], 2 * x)
        assert file.read_bytes() != changed, "it was written anew"


def test_a_setting_that_is_changed_within_a_process_is_another_program(cache, monkeypatch):
    monkeypatch.setattr(programs, "described", lambda value: "as it is")
    x, places = np.arange(3), Programs(lambda x: x / 2, {})
    with jax.enable_x64(True):
        wide = known(places, x)(x)
    with jax.enable_x64(False):
        narrow = known(places, x)(x)
    with jax.enable_x64(True):
        again = known(places, x)(x)
    assert [each.dtype for each in (wide, narrow, again)] == ["float64", "float32", "float64"]


def test_a_program_takes_what_a_kept_program_gave_without_being_compiled_again(cache, monkeypatch):
    monkeypatch.setattr(programs, "described", lambda value: "as it is")
    events, twice = [], known(Programs(lambda x: 2 * x, {}), np.arange(3.0))

    def listener(event, seconds, **of):
        events.append(event)

    first = twice(np.arange(3.0))
    assert first.committed, "else nothing is tested"
    jax.monitoring.register_event_duration_secs_listener(listener)
    try:
        np.testing.assert_array_equal(twice(first), 4 * np.arange(3.0))
    finally:
        jax.monitoring.unregister_event_duration_listener(listener)
    assert not [event for event in events if "compile" in event]


def test_an_error_of_the_function_itself_is_no_verdict_on_its_program(cache, monkeypatch):
    monkeypatch.setattr(programs, "described", lambda value: "as it is")

    def refusing(x):
        raise ValueError("these numbers")

    def calling_back(x):
        return jax.pure_callback(lambda y: y, jax.ShapeDtypeStruct(x.shape, x.dtype), x)

    x = np.arange(3.0)
    assert known(Programs(refusing, {}), x) is None
    assert list(own_folder().iterdir()) == [], "another time there may be a program"
    assert known(Programs(calling_back, {}), x) is None
    assert len(list(own_folder().iterdir())) == 1, "that there is none is known from now on"


@pytest.mark.parametrize(
    ("value", "kept"),
    [
        *((word, False) for word in ("", "0", "off", "no", "n", "N", "False", " f ")),
        *((w, True) for w in ("1", "on", "yes")),
    ],
)
def test_programs_are_kept_where_that_is_switched_on(cache, monkeypatch, value, kept):
    monkeypatch.setenv("IDENT_PROGRAMS", value)
    assert (own_folder() is not None) == kept


def test_threads_that_ask_for_one_program_at_once_get_the_same(cache, monkeypatch):
    monkeypatch.setattr(programs, "described", lambda value: "as it is")
    traced, begin = [], Barrier(4)

    def slow(x):
        traced.append(x)
        sleep(0.05)
        return 2 * x

    places = Programs(slow, {})

    def ask(number):
        begin.wait()
        return places.find((np.full(3, number),), {})

    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(ask, range(4)))
    assert len(traced) == 1
    assert len(set(found)) == 1


def test_nothing_is_kept_without_a_cache(cache):
    jax.config.update("jax_compilation_cache_dir", None)
    assert own_folder() is None


def test_a_changed_source_line_is_another_package(tmp_path):
    (tmp_path / "arm").mkdir()
    for name in ("a.py", "arm/b.py"):
        (tmp_path / name).write_text("x = 1\n")
    own = sources(tmp_path)
    assert own == sources(tmp_path)
    (tmp_path / "arm" / "b.py").write_text("x = 2\n")
    changed = sources(tmp_path)
    (tmp_path / "arm" / "b.py").rename(tmp_path / "arm" / "c.py")
    assert len({own, changed, sources(tmp_path)}) == 3


def test_circumstances_are_those_of_every_setting(monkeypatch):
    own, place = circumstances(), environment()
    with jax.numpy_rank_promotion("warn"):
        assert circumstances()["jax"] != own["jax"]
        assert environment() != place
    assert environment() == place
    monkeypatch.setenv("XLA_FLAGS", "--other")
    flags = circumstances()["flags"]
    monkeypatch.setenv("EQX_ON_ERROR", "off")
    assert own["flags"] != flags != circumstances()["flags"]
    monkeypatch.setattr(sys, "version", "4.0")
    assert circumstances()["python"] != own["python"]
    assert all(word in str(own["libraries"]) for word in (jax.__version__, np.__version__))


@dataclass(frozen=True)
class Foreign:
    x: float = 1.0


def test_a_key_names_all_that_a_program_can_depend_on():
    x = np.ones(3)
    different = [
        (x,),
        [x],
        (np.ones(4),),
        (np.ones(3, "f4"),),
        (jax.numpy.asarray(1.0),),
        (jax.numpy.asarray(np.array(1.0)),),
        (np.array(1),),
        (1,),
        (1.0,),
        (True,),
        (None,),
        ("1",),
        ({"a": 1},),
        ({"b": 1},),
        (float("nan"),),
        (np.dtype("f8"),),
    ]
    keys = [json.dumps(described(each)) for each in different]
    assert len(set(keys)) == len(keys)
    assert described((x,)) == described((np.zeros(3),)), "numbers are traced"


def test_a_function_that_is_decorated_has_the_name_under_which_it_is_found(monkeypatch):
    module = sys.modules["ident.errors"]

    def made(value):
        @wraps(module.one_line)
        def decorated(text):
            return module.one_line(text) + value

        return decorated

    first, second = made("a"), made("b")
    monkeypatch.setattr(module, "one_line", first)
    assert described(first) == ["name", "ident.errors.one_line"]
    assert described(first.__wrapped__) == described(first), "what the decorator holds"
    with pytest.raises(NotKeptError):
        described(second)


@pytest.mark.parametrize("foreign", [Foreign(), np.sin, lambda x: x, Foreign, object(), Path(), "".join])
def test_what_a_key_cannot_name_is_not_kept(foreign, cache):
    with pytest.raises(NotKeptError):
        described((1, {"a": foreign}))
    assert Programs(circumstances, {}).find((foreign,), {}) is None
    assert Programs(lambda x: x, {}).find((1.0,), {}) is None
