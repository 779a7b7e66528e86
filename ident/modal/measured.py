"""The tests of a channel table, one for each posture and load: ambient ones where no force was measured."""

from collections.abc import Mapping
from dataclasses import replace
from fnmatch import fnmatchcase

from ident.errors import InputError, Problem
from ident.measure.channels import ChannelTable
from ident.measure.recordings import Recording
from ident.modal.ambient import ambient_tests
from ident.modal.ambient_test import AmbientTest
from ident.modal.hammer import modal_tests
from ident.modal.modal_test import ModalTest, Processing
from ident.modal.records import ambient_files, records


def measured_tests(
    table: ChannelTable, recordings: Mapping[str, Recording], processing: Processing | None = None
) -> tuple[ModalTest | AmbientTest, ...]:
    """Return the tests of a channel table, one for each posture, load and state of the drives.

    A posture of which no file has a force was shaken by what is about it: an ambient test.

    Args:
        table: with directions in the base frame.
        recordings: by file name.
        processing: windows, estimator and band.

    Raises:
        InputError: see `ident.modal.sources`, `ident.modal.records`; a record that is too short or without a hit.
    """
    processing = processing or Processing()
    ambient = ambient_files(table, recordings)
    quiet = {name: each for name, each in recordings.items() if name in ambient}
    pushed = {name: each for name, each in recordings.items() if name not in ambient}
    rows = [row for row in table.rows if not any(fnmatchcase(name, row.file) for name in quiet)]
    tests: tuple[ModalTest | AmbientTest, ...] = ()
    problems: list[Problem] = []
    try:
        if quiet:
            tests += ambient_tests(records(table, quiet), processing)
    except InputError as error:
        problems += error.problems
    try:
        if any(row.counts for row in rows) or not quiet:
            tests = modal_tests(replace(table, rows=tuple(rows)), pushed, processing) + tests
    except InputError as error:
        problems += error.problems
    if problems:
        raise InputError(problems)
    return tests
