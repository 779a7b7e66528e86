"""What commands say on a terminal while they start."""

import sys
import time

import jax.monitoring
import pytest
from typer.testing import CliRunner

from ident.cli import main, running  # noqa: F401  (hangs the commands on the app)
from ident.cli.command import MAIN, app, speaking


@pytest.mark.parametrize("quiet", [False, True])
def test_that_programs_are_compiled_is_said_once_on_a_terminal(monkeypatch, capsys, quiet):
    running._say_that_it_compiles.cache_clear()
    watched = []
    monkeypatch.setattr(jax.monitoring, "register_event_listener", watched.append)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with speaking(as_json=False, quiet=quiet):
        running.start()
    for event in ("/jax/compilation_cache/cache_hits", running.NEW_PROGRAM, running.NEW_PROGRAM):
        for listener in watched:
            listener(event)
    assert capsys.readouterr().err.count("compiling, once") == (0 if quiet else 1)


def test_a_pipe_is_told_nothing(monkeypatch):
    monkeypatch.setattr(jax.monitoring, "register_event_listener", pytest.fail)
    running.start()


def test_long_work_in_a_log_says_every_ten_seconds_how_far_it_is(monkeypatch, capsys):
    clock = iter(range(0, 400, 4))
    monkeypatch.setattr(running.time, "monotonic", lambda: next(clock))
    assert list(running.progress("starts")(range(7))) == list(range(7))
    assert capsys.readouterr().err.splitlines() == ["starts: 2 of 7, 12 s", "starts: 5 of 7, 24 s"]
    with speaking(as_json=False, quiet=True):
        assert list(running.progress("starts")(range(7))) == list(range(7))
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(("terminal", "quiet", "lines"), [(False, False, 1), (True, False, 0), (False, True, 0)])
def test_long_work_that_shows_no_progress_says_so_once_in_a_log(monkeypatch, capsys, terminal, quiet, lines):
    monkeypatch.setattr(running, "PACE", 0.01)
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    with speaking(as_json=False, quiet=quiet), running.at_work("fit"):
        time.sleep(0.1)
    assert capsys.readouterr().err == "ident fit: at work for 0.01 s\n" * lines
    monkeypatch.setattr(running, "PACE", 10.0)
    with speaking(as_json=False, quiet=quiet), running.at_work("fit"):
        pass
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", sorted(command.name for command in app.registered_commands))
def test_help_fits_a_screen_and_the_rest_is_asked_for(name):
    def help_of(flag):
        return CliRunner().invoke(app, [name, flag], terminal_width=100, max_content_width=100).output.splitlines()

    shown = help_of("--help")
    assert len(shown) <= 30
    assert max(map(len, shown)) <= 100
    if name in MAIN:
        assert len(help_of("--help-all")) > len(shown)
        assert any("--help-all" in line for line in shown)


def test_all_flags_are_those_of_the_options():
    whole = CliRunner().invoke(app, ["fit", "--help-all"]).output
    assert all(f"{flag} " in whole for flag in ("--tie", "--prior", "--robust", "--seed", "--no-figure", "--quiet"))
    assert "--robust" not in CliRunner().invoke(app, ["fit", "--help"]).output
