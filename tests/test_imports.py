"""The house has one way through: no room imports from one further on, and each library has its room."""

import ast
from functools import cache
from pathlib import Path

import pytest

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
    "assess": {"arm", "description", "measure", "inference", "modal", "identify", "vibrate"},
    "present": {"arm", "description", "measure", "inference", "modal", "identify", "vibrate", "assess"},
    "studies": {"arm", "description", "measure", "inference", "modal", "identify", "vibrate", "assess", "present"},
    "cli": {"studies", "description", "measure"},
}
"""Which rooms each room may use, besides the ground: no licence to use all that lie below it."""
ONLY_IN = {
    "dynesty": "inference/draws",
    "emcee": "inference",
    "jinja2": "present/html",
    "matplotlib": "present",
    "nptdms": "measure/recordings",
    "optimistix": "inference/levenberg_marquardt",
    "pydantic": "description",
    "rich": "cli",
    "ruckig": "vibrate/motion",
    "typer": "cli",
}


def imports(path):
    return imports_of(ast.parse(path.read_text()))


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


@pytest.mark.parametrize("module", modules(), ids=str)
def test_no_arrow_points_up(module):
    room = module.parts[0].removesuffix(".py")
    for name in imports(PACKAGE / module):
        parts = name.split(".")
        if parts[0] == "ident" and len(parts) > 1 and room in MAY_USE:
            assert parts[1] in MAY_USE[room] | GROUND | {room}, f"{module} imports {name}"


@pytest.mark.parametrize("module", modules(), ids=str)
def test_each_library_has_its_room(module):
    for name in run(PACKAGE / module):
        room = ONLY_IN.get(name.split(".")[0])
        assert room is None or str(module).startswith(room), f"{module} imports {name}"


def test_present_computes_nothing():
    for module in modules():
        if module.parts[0] == "present":
            assert not {"jax", "jax.numpy", "ident.programs"} & set(imports(PACKAGE / module)), module


def test_the_check_sees_imports():
    assert "ident.errors" in set(imports(PACKAGE / "arm" / "arm.py"))
    design = PACKAGE / "studies" / "design.py"
    assert "matplotlib.figure" in set(imports(design)) - set(run(design))
    assert "ident.present.figures.design" in set(run(design)), "within a function"
    assert len(modules()) > 20


REACHES = {"predict": 15_100, "fit": 24_300, "simulate": 20_350, "sample": 30_100, "modal": 21_450, "sweep": 21_900}
"""Lines of the modules that a study can reach, those that functions import among them: no more, rather less."""


@pytest.mark.parametrize("study", REACHES)
def test_a_study_reaches_only_so_many_lines(study):
    """What a reader of one study may have to read: aims are 12,000 for a prediction, 16,000 for a fit."""
    reached, ahead = set(), [PACKAGE / "studies" / f"{study}.py"]
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
