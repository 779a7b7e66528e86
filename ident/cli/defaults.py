"""Defaults of flags from `ident.toml` beside the campaign, or the arm: command line before file before ident's own.

starts = 8              # a flag of any command, without its dashes
out = "results"         # a path counts from the folder of the file
[fit]
prior-sd = 0.5          # for one command only
fix = ["joint1.k_bend", "joint2.k_bend"]
"""

import json
import os
import textwrap
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin

import typer

from ident.cli.output import FOLDED, output
from ident.errors import InputError, Problem
from ident.text import decode, did_you_mean, one_line, quoted, read_bytes

FILE = "ident.toml"
WITHOUT = ("new", "rerun")
"""Commands that take no defaults: what is new has none, what is repeated has its own."""
TYPES: dict[type, tuple[Any, str]] = {
    bool: (bool, "true or false"),
    int: (int, "a whole number"),
    float: (int | float, "a number"),
    str: (str | int | float, "text in quotes"),
    Path: (str, "a path in quotes"),
}
"""What a flag of each type takes from the file, and how that is said."""
LONGEST_SHOWN = 90
"""Characters of a value that are repeated."""
NO_DEFAULTS = ("help", "json", "quiet", "restart")
"""Flags that a file can't set: they are said once."""


def with_defaults(context: typer.Context, values: Mapping[str, Any], kinds: Mapping[str, Any]) -> dict[str, Any]:
    """Return a command's values, those that the command line does not give by the file, if there is one.

    Args:
        context: of the command line.
        values: by parameter.
        kinds: type of each parameter.

    Raises:
        InputError: keys that no command has, and values that their flags do not take; all are listed.
    """
    given = dict(values)
    name, own = str(context.info_name), _flags(context.command)
    path = _main(context, given)
    if name in WITHOUT or path is None or not os.path.isfile(file := path.parent / FILE):
        return given
    where, document = one_line(str(file)), _read(file)
    problems = [*_unknown(context, document, where)]
    taken: dict[str, Any] = {}
    of_all = {key: value for key, value in document.items() if not isinstance(value, dict)}
    of_this = document.get(name)
    for key, value in {**of_all, **(of_this if isinstance(of_this, dict) else {})}.items():
        parameter = own.get(_plain(key))
        if parameter is None or _said(context, parameter.name):
            continue
        try:
            taken[parameter.name] = _cast(kinds[parameter.name], value, file.parent)
        except (ValueError, OverflowError) as error:
            expected = str(error) if isinstance(error, ValueError) else "a number that is not beyond all others"
            problems.append(Problem(where, quoted(str(value)), expected, f"see ident {name} --help", key))
    if problems:
        raise InputError(problems)
    if taken:
        shown = ", ".join(f"{key.replace('_', '-')} = {_shown(value)}" for key, value in taken.items())
        output().say(textwrap.fill(f"defaults from {where}: {shown}", 100, **FOLDED))
    return {**given, **taken}


def _shown(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= LONGEST_SHOWN else text[:LONGEST_SHOWN] + "…"


def _main(context: typer.Context, values: Mapping[str, Any]) -> Path | None:
    """Return the file that the command is about: its first argument, or else the arm."""
    arguments = [each.name for each in context.command.params if each.param_type_name == "argument"]
    paths = (values.get(str(name)) for name in (*arguments, "arm"))
    return next((path for path in paths if isinstance(path, Path)), None)


def _flags(command: Any) -> dict[str, Any]:
    """Return the parameters of a command by their longest flag, without dashes."""
    options = [each for each in command.params if each.param_type_name == "option" and not each.hidden]
    named = {_plain(max(each.opts, key=len)): each for each in options}
    return {name: each for name, each in named.items() if name not in NO_DEFAULTS}


def _plain(flag: str) -> str:
    return flag.lstrip("-").replace("-", "_")


def _said(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _read(file: Path) -> dict[str, Any]:
    where = one_line(str(file))
    try:
        return tomllib.loads(decode(read_bytes(file, "defaults as TOML"), where))
    except (ValueError, RecursionError) as error:
        raise InputError(Problem(where, str(error).lower(), "defaults as TOML", "correct the syntax")) from None


def _unknown(context: typer.Context, document: Mapping[str, Any], where: str) -> Iterator[Problem]:
    """Yield keys that no command has, and those of a table that its command has not."""
    commands: dict[str, Any] = getattr(context.parent and context.parent.command, "commands", {})
    flags = {name: _flags(command) for name, command in commands.items() if name not in WITHOUT}
    every = sorted({flag for own in flags.values() for flag in own})
    for key, value in document.items():
        if isinstance(value, dict) and key in flags:
            for inner in value:
                if _plain(inner) not in flags[key]:
                    yield _no_such(where, f"{key}.{inner}", inner, sorted(flags[key]))
        elif key in flags and not isinstance(value, str):  # `fit` is a flag of other commands, too
            got, expected = quoted(str(value)), "a table of the command's flags, or as a flag a path in quotes"
            yield Problem(where, got, expected, f"write [{key}] above the flags", key)
        elif isinstance(value, dict) or _plain(key) not in every:
            yield _no_such(where, key, key, [*sorted(flags), *every] if isinstance(value, dict) else every)


def _no_such(where: str, place: str, key: str, known: list[str]) -> Problem:
    remedy = did_you_mean(_plain(key), known, "remove it").replace("_", "-")
    return Problem(where, f"unknown key {quoted(key)}", "a flag of a command, without its dashes", remedy, place)


def _cast(kind: Any, value: Any, folder: Path) -> Any:
    """Return a value of the file as the command line would have given it.

    Raises:
        ValueError: it is of another type than the flag; says what would be right.
    """
    if isinstance(kind, UnionType):
        kind = next(each for each in get_args(kind) if each is not NoneType)
    if get_origin(kind) is list:
        return [_cast(str, each, folder) for each in (value if isinstance(value, list) else [value])]
    wanted, words = TYPES[kind]
    if not isinstance(value, wanted) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(words)
    return folder / value if kind is Path else kind(value)
