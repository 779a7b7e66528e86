"""What the report of a modal test says of ambient ones, whose forces nobody measured."""

from collections.abc import Iterator, Sequence

from ident.modal.ambient_test import AmbientTest
from ident.modal.operational import OperationalModes
from ident.present.text.places import place_in_words
from ident.present.text.words import cut


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
