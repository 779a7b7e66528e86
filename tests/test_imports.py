"""The house has one way through: no room imports from one further on, and each library has its room."""

import ast
import re
from functools import cache
from pathlib import Path

import pytest

from ident.studies import MODULES

PACKAGE = Path(__file__).parent.parent / "ident"
GROUND = {"codec", "errors", "files", "programs", "text", "units"}
MAY_USE = {
    "arm": set(),
    "description": {"arm"},
    "measure": set(),
    "inference": set(),
    "modal": {"measure"},
    "identify": {"arm", "measure", "inference", "modal"},
    "vibrate": {"arm"},
    "report": {"arm", "measure", "inference", "identify"},
    "studies": {"arm", "description", "measure", "inference", "modal", "identify", "vibrate", "report"},
    "cli": {"studies", "description", "measure"},
}
"""Which rooms each room may use, besides the ground: no licence to use all that lie below it."""
STEPS_MAY_USE = {
    "look": set(),
    "measuring": set(),
    "working": {"look"},
    "cause": {"working"},
    "stiffness": {"look", "working", "cause"},
    "cure": {"look", "working", "cause", "stiffness"},
}
"""Which steps the files of each step of the studies may use; the studies' own files use none."""
ONLY_IN = {
    "dynesty": "inference/draws",
    "emcee": "inference",
    "fpdf": "report/pdf",
    "jinja2": "report/templates",
    **dict.fromkeys(("lz4", "mcap", "rosbags", "zstandard"), "measure/robot_logs"),
    "matplotlib": ("report", "studies"),
    "nptdms": "measure/recordings",
    "optimistix": "inference/levenberg_marquardt",
    "pydantic": "description",
    "rich": "cli",
    "ruckig": "vibrate/motion",
    "typer": "cli",
}


@cache
def imports(path):
    return tuple(imports_of(ast.parse(path.read_text())))


def imports_of(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


def run(path):
    """Imports that run: not those for type checkers alone."""
    return imports_of(run_time(path))


@cache
def run_time(path):
    tree = ast.parse(path.read_text())
    blocks = [node for node in ast.walk(tree) if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"]
    for block in blocks:
        block.body = [ast.Pass()]
    return tree


def modules():
    return sorted(path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py"))


def test_no_arrow_points_up():
    every = [(module, module.parts[0].removesuffix(".py")) for module in modules()]
    for module, room in every:
        for name in imports(PACKAGE / module):
            parts = name.split(".")
            if parts[0] == "ident" and len(parts) > 1 and room in MAY_USE:
                assert parts[1] in MAY_USE[room] | GROUND | {room}, f"{module} imports {name}"
    assert {room for _, room in every} >= {*MAY_USE}


def test_each_library_has_its_room():
    for module in modules():
        for name in run(PACKAGE / module):
            room = ONLY_IN.get(name.split(".")[0])
            assert room is None or str(module).startswith(room), f"{module} imports {name}"


def step_of(names):
    """The step that a module of the studies belongs to, by the parts of its name; None for their own files."""
    return names[1] if len(names) > 2 and names[0] == "studies" and names[1] in STEPS_MAY_USE else None


def test_each_step_uses_those_before_it():
    studies = [each for each in modules() if each.parts[0] == "studies"]
    for module in studies:
        own = step_of(module.parts)
        for name in run(PACKAGE / module):
            step = step_of([*name.split(".")[1:], ""])
            assert step in (None, own) or step in STEPS_MAY_USE.get(own, ()), f"{module} imports {name}"
    assert {step_of(module.parts) for module in studies} >= {*STEPS_MAY_USE}


SHOWING = re.compile(r"_(report|figure|page|files)$")


def test_what_shows_results_computes_nothing():
    showing = [each for each in modules() if each.parts[0] == "report" or SHOWING.search(each.stem)]
    assert len(showing) > 50
    for module in showing:
        assert not {"jax", "jax.numpy", "ident.programs"} & set(imports(PACKAGE / module)), module
        drawing = {name for name in run(PACKAGE / module) if name.startswith("matplotlib")}
        assert not drawing or module.parts[0] == "report" or module.stem.endswith(("_figure", "_page")), module


def test_the_check_sees_imports():
    assert "ident.errors" in set(imports(PACKAGE / "arm" / "arm.py"))
    design = PACKAGE / "studies" / "cure" / "design.py"
    assert "matplotlib.figure" in set(imports(design)) - set(run(design))
    assert "ident.studies.cure.design_figure" in set(run(design)), "within a function"
    assert len(modules()) > 20


REACHES = {
    "predict": 17_100,
    "fit": 24_200,
    "simulate": 21_400,
    "sample": 26_600,
    "modal": 21_700,
    "sweep": 21_500,
    "motion": 25_200,
    "plan": 29_300,
    "fleet": 27_700,
    "source": 24_100,
    "balance": 28_100,
    "joint": 14_900,
    "triage": 23_900,
    "diagnose": 47_300,
}
"""Lines of the modules that a study can reach, with its report, figure, page and files: no more, rather less.

Those that functions import, and those that are found by name, count. Planned runs (`plan --runs`) are a part of
`source`, which `plan` loads by its place.
"""
BESIDE = ("", "_report", "_figure", "_page", "_files", "_plan")


@pytest.mark.parametrize("study", REACHES)
def test_a_study_reaches_only_so_many_lines(study):
    """What a reader of one study may have to read."""
    files = [PACKAGE.parent.joinpath(*f"{MODULES[study]}{part}".split(".")).with_suffix(".py") for part in BESIDE]
    reached, ahead = set(), [path for path in files if path.is_file()]
    while ahead:
        path = ahead.pop()
        if path not in reached:
            reached.add(path)
            ahead += list(of_the_house(path))
    assert PACKAGE / "arm" / "arm.py" in reached
    assert sum(path.read_text().count("\n") for path in reached) <= REACHES[study]


@cache
def of_the_house(path):
    """The files that a file's imports run; of `from package import name` the module of that name, if there is one."""
    found = []
    for node in ast.walk(run_time(path)):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        for name in names:
            own = PACKAGE.parent.joinpath(*name.split("."))
            found += [each for each in (own.with_suffix(".py"), own / "__init__.py") if each.is_file()]
    return found
