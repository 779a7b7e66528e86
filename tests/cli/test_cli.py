"""The command line on good input and on bad: exit codes, one line that says what is wrong, nothing written."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from commands import files

from ident import __version__
from ident.cli import main
from ident.cli.output import LABELS, PLACES
from ident.measure import read_campaign
from ident.studies import STUDIES

DATA = Path(__file__).parents[2] / "data" / "lcd_arm"
HEADER = "kind,q1 [deg],q2 [deg],q3 [deg],mode,point,value,unit,relative_sigma"
ROW = "frequency,0,0,0,,,4.38,Hz,0.5%"


def test_version_and_help(run):
    assert run("--version")[:2] == (0, __version__ + "\n")
    code, out, _ = run("fit", "--help")
    assert code == 0
    assert "--no-prior" in out


def test_python_m_ident_is_the_same_program(tmp_path):
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    command = [sys.executable, "-m", "ident", "fit", str(tmp_path / "none.csv")]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=environment, timeout=120)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith(f"ident: {tmp_path / 'none.csv'}: got no such file")
    assert "Traceback" not in done.stderr


BAD_CAMPAIGNS = {
    "missing column": ([HEADER.replace(",unit", ""), ROW.replace(",Hz", "")], "unit"),
    "unknown unit": ([HEADER, ROW.replace("Hz", "Hx")], "c.csv:2, unit"),
    "unknown kind": ([HEADER, ROW.replace("frequency", "frequence")], "c.csv:2, kind"),
    "not a number": ([HEADER, ROW.replace("4.38", "4.3.8")], "c.csv:2, value"),
    "NaN": ([HEADER, ROW.replace("4.38", "nan")], "c.csv:2, value"),
    "zero sigma": ([HEADER, ROW.replace("0.5%", "0")], "c.csv:2, relative_sigma"),
    "short posture": ([HEADER.replace(",q3 [deg]", ""), ROW.replace("0,0,0", "0,0")], "c.csv:2, posture"),
    "unknown point": ([HEADER, "deflection,0,0,0,,nose,22,mm,2%"], "c.csv:2, point"),
    "duplicate row": ([HEADER, ROW, ROW], "c.csv:3"),
    "unknown label": ([HEADER, ROW.replace(",,,4.38", ",wobble,,4.38")], "c.csv:2, mode"),
    "decimal commas between commas": ([HEADER, ROW.replace("4.38", "4,38")], "c.csv:2"),
    "empty": ([], "c.csv"),
    "header only": ([HEADER], "c.csv"),
}


@pytest.mark.parametrize("case", BAD_CAMPAIGNS)
def test_a_bad_campaign_is_one_clear_line_and_nothing_is_written(run, tmp_path, case):
    lines, place = BAD_CAMPAIGNS[case]
    path = tmp_path / "c.csv"
    path.write_text("".join(line + "\n" for line in lines))
    code, out, err = run("fit", path, "--arm", DATA / "arm.toml")
    assert code == 2
    assert out == ""
    assert f"{tmp_path}/{place}" in err or place in err
    assert all(line.startswith("ident: ") for line in err.splitlines())
    assert "expected" in err
    assert files(tmp_path) == ["c.csv"]


def test_european_spreadsheets_are_read(tmp_path):
    path = tmp_path / "c.csv"
    text = "\n".join([HEADER, ROW, ROW.replace("4.38", "4.41")]).replace(",", ";").replace(".", ",")
    path.write_bytes(b"\xef\xbb\xbf" + text.encode() + b"\r\n")
    assert [row.value for row in read_campaign(path)] == [4.38, 4.41]


def test_latin_1_is_refused(run, tmp_path):
    path = tmp_path / "c.csv"
    path.write_bytes((HEADER + ",note\n" + ROW + ",Größe\n").encode("latin-1"))
    code, _, err = run("fit", path, "--arm", DATA / "arm.toml")
    assert code == 2
    assert "UTF-8" in err


BAD_ARMS = {
    "negative mass": ("value = 42.0", "value = -42.0", "mass"),
    "no mass": (
        'mass = { value = 42.0, unit = "kg", origin = "assumed"',
        '# = { value = 20.0, unit = "kg", x = "y"',
        "mass",
    ),
    "not TOML": ("[[joint]]", "[[joint", "arm.toml"),
    "unknown key": ("k_bend", "k_bent", "k_bend"),
    "infinite": ("12.52e6", "inf", "k_bend"),
}


@pytest.mark.parametrize("case", BAD_ARMS)
def test_a_bad_arm_is_one_clear_line_and_nothing_is_written(run, tmp_path, case):
    old, new, word = BAD_ARMS[case]
    text = (DATA / "arm.toml").read_text()
    assert old in text
    arm = tmp_path / "arm.toml"
    arm.write_text(text.replace(old, new, 1))
    code, out, err = run("fit", DATA / "table1.csv", "--arm", arm)
    assert (code, out) == (2, "")
    assert word in err
    assert all(line.startswith(f"ident: {arm}") for line in err.splitlines())
    assert files(tmp_path) == ["arm.toml"]


class Terminal(io.StringIO):
    """A stream that people read."""

    def isatty(self):
        return True


@pytest.mark.parametrize(("stream", "wide"), [(Terminal(), False), (io.StringIO(), True)], ids=["terminal", "script"])
def test_an_error_is_folded_for_people_and_one_line_for_scripts(monkeypatch, tmp_path, stream, wide):
    monkeypatch.chdir(tmp_path)
    path = Path("measured.csv")
    path.write_text("kind,q1 [deg],value,unit,sigma\n" + "frequency,0,a_number_that_is_none,Hz,0.1\n" * 2)
    monkeypatch.setattr(sys, "argv", ["ident", "fit", str(path), f"--out={tmp_path}"])
    monkeypatch.setattr(sys, "stderr", stream)
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    lines = stream.getvalue().splitlines()
    assert (len(lines) == 2) == wide
    assert sum(line.startswith("ident: ") for line in lines) == 2, "one for each mistake"
    if not wide:
        assert max(map(len, lines)) <= 100
        assert " ".join(line.strip() for line in lines).count("expected a number; write a plain number") == 2


def test_help_is_by_what_one_does_and_no_line_is_cut_off(monkeypatch, run):
    monkeypatch.setenv("COLUMNS", "80")
    code, text, _ = run("--help")
    assert code == 0
    lines = [line for line in text.partition("Look at an arm:")[2].splitlines() if line.startswith("  ")]
    assert [line.split()[0] for line in lines][:6] == ["predict", "show", "new", "explore", "export", "modal"]
    assert {line.split()[0] for line in lines} >= {*STUDIES, "rerun", "doctor"}
    assert all(line.endswith(".") and "..." not in line and len(line) <= 80 for line in lines)
    assert set(PLACES.values()) | {""} == set(LABELS)
