"""What each reader says of the ten mistakes made most, word for word: one line each, with its place and a remedy.

`python tests/measure/test_refusals.py` keeps the lines again after a change to what is said, for `git diff` to show.
"""

import os
import re
import tempfile
from functools import partial
from pathlib import Path

import pytest

from ident.errors import InputError
from ident.measure import read_campaign, read_log, read_trace
from ident.measure.channels import read_channels
from ident.measure.joint_log import read_joint_log
from ident.measure.recordings import read_recording
from ident.measure.runs import read_runs

KEPT = Path(__file__).parents[1] / "data" / "refusals"


def over_time(header, *scales, rows=16):
    """Return a table of ramps, a sample each 10 ms."""
    lines = [[k / 100, *(round(scale * (k + 1) / 10, 3) for scale in scales)] for k in range(rows)]
    return "\n".join([header, *(",".join(map(str, line)) for line in lines)]) + "\n"


CAMPAIGN = """kind,q1 [deg],q2 [deg],mode,point,direction,load,value,unit,sigma
frequency,0,45,vertical bending 1,,,,4.31,Hz,0.02
frequency,0,45,vertical bending 1,,,glass,3.87,Hz,0.02
deflection,0,45,,tip,-z,5 kg @ tip,2.31,mm,0.05
"""
CHANNELS = """file,channel,role,point,direction,unit,sensitivity,q1 [deg],q2 [deg]
hit*.csv,hammer,force,tip,-z,N,2.3 mV/N,0,45
hit*.csv,sensor 1,response,tip,x,m/s^2,,0,45
hit*.csv,sensor 2,response,tip,z,m/s^2,,0,45
"""
RUNS = """file,channel,direction,unit,speed [%],load
run7.csv,y,y,mm,7,glass
run7.csv,z,z,mm,7,glass
"""
GROUPS = """kind,q1 [deg],value,unit,sigma,group
frequency,0,4.1,Hz,0.02,hit 1
frequency,0,4.8,Hz,0.02,
frequency,0,5.9,Hz,0.02,hit 1
"""
COVARIANCE = "group,i,j,correlation\nhit 1,1,2,0.5\n"
SEEN = """kind,q1 [deg],point,direction,setup,value,unit,sigma
position,0,tip,x,tracker,4812.35,mm,0.05
position,30,tip,x,tracker,4790.12,mm,0.05
"""
FRAMES = """setup,x,y,z,unit,sigma,rx,ry,rz,turn_unit,turn_sigma
tracker,2310,-1720,640,mm,5,0,0,118,deg,0.5
"""
JOINT = "time [s],axis1.motor [deg],axis1.link [deg],axis1.torque [N*m]"
GOOD = {
    "campaign": (read_campaign, {"campaign.csv": CAMPAIGN}),
    "channels": (read_channels, {"channels.csv": CHANNELS}),
    "runs": (read_runs, {"runs.csv": RUNS, "run7.csv": over_time("time [s],y [mm],z [mm]", 1, 2)}),
    "joint_log": (read_joint_log, {"log.csv": over_time(JOINT, 1, 0.9, 30)}),
    "path": (
        partial(read_log, joints=("joint1", "joint2")),
        {"path.csv": over_time("time [s],joint1 [deg],joint2 [deg]", 200, 2, rows=6)},
    ),
    "trace": (read_trace, {"trace.csv": over_time("time [s],x [mm],z [mm]", 1, 2)}),
    "covariance": (read_campaign, {"campaign.csv": GROUPS, "campaign.covariance.csv": COVARIANCE}),
    "frames": (read_campaign, {"campaign.csv": SEEN, "campaign.setups.csv": FRAMES}),
    "recording": (read_recording, {"hit.csv": over_time("time [s],hammer [N],tip [m/s^2]", 100, 2, rows=8)}),
}
"""Each reader with its small good files, the first of which it is given."""

COMMAS = ".", ","
"""All numbers of a table of samples; any other change is of the first place alone."""
MISTAKES = {
    "campaign": {
        "missing column": ("unit", None),
        "misspelt column": (",value,", ",valeu,"),
        "missing unit of an angle": ("q1 [deg]", "q1"),
        "unit of another quantity": ("2.31,mm", "2.31,Hz"),
        "decimal comma": ("4.31", "4,31"),
        "empty cell": ("mm,0.05", "mm,"),
        "text in a number's place": ("3.87", "ca. 3.87"),
        "unknown word": ("deflection", "displacement"),
        "load without @": ("5 kg @ tip", "5 kg tip"),
        "the same row twice": (",glass,3.87", ",,4.31"),
    },
    "channels": {
        "missing column": ("direction", None),
        "misspelt column": ("channel", "chanel"),
        "missing unit of an angle": ("q1 [deg]", "q1"),
        "two units of a sensitivity": ("mV/N", "mV/lbf"),
        "decimal comma": ("2.3", "2,3"),
        "empty cell": ("response,tip,x", "response,,x"),
        "text in a number's place": ("mV/N,0", "mV/N,folded"),
        "unknown word": ("force", "hammer"),
        "direction in words": ("-z", "down"),
        "the same channel twice": ("sensor 2", "sensor 1"),
    },
    "runs": {
        "missing column": ("direction", None),
        "misspelt column": ("speed", "sped"),
        "wrong unit in the header": ("speed [%]", "speed [m/s]"),
        "unit of another quantity": ("z,z,mm", "z,z,N"),
        "decimal comma": ("mm,7", "mm,7,5"),
        "empty cell": ("z,z,mm,7", "z,z,mm,"),
        "number out of range": ("z,z,mm,7", "z,z,mm,700"),
        "unknown file": ("run7.csv,z,z,mm,7", "run8.csv,z,z,mm,8"),
        "unknown channel": ("z,z", "Z,z"),
        "two speeds of a file": ("z,z,mm,7", "z,z,mm,8"),
    },
    "joint_log": {
        "missing column": ("axis1.link", None),
        "misspelt column": ("torque", "torqe"),
        "missing unit": ("motor [deg]", "motor"),
        "wrong unit": ("N*m", "N"),
        "decimal comma": COMMAS,
        "empty cell": ("0.2,0.18,", "0.2,,"),
        "text in a number's place": ("0.27", "n/a"),
        "the same time twice": ("0.02,", "0.01,"),
        "too few rows": ("0.04,", ...),
        "names without a channel": (JOINT, "time [s],q1 [deg],q1_link [deg],tau1 [N*m]"),
    },
    "path": {
        "missing column": ("joint2", None),
        "misspelt column": ("joint2", "jont2"),
        "missing unit": ("joint1 [deg]", "joint1"),
        "wrong unit": ("joint1 [deg]", "joint1 [mm]"),
        "decimal comma": COMMAS,
        "empty cell": ("60.0,", ","),
        "text in a number's place": ("0.6", "error"),
        "the same time twice": ("0.02,", "0.01,"),
        "seconds marked ms": ("time [s]", "time [ms]"),
        "degrees marked rad": ("joint1 [deg]", "joint1 [rad]"),
    },
    "trace": {
        "missing column": ("time", None),
        "misspelt column": ("time", "tiem"),
        "missing unit": ("x [mm]", "x"),
        "wrong unit": ("x [mm]", "x [N]"),
        "decimal comma": COMMAS,
        "empty cell": ("0.3,", ","),
        "text in a number's place": ("0.6", "overload"),
        "the same time twice": ("0.02,", "0.01,"),
        "displacement and acceleration": ("x [mm]", "x [m/s^2]"),
        "too few rows": ("0.04,", ...),
    },
    "covariance": {
        "no such file": ("campaign.covariance.csv", None),
        "no group in the campaign": (",group\n", ",note\n"),
        "missing column": ("correlation", None),
        "misspelt column": ("correlation", "corelation"),
        "decimal comma": ("0.5", "0,5"),
        "empty cell": ("2,0.5", "2,"),
        "unknown group": ("hit 1,1", "hit1,1"),
        "row of the campaign, not of the group": ("1,2,0.5", "1,3,0.5"),
        "covariance in place of a correlation": ("0.5", "2.5"),
        "the same pair twice": ("0.5\n", "0.5\nhit 1,2,1,0.5\n"),
    },
    "frames": {
        "no setup in the campaign": (",setup,value", ",note,value"),
        "missing column": ("turn_sigma", None),
        "misspelt column": ("turn_unit", "turnunit"),
        "missing unit": ("mm,5", ",5"),
        "wrong unit": ("mm,5", "deg,5"),
        "decimal comma": ("640", "640,5"),
        "empty cell": ("-1720", ""),
        "text in a number's place": ("deg,0.5", "deg,unknown"),
        "unknown setup": ("tracker,2310", "traker,2310"),
        "the same setup twice": ("0.5\n", "0.5\ntracker,0,0,0,mm,free,0,0,0,deg,free\n"),
    },
    "recording": {
        "no such file": ("hit.csv", None),
        "no header": ("time [s],hammer [N],tip [m/s^2]\n", ""),
        "wrong unit of time": ("time [s]", "time [mm]"),
        "two columns of times": ("hammer [N]", "time [ms]"),
        "decimal comma": COMMAS,
        "missing cell": ("30.0,0.6", "30.0"),
        "empty cell": ("30.0", ""),
        "text in a number's place": ("30.0", "overload"),
        "the same time twice": ("0.02,", "0.01,"),
        "one row": ("0.01,", ...),
    },
}
"""Mistakes by name: a text and what stands there instead; None: no such column or file, ...: the file ends there."""


def changed(files, old, new):
    """Return the files with a mistake in the one that has the text."""
    if old in files:
        return {name: text for name, text in files.items() if name != old}
    (name,) = files if (old, new) == COMMAS else [name for name, text in files.items() if old in text]
    header, rows = files[name].split("\n", 1)
    if (old, new) == COMMAS:
        return {name: f"{header}\n{rows.replace(old, new)}"}
    if new is None:
        place = [cell.partition(" [")[0] for cell in header.split(",")].index(old)
        cells = [line.split(",") for line in files[name].splitlines()]
        return files | {name: "".join(",".join(row[:place] + row[place + 1 :]) + "\n" for row in cells)}
    before, _, after = files[name].partition(old)
    return files | {name: before if new is ... else before + new + after}


def error_of(reader, files):
    """Return what a reader says of files, read in their folder; None if nothing."""
    (read, good), here = GOOD[reader], Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        try:
            for name, text in files.items():
                Path(name).write_text(text, encoding="utf-8")
            read(next(iter(good)))
        except InputError as error:
            return error
        finally:
            os.chdir(here)
    return None


def errors_of(reader):
    """Return what a reader says of each mistake, by its name."""
    return {name: error_of(reader, changed(GOOD[reader][1], *change)) for name, change in MISTAKES[reader].items()}


def shown(errors):
    """Return the kept text: a block for each mistake."""
    return "\n".join(f"{name}\n{error}\n" for name, error in errors.items())


@pytest.mark.parametrize("reader", GOOD)
def test_refusals_name_place_and_remedy_as_kept(reader):
    errors, files = errors_of(reader), GOOD[reader][1]
    assert error_of(reader, files) is None, "the files without a mistake are read"
    assert len(errors) == 10
    place = rf"({'|'.join(map(re.escape, [*files, 'run8.csv']))})(:[1-9]\d*)?(, [^:]+)?"
    for name, error in errors.items():
        assert error is not None, name
        lines = str(error).splitlines()
        assert len(lines) <= len(error.problems), name
        for line in lines:
            assert re.fullmatch(rf"{place}: got .+, expected .+; \S.*[^.]", line), line
    assert shown(errors) == (KEPT / f"{reader}.txt").read_text(encoding="utf-8")


if __name__ == "__main__":
    KEPT.mkdir(exist_ok=True)
    for each in GOOD:
        (KEPT / f"{each}.txt").write_text(shown(errors_of(each)), encoding="utf-8")
