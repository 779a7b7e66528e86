"""`ident modal --watch`: what it says while files come slowly, in halves, are renamed and go; on a clock of its own."""

import math
import os
import shutil
from concurrent.futures import wait
from types import SimpleNamespace

import numpy as np
import pytest
from hammer_files import FOLDER
from tapped import tapped, write_taps

from ident.errors import InputError
from ident.modal.ambient import AmbientTest
from ident.studies.measuring import modal_watch
from ident.studies.measuring.modal import ModalOptions
from ident.studies.measuring.modal_watch import Watch, steps_of

Z, Y = "alpha60_z.unv", "alpha60_y.unv"
OPTIONS = ModalOptions(band=(2.0, 20.0))
LATEST = 2.0
"""Seconds after which a line about a file is there."""


def table(folder, taps=None, change=lambda line: line):
    """Write the channel table of one posture of the shipped test, with a number of hits to record."""
    head, *rows = (line for line in (FOLDER / "channels.csv").read_text().splitlines() if not line.startswith("#"))
    rows = [change(row) for row in rows if row.startswith("alpha60")]
    extra = ["", ""] if taps is None else [",taps", f",{taps}"]
    (folder / "channels.csv").write_text("\n".join([head + extra[0], *(row + extra[1] for row in rows)]))
    shutil.copy(FOLDER / "arm.toml", folder)
    return folder


def watched(monkeypatch, folder, actions, options=OPTIONS, until=60.0):
    """Return (time, line) of all that is said while actions happen at their times; whether it ended by itself."""
    now, lines, ahead = 0.0, [], dict(actions)
    watch = Watch(folder, None, None, options)

    def pause(seconds):
        nonlocal now
        now += seconds
        if watch.job:
            wait([watch.job[1]])
        for at in [at for at in ahead if at <= now]:
            ahead.pop(at)()
        if now > until:
            raise KeyboardInterrupt

    monkeypatch.setattr(modal_watch, "sleep", pause)
    monkeypatch.setattr(modal_watch, "monotonic", lambda: now)
    try:
        lines += ((now, line) for line in watch.lines())
    except KeyboardInterrupt:
        return lines, False
    return lines, True


def writing(path, data, mode="ab"):
    def write():
        with path.open(mode) as file:
            file.write(data)

    return write


def copying(folder, *names):
    return lambda: [shutil.copy(FOLDER / name, folder) for name in names]


def datasets(data, channels=7):
    """Return the first dataset of a universal file, which has no channel, and those of each hit."""
    mark = b"    -1\n"
    sets = [mark + part + mark for part in data.split(mark)[1::2]]
    assert b"".join(sets) == data
    return sets[0], [b"".join(sets[i : i + channels]) for i in range(1, len(sets), channels)]


def said(lines, words):
    """Return the times of lines that contain words."""
    return [at for at, line in lines if words in line]


def test_halves_a_rename_and_a_removal(monkeypatch, tmp_path):
    folder, data = table(tmp_path), (FOLDER / Z).read_bytes()
    path, other = folder / Z, folder / "other.unv"
    actions = {
        1.0: writing(path, data[: len(data) // 2]),
        4.0: writing(path, data[len(data) // 2 :]),
        10.0: lambda: path.rename(other),
        13.0: lambda: other.rename(path),
        20.0: path.unlink,
    }
    lines, ended = watched(monkeypatch, folder, actions, until=24.0)
    assert not ended
    (half,) = said(lines, f"{Z} is not whole yet, or damaged: a damaged or truncated file")
    first, again = said(lines, f"{Z}: hits at tip -z accepted: 5, coherence ")
    gone = said(lines, f"{Z} is gone and no longer counts")
    assert said(lines, f"{Z}: hits at tip -z accepted: 0") == gone
    for at, since in ((half, 1.0), (first, 4.0), (again, 13.0)):
        assert 1.0 <= at - since <= LATEST
    assert [at - since for at, since in zip(gone, (10.0, 20.0), strict=True)] == [0.0, 0.0]
    assert len(said(lines, "modes at (60, -120, 60) deg [Hz]: ")) == 2
    assert lines[-1][1].startswith("next (60, -120, 60) deg, hits at tip -z (alpha60_z.unv)")


def test_a_file_that_grows_is_read_once_it_stands_still(monkeypatch, tmp_path):
    """Each part is a whole hit, so that it could be read."""
    folder, data = table(tmp_path), (FOLDER / Z).read_bytes()
    first, hits = datasets(data)
    actions = {1 + 0.5 * i: writing(folder / Z, part) for i, part in enumerate([first, *hits])}
    lines, _ = watched(monkeypatch, folder, actions, until=max(actions) + 4)
    (at,) = said(lines, f"{Z}: hits at tip -z accepted: 5")
    assert 1.0 <= at - max(actions) <= LATEST


def test_a_file_for_each_hit(monkeypatch, tmp_path):
    """The second is an overload; there are no modes before the third that counts."""
    folder = table(tmp_path, taps=3, change=lambda line: line.replace(Y, "alpha60_y_*.unv"))
    rows = [line for line in (folder / "channels.csv").read_text().splitlines() if Z not in line]
    (folder / "channels.csv").write_text("\n".join(rows))
    first, hits = datasets((FOLDER / Y).read_bytes())
    actions = {1.0 + 3 * i: writing(folder / f"alpha60_y_{i + 1}.unv", first + hit) for i, hit in enumerate(hits)}
    lines, ended = watched(monkeypatch, folder, actions)
    assert ended
    assert said(lines, "alpha60_y_1.unv: hits at tip y accepted: 1 of 3")
    assert said(lines, "hits at tip y: 2 more")
    (at,) = said(lines, "alpha60_y_2.unv, hit 1 rejected: overload of the force: 250 of a full scale of 250 N")
    assert at in said(lines, "alpha60_y_2.unv: hits at tip y accepted: 1 of 3")
    (third,) = said(lines, "alpha60_y_4.unv: hits at tip y accepted: 3 of 3, coherence ")
    assert min(said(lines, "modes at")) >= third
    assert not said(lines, "alpha60_y_5.unv")


def test_a_sheet_is_filled_and_a_rejected_hit_is_named(monkeypatch, tmp_path):
    folder = table(tmp_path, taps=5)
    lines, ended = watched(monkeypatch, folder, {1.0: copying(folder, Z), 8.0: copying(folder, Y)})
    assert ended
    assert said(lines, f"{Z}: hits at tip -z accepted: 5 of 5, coherence ")
    assert said(lines, "done; next (60, -120, 60) deg, hits at tip y (alpha60_y.unv)")
    assert said(lines, f"{Y}, hit 2 rejected: overload of the force: 250 of a full scale of 250 N")
    assert lines[-1][1] == "done: nothing is left to record"


@pytest.mark.parametrize(("share", "end"), [(0.02, "done: nothing is left to record"), (0.0002, "hits at tip -z: ")])
def test_repeatability_says_how_many_hits_are_left(monkeypatch, tmp_path, share, end):
    folder = table(tmp_path)
    options = ModalOptions(band=(2.0, 20.0), reproducibility={"frequency": share})
    lines, ended = watched(monkeypatch, folder, {1.0: copying(folder, Z, Y)}, options, until=8.0)
    assert ended == (share == 0.02)
    assert end in lines[-1][1]
    assert bool(said(lines, "Hz repeats to ")) == (not ended)


def test_a_wrong_direction_is_said_before_the_next_posture(monkeypatch, tmp_path):
    folder = table(tmp_path, change=lambda line: line.replace("force,tip,-z", "force,tip,z"))
    lines, ended = watched(monkeypatch, folder, {1.0: copying(folder, Z)}, until=8.0)
    assert said(lines, "driving point, tip z: ")
    assert said(lines, "turn the direction of the force or the response")
    assert (ended, lines[-1][1]) == (False, "not done: see above")


def test_steps_are_the_narrowest_names_of_a_table(tmp_path):
    watch = Watch(table(tmp_path, taps=4), None, None, OPTIONS)
    assert [(step.patterns, step.what, step.wanted) for step in watch.steps] == [
        ((Z,), "hits at tip -z", 4),
        ((Y,), "hits at tip y", 4),
    ]
    assert watch.steps[0].words().endswith("sensors at tip x, tip y, tip z, elbow x, elbow y, elbow z (alpha60_z.unv)")
    assert watch.steps[1].words(watch.steps[0]) == "(60, -120, 60) deg, hits at tip y (alpha60_y.unv)"
    assert [step.wanted for step in Watch(table(tmp_path), None, None, OPTIONS).steps] == [math.inf] * 2
    assert [step.patterns for step in steps_of(watch.table)] == [(Z,), (Y,)]


def test_a_folder_or_a_table_that_is_missing_is_refused_at_once(tmp_path):
    with pytest.raises(InputError, match="no such folder"):
        Watch(tmp_path / "none", None, None, OPTIONS)
    with pytest.raises(InputError, match=r"channels\.csv"):
        Watch(tmp_path, None, None, OPTIONS)


@pytest.mark.slow
def test_taps_are_counted_in_all_files_of_a_posture(monkeypatch, tmp_path):
    """Two taps to a file."""
    rng = np.random.default_rng(4)
    write_taps(tmp_path, tapped().record(rng, "yz"))
    lines = (tmp_path / "channels.csv").read_text().replace("taps.h5", "taps*.h5").splitlines()
    (tmp_path / "channels.csv").write_text("\n".join([lines[0] + ",taps", *(line + ",4" for line in lines[1:])]))
    more = tmp_path / "more"
    more.mkdir()
    write_taps(more, tapped().record(rng, "yz"))
    actions = {3.0: lambda: (more / "taps.h5").rename(tmp_path / "taps2.h5")}
    lines, ended = watched(monkeypatch, tmp_path, actions, ModalOptions())
    assert ended
    assert said(lines, "taps.h5: taps accepted: 2 of 4")
    assert said(lines, "taps2.h5: taps accepted: 4 of 4")
    assert len(said(lines, "modes at (60, -120, 60) deg [Hz]: ")) == 2


def test_a_name_for_each_hit_is_one_step_and_equal_patterns_are_kept(tmp_path):
    folder = table(tmp_path)
    text = (folder / "channels.csv").read_text().splitlines()
    forces = [line for line in text if line.startswith(Y)]
    each = [line.replace(Y, f"alpha60_{hit}.unv") for hit in "abc" for line in forces]
    (folder / "channels.csv").write_text(
        "\n".join([*(line for line in text if not {Z, Y} & {*line.split(",")}), *each])
    )
    (step,) = Watch(folder, None, None, OPTIONS).steps
    assert step.patterns == ("alpha60_a.unv", "alpha60_b.unv", "alpha60_c.unv")
    both = [line.replace(Y, "alpha60_**") for line in forces]
    (folder / "channels.csv").write_text("\n".join([*(line for line in text if Z not in line), *both]))
    assert Watch(folder, None, None, OPTIONS).steps


def test_a_corrected_table_is_read_again_and_a_link_to_nothing_stops_nothing(monkeypatch, tmp_path):
    folder = table(tmp_path)
    rows = (folder / "channels.csv").read_text()
    (folder / "alpha60_link.unv").symlink_to(tmp_path / "nowhere")
    (folder / "channels.csv").write_text(rows.replace("1:-Z force", "1:+Z force"))

    def correct():
        (folder / "channels.csv").write_text(rows)
        os.utime(folder / "channels.csv", ns=(1, 1))

    lines, _ = watched(monkeypatch, folder, {1.0: copying(folder, Z), 8.0: correct}, until=16.0)
    assert max(said(lines, "1:+Z force")) < 8.0
    (at,) = said(lines, "channels.csv has changed: all recordings are read again")
    assert 8.0 <= at <= 8.5
    assert said(lines, f"{Z}: hits at tip -z accepted: 5, coherence ")


def test_taps_of_two_places_share_what_a_repeatability_needs(monkeypatch, tmp_path):
    """The number that is needed is of all taps of a posture; each place is asked for its part."""
    folder = table(tmp_path)
    watch = Watch(folder, None, None, OPTIONS)
    modes = SimpleNamespace(frequency=np.array([5.0]), sigma=np.array([[0.1]]), damping=np.array([0.01]))
    test = AmbientTest.__new__(AmbientTest)
    object.__setattr__(test, "decays", (None,) * 10)
    object.__setattr__(test, "posture", (0.0, 0.0, 0.0))
    monkeypatch.setattr(watch, "_tests", lambda *steps: (test,))
    monkeypatch.setattr(modal_watch, "operational_modes", lambda test: modes)
    watch.count, watch.limit = dict.fromkeys(watch.steps, 5), 0.02 * (10 / 16) ** 0.5
    _, needed = watch._modes(list(watch.steps))
    assert needed == 8
