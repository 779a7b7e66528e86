"""Modes of a modal test on an arm: their names, their campaign, and the places of the sensors."""

import math
from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.parts import Point
from ident.errors import Problem, placed, refusal, refuse, require
from ident.identify.mode_names import Measured, ModeLabels, label_modes
from ident.inference.parameters import Parameters
from ident.measure import DEFINITIONS, Campaign, Measurement
from ident.measure.channels import FRAMES, ChannelRow, ChannelTable
from ident.measure.covariance import Covariance, Group
from ident.measure.load import named_points, unit_vector
from ident.measure.reproducibility import REPRODUCIBILITY, Reproducibility
from ident.modal.ambient import AmbientTest
from ident.modal.finished import POLE, FinishedModes, FinishedTest
from ident.modal.frf import HeldArm, ModalTest
from ident.modal.modes import Modes, modes_of, together
from ident.modal.operational import OperationalModes, operational_modes
from ident.text import did_you_mean, one_line, quoted

# -------- Identified modes
# The named modes of each posture of a modal test, and the campaign from them.


@dataclass(frozen=True)
class IdentifiedModes:
    """Modes of one posture.

    Attributes:
        modes: frequencies, damping ratios and shapes with their joint covariance.
        labels: name of each mode, and its certainty.
    """

    modes: Modes | OperationalModes
    labels: ModeLabels


@dataclass(frozen=True)
class NamedModes:
    """Finished modes of one file.

    Attributes:
        modes: frequencies, damping ratios and shapes with their standard deviations.
        labels: name of each mode, and its certainty.
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
    amplitude: float | None = None,
) -> tuple[IdentifiedModes, ...]:
    """Identify and name the modes of each posture; for a hammer test, the scatter of all hits scales their errors.

    Args:
        arm: with the measured points.
        tests: one a posture.
        parameters: the unknowns with their priors, over which modes are named.
        near: [Hz] frequencies that replace the choice of modes in a test, by its number from 1.
        seed: of the draws.
        amplitude: [m] see `operational_modes`.

    Raises:
        InputError: a test without a mode, with too few hits or lines; a number of no test; an amplitude without taps.
    """
    tapped = any(isinstance(test, AmbientTest) and test.decays for test in tests)
    remedy = "leave it out: taps are records shorter than an ambient test, or those whose excitation is tap"
    require(tapped or amplitude is None, "amplitude", "no posture with taps", "free decays after taps", remedy)
    near = near or {}
    for number in near:
        if not 1 <= number <= len(tests):
            raise refusal("modes", f"posture {number}", f"1 to {len(tests)}", "postures are numbered as in the report")
    every = [_modes(test, near.get(number), amplitude) for number, test in enumerate(tests, 1)]
    hammer = iter(together([modes for modes in every if isinstance(modes, Modes)]))
    modes = [next(hammer) if isinstance(each, Modes) else each for each in every]
    measured = [Measured(test.posture, each, test.load) for test, each in zip(tests, modes, strict=True)]
    labels = label_modes(arm, measured, parameters, seed=seed)
    return tuple(IdentifiedModes(*pair) for pair in zip(modes, labels, strict=True))


def name_modes(
    arm: Arm, tests: Sequence[FinishedTest], parameters: Parameters, *, seed: int = 0
) -> tuple[NamedModes, ...]:
    """Name finished modes of each file, see `identify_modes`."""
    labels = label_modes(arm, [Measured(test.posture, test.modes, test.load) for test in tests], parameters, seed=seed)
    return tuple(NamedModes(test.modes, own) for test, own in zip(tests, labels, strict=True))


def _modes(
    test: ModalTest | AmbientTest, near: tuple[float, ...] | None, amplitude: float | None
) -> Modes | OperationalModes:
    with placed(one_line(", ".join(test.files))):
        if isinstance(test, AmbientTest):
            return operational_modes(test, near=near, amplitude=amplitude)
        return modes_of(test.frf, near=near)


def modal_campaign(
    name: str,
    tests: Sequence[HeldArm],
    identified: Sequence[Labelled],
    *,
    shapes: bool = False,
    reproducibility: Reproducibility | None = None,
) -> Campaign:
    """Return the campaign of the named modes; a doubtful mode gets no row, as it could be matched wrongly.

    For each posture the frequencies, then the damping ratios, then the shapes if requested, with errors correlated
    like the modes'. The scatter within a test is its repeatability; if given, the reproducibility between tests of the
    same posture is added.
    """
    rows, groups = list[Measurement](), list[Group]()
    for number, (test, each) in enumerate(zip(tests, identified, strict=True), 1):
        own = [*_rows(test, each), *(_shape_rows(test, each) if shapes else ())]
        if own:
            slopes = _slopes(each, shapes)
            covariance = slopes @ each.modes.covariance @ slopes.T
            if reproducibility is not None:
                added = reproducibility.covariance([(row.kind, row.value) for row in own])
                covariance = covariance + added
                more = np.sqrt(np.diag(added)).tolist()
                own = [replace(row, sigma=math.hypot(row.sigma, sd)) for row, sd in zip(own, more, strict=True)]
            group = Group(f"{name} {number}", _correlation(covariance))
            rows += [replace(row, group=group.name, member=place) for place, row in enumerate(own, 1)]
            groups.append(group)
    return Campaign(name=name, measurements=tuple(rows), covariance=Covariance(tuple(groups)) if groups else None)


def observed_reproducibility(
    tests: Sequence[HeldArm], identified: Sequence[Labelled], known: Reproducibility
) -> Reproducibility:
    """Return the reproducibility from tests of the same posture, load and drives, by their named modes.

    The variance of the logarithms about their mean, over all modes and postures, less the mean variance within a test.
    """
    states: dict[Hashable, list[Labelled]] = {}
    for test, each in zip(tests, identified, strict=True):
        states.setdefault((tuple(np.round(test.posture, 5)), test.load, test.drives), []).append(each)
    for k, kind in enumerate(REPRODUCIBILITY):
        squares, freedom = 0.0, 0
        for own in states.values():
            labels = dict.fromkeys(str(label) for each in own for label in each.labels.given if label is not None)
            for values, within in (_repeated(own, label, k) for label in labels):
                if len(values) < 2:
                    continue
                squares += float(((values - values.mean()) ** 2).sum() - (len(values) - 1) * (within**2).mean())
                freedom += len(values) - 1
        known = known.after(kind, squares, freedom)
    return known


def with_effect(each: IdentifiedModes, known: Reproducibility) -> IdentifiedModes:
    """Return modes whose standard errors include the scatter of the hits, for the named modes, if any."""
    modes, of = each.modes, _named(each) or slice(None)
    if not isinstance(modes, Modes):
        return each
    unscaled = modes.sigma[:, of] / math.sqrt(max(modes.ratio.value, 1e-12))
    added = np.array([modes.frequency, modes.damping])[:, of] * [[known.share[kind]] for kind in REPRODUCIBILITY]
    effect = np.abs(np.log(np.hypot(modes.sigma[:, of], added) / np.hypot(unscaled, added))).max()
    return replace(each, modes=replace(modes, ratio=replace(modes.ratio, effect=float(effect))))


def _repeated(tests: Sequence[Labelled], label: str, kind: int) -> tuple[Float[np.ndarray, "n"], ...]:
    """Return logarithms of a mode's frequencies, or damping ratios, in several tests, with standard deviations."""
    found = []
    for each in tests:
        for i in _named(each) if kind == 0 else _damped(each):
            if str(each.labels.given[i]) == label:
                value = (each.modes.frequency, each.modes.damping)[kind][i]
                found.append((np.log(value), each.modes.sigma[kind][i] / value))
    values, within = np.array(found, float).reshape(-1, 2).T
    return values, within


def _named(each: Labelled) -> list[int]:
    return [i for i, label in enumerate(each.labels.given) if label is not None]


def _damped(each: Labelled) -> list[int]:
    """Return the modes with a name and a damping ratio."""
    return [i for i in _named(each) if each.modes.damping[i] > 0]


def _slopes(each: Labelled, shapes: bool) -> Float[np.ndarray, "r n"]:
    """Return the derivative of the rows of the named modes by frequencies, damping ratios and shapes."""
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
    """Return the index of the largest motion, the others relative to it, and their slopes by real and imaginary parts.

    The shape is rotated to be as real as possible, see `ident.identify.conditions`, and the real parts count.
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


def _correlation(covariance: Float[np.ndarray, "r r"]) -> tuple[tuple[float, ...], ...]:
    """Return the correlation of numbers of this covariance."""
    sd = np.sqrt(np.diag(covariance))
    whole = covariance / np.outer(sd, sd)
    np.fill_diagonal(whole, 1.0)
    return tuple(map(tuple, ((whole + whole.T) / 2).tolist()))


def _shape_rows(test: HeldArm, each: Labelled) -> Iterator[Measurement]:
    """Yield the motion of each response over the largest one, mode by mode."""
    places = each.modes.responses
    for i in _named(each):
        largest, values, slopes = _ratios(each.modes.shape[:, i])
        sigma = np.sqrt(np.diag(slopes @ each.modes.of_shape([i]) @ slopes.T))
        others = [place for j, place in enumerate(places) if j != largest]
        end = places[largest]
        reference: dict[str, Any] = {"reference_point": end.point, "reference_direction": end.direction}
        of = POLE if _of(each) else None
        for place, *numbers in zip(others, values.tolist(), sigma.tolist(), strict=True):
            where = {"point": place.point, "direction": place.direction, **reference}
            yield _row(test, each, i, ("shape", *numbers), of=of, **where)


def _of(each: Labelled) -> str | None:
    """Return the kind of the frequencies of a damped mode; None for undamped."""
    of = each.modes.of if isinstance(each.modes, FinishedModes) else POLE
    return None if of == DEFINITIONS[0] else of


def _rows(test: HeldArm, each: Labelled) -> Iterator[Measurement]:
    modes = each.modes
    of_frequency, of_damping = modes.sigma
    for i in _named(each):
        numbers = "frequency", float(modes.frequency[i]), float(of_frequency[i])
        yield _row(test, each, i, numbers, of=_of(each))
    for i in _damped(each):
        yield _row(test, each, i, ("damping_ratio", float(modes.damping[i]), float(of_damping[i])))


def _row(test: HeldArm, each: Labelled, mode: int, numbers: tuple[Any, ...], **more: Any) -> Measurement:
    """Return a measurement of a mode: its kind, value and standard deviation, and further fields."""
    kind, value, sigma = numbers
    state: dict[str, Any] = {"posture": test.posture, "load": test.load, "drives": test.drives}
    return Measurement(kind=kind, value=value, sigma=sigma, mode=str(each.labels.given[mode]), **state, **more)


# -------- Places
# Positions of the channels on the arm: points, and directions in the base frame.

BODY = FRAMES[1]


def with_places(arm: Arm, table: ChannelTable) -> Arm:
    """Return the arm with the points defined only by the table, before its own: the end point stays the last one.

    Raises:
        InputError: a point that neither arm nor table defines, or a load at a point missing in the arm's file.
    """
    own = {point.name for point in arm.points}
    new: dict[str, Point] = {}
    problems: list[Problem] = []
    for row in table.rows:
        if not row.counts:
            continue
        problems += _problems(arm, row, own)
        if row.point not in own and row.position is not None:
            point = new.setdefault(row.point, Point(row.point, row.joint, row.position))
            if point.joint != row.joint or not np.allclose(point.position, row.position):
                got, remedy = f"another place of {quoted(row.point)}", "give each place a name of its own"
                problems.append(Problem(row.where, got, "the same as above", remedy, "position"))
    refuse(problems)
    return eqx.tree_at(lambda a: a.points, arm, (*new.values(), *arm.points)) if new else arm


def in_base_frame(arm: Arm, table: ChannelTable) -> ChannelTable:
    """Return the table with every direction in the base frame, at the posture of its row.

    Body axes are taken without the arm's elastic rotations, some tenths of a degree.

    Args:
        arm: with all points of the table, see `with_places`.
        table: the channel table.

    Raises:
        InputError: a posture without exactly one angle for each joint.
    """
    for row in table.rows:
        if row.counts and len(row.posture) != len(arm.driven):
            got, expected = f"{len(row.posture)} joint angles", f"{len(arm.driven)}, as {arm.name} has"
            raise refusal(row.where, got, expected, "add or remove columns q1, q2, ...", "q1")
    turned = [i for i, row in enumerate(table.rows) if row.counts and row.frame == BODY]
    rows = list(table.rows)
    for posture in dict.fromkeys(rows[i].posture for i in turned):
        here = [i for i in turned if rows[i].posture == posture]
        for i, direction in zip(here, _turned(arm, posture, [rows[i] for i in here]), strict=True):
            rows[i] = replace(rows[i], direction=unit_vector(direction), frame=FRAMES[0])
    return replace(table, rows=tuple(rows))


def _turned(arm: Arm, posture: tuple[float, ...], rows: Sequence[ChannelRow]) -> Iterator[list[float]]:
    """Yield directions of bodies in the base frame: the position of a point at that offset from the body's origin."""
    joints = {point.name: point.joint for point in arm.points}
    ends = tuple(Point(f"end{i}", joints[row.point], row.direction) for i, row in enumerate(rows))
    chain = at_posture(eqx.tree_at(lambda a: a.points, arm, ends), jnp.asarray(posture))
    for column in np.asarray(chain.position).T:
        yield [float(f"{each:.12g}") + 0.0 for each in column]


def _problems(arm: Arm, row: ChannelRow, own: set[str]) -> Iterator[Problem]:
    joints = [joint.name for joint in arm.joints]
    if row.point not in own and row.position is None:
        expected = f"a point of {arm.name}, or joint and position of a new one"
        yield Problem(row.where, quoted(row.point), expected, did_you_mean(row.point, own, "correct it"), "point")
    if row.joint and row.joint not in joints:
        remedy = did_you_mean(row.joint, joints, "correct it")
        yield Problem(row.where, quoted(row.joint), f"a joint of {arm.name}", remedy, "joint")
    if row.point in own and row.position is not None:
        remedy = "empty joint and position, or give the place another name"
        got = f"a position of {quoted(row.point)}"
        yield Problem(row.where, got, "none: the arm has this point", remedy, "position")
    payloads = {payload.body.name for payload in arm.payloads}
    for name in named_points(row.load):
        if name not in own:
            remedy = "add it to the arm's file as a [[point]]: a fit needs it, too"
            yield Problem(row.where, f"a load at {quoted(name)}", f"a point of {arm.name}", remedy, "load")
    for name in row.load.payloads:
        if name not in payloads:
            remedy = did_you_mean(name, payloads, "correct the load")
            yield Problem(row.where, quoted(name), f"a payload of {arm.name}", remedy, "load")
