"""The next command of a report: its files, and what the user gave that it needs again."""

import inspect
import re
from collections.abc import Iterable, Iterator, Mapping
from contextvars import ContextVar
from functools import partial
from pathlib import Path
from typing import Any

from ident.studies import module_of, options_of
from ident.studies.options import Options, default_of, flag_of, specs
from ident.studies.reading import columns_in_words
from ident.text import as_word, within

FOLDER = ContextVar("FOLDER", default=Path("out"))
"""The folder of the files that a report's next command names."""
kept_in = partial(within, FOLDER)
"""Let reports made inside this context name files in this folder."""
COMMAND = re.compile(r"(?:^|: )ident (\w+) ")
"""A command that a report proposes, perhaps after what to do before it; its last words."""
BRACES = re.compile(r"{{|}}|{(arm|campaign|trace|runs|result)}")
"""A file that a report names, or a doubled brace, which becomes a single one."""
FILES, VALUES = ("arm", "campaign", "trace", "runs"), ("fit", "posterior", "path")
"""Inputs that a report names in braces, and those that the next command takes by a flag."""
AGAIN = (
    *("limit", "speed", "profile", "retract", "smoothing", "dwell", "phases", "errors", "elastic_belts", "load", "set"),
    *("fix", "tie", "free", "uncertain", "no_uncertain", "prior_sd", "no_prior", "prior", "discrepancy", "robust"),
    *("trust_values", "soft_base", "columns", "units", "force"),
)
"""Options without which the next command would answer another question; those of the computation are not repeated."""
CONTAINED = {
    "--path {result}": ("path", "speed", "profile", "retract", "smoothing", "columns"),
    "{result}.toml": ("fit", "posterior", "set", "force"),
    "--sensitivities": ("limit",),
}
"""What is not repeated with some words: a motion or an arm that was just written contains it, or it is of no use."""
PRINTING = ("check", "predict")
"""Commands that write no files."""


def next_command(words: str, inputs: Mapping[str, Any], options: Options, name: str) -> str:
    """Return the next step of a report: files for `{arm}`, `{result}` and so on, then what was given again."""
    paths = {each: getattr(inputs.get(each), "path", "") or "" for each in (*FILES, *VALUES)}
    files = {each: as_word(paths[each] or each.upper()) for each in FILES} | {"result": as_word(FOLDER.get() / name)}
    if paths["arm"] and paths["campaign"] and Path(paths["arm"]) != Path(paths["campaign"]).parent / "arm.toml":
        files["campaign"] += f" --arm {files['arm']}"
    filled = BRACES.sub(lambda match: files[match[1]] if match[1] else match[0][0], words)
    command = COMMAND.search(words)
    return " ".join([filled, *(_given(command[1], words, paths, options) if command else ())])


def _given(study: str, words: str, paths: Mapping[str, str], options: Options) -> Iterator[str]:
    """Yield the flags of the next command for what this one was given."""
    kind: type[Options] = options_of(study)
    takes = inspect.signature(getattr(module_of(study), study, kind)).parameters  # modal's function has another name
    fields = {each.name: each for each, _ in specs(kind) if each.name not in kind.refuses}
    flags = {each: f"--{each}" for each in VALUES} | {name: flag_of(each) for name, each in fields.items()}
    left_out = {each for mark, own in CONTAINED.items() if mark in words for each in own}
    left_out |= {each for each, flag in flags.items() if f" {flag} " in words}
    files = {each: paths[each] for each in VALUES if each in takes and paths[each] and each not in left_out}
    yield from (f"--{each} {as_word(path)}" for each, path in files.items())
    if "path" in files:
        left_out |= {"profile", "retract"}
    if not files:
        left_out.add("force")
    given = {each.name: each for each, _ in specs(type(options))}
    both = (fields.keys() & given.keys()) - left_out
    for each in (each for each in AGAIN if each in both):
        value, own, other = getattr(options, each), fields[each], given[each]
        alike = own.metadata["spec"].repeated == other.metadata["spec"].repeated  # a plan has several loads
        if alike and value is not None and value != default_of(own):
            yield from (f"{flags[each]} {as_word(text)}" if text else flags[each] for text in _texts(each, value))
    if study not in PRINTING and FOLDER.get() != Path("out"):
        yield f"--out {as_word(FOLDER.get())}"


def _texts(name: str, value: Any) -> Iterable[str]:
    """Return the texts with which a flag gives a value; of a switch an empty one."""
    if name == "columns":
        return [columns_in_words(value)]
    if isinstance(value, Mapping):
        sign = "=" if name in ("set", "prior") else ":"
        return [f"{key}{sign}{each}".removesuffix(":inf") for key, each in value.items()]
    if isinstance(value, tuple) and name != "errors":
        return [each if isinstance(each, str) else "=".join(each) for each in value]
    numbers = value if isinstance(value, tuple) else (value,)
    return ["" if value is True else ":".join(f"{x:.12g}" if isinstance(x, float) else str(x) for x in numbers)]
