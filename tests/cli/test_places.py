"""A mistake in a file is named by file, row and column, whatever the column is called; one in an option by its flag."""

import csv
import shutil

import numpy as np
import pytest
from arms import DATA
from commands import ARM, log

from ident.cli import commands  # noqa: F401  (all options are imported)
from ident.cli.command import _measured
from ident.errors import Problem
from ident.measure.channels import COLUMNS as OF_CHANNELS
from ident.measure.covariance import COVARIANCE_COLUMNS
from ident.measure.frames import SETUP_COLUMNS
from ident.measure.reading import COLUMNS as OF_CAMPAIGNS
from ident.measure.runs import COLUMNS as OF_RUNS
from ident.studies.options import INPUTS, Options, renamed, specs

LCD = DATA / "lcd_arm"
CAMPAIGN = ("check", "fit", "profile", "sample", "validate", "plan", "diagnose")


def kinds(kind=Options):
    return {kind}.union(*(kinds(each) for each in kind.__subclasses__()))


FILES = {"campaign": OF_CAMPAIGNS, "runs": OF_RUNS, "channels": OF_CHANNELS, "log": ("time", "x", "path")}
FILES |= {"covariance": COVARIANCE_COLUMNS, "setups": SETUP_COLUMNS}
NAMES = {name for kind in kinds() for each, spec in specs(kind) for name in (each.name, spec.argument)} | {*INPUTS}
NAMES -= {""}
BAD = {"load": "glas", "sigma": "-1", "drives": "of", "direction": "q", "speed": "-4", "retract": "2", "rate": "-1"}
BAD |= {"point": "tipp", "frame": "world"}
"""What no column can hold, by the columns that share a name with an option of some command."""


@pytest.mark.parametrize("kind", sorted(kinds(), key=lambda kind: kind.__name__))
def test_a_column_is_no_option(kind):
    for name in sorted(NAMES | {column for columns in FILES.values() for column in columns}):
        assert str(renamed(kind, Problem("c.csv:2", "x", "y", "z", name))) == f"c.csv:2, {name}: got x, expected y; z"


def table(path, column, bad):
    """Write a table of which the rows of one file, or the last one, have something bad in a column."""
    rows = list(csv.reader(line for line in path.read_text().splitlines() if not line.startswith("#")))
    names = [cell.partition(" ")[0] for cell in rows[0]]
    if column not in names:
        rows = [[*rows[0], column], *([*row, ""] for row in rows[1:])]
        names.append(column)
    last = [i for i, row in enumerate(rows) if row[0] == rows[-1][0] and path.name == "runs.csv"] or [len(rows) - 1]
    for i in last:
        rows[i][names.index(column)] = bad
    with path.open("w") as file:
        csv.writer(file).writerows(rows)
    return f"{path.name}:{last[0] + 1}, {column}: got "


def one_line(run, place, *arguments):
    code, out, err = run(*arguments)
    lines = err.splitlines()
    assert (code, out) == (2, ""), err
    assert place in lines[0]
    assert not [line for line in lines if "--" in line.partition(": got")[0]]


@pytest.mark.parametrize("column", sorted(NAMES & {*OF_CAMPAIGNS}))
def test_a_campaigns_cell(run, tmp_path, column):
    shutil.copy(ARM, tmp_path / "arm.toml")
    shutil.copy(LCD / "table1.csv", tmp_path / "c.csv")
    place = table(tmp_path / "c.csv", column, BAD[column])
    for command in CAMPAIGN:
        one_line(run, place, command, "c.csv")
    one_line(run, place, "compare", "c.csv", LCD / "campaign.csv")
    if column != "load":
        one_line(run, place, "explore", "arm.toml", "--campaign", "c.csv")


@pytest.fixture
def runs(tmp_path):
    """The shipped runs with a unit and a delay, so that no clock is sought before what is wrong is seen."""
    for name in ("runs.csv", "run7.csv", "run8.csv", "run10.csv", "run13.csv"):
        shutil.copy(LCD / "runs" / name, tmp_path)
    head, *rows = [line for line in (tmp_path / "runs.csv").read_text().splitlines() if not line.startswith("#")]
    (tmp_path / "runs.csv").write_text("\n".join([f"{head},unit,delay [s]", *(f"{row},mm,0" for row in rows)]))


@pytest.mark.usefixtures("runs")
@pytest.mark.parametrize("column", sorted(NAMES & {*OF_RUNS}))
def test_a_cell_of_a_table_of_runs(run, tmp_path, column):
    place = table(tmp_path / "runs.csv", column, BAD.get(column, "none.csv"))
    for command in (("source",), ("triage",), ("plan", "--runs"), ("diagnose", LCD / "table1.csv", "--runs")):
        one_line(run, "none.csv" if column == "path" else place, *command, "runs.csv", "--arm", ARM)


@pytest.mark.parametrize("column", sorted(NAMES & {*OF_CHANNELS}))
def test_a_cell_of_a_channel_table(run, tmp_path, column):
    shutil.copytree(LCD / "hammer", tmp_path / "hammer")
    one_line(run, table(tmp_path / "hammer" / "channels.csv", column, BAD[column]), "modal", "hammer")


@pytest.mark.parametrize("command", ["motion", "simulate", "sweep", "resonance", "design", "spectrum"])
def test_the_times_of_a_path(run, tmp_path, command):
    log(tmp_path / "p.csv")
    rows = (tmp_path / "p.csv").read_text().splitlines()
    (tmp_path / "p.csv").write_text("\n".join([*rows, rows[-1]]))
    given = (command, ARM) if command != "spectrum" else (command, "t.csv", "--arm", ARM)
    (tmp_path / "t.csv").write_text("time [s],x [mm]\n" + "".join(f"{k / 100},{k % 7}\n" for k in range(50)))
    one_line(run, "p.csv:28, time: got 0.5 s after 0.5 s", *given, "--path", "p.csv")
    (tmp_path / "p.csv").write_text("\n".join(rows[:3]))
    one_line(run, "p.csv", *given, "--path", "p.csv")


@pytest.mark.usefixtures("runs")
def test_an_option_is_named_by_its_flag(run):
    for option in ("load=glas", "speed=-4", "smoothing=-1", "dwell=-1"):
        one_line_of_a_flag = run("simulate", ARM, f"--{option}")[2]
        assert one_line_of_a_flag.startswith(f"ident: --{option.partition('=')[0]}"), one_line_of_a_flag
    err = run("source", "runs.csv", "--arm", ARM, "--hold-out", "run99.csv")[2]
    assert err.startswith("ident: --hold-out: got run99.csv, expected one of ")


def test_the_unit_of_a_recordings_times_has_a_place(run, tmp_path):
    shutil.copytree(LCD / "hammer", tmp_path / "hammer", ignore=shutil.ignore_patterns("*.unv"))
    rows = np.column_stack([np.arange(64) / 64, np.sin(np.arange(64))])
    np.savetxt(tmp_path / "hammer" / "a.csv", rows, delimiter=",", header="time [mm],f", comments="")
    one_line(run, "a.csv:1, time: got 'mm'", "modal", "hammer", "--init", "--channels", "new.csv")


def test_a_moment_that_a_motion_can_not_carry(run, tmp_path):
    shutil.copytree(LCD / "runs", tmp_path / "runs")
    head, *rows = [line for line in (LCD / "runs" / "runs.csv").read_text().splitlines() if not line.startswith("#")]
    moment = "5 N*m about y @ tip"
    (tmp_path / "runs" / "runs.csv").write_text("\n".join([f"{head},load", *(f"{row},{moment}" for row in rows)]))
    one_line(run, "runs.csv:2, load: got a moment", "source", "runs/runs.csv", "--arm", ARM)
    assert run("simulate", ARM, "--load", moment)[2].startswith("ident: --load: got a moment, expected ")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("plan", "arm.toml"), "as ident plan --arm arm.toml"),
        (("fit", "arm.toml"), "name the measurements, and this as --arm"),
        (
            ("modal", "table1.csv"),
            "got a file, expected a folder of recordings; name the folder of the recordings",
        ),
        (
            ("fit", "tabel1.csv"),
            "tabel1.csv: got no such file or directory, expected a readable CSV file; did you mean",
        ),
        (("simulate", "amr.toml"), "did you mean arm.toml?"),
        (("simulate", "arm.toml", "--path", "logs/pth.csv"), "did you mean logs/path.csv?"),
        (("modal", "lgs"), "got no such folder, expected a folder of recordings; did you mean logs?"),
        (("fleet", "lgs"), "did you mean logs?"),
        (("fit", "nothing-like-it.csv"), "check the path"),
        (
            ("motion", "arm.toml", "--limit=0.5kg"),
            "--limit: got '0.5kg', expected a number [mm], or one with another unit",
        ),
        (
            ("motion", "arm.toml", "--limit=much"),
            "--limit: got 'much', expected a number [mm], or one with another unit",
        ),
        (("motion", "arm.toml", "--limit=-0.5"), "--limit: got -0.5, expected a number above 0"),
    ],
)
def test_a_wrong_name_gets_the_right_call(run, tmp_path, arguments, words):
    for name in ("arm.toml", "table1.csv"):
        shutil.copy(LCD / name, tmp_path)
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "path.csv").touch()
    code, out, err = run(*arguments)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert words in err


@pytest.mark.parametrize(
    ("given", "number"), [("0.5", 0.5), ("0.5mm", 0.5), ("500 um", 0.5), ("5e-4m", 0.5), (".5mm", 0.5), ("1e3mm", 1000)]
)
def test_a_number_may_have_its_unit(given, number):
    assert _measured(given, "--limit", "mm") == pytest.approx(number, rel=1e-12)


def test_units_of_other_flags():
    assert _measured("2kHz", "--upto", "Hz") == pytest.approx(2000)
    assert _measured("1e3mHz", "--upto", "Hz") == pytest.approx(1)
    assert _measured("10 %", "--speed", "%") == pytest.approx(10)
    assert _measured("20ms", "--dwell", "s") == pytest.approx(0.02)
    assert _measured("1mrad", "--smoothing", "deg") == pytest.approx(0.0573, rel=1e-3)
