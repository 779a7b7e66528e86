"""What a command says: words for people, one JSON document for programs, nothing if that is asked for."""

import json
import os
import re
import subprocess
import sys

import pytest
from commands import ARM

import ident
from ident.studies.saved import RECORD

pytestmark = pytest.mark.slow

CAMPAIGN = ARM.parent / "table1.csv"
FIT = ("fit", CAMPAIGN, "--starts=1", "--no-figure", "--no-explain")


@pytest.mark.parametrize(
    "arguments",
    [("predict", ARM), FIT, ("show", ARM, "--no-figure"), ("show", ARM, "--names"), ("new", "scara", "robot")],
    ids=lambda arguments: arguments[0],
)
def test_json_is_all_of_the_output_and_the_words_go_to_standard_error(run, arguments):
    code, words, err = run(*arguments)
    assert (code, err) == (0, "")
    if arguments[0] == "new":
        arguments, words = ("new", "scara", "other"), words.replace("robot", "other")
    code, out, err = run(*arguments, "--json")
    document = json.loads(out)
    assert out.count("\n") == 1
    assert document["status"] == code == 0
    assert err == words
    assert document["written"] == [
        line.removeprefix("wrote ") for line in err.splitlines() if line.startswith("wrote ")
    ]


def test_the_document_is_that_of_the_file_without_the_result(run, tmp_path):
    _, out, err = run(*FIT, "--json", "--quiet")
    assert err == ""
    document = json.loads(out)
    file = json.loads((tmp_path / "out" / "table1.fit.json").read_text())
    for key in set(file) - {"created", *RECORD}:
        assert document[key] == file[key], key
    _, shown, _ = run("show", "out/table1.fit.json", "--json", "--quiet")
    assert json.loads(shown)["table"] == file["table"]


def test_a_status_is_told_and_a_refusal_is_a_document_too(run):
    code, out, _ = run("check", CAMPAIGN, "--strict", "--no-explain", "--json")
    assert json.loads(out)["status"] == code == 3
    code, out, err = run("fit", "none.csv", "--json", "--quiet")
    document = json.loads(out)
    assert document["status"] == code == 2
    assert [f"ident: {line}" for line in document["error"]] == err.splitlines()
    assert "none.csv" in err


def test_verbose_logs_what_is_read_with_times_and_nothing_does_without(run):
    _, words, err = run("predict", ARM, "-v")
    assert re.search(rf"^\d{{4}}-\d\d-\d\d \S+ ident: read {re.escape(str(ARM))}, \d+ bytes$", err, re.MULTILINE)
    assert run("predict", ARM) == (0, words, "")


def test_quiet_says_nothing(run):
    assert run("predict", ARM, "--quiet") == (0, "", "")


def test_the_shell_completes_commands_without_jax():
    environment = os.environ | {"_IDENT_COMPLETE": "complete_bash", "COMP_WORDS": "ident re", "COMP_CWORD": "1"}
    program = "import sys; sys.argv = ['ident']; from ident.cli import main\n"
    program += "try:\n    main()\nfinally:\n    assert not {'jax', 'numpy'} & set(sys.modules)"
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.split() == ["resonance", "rerun"]


def test_doctor_says_what_to_send_with_a_question(run):
    code, out, _ = run("doctor")
    assert code == 0
    assert {line.partition(":")[0] for line in out.splitlines() if not line.startswith(" ")} == {
        *("system", "libraries", "optional", "backend", "cache")
    }
    assert f"ident-arm {ident.__version__}" in out
    assert json.loads(run("doctor", "--json")[1])["backend"].startswith("cpu")
