"""What a simulation rests on: numbers that are assumed, and values that were taken over from a fit or a posterior."""

from collections.abc import Collection, Iterator, Sequence

from ident.arm.arm import Arm
from ident.arm.drive import SCALARS
from ident.arm.file import ArmFile
from ident.identify.results import Values

PARTS = {"Drive": "drives", "Belt": "belts", "Stroke": "stroke"}


def assumed(arm: Arm, arm_file: ArmFile, known: Collection[str] = (), *, stroke: bool = True) -> tuple[list[str], int]:
    """Return the assumed numbers of drives, belts and stroke, and how many such numbers there are.

    Args:
        arm: the arm.
        arm_file: tells origins.
        known: numbers that the user has set.
        stroke: whether the stroke is carried out.
    """
    kinds = {part.name: type(part).__name__ for part in arm.parts()}
    told = {
        path: origin
        for path, origin in arm_file.origins.items()
        if kinds.get(path.split(".")[0]) in SCALARS and (stroke or path.split(".")[0] != "stroke")
    }
    return [path for path, origin in told.items() if origin == "assumed" and path not in known], len(told)


def guessed(arm: Arm, arm_file: ArmFile) -> tuple[int, int]:
    """Return how many of the arm's other numbers are assumed or calibrated, and how many are given at all."""
    driving = {part.name for part in arm.parts() if type(part).__name__ in SCALARS}
    told = [o for path, o in arm_file.origins.items() if path.split(".")[0] not in driving and o != "derived"]
    return sum(origin in ("assumed", "calibrated") for origin in told), len(told)


def in_words(arm: Arm, found: tuple[list[str], int], others: tuple[int, int]) -> Iterator[str]:
    """Say which numbers are assumed, by `assumed` and `guessed`."""
    names, count = found
    kinds = {part.name: PARTS.get(type(part).__name__, "") for part in arm.parts()}
    fields: dict[str, dict[str, None]] = {}
    for path in names:
        part, _, field = path.partition(".")
        fields.setdefault(kinds[part], {})[field.replace("_", " ")] = None
    if names:
        yield f"Assumed: {len(names)} of the {count} numbers below; the amplitudes hold as far as these do"
        if others[0]:
            yield f"  and {others[0]} of the arm's {others[1]} others (lengths, masses, ...) are assumed or calibrated"
        for kind, words in fields.items():
            yield from _wrapped(f"{kind}: ", list(words))


def values_in_words(values: Values, what: str) -> Iterator[str]:
    """Say what was taken over from a file."""
    count = next(iter(values.values.values())).size
    number = f"{count} {what}" if count > 1 else what
    yield f"  {number} of {len(values.values)} numbers, from {values.path}"
    if values.left_out:
        yield f"    left out, no number of the arm: {', '.join(values.left_out)}"
    if values.remark:
        yield f"    {values.remark}"


def _wrapped(start: str, words: Sequence[str], width: int = 116) -> Iterator[str]:
    line = f"  {start}"
    for i, word in enumerate(words):
        piece = word + (", " if i < len(words) - 1 else "")
        if len(line) + len(piece) > width:
            yield line.rstrip()
            line = "    "
        line += piece
    yield line
