"""The printed table of sensitivities, and the head that it shares with the report of a design."""

from collections.abc import Iterator

import numpy as np

from ident.assess.design import DesignStudy
from ident.present.text.amplitude_words import present_in_words, simulated_in_words
from ident.present.text.basis import assumed_in_words, basis_in_words
from ident.present.text.units import value_in_words
from ident.present.text.words import cut, paragraphs
from ident.vibrate.redesign.sensitivity import NEARBY
from ident.vibrate.response.study import DIRECTIONS

MOST = 12
"""Sensitivities that a report of a design tells."""
UNSURE = "~"
"""Marks a sensitivity whose sign is another for nearby arms."""


def sensitivity_report(study: DesignStudy) -> str:
    """Return the report without a design: motion, present amplitude, all sensitivities, what is assumed."""
    every = table(study, len(study.sensitivities.paths))
    return paragraphs([heading(study), present(study), every, assumed_in_words(study.basis)])


def heading(study: DesignStudy) -> Iterator[str]:
    """Say what is moved, and by which numbers."""
    yield from simulated_in_words(study.basis, elastic_belts=study.evaluator.elastic_belts, rate=study.evaluator.rate)
    yield from basis_in_words(study.basis, changed_draws=True)


def present(study: DesignStudy) -> Iterator[str]:
    """Tell the amplitudes of the arm as it is."""
    return present_in_words(study.basis, study.evaluator.measure, study.sensitivities.amplitude, study.limit)


def table(study: DesignStudy, most: int = MOST) -> Iterator[str]:
    """Tell by how many percent the amplitude changes with each number, the strongest first."""
    each = study.sensitivities
    way = DIRECTIONS[int(np.argmax(each.amplitude))]
    yield "Sensitivities: percent of amplitude per percent of the number, as the arm is"
    head = (f"{d:>9s} " + (" 5 to 95 %".rjust(16) if study.draws else "") for d in DIRECTIONS)
    yield f"  {'':22s}{'at present':>22s}{''.join(head)}".rstrip()
    for i in each.order[:most]:
        row = f"  {cut(each.paths[i], 22):22s}{value_in_words(each.paths[i], each.present[i]):>22s}"
        for d in range(3):
            row += f"{each.elasticity[i, d]:+9.3f}" + (UNSURE if each.unsure[i, d] else " ")
            row += f"{'{:+.3f} {:+.3f}'.format(*each.band[:, i, d]):>16s}" if study.draws else ""
        yield row.rstrip()
    if len(each.paths) > most:
        yield f"  and {len(each.paths) - most} more, in the .json"
    yield f"  strongest in {way} first, where the arm vibrates most"
    if each.unsure.any():
        yield f"  {UNSURE} {unsure_words(study.draws)}"


def unsure_words(draws: int = 0) -> str:
    """Say what is marked where the sign of a sensitivity is another for nearby arms."""
    if draws:
        return f"its sign is not sure: it is another for more than 5 % of the {draws} draws"
    share = f"{100 * NEARBY:g} %"
    return f"holds nearby only: {share} more or {share} less of the number does the opposite"
