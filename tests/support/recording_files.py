"""Small good recordings of each format, written by other libraries than those that ident calls, where there are any."""

import h5py
import numpy as np
import pyuff
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat, wavfile

RATE = 200.0
TIME = np.arange(64) / RATE
FORCE = np.exp(-(((TIME - 0.05) / 0.01) ** 2))
ANSWER = np.sin(40 * TIME)


LVM = """LabVIEW Measurement
Writer_Version\t2
Reader_Version\t2
Separator\tTab
Decimal_Separator\t.
X_Columns\tOne
***End_of_Header***

Channels\t2
Samples\t3\t3
Y_Unit_Label\tN\tm/s^2
Delta_X\t0.005\t0.005
***End_of_Header***
X_Value\thammer\ttip\tComment
0.000\t1.0\t-0.5
0.005\t2.0\t-0.25
0.010\t0.5\t0.125
"""


def lvm(names, rows, *, columns="One", mark=".", special="", **header):
    """An LVM file of one segment; header lines have a cell for each column behind the first."""
    lines = ["LabVIEW Measurement", "Separator\tTab", f"Decimal_Separator\t{mark}", f"X_Columns\t{columns}"]
    lines += [
        "***End_of_Header***",
        "",
        special + f"Channels\t{sum(name not in ('X_Value', 'Comment') for name in names)}",
    ]
    lines += ["\t".join([key, *map(str, cells)]) for key, cells in header.items()]
    lines += ["***End_of_Header***", "\t".join(names), *("\t".join(map(str, row)) for row in rows)]
    return "\n".join(lines).replace(".", mark) + "\n"


def uff(path, binary, data=ANSWER, kind=1, **more):
    common = {"id1": "a", "id2": "b", "id3": "c", "id4": "d", "id5": "e", "func_type": kind, "abscissa_spacing": 1}
    ends = {"rsp_node": 7, "rsp_dir": -3, "ref_node": 2, "ref_dir": 1}
    axes = {"ordinate_spec_data_type": 12, "ordinate_axis_units_lab": "m/s^2", "orddenom_spec_data_type": 13}
    sets = pyuff.prepare_58(binary=binary, data=data, x=TIME[: len(data)], **common, **ends, **axes, **more)
    pyuff.UFF(str(path)).write_sets(sets, mode="add")


def hdf5(path, block=0):
    with h5py.File(path, "w", userblock_size=block) as file:
        file["hit/force"] = FORCE
        file["hit/force"].attrs["units"] = "N"
        file["y"] = np.vstack([FORCE, ANSWER])
        file["y"].attrs["MATLAB_class"] = b"double"
        file["who"] = np.frombuffer(b"m\0e\0", np.uint16)
        file["who"].attrs["MATLAB_class"] = b"char"


def tdms(path):
    properties = {"wf_increment": 0.005, "unit_string": "N"}
    channels = [ChannelObject("hits", "hammer", FORCE, properties), ChannelObject("hits", "tip", ANSWER)]
    with TdmsWriter(str(path)) as writer:
        writer.write_segment(channels)


def files(folder):
    """A good file of each format."""
    uff(folder / "a.uff", 1)
    savemat(folder / "a.mat", {"t": TIME, "f": FORCE}, do_compression=True)  # with a checksum, as MATLAB writes it
    hdf5(folder / "a.h5")
    (folder / "a.lvm").write_text(LVM)
    tdms(folder / "a.tdms")
    wavfile.write(folder / "a.wav", 8000, FORCE.astype(np.float32))
    return [folder / f"a.{end}" for end in ("uff", "mat", "h5", "lvm", "tdms", "wav")]
