"""A remedy in words: something to do."""

import re
from collections.abc import Iterator, Sequence

from ident.assess.remedies import Remedy
from ident.present.text.units import MM, is_stiffness

SMALL = 0.005
"""Relative change of a stiffness that is not worth a word."""
SMALL_MOVE = 0.0005
"""Change of a mass centre [m] that is not worth a word."""


def change_words(remedy: Remedy) -> str:
    """Say what a remedy changes, as something to do."""
    if remedy.kind == "speed":
        return f"run at {remedy.percent:.3g} % of full speed instead of {remedy.percent_before:.3g} %"
    stiffer, moved = list(_stiffer(remedy)), list(_moved(remedy))
    words = [f"make {joined(stiffer)} in torsion"] if stiffer else []
    words += [f"move {joined(moved)}"] if moved else []
    return joined(words) or "change nothing"


def _stiffer(remedy: Remedy) -> Iterator[str]:
    """Say how each stiffness changes, by more than is worth a word."""
    for path, value in remedy.values.items():
        more = value / remedy.before[path] - 1
        if is_stiffness(path) and abs(more) > SMALL:
            yield f"{spaced(path)} {100 * abs(more):.0f} % {'stiffer' if more > 0 else 'softer'}"


def _moved(remedy: Remedy) -> Iterator[str]:
    """Say how far each mass centre moves, if that is worth a word."""
    for path, value in remedy.values.items():
        further = value - remedy.before[path]
        if not is_stiffness(path) and abs(further) > SMALL_MOVE:
            yield f"the mass centre of {spaced(path)} by {MM * further:+.0f} mm in {path[-1]}"


def spaced(path: str) -> str:
    """Return the name of a part, by a path, as one says it: joint 1."""
    return re.sub(r"(?<=[a-z])(?=\d+$)", " ", path.split(".")[0])


def joined(words: Sequence[str]) -> str:
    """Return words as a list: a, b and c."""
    return " and ".join([*([", ".join(words[:-1])] if words[1:] else []), *words[-1:]])
