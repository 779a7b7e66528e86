"""What holds for every report."""

WIDTH = 100
"""Columns of a terminal; those of a path, which is never broken, do not count."""
LONGEST_NAME = 40


def too_wide(report):
    """Return the lines that leave a terminal of 100 columns."""
    return [line for line in report.splitlines() if sum(map(_columns, line.split(" "))) + line.count(" ") > WIDTH]


def _columns(word):
    return 0 if "/" in word and len(word) > LONGEST_NAME else len(word)
