"""`ident check` from the command line."""

from pathlib import Path

import pytest
from commands import files

pytestmark = pytest.mark.slow

HEADER = "kind,q1 [deg],q2 [deg],q3 [deg],mode,point,value,unit,relative_sigma"
DATA = Path(__file__).parents[2] / "data" / "lcd_arm"


def test_check_prints_a_verdict_for_each_parameter_and_writes_nothing(run, tmp_path):
    code, out, err = run("check", DATA / "table1.csv", "--no-explain")
    assert (code, err) == (0, "")
    assert "RESULT: NOT READY. Deflection and frequency data contradict each other (4.1 sigma)." in out
    assert out.count("not determined  only in combination with others") == 6
    assert (
        "torsion of joint2 against torsion of joint1"
        in run("check", DATA / "table1.csv", "--no-explain", "--details")[1]
    )
    assert files(tmp_path) == []
    assert run("check", DATA / "table1.csv", "--no-explain", "--strict")[0] == 3
    assert run("check", DATA / "campaign.csv", "--strict")[0] == 0


def test_check_refuses_what_says_nothing_and_what_contradicts_itself(run, tmp_path):
    path, arm = tmp_path / "c.csv", f"--arm={DATA / 'arm.toml'}"
    row = "deflection,0,0,0,,tip,26.3,mm,2%"
    path.write_text(f"{HEADER}\n{row}\n")
    code, out, err = run("check", path, arm, *(f"--fix=joint{j}.k_bend" for j in (1, 2, 3)))
    assert (code, out) == (2, "")
    assert err.startswith(f"ident: {path}: got no measurement that depends on any of the unknowns")
    path.write_text(f"{HEADER}\n{row}\n{row.replace('26.3', '29.3')}\n")
    for command in ("check", "fit"):
        code, out, more = run(command, path, arm)
        assert (code, out) == (2, "")
        assert more.startswith(f"ident: {path}:3, value: got 29.3 mm, 3.8 sd from row 2")
        assert more.endswith("(--trust-values 3)\n")
        assert len(err.splitlines()) == len(more.splitlines()) == 1
    assert files(tmp_path) == ["c.csv"]
    assert "rows 2 and 3 measured the same and differ" in run("check", path, arm, "--trust-values=3")[1]
