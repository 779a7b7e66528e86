"""The basis of a simulation in words: motion, fitted and set values, assumed numbers."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from ident.arm.belts import belt_mismatches
from ident.arm.multibody import exciting_orders, has_transmission_error
from ident.report.report import Finding, Section, cut
from ident.report.words import MM, arc_seconds, counted, degrees, sentence, unit_of

if TYPE_CHECKING:
    from ident.identify.values import Values
    from ident.studies.scenario import Basis
    from ident.vibrate.fast import Passage

T = TypeVar("T")

EXCITING = 0.02
"""Acceleration that the noise of a path commands, relative to the motion's, from which it is a finding; assumed."""
GUESSED = ("assumed", "calibrated")
"""Origins of numbers that were not measured: assumed, or tuned to a result."""
PARTS = {
    "Drive": "drives",
    "ErrorOrder": "further transmission errors",
    "Belt": "belts",
    "Servo": "servos",
    "Spring": "springs",
    "CubicSpring": "springs",
    "Stroke": "stroke",
}


def subject(basis: "Basis") -> str:
    """Name the arm and its motion: `LCD transfer arm, extension, cycloid, 10 %`."""
    return f"{cut(basis.arm.name, 36)}, {cut(basis.motion.name, 36)}"


def motion_title(what: str, basis: "Basis") -> str:
    """Return the title of a figure of an arm and its motion."""
    return f"{what}: {cut(basis.arm.name, 30)}\n{cut(basis.motion.name, 60)}"


def motion_section(
    basis: "Basis", *, elastic_belts: bool, rate: float, method: str, more: Sequence[str] = (), varied: bool = False
) -> Section:
    """Return the section on motion, method and values of a simulation.

    Args:
        basis: arm, motion and values.
        elastic_belts: whether belts stretch.
        rate: sampling rate [Hz].
        method: of simulation, in words.
        more: further sentences about the motion.
        varied: whether numbers are varied, including those of the draws.
    """
    motion, belts = basis.motion, ("elastic" if elastic_belts else "rigid") if basis.arm.belts else "none"
    start, end = (degrees(np.round(motion(motion.breaks[i])[0], 9).tolist()) for i in (0, -1))
    held = float(motion.breaks[-1]) - motion.arrival
    sentences = [
        f"From {start} to {end} in {motion.arrival:.4g} s" + (f", then held for {held:.4g} s." if held else "."),
        *more,
        f"Load: {basis.load}. Belts: {belts}. {rate:.4g} samples a second. Method: {method}.",
    ]
    twice = "Elastic belts count twice where k_bend or k_tors were measured with them, as by a hammer test."
    sentences += [twice] * (belts == "elastic")
    sentences += map(sentence, _taken_over(basis.fit, basis.posterior))
    sentences += _excitation(basis, varied=varied)
    sentences += map(sentence, changes_in_words(basis.changed))
    return Section("Simulated motion", tuple(sentences))


def _excitation(basis: "Basis", *, varied: bool) -> Iterator[str]:
    """Yield the unknowns of the excitation, and the content of the draws."""
    for low, high in sorted(set(basis.unknown.errors.values())):
        ends = " to ".join(f"{arc_seconds(end):g}" for end in (low, high))
        yield f"Transmission error: {ends} arc seconds peak to peak, twice a turn; the nominal arm has the largest."
    if basis.unknown.phases and varied:
        yield "The imbalance phases are unknown: amplitudes are the largest over all phases (rms: the mean over them)."
    if basis.unknown.phases and basis.posterior:
        yield "Each draw has random phases of its own."
    if basis.posterior and varied:
        yield "A varied number changes by the same factor, or difference, in the nominal arm and in every draw."


def basis_findings(basis: "Basis") -> Iterator[Finding]:
    """Yield doubts about a simulation: a noisy path, an arm without drives, wrong belts, contradictory values."""
    if basis.log is not None:
        from ident.vibrate.replay import noise_of

        noise, share = noise_of(basis.motion, basis.percent / 100 / basis.log.interval)
        if share > EXCITING:
            text = f"the path's noise of {math.degrees(noise):.1g} deg commands {100 * share:.0f} % of its acceleration"
            yield Finding(f"{text}, and so excites the arm", f"--smoothing {math.degrees(1.5 * noise):.1g}")
    if not basis.arm.drives:
        yield Finding("the arm file has no [[drive]]: only the motion itself excites the arm", "add its drives")
    yield from (Finding(str(mismatch)) for mismatch in belt_mismatches(basis.arm))
    yield from (Finding(values.remark) for values in (basis.fit, basis.posterior) if values and values.remark)
    if outside := _outside(basis.fit, basis.posterior):
        text = f"fit and draws exclude each other: the fitted {', '.join(outside)} lies outside all draws"
        yield Finding(text, "sample and fit the same campaign")


def assumption_findings(basis: "Basis") -> Iterator[Finding]:
    """Yield how many numbers of drives, belts and stroke are assumed."""
    names, _ = assumed(basis)
    if names:
        erring = any(path.endswith((".error", ".amplitude")) for path in names)
        scaling = ["the transmission error"] * (erring and not without_transmission_error(basis))
        scaling += ["the imbalance"] * any(path.endswith((".eccentric_mass", ".eccentricity")) for path in names)
        remedy = f"measure {' and '.join(scaling)} first" if scaling else "measure them"
        yield Finding(f"amplitudes rest on {len(names)} assumed numbers ({', '.join(_fields(basis, names))})", remedy)


def transmission_finding(basis: "Basis") -> Iterator[Finding]:
    """Yield the effect of the drives' transmission errors on the arm at rest, or that none are assumed."""
    if without_transmission_error(basis):
        yield Finding("transmission error is set to 0, real drives have some", "try --errors 30:60 (arc seconds)")
    elif words := gear_words(basis):
        yield Finding(words)


def gear_words(basis: "Basis") -> str:
    """Say how far transmission errors move the end at any speed, apart from vibration; empty without any."""
    paths = [each.amplitude for each in exciting_orders(basis.arm) if each.of_error]
    if not paths:
        return ""
    size = f"{max(arc_seconds(float(basis.arm.get(path))) for path in paths):.3g} arc seconds peak to peak"
    size += ", assumed" * any(basis.origins.get(path) in GUESSED for path in paths)
    moved = f"moves the end by up to {MM * basis.gear_error:.2g} mm at any speed"
    return f"the gears' own error ({size}) {moved}; it is not counted as vibration"


def all_findings(basis: "Basis") -> Iterator[Finding]:
    """Yield all findings that affect a simulated amplitude."""
    yield from basis_findings(basis)
    yield from assumption_findings(basis)
    yield from transmission_finding(basis)


def without_transmission_error(basis: "Basis") -> bool:
    """Whether there are drives, but none with a transmission error."""
    return bool(basis.arm.drives) and not has_transmission_error(basis.arm)


def values_in_words(fit: "Values | None", posterior: "Values | None") -> Iterator[str]:
    """Yield the numbers that an arm takes from results."""
    yield from _taken_over(fit, posterior)
    yield from (f"REMARK: {values.remark}" for values in (fit, posterior) if values and values.remark)
    if outside := _outside(fit, posterior):
        yield f"WARNING: fit and draws exclude each other: {', '.join(outside)} of the fit beyond all draws"


def changes_in_words(changed: Mapping[str, float]) -> Iterator[str]:
    """Yield the set numbers, in one line."""
    if changed:
        each = (f"{path} = {value:g} {unit_of(path)}".rstrip(" -") for path, value in changed.items())
        yield f"set: {', '.join(each)}"


def _taken_over(fit: "Values | None", posterior: "Values | None") -> Iterator[str]:
    """Yield the values from results, and their files."""
    for values, what in ((fit, "fitted values"), (posterior, "draws of the posterior")):
        if values is None:
            continue
        count = next(iter(values.values.values())).size
        number = f"{count} {what}" if count > 1 else what
        yield f"{number} of {counted(len(values.values), 'number')}" + (f", from {values.path}" if values.path else "")
        if values.left_out:
            yield f"not used, as the arm has no such number: {', '.join(values.left_out)}"
    if posterior and not fit:
        yield "the nominal arm has the medians of these draws"


def _outside(fit: "Values | None", posterior: "Values | None") -> tuple[str, ...]:
    return fit.outside(posterior) if fit and posterior else ()


# -------- Assumed numbers


def assumed(basis: "Basis") -> tuple[list[str], int]:
    """Return the assumed or calibrated numbers of drives, belts and stroke, and how many such numbers there are.

    Identified or set numbers are left out, and the stroke if a log is replayed.
    """
    counting = [name for name in _kinds(basis) if not (basis.log and name == "stroke")]
    own = basis.origins
    origins = {path: own[path] for path in basis.arm_file.origins if path.split(".")[0] in counting}
    names = [path for path, origin in origins.items() if origin in GUESSED]
    return names, len(origins)


def assumed_section(basis: "Basis") -> Iterator[Section]:
    """Yield the assumed or calibrated numbers of the excitation, if any."""
    names, count = assumed(basis)
    if not names:
        return
    driving = _kinds(basis)
    others = [o for path, o in basis.arm_file.origins.items() if path.split(".")[0] not in driving and o != "derived"]
    guessed = sum(origin in GUESSED for origin in others)
    share = f"{len(names)} of the {count} numbers below are assumed or calibrated"
    if guessed:
        share += f", and {guessed} of the arm's {len(others)} other numbers (lengths, masses, ...)"
    lists = (f"{kind}: {', '.join(words)}." for kind, words in _fields(basis, names).items())
    yield Section("Assumed or calibrated numbers", (f"{share}. No amplitude is better known than these.", *lists))


def _kinds(basis: "Basis") -> dict[str, str]:
    """Return the group name of each drive, belt, servo, spring or stroke."""
    return {part.name: PARTS[kind] for part in basis.arm.parts() if (kind := type(part).__name__) in PARTS}


def _fields(basis: "Basis", names: Sequence[str]) -> dict[str, dict[str, None]]:
    """Return the named fields of drives, belts and stroke, by kind: `{"drives": {"ratio": None, ...}, ...}`."""
    kinds = _kinds(basis)
    fields: dict[str, dict[str, None]] = {}
    for path in names:
        part, _, field = path.partition(".")
        fields.setdefault(kinds[part], {})[field.replace("_", " ")] = None
    return fields


# -------- Lines that coincide


def alike(items: Iterable[T], are_alike: Callable[[T, T], bool]) -> list[list[T]]:
    """Add each item to the first group whose first item is like it, or to a new group; the order stays."""
    groups: list[list[T]] = []
    for item in items:
        same = next((group for group in groups if are_alike(group[0], item)), None)
        if same is None:
            groups.append([item])
        else:
            same.append(item)
    return groups


# -------- Springs


def passage_findings(passages: Sequence["Passage"]) -> Iterator[Finding]:
    """Yield the springs that change their stiffness within a motion, as their load passes T1."""
    for each in passages:
        yield Finding(
            f"the load of {each.spring} passes T1 = {each.torque1:.3g} N m (from {each.low:.3g} to {each.high:.3g} "
            "N m): its stiffness changes within the motion"
        )
