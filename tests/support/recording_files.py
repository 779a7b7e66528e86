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


def dataset_58(values, x=None, ids=(), end=("", 7, 3), code=12, label="", unit="m/s^2", start=0.0, **more):
    """A dataset 58 in ASCII, by the records of the format's description; an abscissa x stands before each value."""
    function, force, step = more.get("function", 1), more.get("force", ("", 2, 3)), more.get("step", 1 / RATE)
    form, number = more.get("form", 6 if np.iscomplexobj(values) else 4), more.get("number", str)
    parts = [values.real, values.imag] if form in (5, 6) else [values]
    widths = [13] * (x is not None) + [20 if form in (4, 6) else 13] * len(parts)
    points = zip(*([] if x is None else [x]), *parts, strict=True)
    per_line = 80 // sum(widths)
    fields = ["".join(number(f"{v:.{w - 8}E}").rjust(w) for v, w in zip(p, widths, strict=True)) for p in points]
    dof = "".join(f" {entity or 'NONE':<10}{node:10d}{direction:4d}" for entity, node, direction in (end, force))
    reals = "".join(number(f"{value:.5E}").rjust(13) for value in (start, step, 0.0))
    axes = [
        (17, "", more.get("axis", "s")),
        (code, label, unit),
        (13, "", "N") if function == 4 else (0, "", ""),
        (0, "", ""),
    ]
    lines = [*ids, *["NONE"] * (5 - len(ids)), f"{function:5d}{0:10d}{0:5d}{0:10d}{dof}"]
    lines += [f"{form:10d}{more.get('count', len(values)):10d}{int(x is None):10d}{reals}"]
    lines += [f"{c:10d}{0:5d}{0:5d}{0:5d} {word or 'NONE':<20} {u or 'NONE':<20}" for c, word, u in axes]
    lines += ["".join(fields[i : i + per_line]) for i in range(0, len(fields), per_line)]
    return dataset(58, *lines)


def dataset(kind, *lines):
    return "\n".join(["    -1", f"{kind:6d}", *lines, "    -1", ""])


def hdf5(path, block=0):
    with h5py.File(path, "w", userblock_size=block) as file:
        file["hit/force"] = FORCE
        file["hit/force"].attrs["units"] = "N"
        file["y"] = np.vstack([FORCE, ANSWER])
        file["y"].attrs["MATLAB_class"] = b"double"
        file["who"] = np.frombuffer(b"m\0e\0", np.uint16)
        file["who"].attrs["MATLAB_class"] = b"char"


def tdms(path, hammer=None, tip=None):
    properties = {"wf_increment": 0.005, "unit_string": "N"} | (hammer or {})
    channels = [ChannelObject("hits", "hammer", FORCE, properties), ChannelObject("hits", "tip", ANSWER, tip)]
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
