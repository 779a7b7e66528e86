"""The modes of each posture of a modal test with their names, and the campaign that they make."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.identify.mode_labels import ModeLabels, label_modes
from ident.inference.parameters import Parameters
from ident.measure import Campaign, Measurement
from ident.measure.covariance import Covariance, Group
from ident.modal.ambient_test import AmbientTest
from ident.modal.estimate import Modes, modes_of, together
from ident.modal.modal_test import ModalTest
from ident.modal.operational import OperationalModes, operational_modes
from ident.text import one_line


@dataclass(frozen=True)
class IdentifiedModes:
    """Modes of one posture.

    Attributes:
        modes: frequencies, damping ratios and shapes with their joint covariance.
        labels: what each is called, and how sure.
    """

    modes: Modes | OperationalModes
    labels: ModeLabels


def identify_modes(
    arm: Arm,
    tests: Sequence[ModalTest | AmbientTest],
    parameters: Parameters,
    *,
    near: Mapping[int, tuple[float, ...]] | None = None,
    seed: int = 0,
) -> tuple[IdentifiedModes, ...]:
    """Identify and name the modes of each posture; those with a hammer are scaled by the scatter of all hits.

    Args:
        arm: with the points at which was measured.
        tests: of the postures.
        parameters: the unknowns with their priors, over which modes are named.
        near: [Hz] overrules the choice of modes of a test, by its number from 1.
        seed: of the draws.

    Raises:
        InputError: a test without a mode, of too few hits or lines, or a number that is no test's.
    """
    near = near or {}
    for number in near:
        if not 1 <= number <= len(tests):
            remedy = "postures are numbered as in the report"
            raise InputError(Problem("modes", f"posture {number}", f"1 to {len(tests)}", remedy))
    modes = _together([_modes(test, near.get(number)) for number, test in enumerate(tests, 1)])
    return tuple(
        IdentifiedModes(each, label_modes(arm, test.posture, each, parameters, test.load, seed=seed))
        for test, each in zip(tests, modes, strict=True)
    )


def _modes(test: ModalTest | AmbientTest, near: tuple[float, ...] | None) -> Modes | OperationalModes:
    try:
        return operational_modes(test, near=near) if isinstance(test, AmbientTest) else modes_of(test.frf, near=near)
    except InputError as error:
        where = one_line(", ".join(test.files))
        problems = (Problem(where, each.got, each.expected, each.remedy, each.column) for each in error.problems)
        raise InputError(problems) from None


def _together(every: Sequence[Modes | OperationalModes]) -> list[Modes | OperationalModes]:
    """Return the modes with those of hammer tests scaled by the scatter of all hits."""
    hammer = iter(together([modes for modes in every if isinstance(modes, Modes)]))
    return [next(hammer) if isinstance(modes, Modes) else modes for modes in every]


def modal_campaign(
    name: str, tests: Sequence[ModalTest | AmbientTest], identified: Sequence[IdentifiedModes]
) -> Campaign:
    """Return the campaign of the modes that have a name; a doubtful one is no row, as it could be matched wrongly.

    Of each posture the frequencies, then the damping ratios, whose errors are correlated as the modes' are.
    """
    rows, groups = list[Measurement](), list[Group]()
    for number, (test, each) in enumerate(zip(tests, identified, strict=True), 1):
        own = list(_rows(test, each))
        if own:
            group = Group(f"{name} {number}", _correlation(each))
            rows += [replace(row, group=group.name, member=place) for place, row in enumerate(own, 1)]
            groups.append(group)
    return Campaign(name=name, measurements=tuple(rows), covariance=Covariance(tuple(groups)) if groups else None)


def _named(each: IdentifiedModes) -> list[int]:
    return [i for i, label in enumerate(each.labels.given) if label is not None]


def _correlation(each: IdentifiedModes) -> tuple[tuple[float, ...], ...]:
    """Return the correlation of frequencies and damping ratios of the modes that have a name."""
    count, named = len(each.modes.frequency), _named(each)
    at = [*named, *(count + i for i in named)]
    covariance = each.modes.covariance[np.ix_(at, at)]
    sd = np.sqrt(np.diag(covariance))
    whole = covariance / np.outer(sd, sd)
    np.fill_diagonal(whole, 1.0)
    return tuple(map(tuple, ((whole + whole.T) / 2).tolist()))


def _rows(test: ModalTest | AmbientTest, each: IdentifiedModes) -> Iterator[Measurement]:
    modes = each.modes
    for kind, values, sigma in zip(
        ("frequency", "damping_ratio"), (modes.frequency, modes.damping), modes.sigma, strict=True
    ):
        for i in _named(each):
            yield Measurement(
                kind=kind,
                posture=test.posture,
                value=float(values[i]),
                sigma=float(sigma[i]),
                mode=str(each.labels.given[i]),
                of="pole" if kind == "frequency" else None,
                load=test.load,
                drives=test.drives,
            )
