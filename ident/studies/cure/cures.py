"""Cures without a new part, speed along the path and balancing; and pairs, where no single remedy is enough."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from ident.errors import InputError
from ident.programs import Progress
from ident.studies.cure.balance_study import Rotor
from ident.studies.cure.motion_study import scheduling_of
from ident.studies.cure.remedies import (
    AND,
    EFFORTS,
    STIFFER,
    Remedy,
    Task,
    assessed,
    carried_out,
    held,
    least,
    rank,
    single_remedies,
)
from ident.vibrate.schedule import Schedule, Scheduling

SEGMENTS = 12
"""Segments of the path, the default of `ident motion`."""
STEPS = 4
"""Stiffnesses of a joint tried together with the speed along the path."""
SHARES = (0.5, 0.6, 0.7, 0.75, 0.8, 0.85, 0.875, 0.9, 0.925, 0.95, 0.975)
"""Tried ratios of a pulley order's frequency to the first natural frequency of the posture; assumed."""


def cures(task: Task, scatter: float, rotors: Sequence[Rotor] = (), progress: Progress = iter) -> tuple[Remedy, ...]:
    """Return the remedies, the best first; pairs too if no single remedy meets the limit.

    Args:
        task: the diagnosis.
        scatter: factor from the amplitude of the arm itself to the amplitude that most of its draws keep.
        rotors: that can be balanced.
        progress: shows progress over the remedies except speeds along the path, balancing and pairs.
    """
    found = single_remedies(task, scatter, progress)
    if path := along_path(task):
        found.append(path)
    if rotors:
        found.append(balancing(task, tuple(rotors)))
    found.sort(key=rank)
    if not found[0].meets_limit:
        found += pairs(task, found)
    return tuple(sorted(found, key=rank))


def along_path(task: Task, other: Remedy | None = None) -> Remedy | None:
    """Return the quickest motion that keeps pulley orders below the first mode and meets the limit, else the quietest.

    v(alpha) = share f_1(alpha) / order, within the limits of alpha, where order is in cycles per radian: only `share`
    is varied, while `ident motion` searches the speed at each place.

    Args:
        task: the diagnosis.
        other: a remedy that is carried out as well.

    Returns:
        The remedy; None if no drive turns, if every motion takes longer than the lowest speed, or if a given path has
        corners or joints without limits.
    """
    stroke, own = None if task.basis.log else task.basis.arm.stroke, task.basis.motion
    if not task.basis.arm.drives:
        return None
    after, evaluator, changes = carried_out(task, other) if other else (task, task.evaluator(), np.zeros(0))
    evaluator = replace(evaluator, draws=after.assessment_draws)
    retract, dwell = False, float(own.breaks[-1] - own.arrival)
    if stroke:
        ends = np.asarray(stroke.direction, float) @ np.asarray(own(own.breaks[[0, -1]])[0])  # alpha grows along it
        retract = bool(ends[1] > ends[0]) == bool(stroke.folded > stroke.unfolded)
    basis = replace(after.basis, arm=evaluator.changed_arm(changes))
    try:
        search = scheduling_of(basis, stroke, segments=SEGMENTS, dwell=dwell, retract=retract)
    except InputError:  # a path that can't be followed at other speeds, or an arm without excitation
        return None
    slowest = own.arrival / min(task.effort.speeds)  # longer than the lowest speed is no cure
    schedules = sorted(_below_first_mode(search), key=lambda each: each.duration)
    schedules = [each for each in schedules if each.duration <= slowest]
    if not schedules:
        return None
    every = [replace(evaluator, motion=held(task, each)) for each in schedules]
    time = np.log2([each.duration / own.arrival for each in schedules])

    def remedy(k: int) -> Remedy:
        kind, rotors = ("schedule" + AND + other.kind, other.rotors) if other else ("schedule", ())
        size, schedule = float(abs(time[k])), schedules[k]
        return assessed(task, every[k], kind, changes, change_norm=size, schedule=schedule, rotors=rotors)

    return least(time, lambda k: float(every[k].alone.amplitudes(changes[None]).max()), task.limit, remedy)


def _below_first_mode(search: Scheduling) -> Iterator[Schedule]:
    """Yield motions in which an order of a pulley stays at a share of the posture's first natural frequency."""
    within = search.places[1:-1]
    first = search.frequencies(within)[0]
    each = (search.schedule(share * first / order) for order in search.orders(within) for share in SHARES)
    yield from {schedule.speeds.tobytes(): schedule for schedule in each}.values()


def balancing(task: Task, rotors: tuple[Rotor, ...]) -> Remedy:
    """Return the effect of masses on rotors; the size of that change is the largest mass over the mass that fits."""
    after = task.balanced(rotors)
    size = max(body.mass / rotor.pulley.most for rotor in rotors for body in rotor.bodies)
    evaluator = after.evaluator(draws=after.assessment_draws)
    return assessed(task, evaluator, "balance", np.zeros(0), change_norm=size, rotors=rotors)


def pairs(task: Task, ranked: Sequence[Remedy]) -> Iterator[Remedy]:
    """Yield the best remedies of two efforts together, least effort first, up to a pair that meets the limit.

    If the speed along the path is one of them, stiffer joints are tried as the other: the higher the first natural
    frequency, the quicker the motion; a stiffness chosen alone does not account for that.

    Args:
        task: the diagnosis.
        ranked: single remedies, the best first.
    """
    best = {effort: next((each for each in ranked if each.effort == effort), None) for effort in EFFORTS.values()}
    for cheap, dear in combinations(filter(None, best.values()), 2):
        tried: list[Remedy] = []
        if cheap.effort == EFFORTS["schedule"]:  # the speed is searched on the changed arm
            for other in (dear, *(_stiffer(task, dear) if dear.effort == EFFORTS["torsion"] else ())):
                if remedy := along_path(task, other):
                    tried.append(remedy)
                    if remedy.meets_limit:
                        break
        if not tried and not cheap.schedule:
            tried = [_both(task, cheap, dear)]
        if tried:
            yield (remedy := min(tried, key=rank))
            if remedy.meets_limit:
                return


def _stiffer(task: Task, template: Remedy) -> Iterator[Remedy]:
    """Yield remedies with a stiffer joint, step by step: the joint that raises the first frequency most."""
    every = task.evaluator(*task.torsion)
    raised = every.end_states(np.diag(every.bounds[1])).frequency
    variable = task.torsion[int(np.argmax(raised))]
    before = {path: float(task.basis.arm.get(path)) for path in variable.paths}
    for factor in STIFFER ** np.linspace(0.25, 1.0, STEPS):
        values = {path: float(factor * number) for path, number in before.items()}
        yield replace(template, kind="torsion", values=values, before=before)


def _both(task: Task, cheap: Remedy, dear: Remedy) -> Remedy:
    """Return two remedies together, each as chosen alone."""
    kind, rotors = cheap.kind + AND + dear.kind, (*cheap.rotors, *dear.rotors)
    both = replace(dear, values={**cheap.values, **dear.values}, percent=cheap.percent, rotors=rotors)
    after, evaluator, changes = carried_out(task, both)
    evaluator = replace(evaluator, draws=after.assessment_draws)
    size = cheap.change_norm + dear.change_norm
    ratio = cheap.percent / cheap.percent_before
    return assessed(task, evaluator, kind, changes, change_norm=size, ratio=ratio, rotors=rotors)
