"""Runs of a moving arm as a recorder would write them, with masses that were added to its drives."""

import numpy as np
import pytest
from arms import DATA
from scipy.interpolate import make_interp_spline
from threadpoolctl import threadpool_limits

from ident.arm.arm import Arm, stiffness_paths
from ident.description.file import read_arm
from ident.identify.binding import loads_of
from ident.measure.load import Load
from ident.vibrate import fast
from ident.vibrate.motion import stroke
from ident.vibrate.simulate import simulate

FILE = DATA / "lcd_arm" / "arm.toml"
HEAD = "file,channel,direction,speed [%],group,load\n"
SECOND = np.deg2rad(1 / 3600)
TRUTH = {
    **{f"drive{k}.eccentricity": e for k, e in ((1, 8e-3), (2, 8e-3), (3, 2e-3))},
    **{f"drive{k}.error": 1.5 * SECOND for k in (1, 2, 3)},
    **{f"drive{k}.phase": phase for k, phase in ((1, 0.5), (2, 3.1), (3, -2.0))},
    **{f"drive{k}.error_phase": phase for k, phase in ((1, -1.0), (2, 2.5), (3, 0.2))},
}


@pytest.fixture(autouse=True, scope="module")
def one_core():
    """Solve as on one core: all sets of an arm by one program, the same on every machine; BLAS without threads.

    It holds in each module that imports it.
    """
    fast._pool()  # which stays as it is, for others
    with pytest.MonkeyPatch.context() as patch, threadpool_limits(1):
        patch.setattr(fast, "cores", lambda: 1)
        yield


def measure(folder, arm, speed, load="", offset=0.01, seed=0, name=""):
    """Write a run of an arm as a recorder would: 100 samples a second, noise of 5 % of the peak, another clock."""
    motion = stroke(arm.stroke, percent=speed, dwell=1.0)
    response = simulate(arm, motion, loads=loads_of(arm, Load.parse(load)), rate=200.0)
    curve = make_interp_spline(response.time, 1e3 * np.asarray(response.measured).T, k=5)
    time = np.arange(0.1, float(response.time[-1]) - 0.1, 0.01)
    values = curve(time + offset)[:, 1:]
    values += 0.05 * np.abs(values).max(0) * np.random.default_rng(seed).standard_normal(values.shape)
    table = np.column_stack([time, values])
    np.savetxt(
        folder / f"run{name or format(speed, 'g')}.csv",
        table,
        "%.6g",
        ",",
        header="time [s],y [mm],z [mm]",
        comments="",
    )


def table(folder, speeds, name="runs.csv", load=""):
    rows = [f"run{speed:g}.csv,{way},{way},{speed:g},a,{load}\n" for speed in speeds for way in "yz"]
    (folder / name).write_text(HEAD + "".join(rows))
    return folder / name


def true_arm() -> Arm:
    """The shipped arm with imbalances and transmission errors, its stiffnesses 1.5 % off."""
    arm = read_arm(FILE).arm
    rng = np.random.default_rng(5)
    stiffer = {path: float(arm.get(path)) * np.exp(0.015 * rng.standard_normal()) for path in stiffness_paths(arm)}
    return arm.replace(TRUTH | stiffer)


def imbalance_of(arm: Arm, drive: str) -> complex:
    """Mass times eccentricity [kg m], its argument the phase."""
    mass, size, phase = (float(arm.get(f"{drive}.{name}")) for name in ("eccentric_mass", "eccentricity", "phase"))
    return mass * size * np.exp(1j * phase)


def with_mass(arm: Arm, drive: str, added: complex) -> Arm:
    """The arm with an imbalance [kg m] added to a drive, at the height of its own."""
    z = (imbalance_of(arm, drive) + added) / float(arm.get(f"{drive}.eccentric_mass"))
    return arm.replace({f"{drive}.eccentricity": abs(z), f"{drive}.phase": float(np.angle(z))})
