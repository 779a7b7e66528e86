"""The faults of the benchmark can be seeded: each text stands once in its file, and its tests exist."""

from pathlib import Path

import pytest
from faults import FAULTS

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.capability)
def test_a_fault_can_be_seeded(fault):
    assert (ROOT / "ident" / fault.file).read_text(encoding="utf-8").count(fault.old) == 1
    assert all((ROOT / "tests" / name.split("::")[0]).exists() for name in fault.tests.split())
