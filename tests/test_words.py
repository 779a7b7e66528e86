"""Manual, data formats and notebooks in plain English: the field's phrases, few words, one glossary."""

import ast
import json
import re
from pathlib import Path

import pytest

from ident.report.document import report_of
from ident.report.report import text_of

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
COUNTED = [
    *(ROOT / name for name in ("README.md", "CHANGELOG.md", "data/README.md", "tests/benchmarks/README.md")),
    *(page for page in sorted(DOCS.rglob("*.md")) if page.name != "conformance.md"),  # written by the tests' records
]
READ = [
    *(page for page in COUNTED if page.name != "CHANGELOG.md"),
    DOCS / "conformance.md",
    *sorted((DOCS / "pictures").glob("*.txt")),
    *sorted((ROOT / "tests" / "benchmarks" / "results").glob("*.txt")),
    *sorted((ROOT / "notebooks").glob("*.py")),
]
WORDS, TERMS = 32_000, 40
"""How long all may be together, and the glossary."""
INSTEAD = {
    "nobody knows": "unknown",
    "turning mass": "imbalance, rotating unbalance",
    "speaks? against": "contradicts, objection, warning",
    "anew": "again",
    "beside": "next to, and, against",
    "for granted": "assumed, assumption",
    "withheld": "not reported",
    "open directions?": "undetermined combination",
    "change norm": "size of change",
    "far too (wide|slow)": "exaggerated, slowed down",
    "likened": "matched",
    "rivals?": "competing optima",
    "reconcile": "explain",
    "near draw": "ambiguous",
    "misfits?": "reference check",
    "held out": "left out, cross-validation",
    "exchanged": "swapped",
    "sought": "searched, searched for",
}
"""What is not said, and what is said instead."""
OLD = (
    *(
        "nobody knows",
        "turning mass(?:es)?",
        "speaks? against",
        "by the others",
        "what hung",
        "anew",
        "likened",
        "unheld",
    ),
    *("misfits", "a slip", "told by", "off by", "not asked for", "rivals?", "oddities", "withheld"),
)
"""Words that no report, figure, page, message or help has any more."""
OLD_WORDS = re.compile(rf"\b({'|'.join(OLD)})\b", re.IGNORECASE)
ALLOWED = {"show.md": ("held out level", "picture.oddities")}
SCREENS = sorted((ROOT / "tests" / "data" / "screens").glob("*/*.json"))
"""Reports, stored by `tests/data/screens/make.py`."""


def said_otherwise(text, allowed=()):
    """Return the phrases of a text that have a better one, code in backticks apart."""
    for phrase in allowed:
        text = text.replace(phrase, "")
    text = " ".join(re.sub(r"`[^`\n]*`", "", text).split())
    found = [phrase for phrase in INSTEAD if re.search(rf"\b{phrase}", text, re.IGNORECASE)]
    return found or OLD_WORDS.findall(text)


@pytest.mark.parametrize("page", READ, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_in_plain_english(page):
    text = page.read_text(encoding="utf-8")
    if page.suffix == ".py":
        text = "\n".join(line.removeprefix("#") for line in text.splitlines() if line.startswith("# "))
    assert not said_otherwise(text, ALLOWED.get(page.name, ()))


def test_a_phrase_is_found():
    assert said_otherwise("phases that nobody\nknows") == ["nobody knows"]
    assert said_otherwise("`anew` besides") == ["beside"]
    assert said_otherwise("told by others") == ["told by"]


def test_all_together_is_short():
    assert sum(len(page.read_text(encoding="utf-8").split()) for page in COUNTED) <= WORDS


def test_the_glossary_is_short_and_in_order():
    text = (DOCS / "glossary.md").read_text(encoding="utf-8")
    terms = re.findall(r"^(.+)\n: ", text, re.MULTILINE)
    assert 20 < len(terms) <= TERMS
    assert terms == sorted(terms, key=str.lower)


def sentences(path):
    """Return what a module may print: its texts of more than one word, docstrings apart."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    bodies = [node.body for node in ast.walk(tree) if isinstance(getattr(node, "body", None), list)]
    docstrings = {id(node.value) for body in bodies for node in body if isinstance(node, ast.Expr)}
    texts = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)]
    return [node.value for node in texts if " " in node.value and id(node) not in docstrings]


def test_no_message_has_an_old_phrase():
    modules = sorted((ROOT / "ident").rglob("*.py"))
    assert not [text for path in modules for text in sentences(path) if OLD_WORDS.search(text)]
    pages = [path for path in (ROOT / "ident").rglob("*.*") if path.suffix in (".jinja", ".js", ".toml", ".csv")]
    assert len(pages) > 10
    for path in (ROOT / "ident" / "cli" / "commands.py", *pages):  # its docstrings are what --help prints
        assert not OLD_WORDS.findall(path.read_text(encoding="utf-8")), path


@pytest.mark.parametrize("path", SCREENS, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_no_report_has_an_old_phrase(path):
    """With its details; a standard error is called one."""
    report = json.loads(path.read_text(encoding="utf-8"))["report"]
    text = text_of(report_of(report), details=True) if report else ""
    assert not OLD_WORDS.findall(text)
    assert not re.findall(r"\bsd\b", text)


def test_a_message_is_read(tmp_path):
    path = tmp_path / "module.py"
    path.write_text('"""What it is."""\nTEXT, NAME = "told by data", "withheld"\n', encoding="utf-8")
    assert sentences(path) == ["told by data"]
