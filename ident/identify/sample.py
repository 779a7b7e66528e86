"""The posterior of an arm's campaign, with the fit that it started from."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ident.identify.fit import CampaignFit
from ident.inference.evidence import Weights, check_weighable, weigh
from ident.inference.posterior import posterior
from ident.inference.posterior_predictive import PosteriorPredictive, posterior_predictive
from ident.inference.sample import DEFAULT, Sample, Settings, sample
from ident.jit import cores


@dataclass(frozen=True)
class CampaignSample:
    """A sampled posterior of an arm's campaign.

    Attributes:
        fitted: the fit, arm and campaign with it.
        sample: the draws.
        posterior_predictive: data as the draws about the best optimum have them.
        weights: shares of the optima; None for a single one, or where they are unknown.
    """

    fitted: CampaignFit
    sample: Sample
    posterior_predictive: PosteriorPredictive
    weights: Weights | None

    @property
    def withheld(self) -> tuple[str, ...]:
        """Why no interval should be quoted: the fit's doubts, but where the sizes of the sigmas are inferred."""
        return () if self.sample.posterior.noise.items else self.fitted.doubts

    @property
    def trust(self) -> dict[str, Any]:
        """What the chains say of themselves, and the shares of the optima, as plain data."""
        return {
            "doubts": list(self.withheld),
            "optima": list(self.sample.basins),
            "enough": [d.enough(self.sample.settings.target_ess) for d in self.sample.diagnosis],
            "diagnosis": [asdict(d) for d in self.sample.diagnosis],
            "weights": None if self.weights is None else asdict(self.weights),
        }


def sample_campaign(
    fitted: CampaignFit,
    *,
    settings: Settings = DEFAULT,
    noise: Sequence[str] = (),
    weights: bool = False,
    folder: Path | None = None,
    provenance: Mapping[str, str] | None = None,
    progress: Callable[[Iterable[int]], Iterable[int]] = iter,
) -> CampaignSample:
    """Sample the posterior of a fitted campaign.

    Args:
        fitted: from `fit_campaign`; its problem is what is sampled.
        settings: how; the threads are chosen here.
        noise: kinds of measurement whose sigma is known up to a factor only.
        weights: weigh several optima against each other, by nested sampling.
        folder: where checkpoints go; None for none.
        provenance: what else must be equal for a checkpoint to be gone on with.
        progress: wraps the numbers of the blocks, to show a bar.

    Raises:
        InputError: see `sample`.
        ModelError: see `sample`.
    """
    target = posterior(fitted.problem, noise)
    # damping ratios call LAPACK, which must not run twice at the same time under jax 0.10
    damped = "damping_ratio" in fitted.problem.kinds
    settings = replace(settings, threads=1 if damped else min(cores(), settings.ensembles))
    if weights:
        check_weighable(target)
    drawn = sample(fitted, target, settings, folder=folder, provenance=provenance, progress=progress)
    several = len(drawn.basins) > 1
    return CampaignSample(fitted, drawn, posterior_predictive(drawn), weigh(drawn) if several and weights else None)
