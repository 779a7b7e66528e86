"""A fleet of robots of one design: the stiffnesses of each, their population, and the outliers."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import refusal, require
from ident.studies.door import DEFAULT, study
from ident.studies.options import option
from ident.studies.result import Progress, Result, silent
from ident.studies.stiffness.fit import FitOptions
from ident.text import one_line, which_file

if TYPE_CHECKING:
    from ident.identify.fleet import Fleet, Robot
    from ident.inference.population import Draws, Under

CAMPAIGN, ARM = "campaign.csv", "arm.toml"


class FleetOptions(FitOptions):
    """Options of `ident.fleet`: those of each robot's fit; its prior is the interim one."""

    refuses: ClassVar[tuple[str, ...]] = ("uncertain", "robust", "no_explain")

    workers: int = option(1, "processes that compute robots at the same time, up to 61", low=1, high=61)
    normal: bool = option(False, "take each robot's data by a normal approximation, not by draws that the model weighs")

    @property
    def of_each(self) -> "FleetOptions":
        """Return the options that results depend on, without where they are computed."""
        return replace(self, workers=1)


class FleetResult(Result):
    """A fleet: the estimates of each robot, and the population of their stiffnesses.

    The table has a row for each robot and stiffness: own estimate, shrunk estimate, and the probability that a healthy
    robot differs as much from the others. The figure shows both estimates next to the population.

    Attributes:
        label: name of the fleet.
        fleet: robots and population.
        options: the options of the call.
    """

    label: str
    fleet: "Fleet"
    options: FleetOptions = field(default_factory=FleetOptions)

    subject = "label"
    summarised = ("label", "standing_out", "failed", "priors")

    @property
    def standing_out(self) -> Mapping[str, Mapping[str, float]]:
        """Robots that stand out, the clearest first: stiffness, and its change [-] from the fleet's median."""
        import numpy as np

        fleet, population = self.fleet, self.fleet.population
        if population is None:
            return {}
        change = np.expm1(population.robot_mean - population.next_mean)
        return {
            fleet.robots[fleet.members[r]].name: {fleet.names[i]: float(change[r, i]) for i in which}
            for r, which in fleet.standing_out.items()
        }

    @property
    def failed(self) -> Mapping[str, str]:
        """Robots without a fit, and why."""
        return {robot.name: robot.error for robot in self.fleet.failed}

    @property
    def priors(self) -> Mapping[str, str]:
        """Prediction of the next robot by the fleet, before its data, by stiffness, in the format of `prior`."""
        from ident.studies.stiffness.fleet_report import fleet_priors

        return fleet_priors(self.fleet)

    @property
    def short(self) -> bool:
        """Whether a robot failed, or too few are left for a population."""
        return bool(self.failed) or self.fleet.population is None

    @property
    def doubtful(self) -> bool:
        """Whether a robot stands out, or its data contradict the model."""
        return bool(self.standing_out or self.fleet.doubted)

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        """Write the result, and the priors of the next robot as flags of `ident fit`."""
        from ident.files import write_text

        written = super()._write(path, head)
        if not self.priors:
            return written
        beside = self._beside(path, ".prior")
        write_text(beside, "".join(f"--prior={name}={prior}\n" for name, prior in self.priors.items()))
        return (*written, beside)

    def _inputs(self) -> Mapping[str, Any]:
        robots = self.fleet.robots
        return {f"{word} of {r.name}": getattr(r, word) for r in robots for word in ("campaign", "arm")}

    @classmethod
    def arguments(cls, inputs: Mapping[str, Path], summary: Mapping[str, Any]) -> dict[str, Any]:
        """Return the files of each robot, by its name."""
        names = [name.removeprefix("campaign of ") for name in inputs if name.startswith("campaign of ")]
        files = [(name, inputs[f"campaign of {name}"], inputs[f"arm of {name}"]) for name in names]
        return {"robots": files, "label": summary["label"]}


Files = tuple[str, Path, Path]
"""A robot: name, campaign file, arm file."""


@study
def fleet(
    robots: str | Path | Sequence[Files],
    arm: str | Path | None = None,
    options: FleetOptions = DEFAULT,
    *,
    folder: str | Path | None = None,
    label: str = "",
    progress: Progress = silent,
) -> FleetResult:
    """Fit each robot of a fleet, and infer the population of their stiffnesses.

    Args:
        robots: a folder with one CSV file, or one folder with a CSV file, for each robot; or name, campaign and arm of
            each. campaign.csv is used where a robot's folder has several. A folder's own arm.toml describes its robot.
        arm: describes the other robots; by default arm.toml in the folder of the fleet.
        options: of the fits, and the number of parallel fits.
        folder: each finished fit is stored here, so that a call after an interruption resumes.
        label: name of the fleet; by default the name of its folder.
        progress: shows progress over the robots.

    Raises:
        InputError: no robots, or two of one name. A wrong file of one robot does not stop the others.
    """
    from ident.identify.fleet import check_names
    from ident.identify.fleet import fleet as infer
    from ident.studies.stiffness.fleet_tasks import Task, drawn, outcomes

    files = robots_in(Path(robots), arm) if isinstance(robots, str | Path) else list(robots)
    if isinstance(robots, str | Path):
        label = label or Path(robots).absolute().name
    check_names([name for name, *_ in files])
    with TemporaryDirectory() as passing:
        tasks = [Task(*each, options, Path(folder or passing)) for each in sorted(files)]
        steps = progress("robots", len(tasks))(range(len(tasks)))
        done = [robot for _, robot in zip(steps, outcomes(tasks, options.workers), strict=True)]
        found = {task.name: task for task in tasks}

        def redraw(robots: "Sequence[Robot]", under: "Under") -> "list[Draws | None]":
            asked = [found[robot.name] for robot in robots]
            steps = progress("draws of robots", len(asked))(range(len(asked)))
            known = dict(each for _, each in zip(steps, drawn(asked, under, options.workers), strict=True))
            return [known[robot.name] for robot in robots]

        inferred = infer(done, seed=options.seed, redraw=None if options.normal else redraw)
    return FleetResult(label or "fleet", inferred, options.of_each)


def robots_in(folder: Path, arm: str | Path | None) -> list[Files]:
    """Return the robots of a folder.

    Raises:
        InputError: not a folder, or no robots in it.
    """
    where, expected = one_line(str(folder)), "a folder with a CSV file, or a folder with one, for each robot"
    if not os.path.isdir(folder):
        raise refusal(where, "no such folder", expected, which_file(folder))
    shared = Path(arm) if arm is not None else folder / ARM
    found: list[Files] = [(path.stem, path, shared) for path in _tables(folder) if path.is_file()]
    for path in folder.iterdir():
        if tables := _tables(path):
            own = path / ARM
            campaign = tables[0] if len(tables) == 1 else path / CAMPAIGN
            found.append((path.name, campaign, own if own.is_file() else shared))
    require(found, where, "no robots", expected, "put their campaigns there")
    if any(path == shared for _, _, path in found) and not shared.is_file():
        remedy = "put arm.toml beside the robots, or name it (`arm`)"
        raise refusal(one_line(str(shared)), "no such file", "the arm's description", remedy)
    return found


def _tables(folder: Path) -> list[Path]:
    """Return the campaigns in a folder, without companion files."""
    from ident.measure.covariance import COVARIANCE_SUFFIX
    from ident.measure.frames import SETUP_SUFFIX

    return [path for path in folder.glob("*.csv") if not path.name.endswith((COVARIANCE_SUFFIX, SETUP_SUFFIX))]
