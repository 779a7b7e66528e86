"""Recordings of each format: what other programs have written is read as they meant it; what is damaged is refused."""

import warnings

import lvm_read
import numpy as np
import pytest
import pyuff
from hammer_files import FOLDER, generator
from recording_files import ANSWER, FORCE, LVM, RATE, TIME, dataset, dataset_58, files, hdf5, tdms, uff
from scipy.io import savemat, wavfile

from ident.errors import InputError
from ident.measure.recordings import NoChannelError, matlab, read_recording


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
    np.testing.assert_allclose(channel.values, [ANSWER, 2 * ANSWER], rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("binary", [0, 1])
def test_a_universal_file_of_frequency_responses(tmp_path, binary):
    response = ANSWER + 1j * FORCE
    uff(tmp_path / "a.unv", binary, response, 4, orddenom_axis_units_lab="N")
    recording = read_recording(tmp_path / "a.unv")
    (channel,) = recording.channels
    assert (channel.name, channel.reference, channel.reference_unit) == ("7:-Z acceleration", "2:+X force", "N")
    np.testing.assert_allclose(channel.values, [response], rtol=1e-11, atol=1e-11)
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
    assert shape.frequency == pytest.approx(abs(-0.5 + 30j) / (2 * np.pi), rel=1e-5)
    assert shape.damping_ratio == pytest.approx(0.5 / abs(-0.5 + 30j), rel=1e-5)
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
    assert (
        "got ordinates of type 3 for 7:+Z acceleration in dataset 2, expected 2 or 4 (real), 5 or 6 (complex)" in line
    )
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
        ("time [s],a [N]\n0,1\n0.1,2\n0.3,3\n", "an interval of 0.1 s before sample 2, expected 0.15 s within 1 %"),
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
    np.testing.assert_array_equal(values(recording, "y:2").values[0], ANSWER)
    np.testing.assert_array_equal(values(recording, "hit.force").values[0], FORCE)


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


def test_hdf5(tmp_path):
    hdf5(tmp_path / "a.h5")
    recording = read_recording(tmp_path / "a.h5")
    assert recording.names == ("hit/force", "y:1", "y:2")
    assert values(recording, "hit/force").unit == "N"
    np.testing.assert_array_equal(values(recording, "y:2").values[0], ANSWER)


def test_matlab_7_3_is_hdf5_behind_a_header(tmp_path):
    hdf5(tmp_path / "a.mat", 512)
    head = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    data = (tmp_path / "a.mat").read_bytes()
    (tmp_path / "a.mat").write_bytes(head + data[len(head) :])
    np.testing.assert_array_equal(values(read_recording(tmp_path / "a.mat"), "y:2").values[0], ANSWER)


def test_lvm(tmp_path):
    (tmp_path / "a.lvm").write_text(LVM)
    hammer, tip = read_recording(tmp_path / "a.lvm").channels
    assert (hammer.name, hammer.unit, tip.unit, tip.step) == ("hammer", "N", "m/s^2", 0.005)
    np.testing.assert_array_equal(tip.values, [[-0.5, -0.25, 0.125]])
    np.testing.assert_array_equal(lvm_read.read_str(LVM)[0]["data"][:, 2], tip.values[0])


def test_an_lvm_file_loads_no_pickle_that_lies_beside_it(tmp_path):
    (tmp_path / "a.lvm").write_text(LVM)
    (tmp_path / "a.lvm.pkl").write_bytes(b"cos\nabort\n(tR.")
    assert len(read_recording(tmp_path / "a.lvm").channels) == 2


def test_tdms(tmp_path):
    tdms(tmp_path / "a.tdms")
    hammer, tip = read_recording(tmp_path / "a.tdms").channels
    assert (hammer.name, hammer.unit, hammer.step) == ("hits/hammer", "N", 0.005)
    assert (tip.unit, tip.step) == ("", None)
    np.testing.assert_array_equal(tip.values[0], ANSWER)


@pytest.mark.parametrize("kind", ["int16", "int32", "uint8", "float32"])
def test_wav_is_a_share_of_full_scale(tmp_path, kind):
    share = np.array([[0.5, -0.5], [0.25, 0.0], [-1.0, 0.125]])
    whole = np.issubdtype(kind, np.integer)
    top = {"int16": 2**15, "int32": 2**31, "uint8": 2**7, "float32": 1}[kind]
    wavfile.write(tmp_path / "a.wav", 8000, (share * top + (128 if kind == "uint8" else 0)).astype(kind))
    first, second = read_recording(tmp_path / "a.wav").channels
    assert (first.name, first.unit, first.step) == ("1", "", 1 / 8000)
    np.testing.assert_allclose([first.values[0], second.values[0]], share.T, atol=1 / top if whole else 1e-7)


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


@pytest.mark.parametrize(
    ("end", "module", "package"),
    [("lvm", "lvm_read", "lvm-read"), ("tdms", "nptdms", "npTDMS")],
)
def test_a_missing_extra_is_said_in_one_line(tmp_path, monkeypatch, end, module, package):
    files(tmp_path)
    monkeypatch.setitem(__import__("sys").modules, module, None)
    line = refused(tmp_path / f"a.{end}")
    assert line.endswith(f"got a file that needs the package {package}, expected {package} to read it; "
                         "pip install 'ident[modal]'")  # fmt: skip
