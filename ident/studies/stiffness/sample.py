"""Sample the posterior of a campaign: how certain each stiffness is, and which combinations are known."""

from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from ident.errors import Problem
from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import option, repeated
from ident.studies.result import Progress, Result, alias, silent
from ident.studies.stiffness.fit import FitOptions, fit

if TYPE_CHECKING:
    import arviz
    import numpy as np
    from matplotlib.figure import Figure

    from ident.description.file import ArmFile
    from ident.identify.fit import CampaignFit
    from ident.identify.sample import CampaignSample
    from ident.identify.values import Draws
    from ident.measure import Campaign


MOST_WALKERS = 20_000
"""Walkers of all ensembles about an optimum."""


class SampleOptions(FitOptions):
    """Options of `ident.sample`: the unknowns, their priors, and the length of the chains."""

    refuses: ClassVar[tuple[str, ...]] = ("robust", "no_explain")

    noise: tuple[str, ...] = repeated(
        (),
        "kind of measurement whose sigma is known up to a factor only, as frequency; may be repeated",
        read=reading.names,
    )
    weights: bool = option(False, "weigh several optima against each other, by nested sampling")
    ess: float = option(2000.0, "effective samples of each unknown at which to stop", low=100.0, high=1e6)
    steps: int = option(20000, "steps at which to stop in any case", low=500, high=10_000_000, argument="max_steps")
    ensembles: int = option(4, "independent ensembles about each optimum", low=4, high=100)
    walkers: int | None = option(
        None, "walkers in each ensemble; default: four to eight times the unknowns", low=2, high=10_000
    )

    def problems(self) -> list[Problem]:
        """Refuse more walkers than are feasible."""
        count = self.ensembles * (self.walkers or 0)
        got, expected = f"{count} in {self.ensembles} ensembles", f"at most {MOST_WALKERS} in all"
        many = Problem("walkers", got, expected, "take fewer, or fewer ensembles")
        return [*super().problems(), *([many] if count > MOST_WALKERS else [])]


class SampleResult(Result):
    """A sampled posterior of an arm's campaign.

    The table has a row for each unknown about each optimum: median, intervals [SI], effective samples, R-hat.

    Attributes:
        arm: the arm as in its file.
        sample: the draws, their starting fit, the predicted data, and diagnostics of the chains.
        options: the options of the call.
        doubtful: whether the starting fit is in doubt, or its data contradict an assumption.
        doubts: why no interval of this posterior is reported; empty without objections.
        fitted: the fit that the chains started from.
    """

    arm: "ArmFile"
    sample: "CampaignSample"
    options: SampleOptions = field(default_factory=SampleOptions)

    suffix = ".nc"
    subject = "sample.fitted.campaign.name"
    made_from = ("arm", "sample.fitted.campaign")
    numbers = ("sample.sample.theta",)
    summarised = ("doubts",)

    doubtful: ClassVar[bool] = alias("sample.fitted.in_doubt")
    doubts: ClassVar[tuple[str, ...]] = alias("sample.withheld")
    fitted: ClassVar["CampaignFit"] = alias("sample.fitted")

    @property
    def short(self) -> bool:
        """Whether the chains are too short, or disagree."""
        return not self.enough

    @property
    def enough(self) -> bool:
        """Whether the chains are long enough, and agree."""
        return all(each.enough(self.options.ess) for each in self.sample.sample.diagnosis)

    @property
    def medians(self) -> Mapping[str, float]:
        """Median by parameter [SI: N m/rad for a stiffness], about the best optimum."""
        return {row["parameter"]: row["median"] for row in self.table() if row["optimum"] == self._best}

    @property
    def intervals(self) -> Mapping[str, tuple[float, float]]:
        """95 % intervals by parameter [SI], about the best optimum; see `doubts` before reporting one."""
        rows = (row for row in self.table() if row["optimum"] == self._best)
        return {row["parameter"]: (row["low_95"], row["high_95"]) for row in rows}

    @property
    def draws(self) -> "Mapping[str, np.ndarray]":
        """Draws by parameter, (n,) [SI] each, about the best optimum, without burn-in."""
        from ident.inference.draws import draws

        sample = self.sample.sample
        return dict(zip(sample.posterior.parameters.names, draws(sample, sample.basins[0]), strict=True))

    @property
    def inference_data(self) -> "arviz.InferenceData":
        """The draws in ArviZ's format, all SI: each walker a chain, without burn-in."""
        from ident.report.document import plain
        from ident.studies.stiffness.sample_files import inference_data

        return inference_data(self.sample, self.head | {"trust": plain(self.sample.trust)})

    def _figures(self) -> "dict[str, Figure]":
        """Return figures of the posterior, of pairs of parameters and of the chains: `posterior`, `corner`, `trace`."""
        from ident.studies.stiffness.sample_figure import corner_figure, posterior_figure, trace_figure

        drawn = {"posterior": posterior_figure, "corner": corner_figure, "trace": trace_figure}
        return {name: figure(self.sample) for name, figure in drawn.items()}

    @property
    def _best(self) -> int:
        return self.sample.sample.basins[0] + 1

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        from ident.report.document import write_netcdf
        from ident.studies.stiffness.sample_files import groups_of

        write_netcdf(path, groups_of(self.inference_data), self._record(head))
        return (path,)

    def standard_errors(self) -> list[dict[str, float]]:
        """Return the Monte Carlo standard errors of the table's numbers [SI]; infinite for diagnostics of chains."""
        from ident.studies.stiffness.sample_files import sample_errors

        return sample_errors(self.sample)

    def posterior_draws(self) -> "Draws":
        """Return the draws as other studies take them."""
        from ident.identify.values import Draws

        return Draws.of_sample(self.sample, self.arm.arm, self.arm.sha256).doubted(self.doubts)


@study
def sample(
    arm: "ArmFile",
    campaign: "Campaign",
    options: SampleOptions = DEFAULT,
    *,
    folder: str | Path | None = None,
    restart: bool = False,
    progress: Progress = silent,
) -> SampleResult:
    """Sample the posterior of a campaign by emcee, until the effective sample size is reached.

    After an interruption, a call with the same folder and inputs resumes, and the chain is the same to the bit; more
    `steps` or `ess` only extend it. At most a million draws are stored: a longer run stores every second step, then
    every fourth, and so on.

    Args:
        arm: its stiffnesses are starting values and centres of the priors.
        campaign: the measurements.
        options: the unknowns, their priors, and the length of the chains.
        folder: checkpoints go here, and stay; None for none.
        restart: discard the contents of the folder.
        progress: shows progress over the starts of the fit and the blocks of steps.

    Raises:
        InputError: campaign and arm, or the named parameters, do not match; implausible values; data and prior that
            leave a parameter undetermined or exclude each other; checkpoints of another run, or of one still at work;
            `weights` without dynesty.
        ModelError: no optimum was reached, or the model has no solution near one.
    """
    from ident.codec import Store
    from ident.files import claimed
    from ident.identify.sample import sample_campaign
    from ident.inference.draws import check_installed
    from ident.inference.sample import ANEW, BLOCK, Settings

    folder = Path(folder) if folder is not None else None
    if options.weights:
        check_installed()
    with claimed(folder):
        fitted = fit(arm, campaign, options, progress=progress)
        if restart and folder is not None:
            Store.discard(folder / ANEW)
            Store.empty(folder)
        sampled = sample_campaign(
            fitted.fit,
            settings=Settings(options.ensembles, options.walkers, options.ess, options.steps, options.seed),
            noise=options.noise,
            weights=options.weights,
            folder=folder,
            provenance={"campaign": campaign.sha256, "arm file": fitted.arm.sha256}
            | {"soft base": str(options.soft_base), "number of starts": str(options.starts)},
            progress=progress("blocks of steps", options.steps // BLOCK),
        )
    return SampleResult(fitted.arm, sampled, options)


def discard_checkpoints(folder: Path) -> None:
    """Remove the checkpoints of a finished run.

    Raises:
        InputError: another run is at work there.
    """
    from ident.codec import Store
    from ident.inference.sample import ANEW

    Store.discard(folder / ANEW)
    Store.discard(folder)
