"""The posterior of an arm's campaign, with its starting fit."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from ident.identify.fit import CampaignFit
from ident.inference.draws import PosteriorPredictive, Weights, check_weighable, posterior_predictive, weigh
from ident.inference.posterior import posterior
from ident.inference.sample import DEFAULT, Sample, Settings, sample
from ident.programs import Progress, cores


@dataclass(frozen=True)
class CampaignSample:
    """A sampled posterior of an arm's campaign.

    Attributes:
        fitted: the fit, arm and campaign with it.
        sample: the draws.
        posterior_predictive: data predicted by the draws about the best optimum.
        weights: shares of the optima; None for a single one, or if they are unknown.
    """

    fitted: CampaignFit
    sample: Sample
    posterior_predictive: PosteriorPredictive
    weights: Weights | None

    @cached_property
    def damping(self) -> dict[tuple[str, ...], Float[np.ndarray, "chains draws"]]:
        """Damping given stiffness, one draw for each draw, by the paths of damping numbers in an arm file."""
        if self.fitted.damping is None:
            return {}
        by_chain, names = self.sample.by_chain().values, self.sample.posterior.parameters.items
        draws = {path: own.ravel() for item, own in zip(names, by_chain, strict=True) for path in item.paths}
        own = set(self.fitted.damping.parameters)
        given = self.fitted.damping.given({path: x for path, x in draws.items() if path in own})
        return {paths: x.reshape(by_chain.shape[1:]) for paths, x in given.items()}

    @property
    def withheld(self) -> tuple[str, ...]:
        """Objections that suppress intervals: the fit's warnings, unless the sizes of the sigmas are inferred."""
        return () if self.sample.posterior.noise.items else self.fitted.doubts

    @property
    def trust(self) -> dict[str, Any]:
        """Diagnosis of the chains, and the shares of the optima, as plain data."""
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
    progress: Progress = iter,
) -> CampaignSample:
    """Sample the posterior of a fitted campaign.

    Args:
        fitted: from `fit_campaign`; its problem is sampled.
        settings: of the sampler; the number of threads is chosen here.
        noise: kinds of measurement whose sigma is known only up to a factor.
        weights: weigh several optima against each other, by nested sampling.
        folder: for checkpoints; None for none.
        provenance: further conditions that must be equal to continue from a checkpoint.
        progress: wraps the numbers of the blocks, to show a bar.

    Raises:
        InputError: see `sample`.
        ModelError: see `sample`.
    """
    target = posterior(fitted.problem, noise)
    # poles call LAPACK, which must not run concurrently under jax 0.10
    damped = fitted.posed.conditions.damped
    settings = replace(settings, threads=1 if damped else min(cores(), settings.ensembles))
    if weights:
        check_weighable(target)
    drawn = sample(fitted, target, settings, folder=folder, provenance=provenance, progress=progress)
    several = len(drawn.basins) > 1
    return CampaignSample(fitted, drawn, posterior_predictive(drawn), weigh(drawn) if several and weights else None)
