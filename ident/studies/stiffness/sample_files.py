"""A sampled posterior as ArviZ InferenceData, which other tools for posteriors read."""

import json
import math
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.identify.values import scaled_by
from ident.inference.draws import LEVELS
from ident.report.document import Group

if TYPE_CHECKING:
    import arviz
    import xarray

    from ident.identify.sample import CampaignSample


def inference_data(result: "CampaignSample", head: Mapping[str, Any]) -> "arviz.InferenceData":
    """Return draws, simulated data, observed data and sampler statistics, with their provenance; all SI.

    Every walker is a chain, as ArviZ has it for emcee; `ensemble` and `optimum` say where a chain belongs. Burn-in is
    left out. The attribute `paths` of a variable lists the paths of its numbers: several if tied.

    Args:
        result: the posterior.
        head: attributes of the file, written as JSON.
    """
    import arviz

    drawn, posterior = result.posterior_predictive, result.sample.posterior
    by_chain = result.sample.by_chain()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "More chains")  # every walker is a chain, and few steps may be enough
        data = arviz.from_dict(
            posterior=dict(zip(posterior.parameters.names, by_chain.values, strict=True)),
            posterior_predictive={"data": drawn.simulated[None], "predicted": drawn.predicted[None]},
            sample_stats={"lp": by_chain.log_density},
            observed_data={"data": np.asarray(posterior.problem.measured)},
            dims={"data": ["measurement"], "predicted": ["measurement"]},
            attrs={name: json.dumps(part) for name, part in head.items()},
        )
    data.posterior.attrs["scaled"] = json.dumps(scaled_by(posterior.problem))
    for item in posterior.parameters.items:
        data.posterior[item.name].attrs["paths"] = json.dumps(item.paths)
    for paths, own in result.damping.items():
        data.posterior[paths[0]] = (("chain", "draw"), own)
        data.posterior[paths[0]].attrs["paths"] = json.dumps(paths)
    data.sample_stats["ensemble"] = ("chain", by_chain.ensemble)
    data.sample_stats["optimum"] = ("chain", by_chain.optimum)
    data.sample_stats["acceptance"] = ("chain", result.sample.acceptance[by_chain.ensemble])
    for name in ("kind", "where", "mode", "point", "joint", "sigma"):
        column = [getattr(m, name) or "" for m in result.fitted.campaign]
        data.observed_data["row" if name == "where" else name] = ("measurement", np.asarray(column))
    return data


def groups_of(data: "arviz.InferenceData") -> "dict[str, Group | xarray.Dataset]":
    """Return InferenceData as the groups of a netCDF file."""
    return {"/": Group({}, data.attrs), **{name: data[name] for name in data.groups()}}


def sample_errors(result: "CampaignSample") -> list[dict[str, float]]:
    """Return Monte Carlo standard errors of the numbers of `sample_rows` [SI]; infinite for diagnostics of the chains.

    References:
        Vehtari et al., "Rank-normalization, folding, and localization: an improved R-hat", Bayesian Analysis 16 (2021):
        quantiles.
    """
    import arviz

    sample, by_chain = result.sample, result.sample.by_chain()
    levels = dict(zip(("low_95", "low_50", "median", "high_50", "high_95"), LEVELS, strict=True))
    own = [by_chain.values[:, by_chain.optimum == basin] for basin in sample.basins]
    return [
        {name: float(arviz.mcse(draws, method="quantile", prob=level)) for name, level in levels.items()}
        | {"effective_samples": math.inf, "r_hat": math.inf}
        for basin in own
        for draws in basin
    ]
