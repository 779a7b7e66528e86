"""Processes that are started with this folder on `PYTHONPATH` compile their programs as the tests do theirs."""

import quickly  # noqa: F401
