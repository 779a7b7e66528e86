"""Makes poses.csv of ipa-robot-accuracy: every fifth measurement of its series B, every tenth of C, positions only.

python data/ur10/reduce.py FOLDER, with FOLDER a copy of github.com/christianlandgraf/ipa-robot-accuracy
"""

import csv
import sys
from pathlib import Path

HERE = Path(__file__).parent
SERIES = {
    "B": ("Series_B/measurements_joint_configurations.csv", 5),
    "C": ("Series_C/measurements_random_poses.csv", 10),
}
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
HEAD = """\
# MEASURED: a UR10 of Fraunhofer IPA, by a laser tracker with a 6-D probe (T-Mac) at its flange, no change of payload.
# Origin: github.com/christianlandgraf/ipa-robot-accuracy (commit 507fba6), Copyright (c) 2021 Christian Landgraf, MIT:
# LICENSE. C. Landgraf, K. Ernst, G. Schleth, M. Fabritius, M. F. Huber, "A Hybrid Neural Network Approach for
# Increasing the Absolute Accuracy of Industrial Robots", IEEE CASE 2021, 468-474.
# Reduced by reduce.py: of series B (the same poses by several joint configurations) every fifth row, of C (random
# poses) every tenth; joint angles, position of the probe in the tracker's frame, standard deviations of that reading.
"""


def rows(folder: Path) -> list[list[str]]:
    """Return the rows that are kept, as text with decimal points."""
    kept = []
    for series, (name, step) in SERIES.items():
        with (folder / name).open(encoding="utf-8") as file:
            every = [row for row in csv.DictReader(file, delimiter=";") if all(row.values())]
        for row in every[1::step]:  # the first row is the posture from which the arm starts
            numbers = [*(row[f"{joint}_joint"] for joint in JOINTS)]
            numbers += [row[f"measurement_{axis}"] for axis in "xyz"]
            numbers += [row[f"measurement_std_{axis}"] for axis in "xyz"]
            kept.append([series, *(number.replace(",", ".") for number in numbers)])
    return kept


if __name__ == "__main__":
    head = [
        "series",
        *(f"{joint} [rad]" for joint in JOINTS),
        *(f"{a} [mm]" for a in "xyz"),
        *(f"sd {a} [mm]" for a in "xyz"),
    ]
    lines = [",".join(head), *(",".join(row) for row in rows(Path(sys.argv[1])))]
    (HERE / "poses.csv").write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")
