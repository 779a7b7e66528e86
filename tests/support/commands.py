"""Files for and from commands."""

import arviz
import numpy as np
from arms import DATA, lcd_arm

ARM = DATA / "lcd_arm" / "arm.toml"


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file())


def posterior(path, draws=12, **extra):
    """Write draws about the arm's values, as `ident sample` does."""
    rng = np.random.default_rng(3)
    names = ("joint1.k_tors", "joint2.k_tors")
    values = {name: float(lcd_arm().get(name)) * np.exp(0.1 * rng.normal(size=(2, draws))) for name in names}
    data = arviz.from_dict(posterior=values | {"discrepancy.deflection": rng.normal(size=(2, draws))} | extra)
    data.to_netcdf(str(path), engine="h5netcdf")
    return values
