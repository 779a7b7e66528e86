"""What holds for every report."""

import re

WIDTH = 100
"""Columns of a terminal; those of a path, which is never broken, do not count."""
LONGEST_NAME = 40
SCREEN = 25
"""Lines of a first screen."""


def too_wide(report, width=WIDTH):
    """Return the lines that leave a terminal, by default of 100 columns; the next command is one line, to be copied."""
    lines = [line for line in report.splitlines() if not line.startswith("Next: ")]
    return [line for line in lines if sum(map(_columns, line.split(" "))) + line.count(" ") > width]


def without_number(report):
    """Return the lines that say nan or inf where a number is meant."""
    return [
        line for line in report.splitlines() if re.search(r"(?<![\w.-])[-+]?(nan|inf)(?![\w.])", line, re.IGNORECASE)
    ]


def _columns(word):
    return 0 if "/" in word and len(word) > LONGEST_NAME else len(word)


def assert_one_screen(report, files=0, extra=0):
    """Assert that a first screen, with a line for each file written, has 25 lines of 100 columns, and `extra` more."""
    lines = report.splitlines()
    assert len(lines) + files <= SCREEN + extra, f"{len(lines)} lines and {files} files"
    assert not too_wide(report)
