"""Recordings of each format: what other programs have written is read as they meant it; what is damaged is refused."""

import logging
import os
import struct
import warnings

import h5py
import lvm_read
import numpy as np
import pytest
import pyuff
from conformance import agrees
from hammer_files import FOLDER, generator
from recording_files import ANSWER, FORCE, LVM, RATE, TIME, dataset, dataset_58, files, hdf5, lvm, tdms, uff
from scipy.io import savemat, wavfile

from ident.errors import InputError
from ident.measure.recordings import ENDINGS, Channel, NoChannelError, matlab, read_recording
from ident.report.document import read_group


def refused(path):
    with pytest.raises(InputError) as caught:
        read_recording(path)
    assert len(caught.value.problems) == 1
    return str(caught.value)


def values(recording, name):
    return next(channel for channel in recording.channels if channel.name == name)


@pytest.mark.parametrize("binary", [0, 1])
def test_a_universal_file_of_samples(tmp_path, binary):
    uff(tmp_path / "a.uff", binary)
    uff(tmp_path / "a.uff", binary, 2 * ANSWER)
    (channel,) = read_recording(tmp_path / "a.uff").channels
    assert (channel.name, channel.unit, channel.reference) == ("7:-Z acceleration", "m/s^2", "")
    assert channel.step == pytest.approx(0.005, rel=1e-5)
    source = f"pyuff, {'58b, binary' if binary else '58, ASCII'}"
    what, expected = "samples of a universal file", [ANSWER, 2 * ANSWER]
    agrees(channel.values, expected, "formats", what, source, rtol=1e-11, atol=1e-11, unit="m/s^2")


@pytest.mark.parametrize("binary", [0, 1])
def test_a_universal_file_of_frequency_responses(tmp_path, binary):
    response = ANSWER + 1j * FORCE
    uff(tmp_path / "a.unv", binary, response, 4, orddenom_axis_units_lab="N")
    recording = read_recording(tmp_path / "a.unv")
    (channel,) = recording.channels
    assert (channel.name, channel.reference, channel.reference_unit) == ("7:-Z acceleration", "2:+X force", "N")
    source = f"pyuff, {'58b, binary' if binary else '58, ASCII'}"
    what = "frequency responses of a universal file"
    agrees(channel.values, [response], "formats", what, source, rtol=1e-11, atol=1e-11)
    assert recording.names == ("7:-Z acceleration", "2:+X force")


def test_a_universal_file_of_modes_and_nodes(tmp_path):
    path = str(tmp_path / "a.unv")
    nodes = pyuff.prepare_15(node_nums=[7, 9], def_cs=[0, 0], disp_cs=[0, 0], color=[0, 0], x=[0.1, 0.2],
                             y=[0.0, 0.5], z=[1.0, 2.0])  # fmt: skip
    mode = pyuff.prepare_55(
        id1="a", id2="b", id3="c", id4="d", id5="e", model_type=1, analysis_type=3, data_ch=2, spec_data_type=8,
        data_type=5, load_case=0, mode_n=1, eig=-0.5 + 30j, modal_a=1 + 0j, modal_b=1 + 0j, node_nums=[7, 9],
        r1=np.array([1 + 1j, 2.0]), r2=np.array([0, 3.0 + 0j]), r3=np.array([0.5 + 0j, 0]),
    )  # fmt: skip
    pyuff.UFF(path).write_sets([nodes, mode], mode="overwrite")
    recording = read_recording(path)
    assert recording.places == {"7": (0.1, 0.0, 1.0), "9": (0.2, 0.5, 2.0)}
    (shape,) = recording.shapes
    expected, what = abs(-0.5 + 30j) / (2 * np.pi), "frequency of a mode in a universal file"
    agrees(shape.frequency, expected, "formats", what, "pyuff, 55", rtol=1e-5, unit="Hz")
    expected, what = 0.5 / abs(-0.5 + 30j), "damping ratio of a mode in a universal file"
    agrees(shape.damping_ratio, expected, "formats", what, "pyuff, 55", rtol=1e-5)
    assert shape.motion["7:+X"] == pytest.approx(1 + 1j)
    assert shape.motion["9:+Y"] == pytest.approx(3)


def test_ascii_and_binary_of_the_same_hits_agree_to_the_digits_of_the_ascii(tmp_path):
    made, noise = generator(), np.random.default_rng(5)
    pushed, answers = noise.normal(size=(2, 50)), noise.normal(size=(6, 2, 50))
    for name, binary in (("a.unv", False), ("b.unv", True)):
        made.write_file(tmp_path / name, "z", pushed, answers, binary)
    ascii_, binary = (read_recording(tmp_path / name) for name in ("a.unv", "b.unv"))
    assert [each.name for each in ascii_.channels] == [each.name for each in binary.channels]
    for a, b in zip(ascii_.channels, binary.channels, strict=True):
        assert (a.unit, a.step) == (b.unit, b.step)
        np.testing.assert_allclose(a.values, b.values, rtol=5e-6 * 1.01)
    np.testing.assert_allclose(values(binary, "1:-Z force").values, pushed, rtol=1e-7)


def test_a_truncated_universal_file_is_refused_though_its_reader_would_leave_a_part_out(tmp_path):
    whole = (FOLDER / "alpha00_z.unv").read_bytes()
    for share in (0.3, 0.999):
        (tmp_path / "a.unv").write_bytes(whole[: int(share * len(whole))])
        assert "truncated file (its last dataset has no end)" in refused(tmp_path / "a.unv")


def test_a_binary_dataset_of_another_precision_than_its_header_says_is_refused(tmp_path):
    common = {"id1": "a", "id2": "b", "id3": "c", "id4": "d", "id5": "e", "func_type": 1, "abscissa_spacing": 1}
    common |= {"rsp_node": 1, "rsp_dir": 3, "ref_node": 0, "ref_dir": 0, "orddenom_spec_data_type": 0}
    single = pyuff.prepare_58(binary=1, data=ANSWER, x=TIME, ord_data_type=2, **common)
    pyuff.UFF(str(tmp_path / "a.uff")).write_sets(single, force_double=False)
    assert "128 values of 1:+Z, its header says 64" in refused(tmp_path / "a.uff")


def written(folder, *datasets):
    (folder / "a.uff").write_text("".join(datasets))
    return folder / "a.uff"


@pytest.mark.parametrize("form", [2, 4])
def test_a_frequency_response_without_its_phase_is_refused(tmp_path, form):
    size = np.abs(ANSWER)
    line = refused(written(tmp_path, dataset_58(size, function=4, form=form)))
    assert f"got real ordinates (type {form}) for the frequency response 7:+Z acceleration" in line
    assert "expected complex ordinates; export real and imaginary parts" in line
    assert "imaginary parts that are all zero" in refused(written(tmp_path, dataset_58(size + 0j, function=4)))
    assert "complex ordinates (type 6)" in refused(written(tmp_path, dataset_58(size + 1j)))
    (kept,) = read_recording(written(tmp_path, dataset_58(size + 1j, function=4))).channels
    np.testing.assert_allclose(kept.values, [size + 1j], rtol=1e-12)


def test_ordinates_of_an_unknown_type_are_refused(tmp_path):
    line = refused(written(tmp_path, dataset_58(ANSWER), dataset_58(ANSWER, form=3)))
    assert "dataset 2: got ordinates of type 3 for 7:+Z acceleration, expected 2 or 4 (real), 5 or 6 (complex)" in line
    uff(tmp_path / "b.uff", 1)
    data = (tmp_path / "b.uff").read_bytes()
    assert data.count(b"         4        64") == 1
    (tmp_path / "b.uff").write_bytes(data.replace(b"         4        64", b"         9        64"))
    assert "ordinates of type 9" in refused(tmp_path / "b.uff")


@pytest.mark.parametrize(
    "number",
    [
        str.lower,
        lambda text: text.replace("E", "D"),
        lambda text: text.replace("E", "d"),
        lambda text: text.replace("E-", "E-0").replace("E+", "E+0"),
        lambda text: text.replace("E-", "-0").replace("E+", "+0"),
    ],
)
def test_exponents_as_programs_write_them(tmp_path, number):
    node = dataset(15, f"{7:10d}{0:10d}{0:10d}{0:10d}" + "".join(number(f"{x:.5E}").rjust(13) for x in (0.1, -2, 3e-7)))
    small = 1e-7 * ANSWER
    recording = read_recording(written(tmp_path, node, dataset_58(small, start=-0.25, number=number)))
    (channel,) = recording.channels
    assert (channel.step, channel.start, recording.places["7"]) == (0.005, -0.25, (0.1, -2, 3e-7))
    np.testing.assert_array_equal(channel.values[0], [float(f"{value:.12E}") for value in small])


def test_datasets_that_nobody_needs_are_passed_over_without_a_word(tmp_path, capfd):
    groups = dataset(2467, *[f"{1:10d}" * 8, "group", "".join(f"{k:10d}" for k in (7, 1, 0, 0) * 2)])
    result = dataset(2414, "1", "no numbers", " 1.0D+00 nonsense", "        -1")
    static = dataset(55, *"abcde", f"{1:10d}{1:10d}{0:10d}{0:10d}{2:10d}{3:10d}", "x", "y", "z")
    coherence = dataset_58(ANSWER, function=6, number=lambda text: "*")
    recording = read_recording(written(tmp_path, groups, result, static, coherence, dataset_58(ANSWER)))
    assert recording.names == ("7:+Z acceleration",)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (dataset_58(ANSWER, number=lambda text: text.replace("E-0", "X-0")), "dataset 2, of type 58: '"),
        (dataset_58(ANSWER, count=65), "dataset 2, of type 58: 64 values of 7:+Z acceleration, its header says 65"),
        (dataset(58, "a", "b"), "dataset 2, of type 58: fewer than 11 lines"),
        (dataset(15, "1 2 3 4 x 6 7"), "dataset 2, of type 15: 'x' is no number"),
        (dataset(2411, "1 2 3 4", "0.0 1.0"), "dataset 2, of type 2411: 6 numbers, expected seven for each node"),
        (
            dataset(55, *"abcde", f"{1:10d}{3:10d}{2:10d}{8:10d}{5:10d}{3:10d}", "", "", "1"),
            "of type 55: a pole of zero",
        ),
        ("    -1\n    58\n", "its last dataset has no end"),
        ("    -1\nabcdef\n    -1\n", "dataset 2 has no type"),
        (dataset_58(ANSWER).removesuffix("    -1\n") + dataset_58(ANSWER), "dataset 2 has no end"),
    ],
)
def test_what_is_wrong_with_a_dataset_that_is_needed_is_said(tmp_path, bad, words):
    assert words in refused(written(tmp_path, dataset_58(ANSWER), bad))


def test_binary_values_may_hold_the_bytes_of_a_tag(tmp_path):
    tag = np.frombuffer(b"\n    -1\n    -1\n ", "<f8")
    uff(tmp_path / "a.uff", 1, np.concatenate([ANSWER[:4], tag, ANSWER[:4]]))
    uff(tmp_path / "a.uff", 1, FORCE[:10])
    (channel,) = read_recording(tmp_path / "a.uff").channels
    np.testing.assert_array_equal(channel.values, [[*ANSWER[:4], *tag, *ANSWER[:4]], FORCE[:10]])


def test_sensors_without_a_node_are_told_apart_by_what_the_file_says_of_them(tmp_path):
    words = ("left", "right", "top")
    force = dataset_58(FORCE, end=("", 0, 0), code=13, unit="N", ids=("hammer",))
    for more in (
        [{"end": (word, 0, 0)} for word in words],
        [{"end": ("", 0, 0), "label": word} for word in words],
        [{"end": ("", 0, 0), "ids": (word,)} for word in words],
        [{"end": ("", 0, 0), "ids": ("arm", word)} for word in words],
    ):
        sensors = [dataset_58(k * ANSWER, **each) for k, each in enumerate(more, 1)]
        for first in ([], [force]):
            channels = read_recording(written(tmp_path, *first, *sensors)).channels
            expected = ["0:S force"] * len(first) + [f"0:S {word} acceleration" for word in words]
            assert [each.name for each in channels] == expected
            np.testing.assert_allclose([each.values[0] for each in channels[-3:]], np.outer([1, 2, 3], ANSWER))


def test_two_sensors_of_one_node_are_told_apart_and_so_are_references(tmp_path):
    both = [dataset_58(ANSWER, end=(word, 7, 3)) for word in ("base", "tip")]
    names = [each.name for each in read_recording(written(tmp_path, *both)).channels]
    assert names == ["7:+Z base acceleration", "7:+Z tip acceleration"]
    force = dataset_58(FORCE, end=("", 2, 3), code=13, unit="N")
    listed = [dataset_58(ANSWER, ids=(word,)) for word in ("base", "tip")]
    names = [each.name for each in read_recording(written(tmp_path, force, *listed)).channels]
    assert names == ["2:+Z force", "7:+Z base acceleration", "7:+Z tip acceleration"]
    pushed = [dataset_58(ANSWER + 1j, function=4, force=(word, 0, 0)) for word in ("hammer", "shaker")]
    references = [each.reference for each in read_recording(written(tmp_path, *pushed)).channels]
    assert references == ["0:S hammer force", "0:S shaker force"]


def test_sensors_that_nothing_tells_apart_are_refused_with_their_id_lines(tmp_path):
    sensors = [dataset_58(ANSWER, end=("", 0, 0), ids=("arm", "now")) for _ in range(3)]
    line = refused(written(tmp_path, *sensors))
    assert "got 3 functions of 0:S acceleration that nothing tells apart (ID lines: 'arm / now', 'arm / now', " in line
    assert "expected a node, an entity name or an ID line of its own for each channel" in line
    mixed = dataset_58(FORCE, end=("", 0, 0), code=0, unit="N"), dataset_58(ANSWER, end=("", 0, 0), code=0)
    assert "got 2 functions of 0:S that differ in length, sampling or unit" in refused(written(tmp_path, *mixed))


def test_hits_stay_blocks_of_one_channel_without_a_node_too(tmp_path):
    """By as many of the force, or by ID lines that count hits; with a node whatever the ID lines say."""
    for node, ids, with_force in ((0, "sensor", 1), (0, "Hit {}", 1), (0, "Hit {}", 0), (7, "note {}", 0)):
        hits = [
            dataset_58(k * values, end=("", node, 0), code=code, unit=unit, ids=(ids.format(k),))
            for k in (1, 2, 3)
            for values, code, unit in [(FORCE, 13, "N"), (ANSWER, 12, "m/s^2")][1 - with_force :]
        ]
        channels = read_recording(written(tmp_path, *hits)).channels
        assert [each.name.rpartition(" ")[2] for each in channels] == ["force", "acceleration"][1 - with_force :]
        assert channels[-1].name == f"{node}:S acceleration"
        np.testing.assert_allclose(channels[-1].values, np.outer([1, 2, 3], ANSWER))


@pytest.mark.parametrize("form", [2, 4, 5, 6])
def test_an_abscissa_that_is_even_is_so_whatever_the_flag_says(tmp_path, form):
    kind = 1 if form in (2, 4) else 4
    values = ANSWER if kind == 1 else ANSWER + 1j * FORCE
    x = 0.5 + TIME
    (channel,) = read_recording(written(tmp_path, dataset_58(values, x, function=kind, form=form, step=0.0))).channels
    assert (channel.step, channel.start) == (pytest.approx(1 / RATE, rel=1e-4), 0.5)
    np.testing.assert_allclose(channel.values[0], values, atol=1e-5)
    (channel,) = read_recording(written(tmp_path, dataset_58(values, x, function=kind, form=form))).channels
    assert channel.step == 1 / RATE, "as the header says, where both agree"
    x[40:] += 0.002
    assert "acceleration at uneven steps, about value" in refused(
        written(tmp_path, dataset_58(values, x, function=kind, form=form))
    )


def test_an_abscissa_is_even_to_its_last_printed_digit(tmp_path):
    fast = np.arange(60000) / 51200
    (channel,) = read_recording(written(tmp_path, dataset_58(fast, fast, step=0.0))).channels
    assert channel.step == pytest.approx(1 / 51200, rel=1e-5)


@pytest.mark.parametrize("form", [2, 4, 6])
def test_zeros_that_fill_the_last_line_are_no_values(tmp_path, form):
    data = ANSWER[:13] if form < 5 else ANSWER[:13] + 1j * FORCE[:13]
    padded = np.append(data, np.zeros(2 if form < 5 else 1))
    function = 1 if form < 5 else 4
    (channel,) = read_recording(written(tmp_path, dataset_58(padded, form=form, count=13, function=function))).channels
    np.testing.assert_allclose(channel.values, [data], rtol=1e-5)
    padded[-1] = 1.0
    assert "its header says 13" in refused(
        written(tmp_path, dataset_58(padded, form=form, count=13, function=function))
    )


def test_a_file_of_nodes_passes_and_one_of_other_functions_is_named(tmp_path):
    node = dataset(15, f"{7:10d}{0:10d}{0:10d}{0:10d}{0.5:13.5E}{0:13.5E}{1:13.5E}")
    recording = read_recording(written(tmp_path, node))
    assert (recording.names, recording.places) == ((), {"7": (0.5, 0.0, 1.0)})
    spectra = [dataset_58(np.abs(ANSWER), function=2) for _ in range(3)]
    with pytest.raises(NoChannelError, match="got 3 functions of kind auto-spectrum, 1 function of kind coherence, "):
        read_recording(written(tmp_path, node, *spectra, dataset_58(ANSWER, function=6)))
    with pytest.raises(NoChannelError, match="got datasets of type 2414, "):
        read_recording(written(tmp_path, dataset(2414, "1")))


def test_when_channels_of_a_universal_file_start(tmp_path):
    blocks = [dataset_58(ANSWER, start=start) for start in (0.02, 1.5)]
    force = [dataset_58(FORCE, end=("", 2, 3), code=13, unit="N", start=-0.25) for _ in range(2)]
    response, hammer = read_recording(written(tmp_path, *blocks, *force)).channels
    assert (response.start, hammer.start) == ((0.02, 1.5), -0.25)


@pytest.mark.parametrize(
    ("hammer", "tip", "starts"),
    [
        ({}, {}, (0.0, 0.0)),
        ({"wf_start_offset": 0.02}, {}, (0.02, 0.0)),
        ({"wf_start_time": 10_250_000}, {"wf_start_time": 10_000_000, "wf_start_offset": 0.5}, (0.25, 0.5)),
        ({"wf_start_time": 10_250_000}, {}, (0.0, 0.0)),
    ],
)
def test_when_channels_of_a_tdms_file_start(tmp_path, hammer, tip, starts):
    """A clock that only one channel names says nothing of the other."""
    clock = [
        {k: np.datetime64(v, "us") if k == "wf_start_time" else v for k, v in each.items()} for each in (hammer, tip)
    ]
    tdms(tmp_path / "a.tdms", *clock)
    assert tuple(each.start for each in read_recording(tmp_path / "a.tdms").channels) == pytest.approx(starts, abs=1e-9)


def test_csv(tmp_path):
    rows = "".join(f"{t:.4f};{f:.9f};{a:.9f}\n".replace(".", ",") for t, f, a in zip(TIME, FORCE, ANSWER, strict=True))
    (tmp_path / "a.csv").write_text("# hit\ntime [s];hammer [N];tip [g_0]\n" + rows)
    hammer, tip = read_recording(tmp_path / "a.csv").channels
    assert (hammer.name, hammer.unit, tip.unit) == ("hammer", "N", "g_0")
    assert tip.step == pytest.approx(0.005, rel=1e-9)
    np.testing.assert_allclose([hammer.values[0], tip.values[0]], [FORCE, ANSWER], atol=1e-9)


RESPONSE = (ANSWER + 1j * FORCE)[:40]
LINES = 0.5 + 0.25 * np.arange(40)


def assert_responses(channels, names, values=(RESPONSE,)):
    assert [each.name for each in channels] == names
    for each, expected in zip(channels, values, strict=True):
        assert (each.step, each.start, each.reference, each.flaw) == (0.25, 0.5, "force", "")
        np.testing.assert_allclose(each.values, [expected], rtol=1e-12)


@pytest.mark.parametrize(
    ("real", "imaginary", "name"),
    [("tip", "imag tip", "tip"), ("Re(tip)", "Im(tip)", "tip"), ("tip_real", "tip_imag", "tip"), ("real", "imag", "H")],
)
def test_csv_of_frequency_responses(tmp_path, real, imaginary, name):
    rows = "".join(f"{f!r},{h.real!r},{h.imag!r}\n" for f, h in zip(LINES.tolist(), RESPONSE.tolist(), strict=True))
    (tmp_path / "a.csv").write_text(f"frequency [Hz],{real} [g/N],{imaginary} [g/N]\n" + rows)
    recording = read_recording(tmp_path / "a.csv")
    assert_responses(recording.channels, [name])
    assert (recording.channels[0].unit, recording.channels[0].reference_unit) == ("g", "N")
    assert recording.names == (name, "force")


@pytest.mark.parametrize(
    "header",
    ["frequency [Hz],|H| [g/N],phase [deg]", "Freq (Hz),dB,real H", "f [Hz],a [g],b", "freq [Hz],H [g],imag H [deg]"],
)
def test_csv_of_half_a_frequency_response_asks_for_both_parts(tmp_path, header):
    rows = "".join(f"{f!r},{abs(h)!r},{h.real!r}\n" for f, h in zip(LINES.tolist(), RESPONSE.tolist(), strict=True))
    (tmp_path / "a.csv").write_text(f"{header}\n{rows}")
    channels = read_recording(tmp_path / "a.csv").channels
    assert len(channels) == 2
    for each in channels:
        assert each.flaw == "values over frequency without an imaginary part"
        assert each.remedy.startswith("export the real and the imaginary part")


@pytest.mark.parametrize(
    ("text", "above"),
    [
        ("DAQ export\n12 May\ntime [s],a [N]\n0,1\n1,2\n", "lines 1 to 2"),
        ("DAQ, export\n0 Hz\ntime [s],a [N]\n0,1\n1,2\n", "lines 1 to 2"),
        ("Rate;1\nGain;10\n\ntime;a\ns;N\n0;1\n1;2\n", "lines 1 to 2"),
    ],
)
def test_lines_above_a_header_are_left_out(tmp_path, text, above):
    (tmp_path / "a.csv").write_text(text)
    (channel,) = read_recording(tmp_path / "a.csv").channels
    assert (channel.name, channel.unit, channel.step) == ("a", "N", 1.0)
    np.testing.assert_array_equal(channel.values, [[1, 2]])
    assert channel.remarks == (f"{tmp_path}/a.csv: left out above the header: {above}",)


def test_a_broken_row_is_no_header(tmp_path):
    (tmp_path / "a.csv").write_text("time [s],a [N]\n0,1\nx,y\n1,2\n2,3\n")
    assert "a.csv:3: got 'x', expected a number" in refused(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("head", "last"),
    [
        ("# time [s],hammer [N],tip [g_0]", ","),
        ("#time [s];hammer [N];tip [g_0]", ";"),
        ("% run 5\n%time [ms]\thammer [N]\ttip [g_0]", "\t"),
    ],
)
def test_a_header_behind_a_mark_of_comments_is_one(tmp_path, head, last):
    """As NumPy's savetxt and MATLAB write it: no name is a number, and no sample is lost."""
    table = np.column_stack([TIME * (1e3 if "ms" in head else 1), FORCE, ANSWER])
    np.savetxt(tmp_path / "a.txt", table, header=head, comments="", delimiter=last)
    hammer, tip = read_recording(tmp_path / "a.txt").channels
    assert (hammer.name, hammer.unit, tip.name, tip.unit) == ("hammer", "N", "tip", "g_0")
    assert (hammer.step, hammer.start) == (pytest.approx(0.005, rel=1e-9), 0.0)
    np.testing.assert_allclose([hammer.values[0], tip.values[0]], [FORCE, ANSWER], rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("0,1\n1,2\n2,4\n", "a.csv:1: got numbers only: '0,1', expected a header; write a line above with a name"),
        (
            "# by X\n0;1,5\n1;2\n2;4\n",
            "a.csv:2: got numbers only: '0;1,5', expected a header; write a line",
        ),
        ("# a,b\n0,1,5\n1,2,2\n", "a.csv:2: got numbers only: '0,1,5', expected a header; write a line above"),
    ],
)
def test_numbers_without_a_header_are_refused(tmp_path, text, words):
    (tmp_path / "a.csv").write_text(text)
    assert words in refused(tmp_path / "a.csv")


def test_columns_that_are_counted_are_named_by_their_numbers(tmp_path):
    """As pandas writes a table without names."""
    (tmp_path / "a.csv").write_text("0,1,2\n0.5,1,2\n1.5,2,2\n2.5,4,4\n")
    assert [(each.name, each.values.size) for each in read_recording(tmp_path / "a.csv").channels] == [
        ("0", 3), ("1", 3), ("2", 3)
    ]  # fmt: skip


def test_columns_of_one_name_are_not_taken_for_each_other(tmp_path):
    rows = "".join(f"{t},{i % 7},{i % 5},{t}\n" for i, t in enumerate(TIME))
    (tmp_path / "a.csv").write_text("time [s],a [N],a [mm],time [s]\n" + rows)
    first, second = read_recording(tmp_path / "a.csv").channels
    assert first.flaw == second.flaw == "2 channels of one name, in 'N', 'mm'"
    (tmp_path / "a.csv").write_text("time [s],a [N],b [mm],b [mm]\n" + rows.replace(",0.", ",9."))
    assert [each.flaw for each in read_recording(tmp_path / "a.csv").channels][1:] == 2 * [
        "2 channels of one name, in 'mm', 'mm'"
    ]
    (tmp_path / "a.csv").write_text("Time,a [N],b [mm],Time\n" + rows)
    assert [(each.name, each.flaw) for each in read_recording(tmp_path / "a.csv").channels] == [
        ("Time", ""), ("a", ""), ("b", "")
    ], "the same column twice is one"  # fmt: skip


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (
            "time [s],a [N],time [ms],b",
            "a.csv:1, time: got 2 columns of different times, expected one; put the channels",
        ),
        ("time [mm],a,b,c", "a.csv:1, time: got 'mm', expected a time unit such as s or ms"),
        ("freq [Hz],real a,imag a,Re(a)", "a.csv:1, a: got 'real a' and 'Re(a)', expected one column for each part"),
        ("frequency [Hz],damping_ratio [%],a,a", "a.csv:1, a: got the column twice, expected it once"),
        ("frequency [order],damping_ratio [%],a,b", "a.csv:1, frequency: got 'order', expected a frequency unit"),
    ],
)
def test_headers_that_contradict_themselves(tmp_path, header, words):
    (tmp_path / "a.csv").write_text(header + "\n" + "".join(f"{i + 1},{i + 2},{i},{i**2}\n" for i in range(9)))
    assert words in refused(tmp_path / "a.csv")


AXES = [
    ("time", unit, factor)
    for factor, units in (
        (1.0, ("", "NONE", "s", "S", "sec", "Seconds", "[s]")),
        (1e-3, ("ms", "msec", "MSEC")),
        (0, ("mm",)),
    )
    for unit in units
]
AXES += [
    ("frequency", unit, factor)
    for factor, units in (
        (1.0, ("", "Hz", "HZ", "Hertz", "cps")),
        (1e3, ("kHz", "KHZ")),
        (1 / 60, ("rpm", "RPM", "CPM")),
        (0.5 / np.pi, ("rad/s",)),
        (0, ("orders", "MHZ")),
    )
    for unit in units
]


@pytest.mark.parametrize(("quantity", "unit", "factor"), AXES)
def test_the_axis_of_a_recording_is_in_its_unit(tmp_path, quantity, unit, factor):
    """With a factor of 0 the unit is none of the quantity: nothing is made of the numbers."""
    of_time = quantity == "time"
    data = ANSWER if of_time else ANSWER + 1j * FORCE
    (tmp_path / "a.uff").write_text(
        dataset_58(data, function=1 if of_time else 4, step=0.25, start=0.5, axis=unit)
        + dataset_58(
            data, 0.5 + 0.25 * np.arange(64), function=1 if of_time else 4, step=0.25, axis=unit, end=("", 8, 3)
        )
    )
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["freq"] = 0.5 + 0.25 * np.arange(64)
        file["freq"].attrs["unit"] = unit.replace("NONE", "")
        file["H"] = ANSWER + 1j * FORCE
    header = {"Delta_X": ("0.25",), "X0": ("0.5",), "X_Unit_Label": (unit.replace("NONE", ""),)}
    (tmp_path / "a.lvm").write_text(lvm(["X_Value", "a"], [("0.5", 1), ("0.75", 2)], **header))
    tdms(
        tmp_path / "a.tdms", {"wf_increment": 0.25, "wf_start_offset": 0.5, "wf_xunit_string": unit.replace("NONE", "")}
    )
    files = ("a.uff", "a.lvm", "a.tdms") if of_time else ("a.uff", "a.h5")
    for each in (channel for name in files for channel in read_recording(tmp_path / name).channels):
        if each.name == "hits/tip":
            continue
        words = "times" if of_time else "frequencies"
        assert each.flaw == ("" if factor else f"{words} in '{unit}'")
        if factor:
            assert (each.step, each.start) == (pytest.approx(0.25 * factor), pytest.approx(0.5 * factor))


def test_csv_without_units_keeps_its_times_as_a_channel(tmp_path):
    np.savetxt(tmp_path / "a.txt", np.column_stack([TIME, FORCE]), header="t,hammer", comments="", delimiter=",")
    first, second = read_recording(tmp_path / "a.txt").channels
    assert (first.name, first.step, second.unit) == ("t", None, "")
    np.testing.assert_allclose(first.values[0], TIME, rtol=1e-15)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time [s],a [N]\n0,1\n0.1,x\n0.2,3\n", "a.csv:3: got 'x', expected a number"),
        ("time [s],a [N]\n0,1\n0.1\n0.2,3\n", "a.csv:3: got 1 fields"),
        (
            "time [s],a [N]\n0,1\n0.1,2\n0.3,3\n",
            "an interval of 0.1 s before sample 2, from 0 s, expected 0.15 s within 1 %",
        ),
        ("time [s],a [N]\n", "no header with two rows"),
    ],
)
def test_csv_that_is_wrong(tmp_path, text, words):
    (tmp_path / "a.csv").write_text(text)
    assert words in refused(tmp_path / "a.csv")


@pytest.mark.parametrize("compressed", [True, False])
def test_matlab_5_vectors_matrices_and_structures(tmp_path, compressed):
    both = np.column_stack([FORCE, ANSWER])
    variables = {"t": TIME, "y": both, "hit": {"force": FORCE}, "fs": RATE, "who": "me"}
    savemat(tmp_path / "a.mat", variables, do_compression=compressed)
    recording = read_recording(tmp_path / "a.mat")
    assert recording.names == ("t", "y:1", "y:2", "hit.force")
    found, source = values(recording, "y:2").values[0], "SciPy's savemat, version 5"
    agrees(found, ANSWER, "formats", "a column of a MATLAB matrix", source)
    agrees(values(recording, "hit.force").values[0], FORCE, "formats", "a field of a MATLAB structure", source)


@pytest.mark.parametrize("place", [248, 249])
def test_matlab_5_with_a_flipped_bit_at_which_scipy_crashes(tmp_path, place):
    """Without compression there is no checksum; here lies the size of a structure's field."""
    savemat(tmp_path / "a.mat", {"hit": {"force": FORCE}})
    data = bytearray((tmp_path / "a.mat").read_bytes())
    data[place] ^= 1 << 4
    (tmp_path / "a.mat").write_bytes(data)
    assert "damaged or truncated" in refused(tmp_path / "a.mat")


def test_matlab_5_whose_reader_dies_is_refused(tmp_path, monkeypatch):
    savemat(tmp_path / "a.mat", {"force": FORCE})
    monkeypatch.setattr(matlab, "ASIDE", "import os; os.abort()")
    assert "scipy's reader crashes" in refused(tmp_path / "a.mat")


def mat_5(path, arrays):
    savemat(path.with_suffix(".mat"), arrays)
    return path.with_suffix(".mat")


def mat_7_3(path, arrays):
    """As MATLAB writes it: axes reversed, complex numbers as pairs named real and imag."""
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            values = np.atleast_2d(values).T
            if values.dtype.kind == "c":
                pairs = np.empty(values.shape, [("real", float), ("imag", float)])
                pairs["real"], pairs["imag"] = values.real, values.imag
                values = pairs
            file[name] = values
            file[name].attrs["MATLAB_class"] = b"double"
    return path


def plain_hdf5(path, arrays):
    with h5py.File(path, "w") as file:
        for name, values in arrays.items():
            file[name] = values
    return path


each_array_file = pytest.mark.parametrize("write", [mat_5, mat_7_3, plain_hdf5])


@each_array_file
def test_complex_arrays_with_their_frequencies_are_frequency_responses(tmp_path, write):
    path = write(tmp_path / "a.h5", {"freq": LINES, "H": RESPONSE, "coherence": np.abs(RESPONSE)})
    *responses, coherence = read_recording(path).channels
    assert_responses(responses, ["H"])
    assert "imaginary part" in coherence.flaw
    path = write(tmp_path / "b.h5", {"freq": LINES, "H": np.stack([RESPONSE, 2 * RESPONSE], 1)})
    assert_responses(read_recording(path).channels, ["H:1", "H:2"], (RESPONSE, 2 * RESPONSE))
    both = np.stack([np.stack([RESPONSE, 2 * RESPONSE], 1), np.stack([3 * RESPONSE, 4 * RESPONSE], 1)], 2)
    found = read_recording(write(tmp_path / "c.h5", {"freq": LINES, "H": both})).channels
    assert [(each.name, each.reference) for each in found] == [
        ("H:1", "force:1"), ("H:1", "force:2"), ("H:2", "force:1"), ("H:2", "force:2"),
    ]  # fmt: skip
    values, what = [each.values[0] for each in found], "complex arrays with their frequencies"
    source = {mat_5: "SciPy's savemat, version 5", mat_7_3: "h5py, MATLAB 7.3", plain_hdf5: "h5py"}[write]
    agrees(values, np.outer([1, 3, 2, 4], RESPONSE), "formats", what, source, rtol=1e-12)


@each_array_file
def test_complex_arrays_without_frequencies_say_what_to_save(tmp_path, write):
    recording = read_recording(write(tmp_path / "a.h5", {"t": TIME, "force": FORCE, "H": RESPONSE}))
    assert set(recording.names) == {"t", "force", "H"}
    assert [each.name for each in recording.channels if each.flaw] == ["H"]
    assert "as a vector freq of the same length" in values(recording, "H").remedy


@each_array_file
def test_magnitudes_over_frequencies_are_no_samples_but_samples_over_times_are(tmp_path, write):
    path = write(tmp_path / "a.h5", {"freq": LINES, "mag": np.abs(RESPONSE)})
    assert [bool(each.flaw) for each in read_recording(path).channels if each.name == "mag"] == [True]
    path = write(tmp_path / "b.h5", {"t": TIME, "f": FORCE, "a": ANSWER})
    assert not any(each.flaw for each in read_recording(path).channels)


@each_array_file
@pytest.mark.parametrize(
    ("real", "imaginary", "name"), [("H_real", "H_imag", "H"), ("real", "imag", "H"), ("t_re", "t_im", "t")]
)
def test_real_and_imaginary_part_in_two_arrays_are_a_frequency_response(tmp_path, write, real, imaginary, name):
    both = np.stack([RESPONSE, 2 * RESPONSE], 1)
    path = write(tmp_path / "a.h5", {"freq": LINES, real: both.real, imaginary: both.imag})
    assert_responses(read_recording(path).channels, [f"{name}:1", f"{name}:2"], (RESPONSE, 2 * RESPONSE))
    (half,) = read_recording(write(tmp_path / "b.h5", {"freq": LINES, real: RESPONSE.real})).channels
    assert half.remedy == "export the real and the imaginary part of the frequency response"


@each_array_file
@pytest.mark.parametrize("sizes", [(2, 64, 3), (5, 400), (100, 30), (800, 65)])
def test_arrays_whose_rows_may_be_hits_are_named_as_unused(tmp_path, write, sizes):
    hits = np.arange(1.0 * np.prod(sizes)).reshape(sizes)
    force, several = read_recording(write(tmp_path / "a.h5", {"force": FORCE, "hits": hits})).channels
    assert (force.flaw, several.flaw) == ("", f"an array of {' x '.join(map(str, sizes))}")
    assert several.remedy.startswith("save each channel as a column or a vector of its own, and each hit")


@each_array_file
@pytest.mark.parametrize("sizes", [(120, 30), (800, 64)])
def test_a_matrix_of_samples_and_few_columns_is_channels(tmp_path, write, sizes):
    table = np.arange(1.0 * np.prod(sizes)).reshape(sizes)
    found = read_recording(write(tmp_path / "a.h5", {"a": table})).channels
    assert [(each.name, each.flaw) for each in found] == [(f"a:{i + 1}", "") for i in range(sizes[1])]
    np.testing.assert_array_equal(np.vstack([each.values for each in found]), table.T)


def test_what_matlab_holds_vectors_in_is_named_as_unused(tmp_path):
    cells, names, hits = (np.empty(2, object) for _ in range(3))
    cells[:], names[:], hits[:] = [FORCE, ANSWER], ["force", "tip"], [{"force": FORCE}, {"force": ANSWER}]
    savemat(tmp_path / "a.mat", {"names": names, "cells": cells, "hits": hits, "set": {"f": FORCE, "c": cells}})
    with h5py.File(tmp_path / "b.mat", "w") as file:
        file["#refs#/a"] = FORCE
        for name in ("cells", "hits/force", "set/c"):
            file[name] = np.array(2 * [file["#refs#/a"].ref], h5py.ref_dtype)
        file["set/f"], file["none"], file["table"] = FORCE, np.zeros(2, "u8"), np.zeros(6, "u4")
        file["none"].attrs["MATLAB_empty"], file["table"].attrs["MATLAB_object_decode"] = 1, 3
        file["records"] = np.zeros(4, [("t", float), ("f", float)])
    flaws = [{c.name: c.flaw for c in read_recording(tmp_path / f"{name}.mat").channels} for name in "ab"]
    held = "a cell array, a structure array or an object such as a table"
    assert flaws[0] == {"cells": held, "hits": held, "set.f": "", "set.c": held}
    assert flaws[1] == dict.fromkeys(("cells", "hits/force", "set/c", "table"), held) | {
        "set/f": "",
        "records": "a table of records",
    }


def other_file(file, path):
    with h5py.File(path.with_name("other.h5"), "w") as other:
        other["secret"] = ANSWER
    return "other.h5"


def external_storage(file, path):
    file.create_dataset("b", (8,), "f8", external=[(str(path.with_name("secret.bin")), 0, 64)])


def external_link(file, path):
    file["group/b"] = h5py.ExternalLink(other_file(file, path), "secret")


def virtual_dataset(file, path):
    layout = h5py.VirtualLayout((len(ANSWER),), "f8")
    layout[:] = h5py.VirtualSource(other_file(file, path), "secret", (len(ANSWER),))
    file.create_virtual_dataset("b", layout)


@pytest.mark.parametrize("end", ["h5", "mat"])
@pytest.mark.parametrize("lead", [external_storage, external_link, virtual_dataset])
@pytest.mark.parametrize("there", [True, False])
def test_hdf5_that_leads_to_other_files_is_refused_whether_they_are_there_or_not(
    tmp_path, monkeypatch, end, lead, there
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "secret.bin").write_bytes(b"x" * 64)
    with h5py.File(tmp_path / f"a.{end}", "w") as file:
        file["a"] = FORCE
        lead(file, tmp_path / f"a.{end}")
    if not there:
        (tmp_path / "secret.bin").unlink()
        (tmp_path / "other.h5").unlink(missing_ok=True)
    assert "expected a file that holds its own numbers" in refused(tmp_path / f"a.{end}")
    with pytest.raises(ValueError, match="another file"):
        read_group(tmp_path / f"a.{end}")


def test_a_soft_link_within_hdf5_is_not_followed(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["a"] = FORCE
        file["b"] = h5py.SoftLink("/a")
    assert read_recording(tmp_path / "a.h5").names == ("a",)


def test_hdf5(tmp_path):
    hdf5(tmp_path / "a.h5")
    recording = read_recording(tmp_path / "a.h5")
    assert recording.names == ("hit/force", "y:1", "y:2")
    assert values(recording, "hit/force").unit == "N"
    agrees(values(recording, "y:2").values[0], ANSWER, "formats", "a column of an HDF5 data set", "h5py")


def test_matlab_7_3_is_hdf5_behind_a_header(tmp_path):
    hdf5(tmp_path / "a.mat", 512)
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    data = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(head + data[len(head) :])
    found = values(read_recording(tmp_path / "a.mat"), "y:2").values[0]
    agrees(found, ANSWER, "formats", "a column of a MATLAB 7.3 matrix", "h5py behind MATLAB's header")


def test_lvm(tmp_path):
    (tmp_path / "a.lvm").write_text(LVM)
    hammer, tip = read_recording(tmp_path / "a.lvm").channels
    assert (hammer.name, hammer.unit, tip.unit, tip.step) == ("hammer", "N", "m/s^2", 0.005)
    np.testing.assert_array_equal(tip.values, [[-0.5, -0.25, 0.125]])
    expected = lvm_read.read_str(LVM)[0]["data"][:, 2]
    agrees(tip.values[0], expected, "formats", "samples of LabVIEW's LVM", "lvm_read", unit="m/s^2")


@pytest.mark.parametrize("end", ["lvm", "csv", "uff"])
def test_what_equipment_writes_may_be_in_latin_1(tmp_path, end):
    text = {
        "lvm": LVM.replace("m/s^2", "°").replace("tip", "Trägheit"),
        "csv": "time [s],Trägheit [°]\n0,-0.5\n0.005,-0.25\n0.010,0.125\n",
        "uff": dataset_58(np.array([-0.5, -0.25, 0.125]), end=("Trägheit", 7, 3), code=0, unit="°"),
    }[end]
    (tmp_path / f"a.{end}").write_bytes(text.encode("latin-1"))
    *_, channel = read_recording(tmp_path / f"a.{end}").channels
    assert (channel.name, channel.unit) == ("7:+Z" if end == "uff" else "Trägheit", "°")
    np.testing.assert_array_equal(channel.values, [[-0.5, -0.25, 0.125]])


def lvm_channels(tmp_path, text):
    (tmp_path / "a.lvm").write_text(text)
    return read_recording(tmp_path / "a.lvm").channels


MULTI = {
    "names": ["X_Value", "a", "X_Value", "b", "Comment"],
    "Samples": (3, "", 2),
    "Y_Unit_Label": ("", "", "mm/s^2"),
    "X0": ("0.0", "", "0.02"),
    "Delta_X": ("0.25", "", "0.5"),
}


def test_units_steps_and_starts_of_an_lvm_file_with_a_column_of_times_for_each_channel(tmp_path):
    rows = [("0.00", 1, "0.02", 10, "well"), ("0.25", 2, "0.52", 20), ("0.50", 3, "", "")]
    a, b = lvm_channels(tmp_path, lvm(rows=rows, columns="Multi", **MULTI))
    assert (a.name, a.unit, a.step, a.start) == ("a", "", 0.25, 0.0)
    assert (b.name, b.unit, b.step, b.start) == ("b", "mm/s^2", 0.5, 0.02)
    np.testing.assert_array_equal(a.values, [[1, 2, 3]])
    np.testing.assert_array_equal(b.values, [[10, 20]])


def test_labels_of_an_lvm_file_above_the_columns_of_times_are_those_of_its_channels_all_the_same(tmp_path):
    moved = {key: ("", *cells) for key, cells in MULTI.items() if key != "names"}
    rows = [("0.00", 1, "0.02", 10), ("0.25", 2, "0.52", 20), ("0.50", 3, "0.77", 30)]
    rows[2] = ("0.50", 3, "1.02", 30)
    text = lvm(MULTI["names"], rows, columns="Multi", **(moved | {"Samples": ("", 3, "", 3)}))
    a, b = lvm_channels(tmp_path, text)
    assert (a.unit, a.step, b.unit, b.step) == ("", 0.25, "mm/s^2", 0.5)


def test_an_lvm_file_with_decimal_commas_and_a_special_section(tmp_path):
    special = "***Start_Special***\nWfm_Sclr_Meas\n1\t2\n\n***End_Special***\n"
    rows = [("0.000", 1.5, -2), ("0.005", -0.25, 4)]
    text = lvm(["X_Value", "a", "b"], rows, mark=",", special=special, Delta_X=("0.005", "0.005"), X0=("0.0", "-0.001"))
    a, b = lvm_channels(tmp_path, text)
    assert (a.step, a.start, b.step, b.start) == (0.005, 0.0, 0.005, -0.001)
    np.testing.assert_array_equal([a.values[0], b.values[0]], [[1.5, -0.25], [-2, 4]])


def test_an_lvm_file_without_times(tmp_path):
    (a,) = lvm_channels(tmp_path, lvm(["X_Value", "a"], [("", 1), ("", 2)], columns="No", Delta_X=("0.1",)))
    assert (a.step, a.start) == (0.1, 0.0)
    np.testing.assert_array_equal(a.values, [[1, 2]])


@pytest.mark.parametrize("printed", ["1.9531250000000000E-5", "0.000020"])
def test_times_of_six_decimals_at_51_2_khz_are_even(tmp_path, printed):
    rows = [(f"{i / 51200:.6f}", i % 7) for i in range(5000)]
    (a,) = lvm_channels(tmp_path, lvm(["X_Value", "a"], rows, Delta_X=(printed,)))
    assert a.step == pytest.approx(1 / 51200, rel=1e-12 if "E" in printed else 2e-5)
    (tmp_path / "a.csv").write_text("time [s],a\n" + "".join(f"{t},{a}\n" for t, a in rows))
    (b,) = read_recording(tmp_path / "a.csv").channels
    assert b.step == pytest.approx(1 / 51200, rel=2e-5)


@pytest.mark.parametrize(
    ("times", "delta", "words"),
    [
        ([0, 0.002, 0.004], "1", "a.lvm:12, X_Value: got a step of 0.002 s, expected 1 s, by Delta_X"),
        ([0, 0.1, 0.2, 0.35], "0.1", "a.lvm:14, X_Value: got a step of 0.15 s, expected 0.1 s, by Delta_X"),
        ([0, 0.1, 0.2, 0.4], "", "expected 0.133333 s, the mean step"),
        ([0, "x", 0.2], "0.1", "a.lvm:12, X_Value: got a time that is no number"),
        ([0, 0.1, 0.2, 0, 0.1], "0.1", "got records of 2 and 3 samples, each from where X_Value starts again"),
    ],
)
def test_times_of_an_lvm_file_that_contradict_its_step(tmp_path, times, delta, words):
    (tmp_path / "a.lvm").write_text(lvm(["X_Value", "a"], [(t, 1) for t in times], Delta_X=(delta,)))
    assert words in refused(tmp_path / "a.lvm")


def test_times_that_start_again_and_segments_are_blocks(tmp_path):
    rows = [(f"{t:.6f}", i) for i, t in enumerate([0, 0.1, 0.2] * 2)]
    text = lvm(["X_Value", "a"], rows, Samples=(3,), Delta_X=("0.1",), X0=("0.0",))
    (a,) = lvm_channels(tmp_path, text)
    np.testing.assert_array_equal(a.values, [[0, 1, 2], [3, 4, 5]])
    assert a.step == 0.1
    once = text.replace("***\n\n", "***\n").partition("***End_of_Header***\n")
    (b,) = lvm_channels(tmp_path, text + "\n" + once[2])
    assert b.values.shape == (4, 3)
    (c,) = lvm_channels(tmp_path, text + "\n" + text.partition("X_Value\ta\n")[2])
    np.testing.assert_array_equal(c.values, b.values)
    (tmp_path / "a.lvm").write_text(text + "\n" + "0.0\t1\n0.1\t2\n")
    assert "2 of 3 samples" in refused(tmp_path / "a.lvm")


def test_times_of_day_of_an_lvm_file_move_the_start_of_a_channel(tmp_path):
    header = {"Date": ("2024/02/29", "2024/03/01", "1903/12/31"), "Delta_X": ("0.1",) * 3}
    header["Time"] = ("23:59:59.99", "00:00:00,01", "19:00:00")
    rows = [("0.0", 1, 2, 3), ("0.1", 1, 2, 3)]
    a, b, c = lvm_channels(tmp_path, lvm(["X_Value", "a", "b", "c"], rows, **header))
    assert (a.start, c.start) == (0.0, 0.0)
    assert b.start == pytest.approx(0.02, abs=1e-6)


def test_spectra_in_an_lvm_file_are_no_samples(tmp_path):
    (a,) = lvm_channels(
        tmp_path, lvm(["X_Value", "a"], [("0.0", 1), ("0.1", 2)], Delta_X=("0.1",), X_Dimension=("Frequency",))
    )
    assert a.flaw == "values over frequency"


def test_tdms(tmp_path):
    tdms(tmp_path / "a.tdms")
    hammer, tip = read_recording(tmp_path / "a.tdms").channels
    assert (hammer.name, hammer.unit, hammer.step) == ("hits/hammer", "N", 0.005)
    assert (tip.unit, tip.step) == ("", None)
    agrees(tip.values[0], ANSWER, "formats", "samples of LabVIEW's TDMS", "npTDMS")


@pytest.mark.parametrize("kind", ["int16", "int32", "uint8", "float32"])
def test_wav_is_a_share_of_full_scale(tmp_path, kind):
    share = np.array([[0.5, -0.5], [0.25, 0.0], [-1.0, 0.125]])
    whole = np.issubdtype(kind, np.integer)
    top = {"int16": 2**15, "int32": 2**31, "uint8": 2**7, "float32": 1}[kind]
    wavfile.write(tmp_path / "a.wav", 8000, (share * top + (128 if kind == "uint8" else 0)).astype(kind))
    first, second = read_recording(tmp_path / "a.wav").channels
    assert (first.name, first.unit, first.step) == ("1", "", 1 / 8000)
    found, what = [first.values[0], second.values[0]], f"samples of a WAV file, {kind}"
    least = 1 / top if whole else 1e-7
    agrees(found, share.T, "formats", what, "SciPy's wavfile", rtol=1e-7, atol=least)


def chunk(name, data):
    return name + struct.pack("<I", len(data)) + data + b"\0" * (len(data) % 2)


def wav(*chunks, samples=(0, 16384, -32768), rate=8000):
    head = chunk(b"fmt ", struct.pack("<HHIIHH", 1, 1, rate, 2 * rate, 2, 16))
    body = b"WAVE" + chunks[0] + head + chunks[1] + chunk(b"data", np.array(samples, "<i2").tobytes()) + chunks[2]
    return b"RIFF" + struct.pack("<I", len(body)) + body


def test_wav_with_chunks_of_recorders(tmp_path):
    path = tmp_path / "a.wav"
    path.write_bytes(wav(chunk(b"bext", b"x" * 603), chunk(b"iXML", b"<x/>"), chunk(b"cue ", bytes(28))))
    np.testing.assert_array_equal(read_recording(path).channels[0].values, [[0, 0.5, -1]])
    path.write_bytes(path.read_bytes()[:-10])
    assert "damaged or truncated file" in refused(path)


@pytest.mark.parametrize(
    ("more", "words"), [({"rate": 0}, "got a sampling rate of 0 Hz"), ({"samples": ()}, "got no sample, expected")]
)
def test_wav_without_rate_or_samples(tmp_path, more, words):
    (tmp_path / "a.wav").write_bytes(wav(b"", b"", b"", **more))
    assert words in refused(tmp_path / "a.wav")


def test_warnings_of_other_libraries_stay_within(tmp_path, monkeypatch):
    tdms(tmp_path / "a.tdms")
    read_recording(tmp_path / "a.tdms")
    assert {logging.getLogger(f"nptdms.{name}").getEffectiveLevel() for name in ("reader", "base_segment")} == {
        logging.ERROR
    }

    def warn(path, data):
        warnings.warn("of a library", RuntimeWarning, stacklevel=1)
        return (Channel("a", FORCE[None]),), (), {}

    hdf5(tmp_path / "a.h5")
    monkeypatch.setattr("ident.measure.recordings.hdf5.read", warn)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert read_recording(tmp_path / "a.h5").names == ("a",)


@pytest.mark.parametrize("end", ENDINGS)
def test_a_file_that_is_too_large_is_refused_unread(tmp_path, end):
    with (tmp_path / f"a{end}").open("wb") as file:
        file.truncate(8 * 10**9)
    assert f"a{end}: got a file of 8000 MB, expected a recording of at most" in refused(tmp_path / f"a{end}")


def test_a_pipe_is_no_recording(tmp_path):
    os.mkfifo(tmp_path / "a.csv")
    assert "got a pipe, a device or a socket, expected a recording in a regular file" in refused(tmp_path / "a.csv")


@pytest.mark.parametrize("share", [0.02, 0.6, 0.97])
def test_each_truncated_file_is_refused_in_one_line(tmp_path, share):
    for path in files(tmp_path):
        whole = path.read_bytes()
        path.write_bytes(whole[: int(share * len(whole))])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            assert "damaged or truncated file" in refused(path), path


def test_an_empty_file_and_another_ending(tmp_path):
    (tmp_path / "a.uff").write_bytes(b"")
    assert "got an empty file" in refused(tmp_path / "a.uff")
    assert "the ending '.xyz', expected a recording" in refused(tmp_path / "a.xyz")
    assert "no such file" in refused(tmp_path / "b.uff")


def test_a_missing_extra_is_said_in_one_line(tmp_path, monkeypatch):
    files(tmp_path)
    monkeypatch.setitem(__import__("sys").modules, "nptdms", None)
    expected = "got a file that needs the package npTDMS, expected npTDMS to read it; pip install npTDMS"
    assert refused(tmp_path / "a.tdms").endswith(expected)
