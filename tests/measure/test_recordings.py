"""Recordings of each format: what other programs have written is read as they meant it; what is damaged is refused."""

import warnings

import lvm_read
import numpy as np
import pytest
import pyuff
from hammer_files import FOLDER, generator
from recording_files import ANSWER, FORCE, LVM, RATE, TIME, files, hdf5, tdms, uff
from scipy.io import savemat, wavfile

from ident.errors import InputError
from ident.measure.recordings import matlab, read_recording


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
    [("uff", "pyuff", "pyuff"), ("tdms", "nptdms", "npTDMS")],
)
def test_a_missing_extra_is_said_in_one_line(tmp_path, monkeypatch, end, module, package):
    files(tmp_path)
    monkeypatch.setitem(__import__("sys").modules, module, None)
    line = refused(tmp_path / f"a.{end}")
    assert line.endswith(f"got a file that needs the package {package}, expected {package} to read it; "
                         "pip install 'ident[modal]'")  # fmt: skip
