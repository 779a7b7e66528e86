"""The printed table of sensitivities, and the head that it shares with the report of a design."""

from collections.abc import Iterator

import numpy as np

from ident.assess.design import DesignStudy
from ident.present.text.basis import assumed_in_words, basis_in_words, load_in_words, motion_in_words
from ident.present.text.units import MM, value_in_words
from ident.present.text.words import cut, paragraphs
from ident.vibrate.response.amplitude import MEASURES
from ident.vibrate.response.study import DIRECTIONS

MOST = 12
"""Sensitivities that a report of a design tells."""


def sensitivity_report(designing: DesignStudy) -> str:
    """Return the report without a design: motion, present amplitude, all sensitivities, what is assumed."""
    count = len(designing.sensitivities.paths)
    return paragraphs([heading(designing), present(designing), table(designing, count), assumptions(designing)])


def heading(designing: DesignStudy) -> Iterator[str]:
    """Say what is moved, and by which numbers."""
    trial = designing.trial
    yield from motion_in_words(designing.basis)
    yield f"{load_in_words(designing.basis, trial.elastic_belts, trial.rate)}; fast method"
    yield from basis_in_words(designing.basis, changed_draws=True)


def present(designing: DesignStudy) -> Iterator[str]:
    """Tell the amplitudes of the arm as it is."""
    amplitude, measure = designing.sensitivities.amplitude, designing.trial.measure
    sizes = ", ".join(f"{d} {mm(a)} mm" for d, a in zip(DIRECTIONS, amplitude, strict=True))
    yield f"Vibration of {designing.point}, {measure}: {MEASURES[measure]}"
    yield f"  as the arm is: {sizes}"
    if designing.design and (limit := designing.design.limit):
        beyond = [d for d, size in zip(DIRECTIONS, amplitude, strict=True) if size > limit]
        words = f"exceeded in {', '.join(beyond)}" if beyond else "kept in all directions"
        yield f"  limit of {MM * limit:g} mm: {words}"


def table(designing: DesignStudy, most: int = MOST) -> Iterator[str]:
    """Tell by how many percent the amplitude changes with each number, the strongest first."""
    found = designing.sensitivities
    way = DIRECTIONS[int(np.argmax(found.amplitude))]
    yield "Sensitivities: percent of amplitude per percent of the number, as the arm is"
    yield f"  {'':22s}{'at present':>22s}" + "".join(
        f"{d:>9s}" + (" 5 to 95 %".rjust(16) if designing.draws else "") for d in DIRECTIONS
    )
    for i in found.order[:most]:
        row = f"  {cut(found.paths[i], 22):22s}{value_in_words(found.paths[i], found.present[i]):>22s}"
        for d in range(3):
            row += f"{found.elasticity[i, d]:+9.3f}"
            row += f"{'{:+.3f} {:+.3f}'.format(*found.band[:, i, d]):>16s}" if designing.draws else ""
        yield row
    if len(found.paths) > most:
        yield f"  and {len(found.paths) - most} more, in the .json"
    yield f"  strongest in {way} first, where the arm vibrates most"


def assumptions(designing: DesignStudy) -> Iterator[str]:
    """Say what is assumed."""
    return assumed_in_words(designing.basis)


def mm(value: float) -> str:
    """Write a length in mm."""
    return f"{MM * value:.4f}"
