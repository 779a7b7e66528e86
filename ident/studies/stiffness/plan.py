"""Rank the next measurements by information per cost."""

from collections.abc import Mapping
from dataclasses import field
from math import log1p, radians
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import refusal, require
from ident.studies import module_of, reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import option, repeated
from ident.studies.result import Progress, Result, silent
from ident.studies.stiffness.fit import FitOptions, fit

if TYPE_CHECKING:
    from ident.description.file import ArmFile
    from ident.identify.candidates import HammerPlan
    from ident.identify.plan import CampaignPlan, PlanSettings
    from ident.measure import Campaign
    from ident.measure.runs import Runs
    from ident.studies.cause.source_plan import RunPlanResult


class PlanOptions(FitOptions):
    """Options of `ident.plan`: the candidates, the aim, and the unknowns."""

    refuses: ClassVar[tuple[str, ...]] = ("no_explain",)

    count: int = option(4, "experiments in the batch, at most", low=1, high=100, short="-k")
    criterion: str = option(
        "d", "what experiments are chosen for: d (information), a (mean variance) or a parameter's name"
    )
    target: float = option(
        0.0, "end the batch when all standard deviations are below this, in percent; 0 for none", low=0.0, high=1e6
    )
    step: float = option(30.0, "step of the grid of joint angles [deg]", above=0.0, high=360.0)
    modes: int = option(4, "frequencies that a hammer test gives, from the lowest", low=1, high=100)
    load: tuple[str, ...] = repeated(
        (), "load that can be mounted, as 'glass' or '5 kg @ tip'; may be repeated", read=reading.names
    )
    sigma: dict[str, float] = repeated(
        {},
        "standard deviation as a share of the value, as frequency=0.005; default: the campaign's",
        read=reading.numbers,
    )
    cost: dict[str, float] = repeated(
        {},
        "minutes for a part of an experiment, as posture=10; also hammer, labels, dial and load",
        read=reading.numbers,
    )
    common_share: float | None = option(
        None,
        "share of a value's variance that is common to its posture, so that a repeat there makes it no smaller;"
        " default: the campaign's, or 0.5, which is assumed",
        low=0.0,
        high=0.99,
    )
    sensors: int = option(
        0,
        "channels of accelerometers at hand: says where to put them, and where to hit how often; 0 to leave that out",
        low=0,
        high=60,
    )
    sheet: str | None = option(
        None, "write a page and channels.csv to measure by: hammer, or tap without a force", choices=("hammer", "tap")
    )
    sensor_mass: float = option(0.0, "mass [g] of the sensors at a point of the sheet, a load", low=0.0, high=1e5)
    hit_noise: float = option(0.1, "standard deviation of one hit's shape, as a share of it", above=0.0, high=1.0)
    run_noise: float = option(
        5.0, "noise of planned runs (--runs), in percent of each trace's peak", above=0.0, high=100.0
    )
    draws: int = option(8, "points besides the best estimate over which gains are averaged", low=0, high=1000)

    @property
    def settings(self) -> "PlanSettings":
        """Options as identification takes them, in SI."""
        from ident.identify.plan import PlanSettings
        from ident.measure import OWN_WEIGHT, Load

        return PlanSettings(
            count=self.count,
            criterion=self.criterion,
            target=log1p(self.target / 100),
            step=radians(self.step),
            modes=self.modes,
            loads=(OWN_WEIGHT, *(Load.parse(text) for text in self.load)),
            sigma=self.sigma,
            costs=self.cost,
            common=self.common_share,
            draws=self.draws,
            seed=self.seed,
        )


class PlanResult(Result):
    """The next measurements on an arm, and what they will gain.

    The figure shows gain over posture, and the expected standard deviations; the table has a row for each experiment of
    the batch: posture [deg], load, kind of test, cost [min], gain, nat.

    Attributes:
        arm: the arm as in its file.
        plan: the batch, its candidates, and the expected standard deviations.
        hammer: sensors and hammer points of the hammer tests in the batch; empty where no sensors are named.
        options: the options of the call.
    """

    arm: "ArmFile"
    plan: "CampaignPlan"
    hammer: "tuple[HammerPlan, ...]" = ()
    options: PlanOptions = field(default_factory=PlanOptions)

    shown = ("plan", "hammer", "options.sheet")
    drawn = listed = ("plan",)
    numbers = ("cost",)
    summarised = ("cost", "sd")

    @property
    def name(self) -> str:
        """Name of the campaign or of the arm, and of the study."""
        return f"{(self.plan.fit.campaign if self.plan.fit else self.arm).name}.plan"

    @property
    def campaign(self) -> "Campaign":
        """The batch as measurements with their expected values."""
        return self.plan.campaign()

    @property
    def cost(self) -> float:
        """Cost of the batch [min]."""
        return float(sum(step.cost for step in self.plan.steps))

    @property
    def sd(self) -> Mapping[str, tuple[float, ...]]:
        """Standard deviation of each parameter, now and after each experiment: of ln(value) [-] for a positive one."""
        names = self.plan.known.sought
        return {name: tuple(map(float, column)) for name, column in zip(names, self.plan.sd.T, strict=True)}

    @property
    def sd_at_draws(self) -> Mapping[str, tuple[float, ...]]:
        """Standard deviation after the batch, for other draws of the unknowns: of ln(value) [-] for a positive one."""
        names, end = self.plan.known.sought, self.plan.at_draws
        return {name: tuple(map(float, column)) for name, column in zip(names, end.T, strict=True)}

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        """Write the plan, a campaign form unless the batch is empty, and the sheet if wanted."""
        from ident.studies.stiffness.plan_report import write_form

        forms: tuple[Path, ...] = (self._beside(path, ".csv"),) if self.plan.steps else ()
        for each in forms:
            write_form(self.plan, each)
        if self.options.sheet and self.hammer:
            from ident.studies.stiffness.plan_sheet import sheet_postures, write_sheet

            mass, tap = self.options.sensor_mass / 1e3, self.options.sheet == "tap"
            postures = tuple(sheet_postures(self.plan, self.hammer, tap, mass))
            forms += write_sheet(self._beside(path, ".sheet"), self.arm, postures, head)
        return (*super()._write(path, head), *forms)

    @property
    def short(self) -> bool:
        """Whether the fit that the plan starts from is not an optimum."""
        return self.plan.fit is not None and self.plan.fit.short

    def _inputs(self) -> Mapping[str, Any]:
        return {"arm": self.arm, "campaign": self.plan.fit.campaign if self.plan.fit else None}


@study
def plan(
    arm: "ArmFile",
    campaign: "Campaign | None" = None,
    options: PlanOptions = DEFAULT,
    *,
    runs: "Runs | str | Path | None" = None,
    progress: Progress = silent,
) -> "PlanResult | RunPlanResult":
    """Choose the next measurements on an arm by information per cost.

    Args:
        arm: its joint limits and workspace decide which postures can be held.
        campaign: the measurements so far; None for none, so that only the priors are known.
        options: the candidates, the aim, and the unknowns.
        runs: table of runs to measure on the moving arm, instead of a campaign: what they would tell of its drives.
        progress: shows progress over the starts of the fit, or over further runs.

    Raises:
        InputError: arm, campaign and options do not match; a campaign with runs.
        ModelError: the campaign can't be fitted, or no posture of the arm is stable.
    """
    import numpy as np

    from ident.identify.candidates import hammer_plans
    from ident.identify.instruments import all_postures
    from ident.identify.plan import plan_campaign

    if runs is not None:
        if campaign is not None:
            raise refusal("runs", f"the campaign {campaign.name} too", "one of them", "plan them one after the other")
        require(not options.sheet, "sheet", "a sheet of planned runs", "hammer or tap tests", "leave it out")
        planned: RunPlanResult = module_of("source", "_plan").planned(
            arm, runs, options, noise=options.run_noise / 100, progress=progress
        )
        return planned
    settings = options.settings
    all_postures(arm.arm, settings.step, settings.seed)  # report a wrong step before the fit
    fitted = fit(arm, campaign, options, progress=progress).fit if campaign is not None else None
    made = plan_campaign(arm.arm, fitted, options.unknowns_of(arm), settings)
    best = made.parameters.by_path(np.asarray(made.parameters.values(made.known.points[0])))
    places = (options.modes, options.sensors or 2, options.hit_noise, options.sheet == "tap")
    sought = {path: best[path] for item in made.sought for path in item.paths if path in arm.arm.paths()}
    hammer = hammer_plans(arm.arm.replace(sought), made.batch, *places) if options.sensors or options.sheet else ()
    return PlanResult(arm, made, hammer, options)
