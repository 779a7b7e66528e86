"""Files for and from commands."""

import arviz
import numpy as np
from arms import DATA, lcd_arm

from ident.files import WRITTEN

ARM = DATA / "lcd_arm" / "arm.toml"
TABLE_1 = ("ident", "fit", "data/lcd_arm/table1.csv")
"""A command of the manual that `tests/cli/test_fit.py` runs for all."""


def files(folder):
    """The files in a folder, but for the hashes of what was written."""
    return sorted(
        str(each.relative_to(folder)) for each in folder.rglob("*") if each.is_file() and each.name != WRITTEN
    )


def log(path, angles=(60, -120, 60)):
    """A way in half a second, from rest to rest."""
    time = np.linspace(0, 0.5, 26)
    x = time / 0.5
    way = 10 * x**3 - 15 * x**4 + 6 * x**5
    columns = [time, *(way * angle for angle in angles)]
    header = "time [s],joint1 [deg],joint2 [deg],joint3 [deg]"
    np.savetxt(path, np.column_stack(columns), header=header, comments="", delimiter=",")


def posterior(path, draws=12, **extra):
    """Write draws about the arm's values, as `ident sample` does."""
    rng = np.random.default_rng(3)
    names = ("joint1.k_tors", "joint2.k_tors")
    values = {name: float(lcd_arm().get(name)) * np.exp(0.1 * rng.normal(size=(2, draws))) for name in names}
    data = arviz.from_dict(posterior=values | {"discrepancy.deflection": rng.normal(size=(2, draws))} | extra)
    data.to_netcdf(str(path), engine="h5netcdf")
    return values
