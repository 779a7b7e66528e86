"""What will be needed later is compiled, or loaded, by a thread, where there is a core for it."""

from threading import Event
from threading import enumerate as threads

import pytest

from ident import jit as ident_jit
from ident.jit import ahead, jit


def doubled(x):
    return 2 * x


@pytest.mark.parametrize(("cores", "store", "begins"), [(2, "on", True), (1, "on", False), (2, "off", False)])
def test_what_will_be_needed_is_made_ready_where_there_is_a_core_for_it(monkeypatch, cores, store, begins):
    monkeypatch.setenv("IDENT_PROGRAMS", store)
    monkeypatch.setattr(ident_jit, "cores", lambda: cores)
    called = Event()

    def first():
        called.set()
        raise ValueError("said again by whoever needs the answer")

    f = jit(doubled)
    ahead(f, first)
    for thread in threads():
        if thread.name == "ahead":
            thread.join(60)
    assert called.is_set() == begins
    f.known.loaded["its program"] = first
    called.clear()
    ahead(f, first)
    assert not called.is_set()
