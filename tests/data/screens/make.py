"""Keep what each command says first, on shipped data and on the examples of `ident new`, after a change to that.

`python tests/data/screens/make.py [lcd_arm|scara|six-axis ...] [COMMAND ...]`; by default all of them. Each file has
the command, its report as result files hold it, and the further lines it printed (files written), which
`tests/report/test_first_screens.py` renders. All takes a quarter of an hour.
"""

import csv
import io
import json
import os
import shlex
import subprocess
import sys
import tempfile
from contextlib import redirect_stdout
from pathlib import Path

HERE = Path(__file__).parent
ROOT = HERE.parents[2]
OWN = [
    "new {kind} robot",
    "show robot/arm.toml",
    "predict robot/arm.toml",
    "check robot/campaign.csv",
    "fit robot/campaign.csv",
    "profile robot/campaign.csv",
    "validate robot/campaign.csv",
    "plan robot/campaign.csv",
    "compare robot/campaign.csv robot/later.csv",
    "sample robot/campaign.csv",
    "fleet robots",
    "export out/campaign.fit.json",
    "rerun out/campaign.fit.json",
    "resonance robot/arm.toml",
    "simulate robot/arm.toml",
    "spectrum out/arm.{motion}.simulate.csv --arm robot/arm.toml",
    "sweep robot/arm.toml --vary joint1.k_tors",
    "design robot/arm.toml --limit 0.5",
    "explore robot/arm.toml",
    "diagnose robot/campaign.csv --limit 0.5",
]
"""What is run on an example, in this order: later ones read what earlier ones wrote."""
NEEDS = {"export": "fit", "rerun": "fit", "spectrum": "simulate"}
"""Commands that read what another one wrote."""
WEAK = ["--fix=joint4.k_tors", "--fix=joint5.*", "--fix=joint6.*"]
LESS = {
    "sample": ["--steps=500", "--walkers=14", "--starts=1", *WEAK],
    "fleet": ["--starts=1", *WEAK],
    "design": ["--starts=1", "--no-curve", "--change=joint2.k_tors"],
    "diagnose": ["--starts=1", *WEAK],
}
"""What is added for six axes, on which these take an hour otherwise: fewer numbers, the same screen."""
EFFORT = {
    "steps": 500,
    "draws": 30,
    "band_draws": 4,
    "assessment_draws": 10,
    "values": 5,
    "screened": 4,
    "iterations": 2,
}
"""What a diagnosis of six axes computes, for which the command has no flag."""
SHIPPED = [
    "new my_robot --robot data/ur10/arm.urdf",
    "show data/lcd_arm/arm.toml",
    "predict data/lcd_arm/arm.toml --posture 0,0,0 --posture 30,-60,30 --load glass",
    "check data/lcd_arm/campaign.csv",
    "fit data/lcd_arm/campaign.csv",
    "fit data/lcd_arm/table1.csv",
    "profile data/lcd_arm/campaign.csv",
    "validate data/lcd_arm/campaign.csv",
    "plan data/lcd_arm/table1.csv --load glass",
    "compare data/lcd_arm/campaign.csv data/lcd_arm/after_a_year.csv",
    "sample data/lcd_arm/campaign.csv",
    "fleet robots",
    "modal data/lcd_arm/hammer",
    "export out/campaign.fit.json",
    "rerun out/campaign.fit.json",
    "resonance data/lcd_arm/arm.toml",
    "simulate data/lcd_arm/arm.toml",
    "spectrum out/arm.extend-10.simulate.csv --arm data/lcd_arm/arm.toml --spectrogram",
    "sweep data/lcd_arm/arm.toml --vary joint1.k_tors --vary bracket.com.x=0:0.29 --vary speed=4:20:17",
    "design data/lcd_arm/arm.toml --limit 0.5",
    "explore data/lcd_arm/arm.toml",
    "diagnose data/lcd_arm/campaign.csv --limit 0.5",
    "joint data/kr300/a.csv data/kr300/b.csv data/kr300/c.csv --inertia axis1=609,axis2=843.9,axis3=751.3",
]


def main(names: list[str]) -> None:
    """Run the commands of each arm in a folder of their own, each in a process of its own."""
    kinds = ("lcd_arm", "scara", "six-axis")
    only = {*names} - {*kinds}
    only |= {NEEDS[name] for name in only if name in NEEDS} | ({"new"} if only else set())
    for kind in [kind for kind in kinds if kind in names] or kinds:
        with tempfile.TemporaryDirectory() as folder:
            Path(folder, "data").symlink_to(ROOT / "data")
            for i, line in enumerate(SHIPPED if kind == "lcd_arm" else OWN):
                if only and line.split()[0] not in only:
                    continue
                words = shlex.split(line.format(kind=kind, motion=motion_of(Path(folder))))
                words += LESS.get(words[0], []) if kind == "six-axis" else []
                path = HERE / kind / f"{i:02d}.{words[0]}.json"
                path.parent.mkdir(exist_ok=True)
                command = [sys.executable, __file__, "--one", str(path), *words]
                environment = os.environ | {"PYTHONPATH": str(ROOT)}
                subprocess.run(command, cwd=folder, env=environment, check=True)
                if words[0] == "new":
                    more_robots(kind, Path(folder))


def motion_of(folder: Path) -> str:
    """Return what the files of a simulated motion are called."""
    return next((path.name.split(".")[1] for path in sorted(folder.glob("out/arm.*.simulate.csv"))), "")


def more_robots(kind: str, folder: Path) -> None:
    """Make a fleet of four, and of an example's campaign a later one: the same, each value moved by a little noise."""
    import numpy as np

    if kind == "lcd_arm":
        sys.path.append(str(ROOT / "data" / "fleet"))
        from generate import generate

        generate(folder / "robots", robots=8, faulty=1, seed=1)  # as docs/commands/fleet.md
        return
    rng, robots = np.random.default_rng(20261126), folder / "robots"
    robots.mkdir()
    (robots / "arm.toml").write_bytes((folder / "robot" / "arm.toml").read_bytes())
    text = (folder / "robot" / "campaign.csv").read_text(encoding="utf-8")
    comments = [line for line in text.splitlines(keepends=True) if line.startswith("#")]
    rows = list(csv.DictReader(line for line in text.splitlines() if not line.startswith("#")))
    for path in (folder / "robot" / "later.csv", *(robots / f"robot{i}.csv" for i in range(1, 5))):
        moved = [row | {"value": f"{float(row['value']) * (1 + 0.002 * rng.normal()):.6g}"} for row in rows]
        with path.open("w", encoding="utf-8", newline="") as file:
            file.writelines(comments)
            writer = csv.DictWriter(file, rows[0].keys())
            writer.writeheader()
            writer.writerows(moved)


def keep(path: Path, words: list[str]) -> None:
    """Run a command in this process, and keep its report and the lines it printed besides."""
    from ident import cli
    from ident.report.document import report_data
    from ident.report.report import text_of
    from ident.studies.cure.effort import DiagnosisEffort
    from ident.studies.result import Reported

    said, report = [], Reported.report

    def heard(self, **how):
        said.append(self.sections())
        return report(self, **how)

    Reported.report = heard
    if path.parent.name == "six-axis":
        DiagnosisEffort.__init__.__kwdefaults__.update(EFFORT)
    sys.argv, printed = ["ident", *words], io.StringIO()
    try:
        with redirect_stdout(printed):
            cli.main()
    except SystemExit as stop:
        if stop.code not in (0, None, 3):
            raise
    first = text_of(said[-1]) if said else ""
    assert first in printed.getvalue()
    record = {
        "command": shlex.join(["ident", *words]),
        "report": report_data(said[-1]) if said else None,
        "further": printed.getvalue().replace(first, "", 1).splitlines(),
    }
    path.write_text(json.dumps(record, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    print(f"{len(printed.getvalue().splitlines()):3d} lines: {record['command']}", flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        keep(Path(sys.argv[2]), sys.argv[3:])
    else:
        main(sys.argv[1:])
