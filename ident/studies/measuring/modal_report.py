"""The report of a modal test: hits, records, checks, modes and their names; and its table."""

import math
from collections.abc import Iterator, Sequence
from itertools import chain, zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.measure import Campaign
from ident.measure.reproducibility import REPRODUCIBILITY, Reproducibility
from ident.modal.ambient import AmbientTest
from ident.modal.finished import POLE, FinishedTest
from ident.modal.frf import MOVING, Check, ModalTest
from ident.modal.modes import Modes, Ratio
from ident.modal.operational import DECAYS, FEW_TAPS, OperationalModes
from ident.report.report import Cell, Finding, Part, Report, Section, Table, Verdict, by_head, cut
from ident.report.words import counted, degrees, percent, sentence
from ident.studies.measuring.modal_campaign import IdentifiedModes, Labelled, NamedModes
from ident.text import by_key

if TYPE_CHECKING:
    from ident.modal.amplitude import AmplitudeTrend
    from ident.modal.frf import Place

AnyTest = ModalTest | AmbientTest | FinishedTest
FEW, LISTED = 3, 3
"""Hits at a point below which rejected ones should be repeated; rejected hits named at most."""
ALONE = 0.99
"""Share of a shape's power at one of several points from which that sensor may be loose; assumed."""
WARNING, IDLE = "WARNING: ", "outside the band"
"""Beginning of a remark that affects the verdict, and ending of one that does not: it appears in the details only."""


def modal_sections(
    tests: Sequence[ModalTest | AmbientTest],
    identified: Sequence[IdentifiedModes] = (),
    finished: Sequence[FinishedTest] = (),
    named: Sequence[NamedModes] = (),
    campaign: Campaign | None = None,
    reproducibility: Reproducibility | None = None,
) -> Report:
    """Return the report of a modal test."""
    every: list[AnyTest] = [*tests, *finished]
    modes: list[Labelled] = [*identified, *named]
    rows = list(_mode_rows(every, modes, reproducibility))
    numbers = "frequency [Hz]|.4f", "std. error|.4f", "damping [%]|.3f", "std. error|.3f", "MAC|.2f"
    return Report(
        _subject(tests, finished, modes),
        _verdict(tests, identified),
        (by_head(("posture [deg]", "mode", *numbers), rows),) if rows else (),
        tuple(_findings(tests, identified, every, modes, reproducibility)),
        next="ident check {result}.csv --arm {arm}" if campaign else "",
        details=tuple(_details(every, modes, campaign, reproducibility)),
    )


def _subject(
    tests: Sequence[ModalTest | AmbientTest], finished: Sequence[FinishedTest], modes: Sequence[Labelled]
) -> str:
    hammer, quiet = _hammer(tests), [test for test in tests if isinstance(test, AmbientTest)]
    tapped, ambient = [test for test in quiet if test.decays], [test for test in quiet if not test.decays]
    parts = []
    if hammer:
        hits, rejected = sum(test.hits for test in hammer), sum(len(test.rejected) for test in hammer)
        parts.append(f"Hammer test at {counted(len(hammer), 'posture')}: {hits} hits accepted, {rejected} rejected")
    if tapped:
        words = f"free decays after {sum(len(test.decays) for test in tapped)} taps, without a force"
        parts.append(f"Tap test at {counted(len(tapped), 'posture')}: {words}")
    if ambient:
        words = f"{sum(test.correlations.duration for test in ambient):.0f} s of responses without a force"
        parts.append(f"Ambient test at {counted(len(ambient), 'posture')}: {words}")
    if finished:
        count = sum(len(test.modes.frequency) for test in finished)
        parts.append(f"Finished modes: {count} in {counted(len(finished), 'file')}")
    named, total = _name_counts(modes)
    return "; ".join([*parts, *([f"{named} of {counted(total, 'mode')} named"] if modes else [])])


def place_in_words(place: "Place") -> str:
    """Write a place as `tip -z`, or with the components of its direction."""
    axes = np.array(place.direction)
    along = np.flatnonzero(abs(axes) > 1 - 1e-9)
    if len(along):
        return f"{cut(place.point, 12)} {'-' if axes[along[0]] < 0 else ''}{'xyz'[along[0]]}"
    return f"{cut(place.point, 12)} ({' '.join(f'{each + 0.0:.2g}' for each in axes)})"


def _hammer(tests: Sequence[ModalTest | AmbientTest]) -> list[ModalTest]:
    return [test for test in tests if isinstance(test, ModalTest)]


def _name_counts(modes: Sequence[Labelled]) -> tuple[int, int]:
    labels = [label for each in modes for label in each.labels.given]
    return sum(label is not None for label in labels), len(labels)


# -------- Verdict


def _verdict(tests: Sequence[ModalTest | AmbientTest], identified: Sequence[IdentifiedModes]) -> Verdict:
    """Judge a test: NOT CONVERGED, DOUBTFUL where checks fail or the arm moved, NOT CHECKED without any, else GOOD."""
    checks = [check for test in _hammer(tests) for check in test.checks]
    ratios = [each.modes.ratio for each in identified if isinstance(each.modes, Modes)]
    quiet = [each.modes for each in identified if isinstance(each.modes, OperationalModes)]
    short, taps = [each for each in quiet if not each.trend], [each.blocks for each in quiet if each.trend]
    if not _all_converged(identified):
        return Verdict("NOT CONVERGED", "The search for the most probable modes has not ended.", "bad")
    failed = [check for check in checks if not check.good]
    parts, moving = [], sum(len(test.moving) for test in _hammer(tests))
    if moving:
        parts.append(f"{MOVING} hits in {counted(moving, 'file')}")
    if checks:
        worst = max(failed or checks, key=lambda check: check.value / check.limit)
        size, limit = f"{100 * worst.value:.1f} %", f"limit {100 * worst.limit:.0f} %"
        passed = f"all {len(checks)} driving-point and reciprocity checks pass (largest {size}, {limit})"
        fail = f"{len(failed)} of {counted(len(checks), 'check')} fail{'s' * (len(failed) == 1)}, most of all "
        parts.append(f"{fail}{worst.name}, {_places(worst)}: {size} ({limit})" if failed else passed)
    if ratios:
        ratio = max(ratios, key=lambda ratio: (ratio.doubtful, abs(math.log(max(ratio.value, 1e-300)))))
        parts.append(f"hit scatter {ratio.value:.2f} times the expected variance, {_band(ratio)}")
    if short:
        fewest = min(short, key=lambda modes: modes.decays)
        decays = f"{fewest.decays:.1f} decay times of the slowest mode (at least {DECAYS:g} needed)"
        parts.append(f"each of {fewest.blocks} blocks has {decays}")
    if taps:
        parts.append(
            f"std. errors by the scatter of {min(taps)} taps at a posture or more (at least {FEW_TAPS} needed)"
        )
    if not parts:
        unchecked = "no driving point and no reciprocal pair were measured" if tests else "no recordings, only modes"
        return Verdict("NOT CHECKED", f"There is nothing to check the modes by: {unchecked}.", "caution")
    doubtful = failed or moving or any(each.modes.doubtful for each in identified)
    reason = sentence("; ".join(parts))
    return Verdict("DOUBTFUL", reason, "bad") if doubtful else Verdict("GOOD", reason, "good")


def check_in_words(check: Check) -> str:
    """Write a check with its places, value and limit."""
    return f"{check.name}, {_places(check)}: {check.value:.1%} (at most {check.limit:.0%})".replace("%", " %")


def _places(check: Check) -> str:
    return " and ".join(map(place_in_words, check.places))


def _band(ratio: Ratio) -> str:
    low, high = ratio.band
    effect = ", without effect on the std. errors" * (ratio.outside and not ratio.doubtful)
    return f"{'outside' if ratio.outside else 'within'} {low:.2f} to {high:.2f}{effect}"


def _all_converged(identified: Sequence[IdentifiedModes]) -> bool:
    return all(each.modes.converged for each in identified if isinstance(each.modes, Modes))


def _findings(
    tests: Sequence[ModalTest | AmbientTest],
    identified: Sequence[IdentifiedModes],
    every: Sequence[AnyTest],
    modes: Sequence[Labelled],
    reproducibility: Reproducibility | None,
) -> Iterator[Finding]:
    """Yield findings that affect the verdict, most important first, without those due to a still moving arm."""
    remarks = _remarks(tests, identified)
    moving = [remark for remark in remarks if MOVING in remark]
    yield from (Finding(remarks.pop(remark) + remark, "wait longer between hits") for remark in moving)
    if not moving and not _all_converged(identified):
        yield Finding("the search for the most probable modes has not ended", "narrow the --band, or choose --modes")
    for number, test in enumerate(tests, 1):
        for check in test.checks if isinstance(test, ModalTest) else ():
            if not check.good:
                yield Finding(f"posture {number}: {check_in_words(check)}", check.remedy)
    if not moving and any(isinstance(each.modes, Modes) and each.modes.doubtful for each in identified):
        text = "the hits scatter otherwise than their noise says, so the std. errors are in doubt"
        yield Finding(text, "hit at the same place and in the same direction each time; look for loose sensors")
    for remark, where in remarks.items():
        if remark.startswith(WARNING):
            yield Finding(where + remark.removeprefix(WARNING))
    yield from _unnamed(every, modes)
    yield from _rejected(_hammer(tests))
    yield from _assumed(reproducibility)
    for remark, where in remarks.items():
        if not remark.startswith(WARNING) and not remark.endswith(IDLE):
            yield Finding(where + remark)


def _remarks(tests: Sequence[ModalTest | AmbientTest], identified: Sequence[IdentifiedModes]) -> dict[str, str]:
    """Return the remarks on tests and modes, with the postures of each, unless it applies to all."""
    found = []
    for number, test in enumerate(tests, 1):
        modes = identified[number - 1].modes if identified else None
        more = modes.remarks if isinstance(modes, OperationalModes) else ()
        found += [(remark, str(number)) for remark in dict.fromkeys((*test.remarks, *more))]
    return {
        remark: f"posture{'s' * (len(at) > 1)} {', '.join(at)}: " if len(at) < len(tests) else ""
        for remark, at in by_key(found).items()
    }


def _unnamed(tests: Sequence[AnyTest], modes: Sequence[Labelled]) -> Iterator[Finding]:
    """Yield the modes without a certain name: the campaign leaves them out."""
    for test, each in zip(tests, modes, strict=False):
        for i, why in enumerate(each.labels.why):
            if why:
                points = [place.point for place in each.modes.responses]
                moved = dict.fromkeys(points, 0.0)
                for point, motion in zip(points, np.abs(each.modes.shape[:, i]) ** 2, strict=True):
                    moved[point] += float(motion)
                alone = max(moved, key=moved.__getitem__)
                if len(moved) > 1 and moved[alone] > ALONE * sum(moved.values()):
                    why += f"; only {cut(alone, 20)} moves: look whether that sensor is loose"
                hertz = each.modes.frequency[i]
                text = f"no certain name for mode {i + 1} at {degrees(test.posture)}, {hertz:.2f} Hz: {why}"
                yield Finding(text, "add a sensor that tells them apart; the campaign leaves it out")


def _rejected(hammer: Sequence[ModalTest]) -> Iterator[Finding]:
    """Yield a finding on rejected hits, if few remain."""
    rejected = [each for test in hammer for each in test.rejected]
    fewest = min((len(test.frf.hits) for test in hammer), default=FEW)
    if rejected and fewest < FEW:
        shown = "; ".join(f"{cut(each.file, 30)}, hit {each.number}: {each.reason}" for each in rejected[:LISTED])
        more = f"; {len(rejected) - LISTED} more" if len(rejected) > LISTED else ""
        text = f"{counted(len(rejected), 'hit')} rejected, a point has {counted(fewest, 'hit')} left: {shown}{more}"
        yield Finding(text, "repeat them")


def _assumed(known: Reproducibility | None) -> Iterator[Finding]:
    """Yield a finding if the reproducibility is assumed."""
    shares = [
        f"{percent(share)} of each {kind.replace('_', ' ')}"
        for kind, share in (known.share.items() if known else ())
        if known and share and kind not in known.said and not known.freedom.get(kind, 0)
    ]
    if shares:
        text = f"the std. errors contain an assumed reproducibility: {' and '.join(shares)}"
        yield Finding(text, "set up and repeat the test of one posture, or give --reproducibility")


# -------- Modes


def _mode_rows(
    tests: Sequence[AnyTest], modes: Sequence[Labelled], reproducibility: Reproducibility | None
) -> Iterator[tuple[Cell, ...]]:
    """Yield each mode with the std. errors of the campaign: repeatability and reproducibility combined."""
    loads, drives = {str(test.load) for test in tests}, {test.drives for test in tests}
    for test, each in zip(tests, modes, strict=False):
        state = [degrees(test.posture).removesuffix(" deg")]
        state += [cut(str(test.load), 24)] * (len(loads) > 1) + [test.drives] * (len(drives) > 1)
        for i, label in enumerate(each.labels.given):
            of_both = ((value, math.hypot(*sd)) for value, *sd in _numbers(each, i, reproducibility))
            name = str(label) if label else f"no name (mode {i + 1})"
            yield ", ".join(state), name, *chain(*of_both), float(each.labels.mac[i].max())


def _numbers(each: Labelled, i: int, known: Reproducibility | None) -> Iterator[tuple[float, ...]]:
    """Yield frequency [Hz] and damping [%] of a mode, each with its repeatability and, if known, reproducibility."""
    of_kind = zip(REPRODUCIBILITY, (each.modes.frequency, each.modes.damping), each.modes.sigma, (1, 100), strict=True)
    for kind, values, sigma, factor in of_kind:
        value = factor * float(values[i])
        yield value, factor * float(sigma[i]), *([known.share[kind] * value] if known else [])


def _modes_table(each: Labelled, reproducibility: Reproducibility | None) -> Table:
    """Return the modes of a posture with both parts of their std. errors."""
    rows = [
        (i + 1, *chain(*_numbers(each, i, reproducibility)), float(each.labels.mac[i].max()), str(label or "-"))
        for i, label in enumerate(each.labels.given)
    ]
    sd = ("repeat", "reprod") if reproducibility else ("std. error",)
    of_kind = {".4f": ("frequency [Hz]", *sd), ".3f": ("damping [%]", *sd)}
    numbers = [f"{head}|{form}" for form, heads in of_kind.items() for head in heads]
    note = "repeat: std. error by the scatter within the test. reprod: by setting up the test again."
    return by_head(("mode|d", *numbers, "MAC|.2f", "name"), rows, note=note * bool(reproducibility))


# -------- Details


def _details(
    every: Sequence[AnyTest],
    modes: Sequence[Labelled],
    campaign: Campaign | None,
    reproducibility: Reproducibility | None,
) -> Iterator[Section]:
    for number, (test, each) in enumerate(zip_longest(every, modes), 1):
        state = f"{degrees(test.posture)}, {cut(str(test.load), 50)}, drives: {test.drives}"
        table = (_modes_table(each, reproducibility),) if each else ()
        if isinstance(test, FinishedTest):
            places = ", ".join(map(place_in_words, test.modes.responses))
            line = f"{counted(len(test.modes.frequency), 'mode')} at {places}; frequencies: {test.modes.of}."
            yield Section(f"{cut(test.files[0], 40)}: {state}", (line, *table))
        else:
            parts = _ambient_test(test) if isinstance(test, AmbientTest) else _hammer_test(test)
            reliance = _reliance(each.modes) if isinstance(each, IdentifiedModes) else ()
            yield Section(f"Posture {number}: {state}", (*parts, *table, *reliance))
    if campaign:
        yield _campaign(modes, campaign, reproducibility)


def _hammer_test(test: ModalTest) -> Iterator[Part]:
    """Yield the records, the rejected hits, coherence, and the checks."""
    frf = test.frf
    low, high = frf.frequency[0], frf.frequency[-1]
    step = frf.frequency[1] - frf.frequency[0]
    record = f", records of {test.duration:.4g} s" if test.duration else ", finished frequency responses"
    hits = f"{len(frf.hits)} hits at each of {len(frf.references)} points"
    yield f"{hits}{record}; {low:.3g} to {high:.4g} Hz, lines every {step:.3g} Hz."
    if frf.decay:
        yield f"The exponential window adds {frf.decay:.4g} 1/s to the decay rate of each mode; this is removed again."
    for each in test.rejected:
        yield f"Rejected: {cut(each.file, 30)}, hit {each.number}: {each.reason}."
    yield from (sentence(remark) for remark in test.remarks if remark.endswith(IDLE))
    rows = zip(map(place_in_words, frf.responses), *np.median(test.coherence, -1).T.tolist(), strict=True)
    yield by_head(("coherence, median", *(f"force {place_in_words(place)}|.3f" for place in frf.references)), rows)
    words = {True: "good", False: "FAILS"}
    checks = [(f"{each.name}, {_places(each)}", each.value, each.limit, words[each.good]) for each in test.checks]
    if checks:
        yield by_head(("check", "value|.1%", "at most|.0%", ""), checks)


def _ambient_test(test: AmbientTest) -> Iterator[Part]:
    """Yield the records, and the removed lines."""
    low, high = test.band
    record = f"{test.correlations.duration:.4g} s at {1 / test.correlations.step:.4g} Hz"
    record = f"{len(test.decays)} free decays after taps, {record}" if test.decays else record
    yield (
        f"{counted(len(test.responses), 'response')}, {len(test.references)} of them references, {record}; "
        f"{low:.3g} to {high:.4g} Hz: {', '.join(place_in_words(place) for place in test.responses)}."
    )
    yield "Shapes are not scaled: without a force there are no residues and no driving point."
    for line in test.harmonics:
        where = place_in_words(test.responses[line.response])
        share = f"{100 * line.share:.2g} % of the power of {where}"
        yield f"Harmonic, not a mode: {cut(str(line), 50)}, {share}; it was removed."


def _reliance(modes: Modes | OperationalModes) -> Iterator[Part]:
    """Yield the basis of the covariance, and the poles that are not modes."""
    if isinstance(modes, Modes):
        share = f"{modes.ratio.value:.2f} of the variance by maximum likelihood"
        yield f"Hit scatter: {share}, {_band(modes.ratio)} (99 %)."
    else:
        what = "taps" if modes.trend else "blocks"
        yield f"Standard errors by leaving out one of {modes.blocks} {what} at a time."
        if modes.trend:
            yield _amplitudes(modes, modes.trend)
    yield from (f"No mode at {pole.frequency:.2f} Hz: {pole.why}." for pole in modes.rejected)


def _amplitudes(modes: OperationalModes, trend: "AmplitudeTrend") -> Table:
    """Return frequency and damping in both halves of the decays, by the amplitude there."""
    poles = np.array([modes.frequency, modes.damping])
    early, late = (poles + trend.change(poles, each) for each in trend.amplitude[1:])
    columns = *(1e3 * trend.amplitude), early[0], late[0], 100 * early[1], 100 * late[1]
    heads = "largest [mm]|.2g", "early|.2g", "late|.2g", "frequency [Hz]|.4f", "late|.4f", "damping [%]|.3f", "late|.3f"
    rows = [(i, *map(float, row)) for i, row in enumerate(zip(*columns, strict=True), 1)]
    return by_head(("mode|d", *heads), rows, note="At the response that a mode moves most, along the decays.")


def reproducibility_in_words(known: Reproducibility) -> str:
    """Say what the sigmas of a campaign consist of, and their source."""
    parts = []
    for kind, share in known.share.items():
        freedom = known.freedom.get(kind, 0)
        origin = "given" if kind in known.said else f"from repeated tests, {freedom} d.o.f." if freedom else "assumed"
        parts.append(f"{100 * share:.2g} % of each {kind.replace('_', ' ')} ({origin})")
    common = f"{100 * known.common:.3g} % of its variance common to a test"
    return f"repeatability (scatter within the test) and reproducibility: {', '.join(parts)}; {common}"


def _campaign(modes: Sequence[Labelled], campaign: Campaign, reproducibility: Reproducibility | None) -> Section:
    """Return the content of the campaign."""
    count, total = _name_counts(modes)
    of = " (|pole| / 2 pi)" if all(m.of == POLE for m in campaign.of_kind("frequency")) else ""
    shapes = ", damping ratio and shape" if campaign.of_kind("shape") else " and damping ratio"
    parts = [f"{count} of {total} modes have a name: rows of frequency{of}{shapes}."]
    if count and reproducibility:
        words = reproducibility_in_words(reproducibility)
        parts.append(f"Standard errors: {words} (--reproducibility, --common-share).")
    if count:
        parts += ["The correlations of the rows are in the covariance file next to the campaign; ident fit reads it."]
    return Section("Campaign", tuple(parts))


# -------- Rows


def modal_rows(
    tests: Sequence[ModalTest | AmbientTest],
    identified: Sequence[IdentifiedModes],
    finished: Sequence[FinishedTest],
    named: Sequence[NamedModes],
    *_: object,
) -> list[dict[str, Any]]:
    """Return a row for each mode: posture [deg], load, frequency [Hz], damping ratio [-], sd of both, label."""
    pairs: list[tuple[AnyTest, Labelled]] = [*zip(tests, identified, strict=False)]
    pairs += zip(finished, named, strict=False)
    return [
        {"posture": " ".join(f"{math.degrees(angle) + 0.0:.6g}" for angle in test.posture), "load": str(test.load)}
        | {"frequency": float(each.modes.frequency[i]), "frequency_sd": float(each.modes.sigma[0, i])}
        | {"damping_ratio": float(each.modes.damping[i]), "damping_ratio_sd": float(each.modes.sigma[1, i])}
        | {"label": str(label or ""), "probability": float(each.labels.probability[i].max(initial=0.0))}
        for test, each in pairs
        for i, label in enumerate(each.labels.given)
    ]
