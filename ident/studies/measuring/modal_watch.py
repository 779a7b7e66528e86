"""Watch the folder of a modal test during the measurement: hits that count, modes so far, what to record next.

The folder is polled: network shares send no events, and a look at it costs nothing.
"""

import math
import os
from collections.abc import Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path
from time import monotonic, sleep
from typing import NamedTuple

import numpy as np

from ident.errors import InputError
from ident.measure.channels import FORCE, ChannelTable, is_table
from ident.measure.load import Load
from ident.measure.recordings import Recording, is_recording, read_recording
from ident.measure.reproducibility import REPRODUCIBILITY
from ident.modal.ambient import AmbientTest, measured_tests
from ident.modal.frf import MOVING, ModalTest
from ident.modal.modes import modes_of
from ident.modal.operational import operational_modes
from ident.modal.recorded import place_of, state_of
from ident.report.words import degrees, percent
from ident.studies.measuring.modal import ModalOptions, described
from ident.studies.measuring.modal_report import check_in_words, place_in_words
from ident.text import by_key

STILL, PACE = 1.0, 0.5
"""Time [s] for which a file stands still before it is read, and between two looks at the folder."""
FEW = 3
"""Fewest hits that show a scatter."""
SHARE = 1 / 3
"""Largest repeatability over reproducibility: both together are then 5 % above the latter."""
LIGHT = 0.05
"""Largest damping ratio of a mode whose repeatability counts; assumed."""
COHERENT = 0.9
"""Least coherence at the modes; assumed."""
State = tuple[tuple[float, ...], Load, str]
"""Posture, load and state of the drives."""
AnyTest = ModalTest | AmbientTest


class Step(NamedTuple):
    """What to record under one name of a channel table.

    Attributes:
        patterns: names of the files; `*` stands for any letters.
        state: posture [rad], load and state of the drives.
        what: `hits` and where, or `taps`.
        sensors: places of the responses.
        wanted: hits or taps to record; infinite if the table does not say it.
    """

    patterns: tuple[str, ...]
    state: State
    what: str
    sensors: str
    wanted: float

    def has(self, name: str) -> bool:
        """Whether a file belongs to the step."""
        return any(fnmatchcase(name, pattern) for pattern in self.patterns)

    def words(self, before: "Step | None" = None) -> str:
        """Say what to record, and where the sensors are unless they stay."""
        moved = f", sensors at {self.sensors}" * (before is None or before.sensors != self.sensors)
        return f"{degrees(self.state[0])}, {self.what}{moved} ({', '.join(self.patterns)})"


def steps_of(table: ChannelTable) -> Iterator[Step]:
    """Yield the steps of a channel table in its order: names of files, as narrow as they are, with numbers of hits.

    Names without a number are one step where all else is the same: a name for each hit.
    """
    names, steps = dict.fromkeys(row.file for row in table.rows if row.counts), list[Step]()
    for name in [name for name in names if not any(_narrower(other, name) for other in names)]:
        rows = [row for row in table.rows if row.counts and fnmatchcase(name, row.file)]
        forces, sensors = ([row for row in rows if (row.role == FORCE) == force] for force in (True, False))
        hit, at = (", ".join(place_in_words(place_of(row)) for row in own) for own in (forces, sensors))
        wanted = next((row.taps for row in (*forces, *sensors) if row.taps), math.inf)
        steps.append(Step((name,), state_of(rows[0]), f"hits at {hit}" if hit else "taps", at, wanted))
    for own in by_key((each[1:] if each.wanted == math.inf else each, each) for each in steps).values():
        yield own[0]._replace(patterns=tuple(name for each in own for name in each.patterns))


def _narrower(name: str, than: str) -> bool:
    return fnmatchcase(name, than) and not fnmatchcase(than, name)


class Watch:
    """The folder of a modal test during the measurement.

    Args:
        tests: folder of the recordings.
        channels: channel table; by default channels.csv in that folder.
        arm: the arm; by default arm.toml in that folder.
        options: as for `ident.modal_test`.

    Raises:
        InputError: no such folder; or table or arm is wrong.
    """

    def __init__(self, tests: Path, channels: Path | None, arm: Path | None, options: ModalOptions):
        self.given, self.folder, self.options = (channels, arm), tests, options
        self._begin()
        self.limit = SHARE * (options.known_reproducibility.share["frequency"] or REPRODUCIBILITY["frequency"])

    def _begin(self) -> None:
        """Read the table and the arm, and forget what was read by the table before."""
        table, _, self.table = described(self.folder, *self.given, self.options)
        self.steps, self.path, self.stamp = tuple(steps_of(table)), table.path, os.stat(table.path).st_mtime_ns
        # of each file its stamp and since when it stands still, and what it holds: None if damaged
        self.seen, self.read = dict[str, tuple[object, float]](), dict[str, Recording | None]()
        # accepted hits; those that the repeatability needs; states whose modes are still to be computed
        self.count, self.needed, self.stale = dict[Step, float](), dict[State, float](), dict[State, None]()
        self.job: tuple[State, Future[tuple[list[str], float]]] | None = None

    def lines(self) -> Iterator[str]:
        """Yield what there is to say, as files come and go, until nothing is left to record."""
        yield f"watching {self.folder} until all is recorded, or Ctrl-C; first {self.steps[0].words()}"
        with ThreadPoolExecutor(1) as pool:  # a new file need not wait for the modes of those before
            while self.job or self.stale or self.seen.keys() - self.read.keys() or any(map(self._left, self.steps)):
                with suppress(OSError):  # a share may be gone for a while
                    yield from self._look()
                if self.job and self.job[1].done():
                    (state, done), self.job = self.job, None
                    words, self.needed[state] = done.result()
                    yield from (*words, self._advice(state))
                if self.stale and not self.job:
                    state = self.stale.popitem()[0]
                    self.job = state, pool.submit(self._modes, self._steps(state))
                sleep(PACE)

    def _look(self) -> Iterator[str]:
        """Forget files that are gone or differ, and read those that stand still."""
        if not self.job and os.stat(self.path).st_mtime_ns != self.stamp:
            try:
                self._begin()
                yield f"{self.path} has changed: all recordings are read again"
            except InputError as error:
                self.stamp = os.stat(self.path).st_mtime_ns
                yield str(error)
        stamps = dict[str, tuple[float, ...]]()
        for name in sorted(os.listdir(self.folder)):
            if is_recording(Path(name)) and any(step.has(name) for step in self.steps):
                with suppress(OSError):  # gone meanwhile, or a link to nothing
                    own = os.stat(self.folder / name)
                    stamps[name] = own.st_size, own.st_mtime_ns, own.st_ino
        now, changed = monotonic(), set[str]()
        for name in [name for name, (stamp, _) in self.seen.items() if stamps.get(name) != stamp]:
            del self.seen[name]
            if self.read.pop(name, None):
                changed.add(name)
                yield f"{name} {'has changed' if name in stamps else 'is gone'} and no longer counts"
        for name, stamp in stamps.items():
            if now - self.seen.setdefault(name, (stamp, now))[1] >= STILL and name not in self.read:
                self.read[name] = None
                try:
                    if not is_table(self.folder / name):
                        self.read[name] = read_recording(self.folder / name, self.options.columns)
                        changed.add(name)
                except InputError as error:
                    yield f"{name} is not whole yet, or damaged: {error.problems[0].got}"
        for step in [step for step in self.steps if any(map(step.has, changed))]:
            yield from self._counted(step, changed)

    def _tests(self, *steps: Step) -> tuple[AnyTest, ...]:
        """Return the tests of the files of some steps of one state, if there are any."""
        read = {name: own for name, own in list(self.read.items()) if own and any(step.has(name) for step in steps)}
        rows = tuple(row for row in self.table.rows if any(fnmatchcase(name, row.file) for name in read))
        return measured_tests(replace(self.table, rows=rows), read, self.options.processing) if read else ()

    def _counted(self, step: Step, changed: Collection[str]) -> Iterator[str]:
        """Yield what files that came or went change at a step, and have the modes of its state computed."""
        files, tests = sorted(filter(step.has, changed)), tuple[AnyTest, ...]()
        whole = [name for name in self.read if step.has(name) and self.read[name]]
        try:
            tests = self._tests(step)
            self.count[step] = sum(map(_hits, tests)) if tests or not whole else math.inf
        except InputError as error:
            self.count[step] = 0
            yield from map(str, error.problems)
        hammer = [test for test in tests if isinstance(test, ModalTest)]
        rejected = [f"{hit.file}, hit {hit.number} rejected: {hit.reason}" for test in hammer for hit in test.rejected]
        remarks = [remark for test in tests for remark in test.remarks if MOVING in remark or "overload" in remark]
        yield from (line for line in (*rejected, *remarks) if line.startswith(tuple(files)))
        wanted = f" of {step.wanted}" * (step.wanted < math.inf)
        words = [f"{step.what} accepted: {self.count[step]}{wanted}" if self.count[step] < math.inf else "read"]
        words += [f"coherence {coherence_at_modes(test):.3f}" for test in hammer if _hits(test) > 1]
        yield f"{', '.join(files)}: {', '.join(words)}"
        self.needed.pop(step.state, None)
        if self.job and self.job[0] == step.state and not set(files) <= set(whole):
            self.job = None
        few = [other for other in self._steps(step.state) if 0 < self.count.get(other, 0) < FEW]
        if tests and not self.options.no_modes and not (hammer and few):
            self.stale[step.state] = None
        else:
            yield self._advice(step.state)

    def _steps(self, state: State) -> list[Step]:
        return [step for step in self.steps if step.state == state]

    def _left(self, step: Step) -> float:
        """Return the number of hits still to record; infinite where something is to be corrected first."""
        wanted = min(step.wanted, self.needed.get(step.state, math.inf if step.wanted < math.inf else FEW))
        return max(wanted - self.count.get(step, 0), 0) if wanted < math.inf else math.inf

    def _advice(self, state: State) -> str:
        """Say what is left to record at a state, or what comes next."""
        left, own = {step: more for step in self.steps if (more := self._left(step))}, self._steps(state)
        if here := [step for step in own if step in left and self.count.get(step)]:
            words = "; ".join(f"{step.what}: {left[step]:g} more" for step in here)
            return words if left[here[0]] < math.inf else "not done: see above"
        ahead = sorted(left, key=lambda step: step.state != state)
        done = "done; " * any(self.count.get(step) and step not in left for step in own)
        return f"{done}next {ahead[0].words(own[0])}" if ahead else "done: nothing is left to record"

    def _modes(self, steps: list[Step]) -> tuple[list[str], float]:
        """Return the modes of a state in words, and the number of hits that their repeatability needs."""
        lines, needed = list[str](), float(FEW)
        early = any(not self.count.get(step) and step.wanted == math.inf for step in steps)
        try:
            for test in self._tests(*steps):
                modes = modes_of(test.frf) if isinstance(test, ModalTest) else operational_modes(test)
                pairs = zip(modes.frequency, modes.sigma[0], strict=True)
                shown = ", ".join(f"{frequency:.4f} ± {sigma:.4f}" for frequency, sigma in pairs)
                lines.append(f"modes at {degrees(test.posture)} [Hz]: {shown}")
                share = np.where(modes.damping < LIGHT, modes.sigma[0] / modes.frequency, 0.0)
                if not early and (hits := _hits(test)) < (enough := hits * (share.max() / self.limit) ** 2) < math.inf:
                    places = sum(self.count.get(step, 0) > 0 for step in steps) if isinstance(test, AmbientTest) else 1
                    hertz, needed = modes.frequency[share.argmax()], max(needed, math.ceil(enough / places))
                    lines.append(f"{hertz:.2f} Hz repeats to {percent(share.max())}, wanted {percent(self.limit)}")
                if isinstance(test, ModalTest):
                    wrong = [f"{check_in_words(check)}: {check.remedy}" for check in test.checks if not check.good]
                    low = coherence_at_modes(test) < COHERENT
                    wrong += [f"coherence below {COHERENT:g}: look for noise and loose sensors"] * low
                    lines, needed = [*lines, *wrong], math.inf if wrong else needed
        except InputError as error:
            return [*lines, *map(str, error.problems)], math.inf
        return lines, needed


def _hits(test: AnyTest) -> float:
    """Return the number of accepted hits or taps; infinite for a record that needs none."""
    return len(test.frf.hits) if isinstance(test, ModalTest) else len(test.decays) or math.inf


def coherence_at_modes(test: ModalTest) -> float:
    """Return the share of the responses' power that is linear in the force, [-]; the least of all forces."""
    power = np.abs(test.frf.mean) ** 2
    return float(((test.coherence * power).sum((0, 2)) / power.sum((0, 2))).min())
