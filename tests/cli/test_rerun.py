"""`ident show` and `ident rerun`."""

import json
import re
import shutil

import pytest
from commands import ARM, files
from reports import assert_one_screen

from ident.cli.command import SHORT

pytestmark = pytest.mark.slow

DATA = ARM.parent / "table1.csv"


def test_a_result_is_shown_as_it_was_printed_and_comes_out_again(run, tmp_path):
    """Data that contradict each other are a status of their own, with --strict; then an input changes, then a value."""
    shutil.copy(ARM, tmp_path / "arm.toml")
    code, printed, _ = run("fit", DATA, "--arm=arm.toml", "--starts=1", "--no-figure", "--no-explain", "--strict")
    assert code == SHORT
    path = "out/table1.fit.json"
    code, out, err = run("show", path)
    assert (code, err) == (0, "")
    assert printed.startswith(out.rstrip())

    before = files(tmp_path)
    code, out, err = run("rerun", path)
    assert (code, err) == (0, "")
    assert "RESULT: SAME." in out
    assert_one_screen(out)
    assert files(tmp_path) == before

    with open(tmp_path / "arm.toml", "a") as file:
        file.write("# changed\n")
    code, out, err = run("rerun", path, "--out=new")
    assert (code, err) == (0, "")
    assert "NOTE: arm.toml is not as it was: repeated from its text in the result" in out
    assert "wrote new/table1.fit.json" in out

    text = (tmp_path / path).read_text()
    value = re.search(r'"parameter": "joint2.k_tors",\s*"value": ([^,]+),', text)[1]
    (tmp_path / path).write_text(text.replace(value, str(float(value) * 1.001)))
    code, out, _ = run("rerun", path)
    assert code == SHORT
    assert "RESULT: DIFFERENT. 1 number does not agree" in out

    document = json.loads(text)
    (tmp_path / path).write_text(json.dumps({**document, "texts": {}}))
    code, out, err = run("rerun", path)
    assert (code, out) == (2, "")
    assert err.startswith("ident: arm.toml: got a file that has changed since")
    assert err.count("\n") == 1


@pytest.mark.parametrize("command", ["show", "rerun"])
def test_no_result_is_one_line_with_status_2(run, command, tmp_path):
    other = tmp_path / "other.json"
    other.write_text("{}")
    code, out, err = run(command, other)
    assert (code, out) == (2, "")
    assert "expected a result file of ident" in err
