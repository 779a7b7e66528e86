"""What is wrong with an `arm.toml`, as one-line problems with the place in the file and a remedy."""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, get_args

from pydantic import ValidationError

from ident.description.schema import ArmDocument, Box, Cylinder, Loc, Lump, Origin, Quantity, Table, as_written, named
from ident.errors import Problem, refusal
from ident.text import NAME_RULE, did_you_mean

# -------- Explanations
# What is wrong with an `arm.toml`: pydantic's errors, and clashing names, as one-line problems.

EXPECTED = {
    "finite_number": "a finite number",
    "float_type": "a number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "list_type": "a list",
    "greater_than": "a number > {gt:g}",
    "greater_than_equal": "a number >= {ge:g}",
    "less_than_equal": "magnitudes up to {le:g}",
    "too_short": "at least {min_length} entries",
    "too_long": "at most {max_length} entries",
    "literal_error": "{expected}",
    "union_tag_invalid": "kind {expected_tags}",
    "union_tag_not_found": "kind 'box', 'cylinder' or 'point'",
    "string_pattern_mismatch": NAME_RULE,
    "string_too_short": "some text",
}
"""What pydantic's error types mean for the writer of the file."""

ADD = {
    "unit": 'add unit = "..."',
    "origin": f'add origin = "..."; one of {", ".join(get_args(Origin))}',
    "joint": "describe each joint in a table [[joint]]",
    "format": 'begin the file with format = "ident-arm/1"',
}
"""How to add a key that is missing."""

SHAPES: dict[str, type[Table]] = {"box": Box, "cylinder": Cylinder, "point": Lump}


@cache
def tables_of(document: type[Table]) -> dict[str, type[Table]]:
    """Return what each table of a document may say, by its key; the whole by none."""
    inner = [(key, kind) for key, field in document.model_fields.items() for kind in _tables_in(field.annotation)]
    return {key: kind for _, table in inner for key, kind in tables_of(table).items()} | dict(inner) | {"": document}


def _tables_in(annotation: Any) -> Iterator[type[Table]]:
    """Yield the classes of tables that a field may have."""
    if inner := get_args(annotation):
        yield from (table for each in inner for table in _tables_in(each))
    elif isinstance(annotation, type) and issubclass(annotation, Table):
        yield annotation


@dataclass(frozen=True)
class Source:
    """The text and its content, which together tell where a thing is written.

    Attributes:
        where: names the text.
        text: the TOML text.
        raw: its content, not checked.
        document: what it may say.
    """

    where: str
    text: str
    raw: dict[str, Any]
    document: type[Table] = ArmDocument

    def problem(self, loc: Loc, got: str, expected: str, remedy: str) -> Problem:
        """Return a problem with the found or missing entry at a location."""
        lines = _line_numbers(self.text)
        line = next(lines[loc[:n]] for n in range(len(loc), -1, -1) if loc[:n] in lines)
        return Problem(f"{self.where}:{line}", got, expected, remedy, self.words(loc))

    def read(self) -> tuple[Any, list[Problem]]:
        """Return the document (None if invalid) and its problems."""
        problems = list(self.name_problems())
        try:
            return self.document.model_validate(self.raw), problems
        except ValidationError as error:
            details = error.errors(include_url=False)
        places = [self._written(detail["loc"], missing=detail["type"] == "missing") for detail in details]
        found = [self.problem(loc, *self._finding(loc, each)) for loc, each in zip(places, details, strict=True)]
        return None, [*found, *problems]

    def name_problems(self) -> Iterator[Problem]:
        """Yield names that occur twice, and joints that do not exist."""
        seen: dict[str, Loc] = {}
        tables = list(named(self.raw))
        joints = [str(name) for (*_, kind, _), name, _ in tables if kind == "joint"]
        for loc, _, table in tables:
            name = table.get("name")
            if isinstance(name, str) and seen.setdefault(name, loc) != loc:
                remedy = f"rename it or {self.words(seen[name])}"
                yield self.problem((*loc, "name"), f"the name {as_written(name)} again", "unique names", remedy)
            for key in ("joint", "driver", "driven") if loc[0] != "joint" else ():
                if isinstance(joint := table.get(key), str) and joint not in joints:
                    remedy = did_you_mean(joint, joints, "name a joint of this arm")
                    yield self.problem((*loc, key), as_written(joint), f"one of {', '.join(joints)}", remedy)

    def words(self, loc: Loc) -> str:
        """Return a location such as `joint[2] 'joint3'.link[1] 'fingers'.mass`."""
        text, node = "", self.raw  # type: str, Any
        for step in loc:
            node = _child(node, step)
            key = step if re.fullmatch(r"[\w-]+", str(step)) else repr(step)
            text += f"[{step}]" if isinstance(step, int) else f".{key}" if text else str(key)
            name = node.get("name") if isinstance(node, dict) and isinstance(step, int) else None
            text += f" {as_written(name)}" if isinstance(name, str) else ""
        return text

    def _finding(self, loc: Loc, detail: Any) -> tuple[str, str, str]:
        """Return what was got and expected, and the remedy."""
        kind, context, key = detail["type"], detail.get("ctx", {}), str(loc[-1]) if loc else ""
        if kind == "ident":
            return context["got"], context["expected"], context["remedy"]
        if kind == "missing":
            return "nothing", f"the key {key}", ADD.get(key, f"add {key} = ...")
        if kind == "extra_forbidden":
            known = self._keys(loc[:-1])
            remedy = did_you_mean(key, known, "remove it")
            return f"unknown key {as_written(key)}", f"one of {', '.join(known)}", remedy
        if kind in ("model_type", "model_attributes_type"):
            unit = ', unit = "..."' * ("unit" in tables_of(self.document).get(key, Quantity).model_fields)
            remedy = f'write {key} = {{ value = ...{unit}, origin = "..." }}'
            return as_written(detail["input"]), "a table", remedy
        return as_written(detail["input"]), EXPECTED.get(kind, detail["msg"]).format(**context), "correct it"

    def _written(self, loc: Loc, *, missing: bool) -> Loc:
        """Return the location without the names that pydantic gives to the members of a union."""
        node, written = self.raw, ()  # type: Any, Loc
        for n, step in enumerate(loc):
            there = isinstance(step, int) or (isinstance(node, dict) and step in node)
            if there or (missing and n == len(loc) - 1):
                written, node = (*written, step), _child(node, step)
        return written

    def _keys(self, loc: Loc) -> list[str]:
        """Return the keys that a table may have."""
        last = next((step for step in reversed(loc) if isinstance(step, str)), "")
        node: Any = self.raw
        for step in loc:
            node = _child(node, step)
        table = SHAPES[node["kind"]] if last == "shape" else tables_of(self.document).get(last, Quantity)
        return list(table.model_fields)


def _child(node: Any, step: str | int) -> Any:
    if isinstance(node, dict):
        return node.get(step)
    return node[step] if isinstance(node, list) and isinstance(step, int) and step < len(node) else None


def lines_of(text: str) -> dict[str, int]:
    """Return the line of each quantity of an `arm.toml` that is right, by its name as `link2.com`."""
    lines, raw = _line_numbers(text), tomllib.loads(text)
    places = {loc: name for loc, name, _ in named(raw)} | {("stroke",): "stroke"}
    return {f"{places[loc[:-1]]}.{loc[-1]}": line for loc, line in lines.items() if loc[:-1] in places}


@cache
def _line_numbers(text: str) -> dict[Loc, int]:
    """Return the line of every table and key that begins a line; multi-line strings are passed over."""
    plain = re.sub(r"(\"\"\"|''').*?\1", lambda m: "\n" * m[0].count("\n"), text, flags=re.S)
    lines: dict[Loc, int] = {(): 1}
    counts: dict[Loc, int] = {}
    table: Loc = ()
    for number, line in enumerate(plain.split("\n"), 1):
        if header := re.match(r"\s*\[(\[?)\s*([\w.\- ]+?)\s*\]", line):
            table = _table_loc(header[2].split("."), counts, new=bool(header[1]))
            lines.setdefault(table, number)
        elif key := re.match(r"\s*([\w-]+)\s*=", line):
            lines.setdefault((*table, key[1]), number)
    return lines


def _table_loc(keys: list[str], counts: dict[Loc, int], *, new: bool) -> Loc:
    """Return where a header's table is; `counts` remembers how many each array of tables has."""
    loc: Loc = ()
    for n, key in enumerate(keys):
        loc += (key.strip(),)
        if new and n == len(keys) - 1:
            counts[loc] = counts.get(loc, -1) + 1
        if loc in counts:
            loc += (counts[loc],)
    return loc


# -------- TOML
# TOML text as plain data, and its mistakes as one-line problems.


def load_toml(text: str, where: str) -> dict[str, Any]:
    """Return the content of a TOML text, not checked; `where` names it in errors.

    Raises:
        InputError: it is no TOML.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        parts = re.search(r"^(.*) \(at line (\d+), column (\d+)\)$", str(error), re.S)
        what, line, column = parts.groups() if parts else (str(error), "", "")
        if not line and "end of document" in what:
            line = str(text.count("\n") + 1)
        place, column = f"{where}:{line}" if line else where, f"column {column}" if column else ""
        if where.lower().endswith(".csv"):
            raise refusal(where, "a table", "an arm description as TOML", "name the arm's file") from None
        raise refusal(place, what.lower(), "TOML", "correct the syntax", column) from None
