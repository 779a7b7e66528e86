"""The modes of each posture of a modal test with their names, and the campaign that they make."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Complex, Float

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.identify.mode_labels import Measured, ModeLabels, label_modes
from ident.inference.parameters import Parameters
from ident.measure import DEFINITIONS, Campaign, Measurement
from ident.measure.covariance import Covariance, Group
from ident.modal.ambient_test import AmbientTest
from ident.modal.estimate import Modes, modes_of, together
from ident.modal.finished import POLE, FinishedModes, FinishedTest
from ident.modal.modal_parameters import ModalParameters
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


@dataclass(frozen=True)
class NamedModes:
    """Finished modes of one file.

    Attributes:
        modes: frequencies, damping ratios and shapes with their standard deviations.
        labels: what each is called, and how sure.
    """

    modes: FinishedModes
    labels: ModeLabels


Labelled = IdentifiedModes | NamedModes


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
    measured = [Measured(test.posture, each, test.load) for test, each in zip(tests, modes, strict=True)]
    labels = label_modes(arm, measured, parameters, seed=seed)
    return tuple(IdentifiedModes(*pair) for pair in zip(modes, labels, strict=True))


def name_modes(
    arm: Arm, tests: Sequence[FinishedTest], parameters: Parameters, *, seed: int = 0
) -> tuple[NamedModes, ...]:
    """Name finished modes of each file, see `identify_modes`."""
    labels = label_modes(arm, [Measured(test.posture, test.modes, test.load) for test in tests], parameters, seed=seed)
    return tuple(NamedModes(test.modes, own) for test, own in zip(tests, labels, strict=True))


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
    name: str,
    tests: Sequence[ModalTest | AmbientTest | FinishedTest],
    identified: Sequence[Labelled],
    *,
    shapes: bool = False,
) -> Campaign:
    """Return the campaign of the modes that have a name; a doubtful one is no row, as it could be matched wrongly.

    Of each posture the frequencies, then the damping ratios, then the shapes where they are asked for, whose errors are
    correlated as the modes' are.
    """
    rows, groups = list[Measurement](), list[Group]()
    for number, (test, each) in enumerate(zip(tests, identified, strict=True), 1):
        own = [*_rows(test, each), *(_shape_rows(test, each) if shapes else ())]
        if own:
            group = Group(f"{name} {number}", _correlation(each.modes, _slopes(each, shapes)))
            rows += [replace(row, group=group.name, member=place) for place, row in enumerate(own, 1)]
            groups.append(group)
    return Campaign(name=name, measurements=tuple(rows), covariance=Covariance(tuple(groups)) if groups else None)


def _named(each: Labelled) -> list[int]:
    return [i for i, label in enumerate(each.labels.given) if label is not None]


def _damped(each: Labelled) -> list[int]:
    """Return the modes that have a name and a damping ratio."""
    return [i for i in _named(each) if each.modes.damping[i] > 0]


def _slopes(each: Labelled, shapes: bool) -> Float[np.ndarray, "r n"]:
    """Return the derivative of the rows of the modes that have a name by frequencies, damping ratios and shapes."""
    modes, named = each.modes, _named(each)
    outputs, count = len(modes.shape), len(modes.frequency)
    columns = 2 * count + 2 * outputs * count
    rows = [np.eye(columns)[[*named, *(count + i for i in _damped(each))]]]
    for i in named if shapes else ():
        own = np.zeros((outputs - 1, columns))
        own[:, 2 * count + 2 * outputs * i :][:, : 2 * outputs] = _ratios(modes.shape[:, i])[2]
        rows.append(own)
    return np.concatenate(rows)


def _ratios(shape: Complex[np.ndarray, "O"]) -> tuple[int, Float[np.ndarray, "r"], Float[np.ndarray, "r two_O"]]:
    """Return the place of the largest motion, the others over it, and their slopes by real and imaginary parts.

    The shape is turned so that it is as real as can be, see `ident.identify.shapes`, and the real parts count.
    """
    turn = np.exp(-0.5j * np.angle((shape**2).sum()))
    turned = shape * turn
    largest = int(np.argmax(np.abs(turned.real)))
    angle = turned * turn / (turned**2).sum().real  # its change is that of the imaginary part of its sum with the shape
    moves = np.eye(len(shape)) * turn - 1j * np.outer(turned.imag, angle)
    ratio = turned.real / turned.real[largest]
    parts = np.concatenate([moves.real, -moves.imag], 1)
    others = np.arange(len(shape)) != largest
    return largest, ratio[others], ((parts - np.outer(ratio, parts[largest])) / turned.real[largest])[others]


def _correlation(
    modes: ModalParameters | FinishedModes, slopes: Float[np.ndarray, "r n"]
) -> tuple[tuple[float, ...], ...]:
    """Return the correlation of numbers that have these derivatives."""
    covariance = slopes @ modes.covariance @ slopes.T
    sd = np.sqrt(np.diag(covariance))
    whole = covariance / np.outer(sd, sd)
    np.fill_diagonal(whole, 1.0)
    return tuple(map(tuple, ((whole + whole.T) / 2).tolist()))


def _shape_rows(test: ModalTest | AmbientTest | FinishedTest, each: Labelled) -> Iterator[Measurement]:
    """Yield the motion of each response over the largest one, mode by mode."""
    places = each.modes.responses
    for i in _named(each):
        largest, values, slopes = _ratios(each.modes.shape[:, i])
        sigma = np.sqrt(np.diag(slopes @ each.modes.of_shape([i]) @ slopes.T))
        others = [place for j, place in enumerate(places) if j != largest]
        for place, value, sd in zip(others, values.tolist(), sigma.tolist(), strict=True):
            yield Measurement(
                kind="shape",
                posture=test.posture,
                value=value,
                sigma=sd,
                mode=str(each.labels.given[i]),
                of=POLE if _of(each) else None,
                point=place.point,
                direction=place.direction,
                reference_point=places[largest].point,
                reference_direction=places[largest].direction,
                load=test.load,
                drives=test.drives,
            )


def _of(each: Labelled) -> str | None:
    """Return what the frequencies are of a damped mode; None for undamped."""
    of = each.modes.of if isinstance(each.modes, FinishedModes) else POLE
    return None if of == DEFINITIONS[0] else of


def _rows(test: ModalTest | AmbientTest | FinishedTest, each: Labelled) -> Iterator[Measurement]:
    modes = each.modes
    for kind, values, sigma in zip(
        ("frequency", "damping_ratio"), (modes.frequency, modes.damping), modes.sigma, strict=True
    ):
        for i in _named(each) if kind == "frequency" else _damped(each):
            yield Measurement(
                kind=kind,
                posture=test.posture,
                value=float(values[i]),
                sigma=float(sigma[i]),
                mode=str(each.labels.given[i]),
                of=_of(each) if kind == "frequency" else None,
                load=test.load,
                drives=test.drives,
            )
