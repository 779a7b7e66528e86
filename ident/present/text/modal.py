"""The printed report of a hammer test: what was measured at each posture, what was rejected, what the checks say."""

from collections.abc import Iterator, Sequence

import numpy as np

from ident.modal.frf import Place
from ident.modal.modal_test import ModalTest
from ident.present.text.words import cut, degrees, paragraphs


def modal_report(tests: Sequence[ModalTest]) -> str:
    """Return the report: a heading, then each posture."""
    return paragraphs([_heading(tests), *(_test(test) for test in tests)])


def _heading(tests: Sequence[ModalTest]) -> Iterator[str]:
    hits = sum(len(test.frf.hits) * len(test.frf.references) for test in tests)
    rejected = sum(len(test.rejected) for test in tests)
    states = f"{len(tests)} posture{'s' * (len(tests) > 1)}"
    yield f"Hammer test at {states}: {hits} hits count, {rejected} {'does' if rejected == 1 else 'do'} not"
    doubtful = sum(not check.good for test in tests for check in test.checks)
    if doubtful:
        fail = "s fail" if doubtful > 1 else " fails"
        yield f"  WARNING: {doubtful} check{fail}, see below: look at directions first"


def _test(test: ModalTest) -> Iterator[str]:
    frf = test.frf
    yield f"Posture {degrees(test.posture)}, {cut(str(test.load), 50)}, drives: {test.drives}"
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


def place_in_words(place: Place) -> str:
    """Write a place as `tip -z`, or with the components of its direction."""
    axes = np.array(place.direction)
    along = np.flatnonzero(abs(axes) > 1 - 1e-9)
    if len(along):
        return f"{cut(place.point, 12)} {'-' if axes[along[0]] < 0 else ''}{'xyz'[along[0]]}"
    return f"{cut(place.point, 12)} ({' '.join(f'{each + 0.0:.2g}' for each in axes)})"
