"""Makes the runs of this folder: what sensors at the tip of the arm of ../arm.toml could have measured while it moves.

python data/lcd_arm/runs/generate.py
"""

from pathlib import Path

import jax
import numpy as np
from scipy.interpolate import make_interp_spline

from ident.arm.arm import Arm
from ident.description.file import read_arm
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import simulate

HERE = Path(__file__).parent
SPEEDS = (7, 8, 10, 13)
"""Percent of full speed."""
ERROR = 3.0
"""Transmission error of every drive at twice a turn [arc seconds, peak to peak]: assumed, see docs/paper.md."""
NOISE, OFFSET = 0.05, 0.02
"""White noise as a share of a trace's peak, and largest offset of the recorder's clock [s]: assumed."""
RATE = 100.0
"""Samples a second."""
SEED = 20261126
COMMENT = "SYNTHETIC: the exact equations of ident with arm.toml's numbers, see generate.py; not measured on any robot."


def true_arm(arm: Arm, rng: np.random.Generator) -> Arm:
    """Return the arm with transmission errors, and with phases that are drawn."""
    numbers = {f"{drive.name}.error": np.deg2rad(ERROR / 2 / 3600) for drive in arm.drives}
    phases = [f"{drive.name}.{name}" for drive in arm.drives for name in ("phase", "error_phase")]
    return arm.replace(numbers | dict(zip(phases, rng.uniform(-np.pi, np.pi, len(phases)), strict=True)))


def main() -> None:
    """Write the runs and their table."""
    jax.config.update("jax_enable_x64", True)
    rng = np.random.default_rng(SEED)
    arm = true_arm(read_arm(HERE.parent / "arm.toml").arm, rng)
    assert arm.stroke is not None
    rows = ["file,channel,direction,speed [%],group"]
    for speed in SPEEDS:
        motion = stroke(arm.stroke, percent=speed, dwell=2.0)
        response = simulate(arm, motion, method="exact", rate=200.0)
        curve = make_interp_spline(response.time, 1e3 * np.asarray(response.measured).T[:, 1:], k=5)
        time, offset = np.arange(0.1, float(response.time[-1]) - 0.1, 1 / RATE), rng.uniform(-OFFSET, OFFSET)
        values = curve(time + offset)
        values += NOISE * np.abs(values).max(0) * rng.standard_normal(values.shape)
        header = f"# {COMMENT}\ntime [s],y [mm],z [mm]"
        np.savetxt(HERE / f"run{speed}.csv", np.column_stack([time, values]), "%.5g", ",", header=header, comments="")
        rows += [f"run{speed}.csv,{way},{way},{speed},1" for way in "yz"]
    (HERE / "runs.csv").write_text(f"# {COMMENT}\n" + "\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
