"""Draws of samples and diagnoses as ArviZ InferenceData, which other tools for posteriors read."""

import hashlib
import json
import math
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.assess.diagnose import Diagnosis
from ident.identify.compare import CampaignSample
from ident.identify.values import BEST_ONLY, Draws, Robot, scaled_by
from ident.inference.draws import LEVELS
from ident.present.files.document import check_format, plain, read_group, whole
from ident.present.files.fit import rows
from ident.text import LARGEST_BINARY, one_line, read_bytes

if TYPE_CHECKING:
    import arviz
    import xarray

EXPECTED = "a posterior of ident sample (.sample.nc)"


def inference_data(result: CampaignSample, head: Mapping[str, Any]) -> "arviz.InferenceData":
    """Return draws, simulated data, observed data and sampler statistics, with where they come from; all SI.

    Every walker is a chain, as ArviZ has it for emcee; `ensemble` and `optimum` say where a chain belongs. Burn-in is
    left out. A variable's attribute `paths` has the paths of the numbers that it stands for: several where tied.

    Args:
        result: the posterior.
        head: attributes of the file, written as JSON.
    """
    import arviz

    drawn, posterior = result.posterior_predictive, result.sample.posterior
    by_chain = result.sample.by_chain()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "More chains")  # every walker is one, and few steps may be enough
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
    data.sample_stats["ensemble"] = ("chain", by_chain.ensemble)
    data.sample_stats["optimum"] = ("chain", by_chain.optimum)
    data.sample_stats["acceptance"] = ("chain", result.sample.acceptance[by_chain.ensemble])
    for name, column in rows(result.fitted.campaign).items():
        data.observed_data[name] = ("measurement", np.asarray(column))
    return data


def groups_of(data: "arviz.InferenceData") -> "dict[str, xarray.Dataset]":
    """Return InferenceData as the groups of a netCDF file, compressed as `InferenceData.to_netcdf` does it."""
    import xarray

    groups = {"/": xarray.Dataset(attrs=data.attrs), **{name: data[name] for name in data.groups()}}
    for group in groups.values():
        for variable in group.variables.values():
            variable.encoding = {"zlib": True} if variable.dtype.kind in "biufc" else {}
    return groups


def sample_errors(result: CampaignSample) -> list[dict[str, float]]:
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


def read_posterior(form: str, path: str | Path) -> Draws:
    """Return the draws of a posterior file, of `ident sample` or of any tool that writes InferenceData.

    Args:
        form: the format that one of `ident sample` must have.
        path: the file.
    """
    where = one_line(str(path))
    data = read_bytes(path, EXPECTED, LARGEST_BINARY)
    with whole(path, "other contents", EXPECTED, "give the file that ident sample wrote"):
        root = read_group(path)
        own = str(json.loads(root.attrs.get("format", '""')))
        ours = own.startswith("ident-sample/")
        of_ident = own.startswith("ident-")
        arm_sha256 = str(json.loads(root.attrs["inputs"])["arm"]["sha256"]) if of_ident else ""
        doubts = json.loads(root.attrs.get("trust", "{}")).get("doubts", []) if of_ident else []
        chains, remark = _best(path)
        group = read_group(path, "posterior")
        by_paths = dict(_variables(group, chains))
        scaled = tuple(map(str, json.loads(group.attrs.get("scaled", "[]"))))
        document = json.loads(root.attrs.get("robot", "null")) if of_ident else None
        robot = Robot.read(document, arm_sha256)
    if ours:
        check_format(own, form, where, EXPECTED)
    draws = Draws(by_paths, where, hashlib.sha256(data).hexdigest(), remark, scaled, robot)
    return draws.doubted(tuple(map(str, doubts)))


def _variables(posterior: "xarray.Dataset", chains: slice | np.ndarray) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """Yield the paths and the draws of each variable, chain by chain."""
    for name, variable in posterior.data_vars.items():
        if variable.dims == ("chain", "draw"):
            paths = variable.attrs.get("paths")
            own = tuple(map(str, json.loads(paths))) if paths else (str(name),)
            yield own, np.asarray(variable.values, float)[chains].ravel()


def _best(path: str | Path) -> tuple[slice | np.ndarray, str]:
    """Return which chains are about the best optimum, and a remark if there are others."""
    try:
        optimum = np.asarray(read_group(path, "sample_stats")["optimum"].values)
    except (OSError, ValueError, KeyError):
        return slice(None), ""
    best = optimum == optimum.min()
    return best, "" if best.all() else BEST_ONLY


# -------- Diagnose
# The posterior of a diagnosis as a file.


def posterior_groups(diagnosis: Diagnosis, head: Mapping[str, Any]) -> "dict[str, xarray.Dataset]":
    """Return the posterior as the groups of a file of `ident sample`; `head` is the provenance."""
    sampled = diagnosis.identification.sampled
    return groups_of(inference_data(sampled, {**head, "trust": plain(sampled.trust)}))
