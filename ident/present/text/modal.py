"""The printed report of a modal test: each posture's hits or record, its modes, names, and what is in doubt."""

from collections.abc import Iterator, Sequence
from itertools import chain, zip_longest

import numpy as np

from ident.assess.modal import IdentifiedModes, Labelled, NamedModes
from ident.measure import Campaign
from ident.measure.covariance_and_frames import Reproducibility
from ident.modal.ambient import AmbientTest
from ident.modal.frf import ModalTest
from ident.modal.modes import Modes
from ident.modal.operational import OperationalModes
from ident.modal.sources import POLE, FinishedTest
from ident.present.text.words import cut, degrees, paragraphs, place_in_words

# -------- Ambient
# What the report of a modal test says of ambient ones, whose forces nobody measured.


def ambient_heading(tests: Sequence[AmbientTest], postures: str) -> Iterator[str]:
    """Yield the heading."""
    duration = sum(test.correlations.duration for test in tests)
    yield f"Ambient test at {postures}: {duration:.0f} s of responses without a force"
    yield "  shapes are not scaled: without a force there are no residues and no driving point"


def ambient_test(test: AmbientTest) -> Iterator[str]:
    """Yield what was recorded, and which lines were taken out."""
    low, high = test.band
    record = f"{test.correlations.duration:.4g} s at {1 / test.correlations.step:.4g} Hz"
    yield (
        f"  {len(test.responses)} responses, {len(test.references)} of them references, {record}; "
        f"{low:.3g} to {high:.4g} Hz"
    )
    yield f"  {', '.join(place_in_words(place) for place in test.responses)}"
    for line in test.harmonics:
        where = place_in_words(test.responses[line.response])
        yield f"  HARMONIC {cut(str(line), 50)}, no mode: {100 * line.share:.2g} % of the power of {where}; taken out"
    for remark in test.remarks:
        yield f"  {remark}"


def ambient_reliance(modes: OperationalModes) -> Iterator[str]:
    """Yield what the covariance rests on."""
    yield f"  standard deviations by leaving out one of {modes.blocks} blocks at a time"
    for remark in modes.remarks:
        yield f"  {remark}"


# -------- Modal

CORRELATED = 0.3
"""Correlation of two rows of a campaign from which on it is said."""


def modal_report(
    tests: Sequence[ModalTest | AmbientTest],
    identified: Sequence[IdentifiedModes] = (),
    finished: Sequence[FinishedTest] = (),
    named: Sequence[NamedModes] = (),
    campaign: Campaign | None = None,
    reproducibility: Reproducibility | None = None,
) -> str:
    """Return the report: a heading, each posture with its modes, files of finished ones, then what the campaign has."""
    postures = [
        chain(_state(number, test), _test(test), _modes(each, reproducibility) if each else ())
        for number, (test, each) in enumerate(zip_longest(tests, identified), 1)
    ]
    postures += [
        chain(_finished(test), _named(each, reproducibility) if each else ())
        for test, each in zip_longest(finished, named)
    ]
    every: tuple[Labelled, ...] = (*identified, *named)
    last = _campaign(every, campaign, reproducibility) if campaign else ()
    return paragraphs([_heading(tests, finished), *postures, last])


def _heading(tests: Sequence[ModalTest | AmbientTest], finished: Sequence[FinishedTest]) -> Iterator[str]:
    hammer = [test for test in tests if isinstance(test, ModalTest)]
    ambient = [test for test in tests if isinstance(test, AmbientTest)]
    if finished:
        modes = sum(len(test.modes.frequency) for test in finished)
        yield f"Finished modes: {modes} in {len(finished)} file{'s' * (len(finished) > 1)}"
    if hammer:
        rejected = sum(len(test.rejected) for test in hammer)
        hits = sum(test.hits for test in hammer)
        not_counted = f"{rejected} {'does' if rejected == 1 else 'do'} not"
        yield f"Hammer test at {_postures(hammer)}: {hits} hits count, {not_counted}"
    if ambient:
        yield from ambient_heading(ambient, _postures(ambient))
    doubtful = sum(not check.good for test in hammer for check in test.checks)
    if doubtful:
        fail = "s fail" if doubtful > 1 else " fails"
        yield f"  WARNING: {doubtful} check{fail}, see below: look at directions first"


def _postures(tests: Sequence[object]) -> str:
    return f"{len(tests)} posture{'s' * (len(tests) > 1)}"


def _state(number: int, test: ModalTest | AmbientTest) -> Iterator[str]:
    yield f"Posture {number}: {degrees(test.posture)}, {cut(str(test.load), 50)}, drives: {test.drives}"


def _test(test: ModalTest | AmbientTest) -> Iterator[str]:
    return ambient_test(test) if isinstance(test, AmbientTest) else _hammer_test(test)


def _hammer_test(test: ModalTest) -> Iterator[str]:
    frf = test.frf
    low, high = frf.frequency[0], frf.frequency[-1]
    step = frf.frequency[1] - frf.frequency[0]
    record = f", records of {test.duration:.4g} s" if test.duration else ", finished frequency responses"
    hits = f"{len(frf.hits)} hits at each of {len(frf.references)} points"
    yield f"  {hits}{record}; {low:.3g} to {high:.4g} Hz by {step:.3g} Hz"
    if frf.decay:
        yield f"  exponential window: adds {frf.decay:.4g} 1/s to the decay rate of each mode, to be taken off again"
    for each in test.rejected:
        yield f"  REJECTED {cut(each.file, 30)}, hit {each.number}: {each.reason}"
    for remark in test.remarks:
        yield f"  {remark}"
    yield f"  {'coherence, median over lines':34s}" + "".join(
        f"{place_in_words(place):>16s}" for place in frf.references
    )
    for o, place in enumerate(frf.responses):
        cells = "".join(f"{float(np.median(each)):16.3f}" for each in test.coherence[o])
        yield f"    {place_in_words(place):32s}{cells}"
    for check in test.checks:
        verdict = "good" if check.good else f"BAD: {check.remedy}"
        places = " and ".join(map(place_in_words, check.places))
        yield f"  {check.name}, {places}: {100 * check.value:.1f} % (at most {100 * check.limit:.0f} %), {verdict}"


def _finished(test: FinishedTest) -> Iterator[str]:
    """Yield where finished modes come from."""
    yield f"{cut(test.files[0], 40)}: {degrees(test.posture)}, {cut(str(test.load), 50)}, drives: {test.drives}"
    places = ", ".join(map(place_in_words, test.modes.responses))
    yield f"  {len(test.modes.frequency)} modes at {places}; frequencies: {test.modes.of}"


def _modes(each: IdentifiedModes, reproducibility: Reproducibility | None) -> Iterator[str]:
    """Yield the modes of a posture, each with its name or what is in doubt, and how sure they are."""
    modes = each.modes
    yield from _named(each, reproducibility)
    yield from _reliance(modes) if isinstance(modes, Modes) else ambient_reliance(modes)
    for pole in modes.rejected:
        yield f"  no mode at {pole.frequency:.2f} Hz: {pole.why}"


def _reliance(modes: Modes) -> Iterator[str]:
    """Yield what the covariance rests on."""
    low, high = modes.ratio.band
    verdict = "beyond" if modes.ratio.doubtful else "within"
    yield (
        f"  scatter of the hits: {modes.ratio.value:.2f} of the variance by maximum likelihood, {verdict} "
        f"{low:.2f} to {high:.2f} (99 %)"
    )
    if not modes.converged:
        yield "  WARNING: the search for the most probable modes has not ended"


def _named(each: Labelled, reproducibility: Reproducibility | None) -> Iterator[str]:
    """Yield the modes of a posture, each with its name or what is in doubt; both parts of its standard deviations."""
    modes, labels = each.modes, each.labels
    share = reproducibility.share if reproducibility else {}
    head = f"{'repeat':>9s}{'reprod':>8s}" if share else f"{'sd':>9s}"
    yield f"  {'mode':>6s}{'frequency':>12s}{head}{'damping':>10s}{head}  {'MAC':>5s}  name"
    for i, (label, why) in enumerate(zip(labels.given, labels.why, strict=True)):
        frequency, damping = modes.frequency[i], 100 * modes.damping[i]
        again = [f"{share[kind] * x:8.{digits}f}" if share else "" for kind, x, digits in
                 (("frequency", frequency, 4), ("damping_ratio", damping, 3))]  # fmt: skip
        sd = modes.sigma[0, i], 100 * modes.sigma[1, i]
        numbers = f"{frequency:9.4f} Hz{sd[0]:9.4f}{again[0]}{damping:8.3f} %{sd[1]:9.3f}{again[1]}"
        yield f"  {i + 1:6d}{numbers}  {float(labels.mac[i].max()):5.2f}  {label or '-'}"
        if why:
            yield f"         NO NAME for mode {i + 1}: {why}"


def reproducibility_in_words(known: Reproducibility) -> str:
    """Say what the sigmas of a campaign are made of, and where that is from."""
    parts = []
    for kind, share in known.share.items():
        freedom = known.freedom.get(kind, 0)
        origin = "given" if kind in known.said else f"from repeated tests, {freedom} d.o.f." if freedom else "assumed"
        parts.append(f"{100 * share:.2g} % of each {kind.replace('_', ' ')} ({origin})")
    common = f"{100 * known.common:.3g} % of its variance common to a test"
    return f"repeatability (scatter within the test) and reproducibility: {', '.join(parts)}; {common}"


def _campaign(identified: Sequence[Labelled], made: Campaign, reproducibility: Reproducibility | None) -> Iterator[str]:
    """Yield what the campaign has, and which of its errors are correlated most."""
    named = sum(label is not None for each in identified for label in each.labels.given)
    every = sum(len(each.labels.given) for each in identified)
    of = " (|pole| / 2 pi)" if all(m.of == POLE for m in made.of_kind("frequency")) else ""
    shapes = ", damping ratio and shape" if made.of_kind("shape") else " and damping ratio"
    yield f"Campaign: {named} of {every} modes have a name: rows of frequency{of}{shapes}"
    if not named:
        return
    if reproducibility:
        yield f"  sigma: {reproducibility_in_words(reproducibility)} (--reproducibility, --common-share)"
    pairs = [
        (value, (places[j], places[i]))
        for places, matrix in made.correlated
        for i, row in enumerate(matrix)
        for j, value in enumerate(row[:i])
    ]
    value, both = max(pairs, key=lambda pair: abs(pair[0]), default=(0.0, (0, 0)))
    if abs(value) > CORRELATED:
        rows = [made.measurements[k] for k in both]
        words = " and ".join(f"{row.mode} ({row.kind.replace('_', ' ')})" for row in rows)
        yield f"  largest correlation {value:.2f}: {words} at {degrees(rows[0].posture)}"
    yield "  how the rows' errors are correlated lies beside the campaign, where ident fit finds it"
