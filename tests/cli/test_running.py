"""What commands say on a terminal while they start."""

import sys

import jax.monitoring
import pytest

from ident.cli import running
from ident.cli.command import speaking


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
