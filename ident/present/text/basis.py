"""What was simulated and what that rests on: motion, numbers that were taken over or set, and assumed ones."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from ident.arm.arm import Arm
from ident.description.file import ArmFile
from ident.identify.values import Values
from ident.measure import Log
from ident.present.text.words import cut, degrees
from ident.vibrate.motion.motion import Motion

UNDRIVEN = "The arm file has no [[drive]]: only the motion itself shakes the arm, no turning mass does."
PARTS = {"Drive": "drives", "Belt": "belts", "Stroke": "stroke"}


@runtime_checkable
class Basis(Protocol):
    """Where the numbers come from; see `simulation.Simulation`."""

    @property
    def arm(self) -> Arm: ...  # noqa: D102
    @property
    def arm_file(self) -> ArmFile: ...  # noqa: D102
    @property
    def log(self) -> Log | None: ...  # noqa: D102
    @property
    def fit(self) -> Values | None: ...  # noqa: D102
    @property
    def posterior(self) -> Values | None: ...  # noqa: D102
    @property
    def changed(self) -> Mapping[str, float] | None: ...  # noqa: D102


def motion_in_words(arm: Arm, motion: Motion) -> Iterator[str]:
    """Say which arm makes which motion."""
    yield f"{cut(arm.name, 40)}: {cut(motion.name, 60)}"
    start, end = (degrees(np.round(motion(motion.breaks[i])[0], 9).tolist()) for i in (0, -1))
    held = float(motion.breaks[-1]) - motion.arrival
    yield f"  from {start} to {end} in {motion.arrival:.4g} s" + (f", then held for {held:.4g} s" if held else "")


def basis_in_words(found: Basis, *, changed_draws: bool = False) -> Iterator[str]:
    """Say which numbers are not the arm file's.

    Args:
        found: what was simulated.
        changed_draws: whether the numbers are changed, those of the draws with them.
    """
    if not found.arm.drives:
        yield f"  {UNDRIVEN}"
    for values, what in ((found.fit, "fitted values"), (found.posterior, "draws of the posterior")):
        yield from _values_in_words(values, what) if values else ()
    if found.posterior and not found.fit:
        yield "  the arm itself has the medians of these draws"
    if found.posterior and changed_draws:
        yield "  every draw is changed by the factor, or the difference, by which the arm itself is"
    for path, value in (found.changed or {}).items():
        yield f"  set: {path} = {value:g}"


def assumed(found: Basis) -> tuple[list[str], int]:
    """Return the assumed numbers of drives, belts and stroke, and how many such numbers there are.

    Left out are numbers that the user has set, and the stroke where a log is replayed.
    """
    kinds = {part.name: type(part).__name__ for part in found.arm.parts()}
    told = {
        path: origin
        for path, origin in found.arm_file.origins.items()
        if kinds.get(path.split(".")[0]) in PARTS and not (found.log and path.split(".")[0] == "stroke")
    }
    known = found.changed or {}
    return [path for path, origin in told.items() if origin == "assumed" and path not in known], len(told)


def assumed_in_words(found: Basis) -> Iterator[str]:
    """Say which numbers are assumed."""
    names, count = assumed(found)
    guessed, others = _guessed(found)
    kinds = {part.name: PARTS.get(type(part).__name__, "") for part in found.arm.parts()}
    fields: dict[str, dict[str, None]] = {}
    for path in names:
        part, _, field = path.partition(".")
        fields.setdefault(kinds[part], {})[field.replace("_", " ")] = None
    if names:
        yield f"Assumed: {len(names)} of the {count} numbers below; the amplitudes hold as far as these do"
        if guessed:
            yield f"  and {guessed} of the arm's {others} others (lengths, masses, ...) are assumed or calibrated"
        for kind, words in fields.items():
            yield from _wrapped(f"{kind}: ", list(words))


def _guessed(found: Basis) -> tuple[int, int]:
    """Return how many of the arm's other numbers are assumed or calibrated, and how many are given at all."""
    driving = {part.name for part in found.arm.parts() if type(part).__name__ in PARTS}
    told = [o for path, o in found.arm_file.origins.items() if path.split(".")[0] not in driving and o != "derived"]
    return sum(origin in ("assumed", "calibrated") for origin in told), len(told)


def _values_in_words(values: Values, what: str) -> Iterator[str]:
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
