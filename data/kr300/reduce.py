"""Makes the logs a.csv, b.csv and c.csv of Robot_Identification: axes 1 to 3, both encoders and the motor's torque.

python data/kr300/reduce.py FOLDER, with FOLDER a copy of github.com/JonasWeigand/Robot_Identification
"""

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

HERE = Path(__file__).parent
AXES = (1, 2, 3)
HEAD = """\
# MEASURED: axes 1 to 3 of a KUKA KR300, which moved together, with an encoder on each link as well as on each motor.
# Origin: github.com/JonasWeigand/Robot_Identification (commit 9e403c0), Copyright (c) 2021 Jonas Weigand, MIT: LICENSE.
# data/recorded_trajectories/2020-10-21 10s FF {name} 08ms/data.mat, of which reduce.py kept every sample (4 ms) of
# act_pos_mot_deg (counted at the joint), act_pos_se_deg and act_torque_abs_nm times the ratio `para.u`.
"""


def table(path: Path) -> tuple[list[str], np.ndarray]:
    """Return head and numbers of a log."""
    data = loadmat(path, struct_as_record=False, squeeze_me=True)
    record, ratio = data["rec"], data["para"].u
    head, columns = ["time [s]"], [record.time_cont]
    for i, axis in enumerate(AXES):
        head += [f"axis{axis}.motor [deg]", f"axis{axis}.link [deg]", f"axis{axis}.torque [N*m]"]
        columns += [record.act_pos_mot_deg[i], record.act_pos_se_deg[i], ratio[i] * record.act_torque_abs_nm[i]]
    return head, np.stack(columns, axis=1)


if __name__ == "__main__":
    for name in "ABC":
        place = Path(sys.argv[1]) / "data" / "recorded_trajectories" / f"2020-10-21 10s FF {name} 08ms" / "data.mat"
        head, numbers = table(place)
        forms = ["{:.3f}", *["{:.5f}", "{:.5f}", "{:.1f}"] * len(AXES)]
        lines = [",".join(form.format(x) for form, x in zip(forms, row, strict=True)) for row in numbers]
        text = HEAD.format(name=name) + "\n".join([",".join(head), *lines]) + "\n"
        (HERE / f"{name.lower()}.csv").write_text(text, encoding="utf-8")
