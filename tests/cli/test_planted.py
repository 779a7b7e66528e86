"""Nothing of a folder that somebody hands over is executed; a lab's own `select.py` does not break what reads there."""

import ast
import inspect
import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from arms import DATA
from scipy.io import savemat
from typer.models import OptionInfo

import ident
from ident.cli.command import NO_DEFAULTS, WITHOUT
from ident.cli.output import app
from ident.studies.options import specs

IDENT = str(Path(sys.executable).with_name("ident"))
MODULES = ("numpy", "json", "select", "multiprocessing", "difflib", "scipy", "jax")
WAYS = {"ident": ([IDENT], True), "-P -m": ([sys.executable, "-P", "-m", "ident"], True)}
WAYS["-m"] = ([sys.executable, "-m", "ident"], False)  # Python itself imports a package of that name before anything


def planted(folder, package=True):
    """A recording of SciPy's default, with modules beside it that leave a mark where they are executed."""
    folder.mkdir()
    savemat(folder / "hit.mat", {"hammer": np.sin(np.arange(64.0)), "tip": np.cos(np.arange(64.0))})
    places = [folder / f"{name}.py" for name in MODULES] + [folder / "ident" / "__init__.py"] * package
    for place in places:
        place.parent.mkdir(exist_ok=True)
        place.write_text(f"open({str(folder / 'executed')!r}, 'a').write(__name__)\nraise SystemExit(5)\n")


def called(words, folder):
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=240)
    assert not (folder / "executed").exists(), (folder / "executed").read_text()
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("way", WAYS)
def test_a_recording_is_read_in_a_folder_of_planted_modules(tmp_path, way):
    """An uncompressed MATLAB file is read by a process of its own."""
    words, package = WAYS[way]
    planted(tmp_path / "handed", package)
    code, out, err = called([*words, "modal", ".", "--init"], tmp_path / "handed")
    assert (code, err) == (0, "")
    assert "2 channels to fill in" in out


@pytest.mark.slow
def test_workers_of_a_fleet_execute_nothing_planted(tmp_path):
    planted(tmp_path / "handed")
    for name in ("one", "two"):
        (tmp_path / "handed" / f"{name}.csv").write_text("kind,value\n")
    words = [IDENT, "fleet", ".", "--workers=2", "--no-figure", "--details", f"--arm={DATA / 'lcd_arm' / 'arm.toml'}"]
    code, out, err = called(words, tmp_path / "handed")
    assert code == 3, err
    assert "0 in the population, 2 failed" in out
    assert "killed" not in out


STARTS = r"\b(subprocess|multiprocessing|pickle|shelve|runpy|os\.system|import_module|__import__|eval|exec)\b"
KNOWN = {
    "__init__.py": {"import_module"},  # names of its own table
    "measure/__init__.py": {"import_module"},
    "measure/recordings/__init__.py": {"import_module"},  # by the file's ending, one of a table
    "measure/recordings/matlab.py": {"subprocess"},
    "studies/__init__.py": {"import_module"},  # files beside it
    "studies/stiffness/fleet_tasks.py": {"multiprocessing"},  # its processes with PYTHONSAFEPATH
}
"""Where processes start and modules are found by name: each keeps out of the current folder. Nothing is unpickled."""


def test_a_new_place_that_starts_something_is_looked_at():
    root = Path(ident.__file__).parent
    found = {}
    for path in sorted(root.rglob("*.py")):
        tree = ast.parse(path.read_text())
        code = [node for node in ast.walk(tree) if isinstance(node, ast.Call | ast.Import | ast.ImportFrom)]
        words = {word for node in code for word in re.findall(STARTS, _named(node))}
        if words:
            found[str(path.relative_to(root))] = words
    assert found == KNOWN


def _named(node):
    """What is imported, or called."""
    if isinstance(node, ast.Call):
        return ast.unparse(node.func)
    return " ".join([*(each.name for each in node.names), getattr(node, "module", None) or ""])


READ = {"arm", "fit", "font", "posterior", "path", "trace", "against", "runs", "channels", "measured"}
WRITTEN_TO = {"out"}
NAMES = {"load", "payload", "criterion", "point"}
"""What `ident.toml` may set of flags with a path or free text: files that are read, the folder that is written to and
that a line says, names of parts. Nothing else opens, writes or connects; a new flag of this kind is put here."""


def flags_of_all_commands():
    for each in app.registered_commands:
        own = {} if each.name in WITHOUT else inspect.signature(each.callback).parameters
        for name in own.keys() - {*NO_DEFAULTS, "context"}:
            kind, info = get_args(own[name].annotation)
            if isinstance(info, OptionInfo):
                yield name, {kind, *get_args(kind)}


def test_what_may_stand_in_ident_toml_connects_with_nobody():
    """What is parsed, as postures are, comes as a text or none."""
    flags = list(flags_of_all_commands())
    chosen = {each.name for kind in every_kind_of_options() for each, spec in specs(kind) if spec.choices}
    assert {name for name, kinds in flags if Path in kinds} == READ | WRITTEN_TO
    assert {name for name, kinds in flags if kinds == {str}} - chosen == NAMES


def every_kind_of_options():
    return [getattr(ident, name) for name in ident.__all__ if name.endswith("Options")]


@pytest.mark.parametrize("kind", every_kind_of_options())
def test_what_a_result_has_recorded_connects_with_nobody(kind):
    """Of options with free text only names of parts are taken over: as an address each would be refused as such."""
    free = [each.name for each, spec in specs(kind) if each.type is str and not (spec.choices or spec.read)]
    texts = [name for name in free if name not in kind.refuses]
    recorded = kind().recorded()
    needed = {"tool": True} if "tool" in recorded else {}  # a point is that of the tool
    restored = kind.restored(recorded | needed | dict.fromkeys(texts, "tcp://127.0.0.1:1"))
    assert {name for name in texts if getattr(restored, name)} <= NAMES
