"""`IDENT_TIMES`: each moment of a command counts once, and the line says where it went."""

import builtins
import os
import re
import subprocess
import sys

import pytest
from arms import DATA

from ident.cli.times import KINDS, Times, begin


def test_each_moment_counts_once_for_the_first_kind_that_was_going_on():
    times = Times(start=10.0)
    times.spans += [
        (12.0, 18.0, "drawing"),
        (13.0, 15.0, "tracing"),
        (14.0, 16.0, "importing"),
        (17.0, 17.5, "tracing"),
    ]
    shares = times.shares(20.0)
    assert shares == pytest.approx(
        dict.fromkeys(KINDS, 0.0) | {"importing": 2.0, "tracing": 1.5, "drawing": 2.5, "computing": 4.0}
    )
    assert sum(shares.values()) == pytest.approx(10.0)


def test_what_jax_reports_is_counted_at_its_end():
    times = Times(start=0.0)
    times.event("/jax/core/compile/jaxpr_trace_duration", 0.25, fun_name="f")
    times.event("/jax/other", 5.0)
    ((begin, end, kind),) = times.spans
    assert (kind, round(end - begin, 9)) == ("tracing", 0.25)
    assert "0 programs" in times.line(end)


def test_only_the_outermost_import_is_counted(monkeypatch):
    times, plain = Times(), builtins.__import__
    monkeypatch.setattr(builtins, "__import__", plain)
    times.watch_imports()
    import wsgiref.simple_server  # noqa: F401  (of several modules)

    assert len(times.spans) == 1


def test_a_command_says_where_its_time_went():
    line = [sys.executable, "-c", "from ident.cli import main; main()", "predict", str(DATA / "lcd_arm" / "arm.toml")]
    done = subprocess.run(line, env=os.environ | {"IDENT_TIMES": "1"}, capture_output=True, text=True, check=True)
    total, rest = re.fullmatch(r"ident: ([\d.]+) s: (.*); \d+ programs, \d+ of them loaded\n", done.stderr).groups()
    shares = {kind: float(seconds) for kind, seconds in (part.split() for part in rest.split(", "))}
    assert list(shares) == [*KINDS, "computing"]
    assert sum(shares.values()) == pytest.approx(float(total), abs=0.06)
    assert shares["importing"] > 0.1
    assert shares["tracing"] > 0


@pytest.mark.parametrize("off", ["", "0", "off"])
def test_it_says_nothing_where_that_is_switched_off(monkeypatch, off):
    plain = builtins.__import__
    monkeypatch.setenv("IDENT_TIMES", off)
    begin()
    assert builtins.__import__ is plain
