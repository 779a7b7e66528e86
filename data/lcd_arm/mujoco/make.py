"""Makes the files of this folder: what sensors could have measured on an arm that MuJoCo moves, not ident.

python data/lcd_arm/mujoco/make.py

The arm is that of ../arm.toml with transmission errors and phases that are drawn, its stiffnesses off by a draw of the
fit to ../campaign.csv. Masses that ident finds from the runs, as notebook 05 finds them, are then mounted on it.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.interpolate import make_interp_spline

import ident
from ident.arm.arm import Arm
from ident.vibrate.motion import stroke

HERE = Path(__file__).parent
sys.path += [str(HERE.parents[2] / "tests" / name) for name in ("benchmarks", "support")]

from balance import Moved  # noqa: E402, by MuJoCo

SPEEDS = (7, 8, 10, 13)
"""Percent of full speed."""
ERROR = 3.0
"""Transmission error of every drive at twice a turn [arc seconds, peak to peak]: assumed, see docs/paper.md."""
NOISE, OFFSET, DRIFT = 0.05, 0.02, 1e-4
"""Noise as a share of a trace's peak, largest offset [s] and standard deviation of the clock's rate: assumed."""
RATE = 100.0
"""Samples a second."""
SEED = 20261127
COMMENT = "SYNTHETIC: MuJoCo's equations with an arm near ../arm.toml, see make.py; not measured on any robot."
EVERY = 2
"""One of so many of MuJoCo's samples is written, where there is no noise."""
RADIUS, HOLES = 90.0, 12
"""Radius [mm] of the holes for masses on drive 2, and how many there are: assumed."""


def true_arm(file: "ident.ArmFile", rng: np.random.Generator) -> Arm:
    """Return the arm that is measured."""
    fitted = ident.fit(file, ident.read_campaign(HERE.parent / "campaign.csv")).fit.information
    off = rng.multivariate_normal(np.zeros(len(fitted.names)), fitted.covariance)
    numbers = {name: float(file.arm.get(name)) * np.exp(x) for name, x in zip(fitted.names, off, strict=True)}
    numbers |= {f"{drive.name}.error": np.deg2rad(ERROR / 2 / 3600) for drive in file.arm.drives}
    phases = [f"{drive.name}.{name}" for drive in file.arm.drives for name in ("phase", "error_phase")]
    return file.arm.replace(numbers | dict(zip(phases, rng.uniform(-np.pi, np.pi, len(phases)), strict=True)))


def write(name: str, columns: dict[str, np.ndarray], note: str = "") -> None:
    """Write a file of columns."""
    header = f"# {COMMENT}{note}\n" + ",".join(columns)
    np.savetxt(HERE / name, np.column_stack(list(columns.values())), "%.4g", ",", header=header, comments="")


def main() -> None:
    """Write runs, their table, and what the masses bring."""
    rng = np.random.default_rng(SEED)
    file = ident.read_arm(HERE.parent / "arm.toml")
    arm = true_arm(file, rng)
    assert arm.stroke is not None
    changed = [path for path in arm.paths() if not np.allclose(arm.get(path), file.arm.get(path), rtol=1e-12)]
    lines = [f"{path},{float(arm.get(path)):.8g}" for path in changed]
    (HERE / "truth.csv").write_text(
        "\n".join([f"# {COMMENT} What differs from arm.toml [SI].", "path,value", *lines]) + "\n"
    )
    rows = ["file,channel,direction,speed [%],group"]
    for speed in SPEEDS:
        at, vibration = Moved(arm, stroke(arm.stroke, percent=speed, dwell=2.0)).vibration({})
        time = np.arange(0.1, float(at[-1]) - 0.1, 1 / RATE)
        clock = time * (1 + DRIFT * rng.standard_normal()) + rng.uniform(-OFFSET, OFFSET)
        values = make_interp_spline(at, 1e3 * vibration.T[:, 1:], k=5)(clock)
        values += NOISE * np.abs(values).max(0) * rng.standard_normal(values.shape)
        write(f"run{speed}.csv", {"time [s]": time, "y [mm]": values[:, 0], "z [mm]": values[:, 1]})
        rows += [f"run{speed}.csv,{way},{way},{speed},1" for way in "yz"]
    (HERE / "runs.csv").write_text(f"# {COMMENT}\n" + "\n".join(rows) + "\n")
    remedied(file, arm)


def remedied(file: "ident.ArmFile", arm: Arm) -> None:
    """Write what the true arm does as it is, and with the masses that its runs lead to, without noise."""
    source = ident.source(HERE / "runs.csv", file, ident.SourceOptions(hold_out=("run8.csv",)))
    mounting = ident.BalanceOptions(speed=10, radius={"drive2": RADIUS}, holes={"drive2": HOLES})
    rows = [row for row in ident.balance(source, mounting).table() if row["mass"] > 0]
    masses = [f"{1e3 * row['mass']:.1f} g @ {row['drive']} hole {row['hole']:.0f}" for row in rows]
    bodies: dict[str, list[tuple[float, complex, float]]] = {}
    for row in rows:
        place = row["radius"] * np.exp(1j * row["angle"])
        bodies.setdefault(row["drive"], []).append((round(row["mass"], 4), place, row["height"]))
    assert arm.stroke is not None
    moved = Moved(arm, stroke(arm.stroke, percent=10, dwell=2.0))
    for name, mounted, note in (("as_it_is", {}, ""), ("balanced", bodies, f" Mounted: {' + '.join(masses)}")):
        time, vibration = (part[..., ::EVERY] for part in moved.vibration(mounted))
        write(f"{name}.csv", {"time [s]": time, "y [mm]": 1e3 * vibration[1], "z [mm]": 1e3 * vibration[2]}, note)


if __name__ == "__main__":
    main()
