"""Values of an arm's numbers out of what `ident fit` and `ident sample` have written."""

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm
from ident.errors import InputError, Problem
from ident.identify.fit import CampaignFit
from ident.inference.sample import Sample
from ident.text import decode, one_line, read_bytes

if TYPE_CHECKING:
    import xarray

FIT = "ident-fit/2"
BEST_ONLY = "draws about the best optimum only; the others are left out"


@dataclass(frozen=True)
class Values:
    """Numbers of an arm that a result file tells.

    Attributes:
        path: the file; empty for what was computed in this process.
        sha256: hash of its bytes.
        values: by path in the arm, () or (draws,) [SI]; tied numbers each by its own path.
        left_out: names in the file that are no numbers of the arm.
        remark: what else a reader must know; mostly empty.
    """

    path: str
    sha256: str
    values: Mapping[str, Float[np.ndarray, "*draws"]]
    left_out: tuple[str, ...] = ()
    remark: str = ""

    @classmethod
    def of_fit(cls, fit: CampaignFit) -> "Values":
        """Return the fitted numbers of a fit that was made in this process."""
        return cls("", "", {path: np.asarray(value) for path, value in fit.fit.parameters.items()})

    @property
    def medians(self) -> dict[str, float]:
        """The median of each number's draws, or the number itself."""
        return {path: float(np.median(values)) for path, values in self.values.items()}

    def shuffled(self, seed: int) -> dict[str, np.ndarray]:
        """Return the draws in random order, so that any part of them is as good as any other."""
        order = np.random.default_rng(seed).permutation(len(next(iter(self.values.values()))))
        return {path: values[order] for path, values in self.values.items()}

    def without(self, paths: Mapping[str, Any]) -> dict[str, np.ndarray]:
        """Return the values of all numbers but those at some paths."""
        return {path: values for path, values in self.values.items() if path not in paths}


def read_fit(path: str | Path, arm: Arm) -> Values:
    """Return the fitted values of a result file of `ident fit`.

    Raises:
        InputError: the file is no such result, or has no number of this arm.
    """
    where, expected = one_line(str(path)), "a result file of ident fit (.fit.json)"
    data = read_bytes(path, expected)
    try:
        document = json.loads(decode(data, where))
        if document["format"] != FIT:
            raise KeyError
        found = {tuple(p["paths"]): np.asarray(float(p["value"])) for p in document["parameters"]}
    except (ValueError, KeyError, TypeError):
        raise InputError(Problem(where, "other contents", expected, "give the file that ident fit wrote")) from None
    return _of_arm(where, data, found, arm)


def read_draws(source: str | Path | Sample, arm: Arm, count: int, seed: int | None = None) -> Values:
    """Return draws of a posterior; about the best optimum if there are several.

    Args:
        source: a sample, or the file that `ident sample` has written (netCDF of InferenceData).
        arm: whose numbers are looked for.
        count: draws, at most; all if the file has fewer.
        seed: of a choice at random, none drawn twice; without one the draws are spread evenly over the chains.

    Raises:
        InputError: the file is no such posterior, or has no number of this arm.
    """
    read = _all_draws(source)
    return read.values(arm, _choice(read.total, min(count, read.total), seed))


def read_two_groups(
    source: str | Path | Sample, arm: Arm, count: int, fresh: int, seed: int = 0
) -> tuple[Values, Values | None]:
    """Return draws that are spread evenly over the chains, and others, chosen at random of those that are left.

    What was fitted to the first can be tested with the others.

    Args:
        source: see `read_draws`.
        arm: whose numbers are looked for.
        count: draws of the first group, at most; all if the file has fewer.
        fresh: draws of the second, at most; all that are left if these are fewer, None if there are none.
        seed: of the choice.

    Raises:
        InputError: see `read_draws`.
    """
    read = _all_draws(source)
    first = _choice(read.total, min(count, read.total), None)
    left = np.setdiff1d(np.arange(read.total), first)
    second = left[_choice(len(left), min(fresh, len(left)), seed)]
    return read.values(arm, first), read.values(arm, second) if len(second) else None


@dataclass(frozen=True)
class _Posterior:
    """All draws of a file, by the paths of each variable."""

    where: str
    data: bytes
    found: Mapping[tuple[str, ...], np.ndarray]
    remark: str

    @property
    def total(self) -> int:
        return min((len(values) for values in self.found.values()), default=0)

    def values(self, arm: Arm, chosen: np.ndarray) -> Values:
        drawn = {paths: values[chosen] for paths, values in self.found.items()}
        return _of_arm(self.where, self.data, drawn, arm, self.remark)


def _all_draws(source: str | Path | Sample) -> _Posterior:
    return _of_sample(source) if isinstance(source, Sample) else _read_posterior(source)


def _of_sample(sample: Sample) -> _Posterior:
    """Return the draws of a sample chain by chain, as its file has them."""
    best = np.array(sample.basin) == min(sample.basin)
    kept = np.moveaxis(sample.theta[sample.burn_in :, best], (3, 0), (0, -1))
    values = np.asarray(sample.posterior.parameters.values(jnp.asarray(kept.reshape(len(kept), -1))))
    paths = [item.paths for item in sample.posterior.parameters.items]
    return _Posterior("", b"", dict(zip(paths, values, strict=True)), "" if best.all() else BEST_ONLY)


def _read_posterior(path: str | Path) -> _Posterior:
    import xarray

    where, expected = one_line(str(path)), "a posterior of ident sample (.sample.nc)"
    data = read_bytes(path, expected)
    try:
        with xarray.open_dataset(path, group="posterior", engine="h5netcdf") as posterior:
            chains, remark = _best(path)
            found = dict(_variables(posterior.load(), chains, _ties(path)))
    except (OSError, ValueError, KeyError, TypeError, IndexError):
        raise InputError(Problem(where, "other contents", expected, "give the file that ident sample wrote")) from None
    return _Posterior(where, data, found, remark)


def _choice(total: int, count: int, seed: int | None) -> np.ndarray:
    if seed is not None:
        return np.sort(np.random.default_rng(seed).choice(total, count, replace=False))
    return np.floor((np.arange(count) + 0.5) * total / max(count, 1)).astype(int)


def _variables(
    posterior: "xarray.Dataset", chains: slice | np.ndarray, ties: Mapping[str, tuple[str, ...]]
) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """Yield the paths and the draws of each variable, chain by chain."""
    for name, variable in posterior.data_vars.items():
        if variable.dims == ("chain", "draw"):
            told = variable.attrs.get("paths")
            paths = tuple(json.loads(told)) if told else ties.get(str(name), (str(name),))
            yield paths, np.asarray(variable.values, float)[chains].ravel()


def _best(path: str | Path) -> tuple[slice | np.ndarray, str]:
    """Return which chains are about the best optimum, and a remark if there are others."""
    import xarray

    try:
        with xarray.open_dataset(path, group="sample_stats", engine="h5netcdf") as stats:
            optimum = np.asarray(stats["optimum"].values)
    except (OSError, ValueError, KeyError):
        return slice(None), ""
    best = optimum == optimum.min()
    return best, "" if best.all() else BEST_ONLY


def _ties(path: str | Path) -> dict[str, tuple[str, ...]]:
    """Return the tied paths by the first one, from the recorded options: for files that do not have them beside."""
    import xarray

    with xarray.open_dataset(path, engine="h5netcdf") as root:
        recorded = json.loads(root.attrs.get("options", "{}"))
    groups = (tuple(text.split("=")) for text in recorded.get("tie", ()))
    return {group[0]: group for group in groups}


def _of_arm(where: str, data: bytes, found: Mapping[tuple[str, ...], np.ndarray], arm: Arm, remark: str = "") -> Values:
    """Sort what was found by whether the arm has it."""
    known = set(arm.paths())
    values = {path: drawn for paths, drawn in found.items() for path in paths if path in known}
    left_out = tuple(path for paths in found for path in paths if path not in known)
    if not values:
        got = f"only {', '.join(left_out[:3])}" if left_out else "no variable"
        raise InputError(Problem(where, got, f"numbers of {arm.name}", "give the result of a fit of this arm"))
    if not all(np.isfinite(drawn).all() for drawn in values.values()):
        raise InputError(Problem(where, "a value that is not finite", "finite numbers", "run the fit or sample again"))
    return Values(where, hashlib.sha256(data).hexdigest() if data else "", values, left_out, remark)
