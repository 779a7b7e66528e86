"""The house keeps its size and shape: files of 60 to 900 lines, few parameters, no cycle of imports."""

import ast
import re
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "ident"
FILES = sorted(PACKAGE.rglob("*.py"))
LINES, MANY_LINES, FEW_LINES, PARAMETERS = 900, 700, 60, 9
CODE_LINES = 40_445
"""Of the package, without docstrings, comments, blank lines and imports. What comes in is paid for by what goes out."""
BOUND = ("self", "cls")


def tree_of(path):
    return ast.parse(path.read_text(encoding="utf-8"))


def module_name(path):
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_name(path): path for path in FILES}


def parameters(function):
    given = function.args
    named = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
    return [name for name in named if name not in BOUND]


def functions(tree):
    """All but constructors: those take the fields of a value, however many it has."""
    every = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return [function for function in every if function.name != "__init__"]


def for_type_checkers(node):
    return isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test)


def run_at_import(tree):
    """Statements that run when a module is imported: no bodies of functions, nothing for type checkers alone."""
    pending = list(tree.body)
    while pending:
        node = pending.pop()
        yield node
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) and not for_type_checkers(node):
            pending += [child for child in ast.iter_child_nodes(node) if isinstance(child, ast.stmt)]


def run_at_some_time(tree):
    """The same, with the bodies of functions."""
    hidden = {id(inner) for node in ast.walk(tree) if for_type_checkers(node) for inner in ast.walk(node)}
    return [node for node in ast.walk(tree) if id(node) not in hidden]


def imported(nodes):
    """Modules of this house that statements import."""
    for node in nodes:
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            module = name if name in MODULES else name.rpartition(".")[0]
            if module in MODULES:
                yield module


@cache
def imported_at_some_time(path):
    return tuple(imported(run_at_some_time(tree_of(path))))


def cycle(graph):
    """Return a cycle of a graph as text, empty where there is none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return " -> ".join(error.args[1])
    return ""


def test_no_file_is_long():
    assert not [path for path in FILES if len(path.read_text(encoding="utf-8").splitlines()) > LINES]


def code_lines(path):
    """Lines that are neither blank, comment, docstring nor import."""
    text = path.read_text(encoding="utf-8")
    lines, apart = text.splitlines(), set()
    for node in ast.walk(ast.parse(text)):
        bodies = node.body if isinstance(getattr(node, "body", None), list) else []
        said = [each for each in bodies if isinstance(each, ast.Expr) and isinstance(each.value, ast.Constant)]
        own = [each for each in said if isinstance(each.value.value, str)]
        for each in [*own, *([node] if isinstance(node, ast.Import | ast.ImportFrom) else [])]:
            apart |= set(range(each.lineno, each.end_lineno + 1))
    return sum(bool(line.strip()) and line.strip()[0] != "#" for i, line in enumerate(lines, 1) if i not in apart)


def test_the_package_does_not_grow():
    assert sum(map(code_lines, FILES)) <= CODE_LINES


def test_most_files_are_neither_short_nor_long():
    lengths = [len(path.read_text(encoding="utf-8").splitlines()) for path in FILES if not path.stem.startswith("__")]
    assert sum(FEW_LINES <= length <= MANY_LINES for length in lengths) >= 0.9 * len(lengths)


def test_the_first_words_of_a_file_name_what_exists():
    """Names in backticks, in the docstring of a module and in its headings."""
    words = set()
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        headings = re.findall(r"^# -{8} .*(?:\n#.*)*", text, re.MULTILINE)
        parts = [ast.get_docstring(ast.parse(text)) or "", *headings]
        words |= {(word, path) for part in parts for word in re.findall(r"`(\w+)`", part)}
    assert len(words) > 20
    assert not {(word, path) for word, path in words if not is_name(word)}


@cache
def is_name(word):
    """Whether a word names a file, or stands without backticks in the package or its tests."""
    sources = [*FILES, *Path(__file__).parent.rglob("*.py")]
    named = re.compile(rf"(?<![`\w]){word}(?![`\w])")
    return any(named.search(path.read_text(encoding="utf-8")) or path.stem == word for path in sources)


def test_no_function_has_many_parameters():
    every = [(path, f) for path in FILES for f in functions(tree_of(path))]
    assert not {(path, f.name): len(parameters(f)) for path, f in every if len(parameters(f)) > PARAMETERS}


def test_no_cycle_of_modules():
    graph = {name: set(imported(run_at_import(tree_of(path)))) - {name} for name, path in MODULES.items()}
    assert not cycle(graph)


def test_no_cycle_of_rooms_with_what_is_imported_late():
    graph = {}
    for name, path in MODULES.items():
        room = name.split(".")[1:2]
        used = {module.split(".")[1] for module in imported_at_some_time(path) if "." in module}
        if room:
            graph.setdefault(room[0], set()).update(used - set(room))
    assert {"arm", "studies", "cli"} <= set(graph)
    assert not cycle(graph)


def test_the_checks_see_what_they_look_for():
    tree = ast.parse("from ident.arm import modes\ndef f(self, a, /, b, *, c):\n    import ident.errors\n")
    assert parameters(functions(tree)[0]) == ["a", "b", "c"]
    assert list(imported(run_at_import(tree))) == ["ident.arm.modes"]
    assert sorted(imported(run_at_some_time(tree))) == ["ident.arm.modes", "ident.errors"]
    assert cycle({"a": {"b"}, "b": {"a"}})
    hidden = ast.parse("if TYPE_CHECKING:\n    import ident.arm.modes\n")
    assert not [*imported(run_at_import(hidden)), *imported(run_at_some_time(hidden))]


def test_contributing_says_who_may_use_whom():
    source = (PACKAGE.parent / "tests" / "test_imports.py").read_text(encoding="utf-8")
    tables = {ast.unparse(n.targets[0]): n.value for n in ast.parse(source).body if isinstance(n, ast.Assign)}
    may_use = {ast.literal_eval(k): v for k, v in zip(tables["MAY_USE"].keys, tables["MAY_USE"].values, strict=True)}
    text = (PACKAGE.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| ([\w, ]*)\|", text, re.MULTILINE)
    assert [room for room, _ in rows] == list(may_use)
    for room, used in rows:
        allowed = set() if isinstance(may_use[room], ast.Call) else ast.literal_eval(may_use[room])
        assert set(filter(None, map(str.strip, used.split(",")))) == allowed
    ground = re.search(r"the ground \(([^)]*)\)", text)[1]
    assert set(re.findall(r"`(\w+)`", ground)) == ast.literal_eval(tables["GROUND"])
