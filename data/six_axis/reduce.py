"""Makes arm.xml of the Kinova Jaco 2 of dm_control: its chain, masses and inertias, no meshes, the hand as one body.

python data/six_axis/reduce.py FOLDER, with FOLDER a copy of dm_control/third_party/kinova
"""

import sys
from pathlib import Path

import mujoco
import numpy as np

HERE = Path(__file__).parent
ORIGIN = """<!--
  Kinova Jaco 2, six axes with an oblique wrist (two bends of 60 degrees): frames, limits, masses and inertias of
  github.com/google-deepmind/dm_control, dm_control/third_party/kinova/jaco_arm.xml and jaco_hand.xml (commit 985d094),
  Copyright (c) 2017 Kinova Robotics inc., modified work Copyright (c) 2018 The dm_control Authors, BSD 3-Clause:
  LICENSE. Reduced by reduce.py: no meshes, contacts and actuators; inertias as MuJoCo computes them from the meshes and
  masses there; the hand with its fingers, at angle 0, as one body.
-->
"""


def composite(model: mujoco.MjModel) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass [kg], mass centre [m] and inertia [kg m^2] about it of a model, in the axes of its body 1."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    own = data.xmat[1].reshape(3, 3)
    mass, com = model.body_mass.sum(), model.body_mass @ data.xipos / model.body_mass.sum()
    inertia = np.zeros((3, 3))
    for m, at, turn, moments in zip(model.body_mass, data.xipos, data.ximat, model.body_inertia, strict=True):
        arm, axes = at - com, turn.reshape(3, 3)
        inertia += axes @ np.diag(moments) @ axes.T + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return float(mass), own.T @ (com - data.xpos[1]), own.T @ inertia @ own


def reduced(folder: Path) -> str:
    """Return the MJCF text."""
    arm = mujoco.MjModel.from_xml_path(str(folder / "jaco_arm.xml"))
    hand = composite(mujoco.MjModel.from_xml_path(str(folder / "jaco_hand.xml")))
    lines, indent = (
        [f'{ORIGIN}<mujoco model="jaco2">', '  <compiler angle="radian" autolimits="true"/>', "  <worldbody>"],
        "    ",
    )
    for body in range(1, arm.nbody):
        lines.append(f'{indent}<body name="{arm.body(body).name}" {_at(arm.body_pos[body], arm.body_quat[body])}>')
        indent += "  "
        if arm.body_jntnum[body]:
            joint = int(arm.body_jntadr[body])
            limits = f' range="{_text(arm.jnt_range[joint])}"' if arm.jnt_limited[joint] else ""
            lines.append(f'{indent}<joint name="{arm.joint(joint).name}" axis="{_text(arm.jnt_axis[joint])}"{limits}/>')
        if arm.body_mass[body] > 1e-6:
            place = _at(arm.body_ipos[body], arm.body_iquat[body])
            moments = _text(arm.body_inertia[body])
            lines.append(f'{indent}<inertial mass="{arm.body_mass[body]:.9g}" {place} diaginertia="{moments}"/>')
    mass, com, inertia = hand
    full = _text([*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]])
    lines += [f'{indent}<inertial mass="{mass:.9g}" pos="{_text(com)}" fullinertia="{full}"/>']
    lines += [f'{indent}<site name="palm" pos="0 -0.0001 -0.159"/>']
    while len(indent) > 4:
        indent = indent[2:]
        lines.append(f"{indent}</body>")
    return "\n".join([*lines, "  </worldbody>", "</mujoco>"]) + "\n"


def _at(place: np.ndarray, turn: np.ndarray) -> str:
    return f'pos="{_text(place)}" quat="{_text(turn)}"'


def _text(numbers: object) -> str:
    return " ".join(f"{x:.9g}" if abs(x) > 1e-12 else "0" for x in np.asarray(numbers))


if __name__ == "__main__":
    (HERE / "arm.xml").write_text(reduced(Path(sys.argv[1])), encoding="utf-8")
