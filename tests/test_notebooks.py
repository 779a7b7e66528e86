"""The notebooks run, with less of what takes long, and their executed copies show the scripts as they are.

What is less stands in `support/run_notebook.py`. After a change to a script,
`PYTHONPATH=tests/support python tests/test_notebooks.py NAME ...` executes it and writes the .ipynb anew; without a
name, all of them.
"""

import ast
import base64
import sys
from pathlib import Path

import jupytext
import nbformat
import pytest
from notebook_runner import NotebookRunner

pytestmark = pytest.mark.slow

FOLDER = Path(__file__).parents[1] / "notebooks"
SCRIPTS = sorted(FOLDER.glob("*.py"))
LIMIT = 560
"""Seconds that a notebook may take where nothing has been compiled yet."""
PICTURE = "06_the_remedy.ipynb", "remedy.png"
"""The notebook whose last figure is the README's, and where that lies."""
by_script = pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)


def code(notebook):
    return [cell.source for cell in notebook.cells if cell.cell_type == "code"]


def executed(script):
    return nbformat.read(script.with_suffix(".ipynb"), as_version=4)


def test_there_are_notebooks():
    assert SCRIPTS


@pytest.fixture(scope="module")
def runner():
    """Runs one script after the other in one process."""
    notebooks = NotebookRunner(FOLDER)
    yield notebooks
    notebooks.stop()


@by_script
@pytest.mark.timeout(LIMIT)
def test_runs_as_plain_python(runner, script):
    done = runner.run(script.name)
    assert not done["failed"], done["failed"]
    assert done["printed"].strip()


@by_script
def test_no_script_chooses_phases(script):
    """`support/run_notebook.py` has all simulations with those of the arm's file."""
    assert "phases=" not in script.read_text(encoding="utf-8")


def imported_of_ident(text):
    """Modules of ident that a script imports, and what it imports from them."""
    for node in ast.walk(ast.parse(text)):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        yield from (ast.unparse(node) for name in names if name.partition(".")[0] == "ident")


@by_script
def test_it_takes_the_front_door(script):
    text = script.read_text(encoding="utf-8")
    assert list(imported_of_ident(text)) == ["import ident"]
    assert "jax" not in text


def test_the_front_door_is_told_from_others():
    for line in ("import ident.arm", "from ident.arm import arm", "from ident import fit", "import ident as i"):
        assert list(imported_of_ident(f"import numpy\nif True:\n    {line}")) == [line]


@by_script
def test_executed_copy_shows_the_script(script):
    copy = executed(script)
    assert code(copy) == code(jupytext.read(script))
    text = [cell.source for cell in copy.cells if cell.cell_type == "markdown"]
    assert text == [cell.source for cell in jupytext.read(script).cells if cell.cell_type == "markdown"]


@by_script
def test_executed_copy_has_outputs_and_no_traces_of_a_machine(script):
    copy, raw = executed(script), script.with_suffix(".ipynb").read_text(encoding="utf-8")
    outputs = [output for cell in copy.cells if cell.cell_type == "code" for output in cell.outputs]
    assert not [o for o in outputs if o.output_type == "error" or o.get("name") == "stderr"]
    assert sum("image/png" in o.get("data", {}) for o in outputs) >= 3
    assert len(raw) < 1_500_000
    for trace in ("/home/", "/root/", "/tmp/", "/work/", "/Users/", str(FOLDER.parent)):
        assert trace not in raw


def last_picture(notebook):
    outputs = [output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs]
    return base64.b64decode([o.data["image/png"] for o in outputs if "image/png" in o.get("data", {})][-1])


def test_picture_of_the_readme_is_that_of_its_notebook():
    name, picture = PICTURE
    shown = (FOLDER / picture).read_bytes()
    assert shown == last_picture(executed(FOLDER / name))
    assert len(shown) < 150_000
    assert f"notebooks/{picture}" in (FOLDER.parent / "README.md").read_text(encoding="utf-8")


def rebuild(script):
    from nbclient import NotebookClient

    notebook = jupytext.read(script)
    NotebookClient(notebook, timeout=1800, record_timing=False, resources={"metadata": {"path": str(FOLDER)}}).execute()
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number}"
    notebook.metadata.pop("jupytext", None)
    nbformat.write(notebook, script.with_suffix(".ipynb"))
    name, picture = PICTURE
    if script.with_suffix(".ipynb").name == name:
        (FOLDER / picture).write_bytes(last_picture(notebook))


if __name__ == "__main__":
    for path in [FOLDER / f"{name.removesuffix('.py')}.py" for name in sys.argv[1:]] or SCRIPTS:
        rebuild(path)
