"""Draws as ArviZ InferenceData, the format that other tools for posteriors read."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.files import replace_path
from ident.inference.posterior_predictive import PosteriorPredictive
from ident.inference.posterior_summary import chains
from ident.inference.sample import Sample

if TYPE_CHECKING:
    import arviz


def inference_data(
    sample: Sample, drawn: PosteriorPredictive, rows: Mapping[str, Sequence[Any]], provenance: Mapping[str, Any]
) -> "arviz.InferenceData":
    """Return draws, simulated data, observed data and sampler statistics, with where they come from; all SI.

    Every walker is a chain, as ArviZ has it for emcee; `ensemble` and `optimum` say where a chain belongs. Burn-in is
    left out. A variable's attribute `paths` has the paths of the numbers that it stands for: several where tied.

    Args:
        sample: the draws.
        drawn: data that they predict.
        rows: what is known of each measured value, `(D,)` each.
        provenance: attributes of the file, written as JSON.
    """
    import arviz

    log, (ensembles, walkers) = sample.log_density[sample.burn_in :], sample.theta.shape[1:3]
    names, chain = sample.posterior.parameters.names, np.repeat(np.arange(ensembles), walkers)
    data = arviz.from_dict(
        posterior=dict(zip(names, chains(sample), strict=True)),
        posterior_predictive={"data": drawn.simulated[None], "predicted": drawn.predicted[None]},
        sample_stats={"lp": log.reshape(len(log), -1).T},
        observed_data={"data": np.asarray(sample.posterior.problem.measured)},
        dims={"data": ["measurement"], "predicted": ["measurement"]},
        attrs={name: json.dumps(part) for name, part in provenance.items()},
    )
    for item in sample.posterior.parameters.items:
        data.posterior[item.name].attrs["paths"] = json.dumps(item.paths)
    data.sample_stats["ensemble"] = ("chain", chain)
    data.sample_stats["optimum"] = ("chain", np.array(sample.basin)[chain])
    data.sample_stats["acceptance"] = ("chain", sample.acceptance[chain])
    for name, column in rows.items():
        data.observed_data[name] = ("measurement", np.asarray(column))
    return data


def write_netcdf(data: "arviz.InferenceData", path: Path) -> None:
    """Write InferenceData whole or not at all.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    replace_path(path, lambda part: data.to_netcdf(str(part), engine="h5netcdf"), make_folders=True)
