"""What was simulated and what that rests on: motion, numbers that were taken over or set, and assumed ones."""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ident.arm.plausibility import belt_mismatches
from ident.assess.scenario import Basis
from ident.identify.check import SpringCheck
from ident.identify.values import Values
from ident.present.text.words import WIDTH, cut, degrees
from ident.vibrate.fast import Passage

UNDRIVEN = "The arm file has no [[drive]]: only the motion itself shakes the arm, no turning mass does."
TWICE = "Elastic belts count twice where k_bend or k_tors were measured with them, by a hammer test for one."
GUESSED = ("assumed", "calibrated")
"""Origins of numbers that were not measured: assumed, or set so that a result comes out."""
PARTS = {
    "Drive": "drives",
    "Belt": "belts",
    "Servo": "servos",
    "Spring": "springs",
    "CubicSpring": "springs",
    "Stroke": "stroke",
}


def motion_in_words(basis: Basis) -> Iterator[str]:
    """Say which arm makes which motion."""
    motion = basis.motion
    yield f"{cut(basis.arm.name, 40)}: {cut(motion.name, 60)}"
    start, end = (degrees(np.round(motion(motion.breaks[i])[0], 9).tolist()) for i in (0, -1))
    held = float(motion.breaks[-1]) - motion.arrival
    yield f"  from {start} to {end} in {motion.arrival:.4g} s" + (f", then held for {held:.4g} s" if held else "")


def load_in_words(basis: Basis, elastic_belts: bool, rate: float) -> str:
    """Say how it is simulated: load case, belts, and samples a second."""
    belts = ("elastic" if elastic_belts else "rigid") if basis.arm.belts else "none"
    line = f"  load: {basis.load}; belts: {belts}; {rate:.4g} samples a second"
    return f"{line}\n  {TWICE}" if belts == "elastic" else line


def basis_in_words(basis: Basis, *, changed_draws: bool = False) -> Iterator[str]:
    """Say which numbers are not the arm file's.

    Args:
        basis: what was simulated.
        changed_draws: whether the numbers are changed, those of the draws with them.
    """
    if not basis.arm.drives:
        yield f"  {UNDRIVEN}"
    yield from (f"  WARNING: {mismatch}" for mismatch in belt_mismatches(basis.arm))
    yield from values_in_words(basis.fit, basis.posterior)
    for low, high in sorted(set(basis.unknown.errors.values())):
        ends = " to ".join(f"{2 * np.rad2deg(end) * 3600:g}" for end in (low, high))
        yield f"  kinematic error: {ends} arc seconds peak to peak, twice a turn; the arm itself has the largest"
    if basis.unknown.phases and changed_draws:
        yield "  amplitudes: largest over all phases of the turning masses, which nobody knows (rms: in the mean)"
    if basis.unknown.phases and basis.posterior:
        yield "  each draw has phases of its own"
    if basis.posterior and changed_draws:
        yield "  every draw is changed by the factor, or the difference, by which the arm itself is"
    yield from changes_in_words(basis.changed)


def values_in_words(fit: Values | None, posterior: Values | None) -> Iterator[str]:
    """Say which numbers an arm has taken over."""
    for values, what in ((fit, "fitted values"), (posterior, "draws of the posterior")):
        yield from _taken_over(values, what) if values else ()
    if posterior and not fit:
        yield "  the arm itself has the medians of these draws"
    if fit and posterior and (outside := fit.outside(posterior)):
        yield f"  WARNING: fit and draws exclude each other: {', '.join(outside)} of the fit beyond all draws"


def changes_in_words(changed: Mapping[str, float]) -> Iterator[str]:
    """Say which numbers were set."""
    for path, value in changed.items():
        yield f"  set: {path} = {value:g}"


def assumed(basis: Basis) -> tuple[list[str], int]:
    """Return the assumed or calibrated numbers of drives, belts and stroke, and how many such numbers there are.

    Left out are numbers that the user has set, and the stroke where a log is replayed.
    """
    kinds = {part.name: type(part).__name__ for part in basis.arm.parts()}
    origins = {
        path: origin
        for path, origin in basis.arm_file.origins.items()
        if kinds.get(path.split(".")[0]) in PARTS and not (basis.log and path.split(".")[0] == "stroke")
    }
    names = [path for path, origin in origins.items() if origin in GUESSED and path not in basis.changed]
    return names, len(origins)


def assumed_in_words(basis: Basis) -> Iterator[str]:
    """Say which numbers are assumed."""
    names, count = assumed(basis)
    guessed, others = _guessed(basis)
    kinds = {part.name: PARTS.get(type(part).__name__, "") for part in basis.arm.parts()}
    fields: dict[str, dict[str, None]] = {}
    for path in names:
        part, _, field = path.partition(".")
        fields.setdefault(kinds[part], {})[field.replace("_", " ")] = None
    if names:
        yield f"Assumed or calibrated: {len(names)} of the {count} numbers below; amplitudes hold as far as these do"
        if guessed:
            yield f"  and {guessed} of the arm's {others} others (lengths, masses, ...) are assumed or calibrated"
        for kind, words in fields.items():
            yield from _wrapped(f"{kind}: ", list(words))


def _guessed(basis: Basis) -> tuple[int, int]:
    """Return how many of the arm's other numbers are assumed or calibrated, and how many are given at all."""
    driving = {part.name for part in basis.arm.parts() if type(part).__name__ in PARTS}
    origins = [o for path, o in basis.arm_file.origins.items() if path.split(".")[0] not in driving and o != "derived"]
    return sum(origin in GUESSED for origin in origins), len(origins)


def _taken_over(values: Values, what: str) -> Iterator[str]:
    """Say what was taken over from a file."""
    count = next(iter(values.values.values())).size
    number = f"{count} {what}" if count > 1 else what
    of = f"{len(values.values)} number{'s' * (len(values.values) != 1)}"
    yield f"  {number} of {of}" + (f", from {values.path}" if values.path else "")
    if values.left_out:
        yield f"    left out, no number of the arm: {', '.join(values.left_out)}"
    if values.remark:
        yield f"    REMARK: {values.remark}"


def _wrapped(start: str, words: Sequence[str], width: int = WIDTH) -> Iterator[str]:
    line = f"  {start}"
    for i, word in enumerate(words):
        piece = word + (", " if i < len(words) - 1 else "")
        if len(line) + len(piece) > width:
            yield line.rstrip()
            line = "    "
        line += piece
    yield line


# -------- Springs
# Curved springs in words: what a campaign can tell of them, and where vibration passes T1.


def springs_in_words(springs: Sequence[SpringCheck]) -> Iterator[str]:
    """Say of each spring whether the data can tell it from a straight one, and how it is loaded meanwhile."""
    if not springs:
        return
    yield "Curved springs: can the data tell them from straight ones? Data as predicted at the arm file's values"
    for each in springs:
        told = "yes" if each.told else "NO"
        cost = "no arm with a straight one stands" if math.isnan(each.chi_squared) else _cost(each)
        yield f"  {each.spring}: {told}, {cost}"
        yield f"    load {_loads(each)}"
        if each.unloaded:
            yield "    WARNING: next to no load wherever modes were measured: frequencies see K1 alone"
        if not each.told:
            yield "    fix its numbers, or measure under loads on both sides of T1"


def passages_in_words(passages: Sequence[Passage]) -> Iterator[str]:
    """Warn of springs whose load passes T1 in a motion."""
    for each in passages:
        yield (
            f"  WARNING: the load of {each.spring} passes T1 = {each.torque1:.3g} N m: it goes from {each.low:.3g} to"
            f" {each.high:.3g} N m, so that its stiffness changes within the motion"
        )


def _cost(check: SpringCheck) -> str:
    return f"a straight one would cost a chi-squared of {check.chi_squared:.2g}"


def _loads(check: SpringCheck) -> str:
    parts = [("at rest", check.at_rest), ("where modes were measured", check.vibrating)]
    given = [f"{low:.3g} to {high:.3g} N m {what}" for what, (low, high) in parts if not math.isnan(high)]
    limit = "" if math.isnan(check.torque1) else f"; T1 = {check.torque1:.3g} N m"
    return ", ".join(given) + limit
