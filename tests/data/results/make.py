"""Write one small result of every study into a folder, from the root of the repository.

`python tests/data/results/make.py tests/data/results/VERSION`, once for each version of the formats: what was written
stays, and is read for ever (`tests/studies/test_saved.py`).
"""

import runpy
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import ident
from ident.studies.cure.effort import DiagnosisEffort
from ident.studies.result import Result

DATA = Path("data")
LCD = DATA / "lcd_arm"
ARM, CAMPAIGN = LCD / "arm.toml", LCD / "campaign.csv"
FIT = {"starts": 1}
SHORT = {"speed": 200.0, "dwell": 0.2, "rate": 50.0}
SMALL = DiagnosisEffort(
    steps=500, draws=30, band_draws=4, assessment_draws=10, speeds=(0.5, 1.25), values=5, screened=4, iterations=2
)
FAST = {**SHORT, "method": "fast"}


def fleet(folder: Path) -> ident.FleetResult:
    """Return a fleet of four robots."""
    runpy.run_path(str(DATA / "fleet" / "generate.py"))["generate"](folder / "robots", robots=4, faulty=1)
    return ident.fleet(folder / "robots", **FIT)


def results(folder: Path) -> Iterator[Result]:
    """Yield a result of every study."""
    fit, simulated = ident.fit(ARM, CAMPAIGN), ident.simulate(ARM, **FAST)
    numbers = {"joint1.k_tors": ("0.5x", "2x", 2)}
    yield fit
    yield simulated
    yield ident.predict(ARM, posture=((0, 0, 0),))
    yield ident.check(ARM, CAMPAIGN)
    yield ident.profile(ARM, CAMPAIGN, parameter=("joint1.k_bend",), **FIT)
    yield ident.sample(ARM, CAMPAIGN, steps=500, walkers=14, starts=1)
    yield ident.validate(ARM, CAMPAIGN, **FIT)
    yield ident.plan(ARM, LCD / "table1.csv", step=60, count=1, **FIT)
    yield ident.compare(fit, ident.fit(ARM, LCD / "after_a_year.csv", starts=1))
    yield fleet(folder)
    yield ident.resonance(ARM, speed=10.0)
    yield ident.spectrum(simulated)
    yield ident.sweep(ARM, vary=numbers, **SHORT)
    yield ident.triage(LCD / "runs" / "runs.csv", ARM)
    source = ident.source(LCD / "runs" / "runs.csv", ARM, hold_out=("run7.csv", "run8.csv", "run13.csv"), draws=5)
    yield source
    yield ident.balance(source, speed=200.0, dwell=0.2)
    yield ident.joint([DATA / "kr300" / f"{name}.csv" for name in "ab"], inertia="700")
    yield ident.motion(ARM, speed=100.0, dwell=0.2, time=6.0, segments=4)
    yield ident.variants([ARM, fit.save(folder)[0]], speed=100.0, dwell=1.0, limit=1.0, segments=4)
    yield ident.design(ARM, change={"joint1.k_tors": ("1x", "2x")}, no_curve=True, starts=1, **SHORT)
    yield ident.modal_test(LCD / "hammer")
    yield ident.diagnose(ARM, CAMPAIGN, ident.DiagnoseOptions(speed=100.0, dwell=0.2, limit=1.3, effort=SMALL))


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as scratch:
        for result in results(Path(scratch)):
            for path in result.save(sys.argv[1]):
                if not path.name.endswith((".json", ".sample.nc")):
                    path.unlink()  # what nothing reads again
