"""The result file of a fit: JSON that says what was fitted, from what, how, and what came out."""

import json
import math
import platform
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ident.description.file import ArmFile
from ident.files import replace_file
from ident.identify.fit import CampaignFit
from ident.measure import Campaign
from ident.present.text.units import unit_of

FORMAT = "ident-fit/1"
LIBRARIES = ("ident", "jax", "optimistix", "emcee", "arviz", "numpy", "scipy")


def fit_document(result: CampaignFit, arm_file: ArmFile, options: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a fit as plain data, all numbers SI; infinite and undefined ones become null."""
    fit, known = result.fit, result.fit.information
    items = fit.problem.parameters.items
    document = provenance(FORMAT, arm_file, result.campaign, options) | {
        "parameters": [
            {
                "name": item.name,
                "paths": list(item.paths),
                "value": value,
                "unit": unit_of(item.name),
                "interval_95": list(interval),
                "data_support_interval": bool(supported),
                "fitted_as": "ln(value)" if item.positive else f"value / {float(item.scale):g}",
                "sd": sd,
                "sd_by_data_alone": data_sd,
                "prior_share": share,
                "prior": {"median": item.centre, "sd": item.prior_sd, "flat_half_width": item.flat},
            }
            for item, value, interval, supported, sd, data_sd, share in zip(
                items,
                fit.best.values,
                fit.interval(),
                result.supported,
                known.sd,
                known.data_sd,
                known.prior_share,
                strict=True,
            )
        ],
        "covariance": known.covariance,
        "correlation": known.correlation,
        "directions": [{"weights": d.weights, "sd": d.sd, "seen": d.seen, "weak": d.weak} for d in known.directions],
        "rank": known.rank,
        "chi_squared": fit.chi_squared,
        "degrees_of_freedom": fit.degrees_of_freedom,
        "p_value": fit.p_value,
        "measurements": [
            {
                "kind": m.kind,
                "posture": list(m.posture),
                "mode": m.mode,
                "point": m.point,
                "direction": m.direction,
                "load": str(m.load),
                "reference_load": str(m.reference_load),
                "measured": m.value,
                "sigma": m.sigma,
                "predicted": predicted,
                "predicted_sd": sd,
                "note": m.note,
            }
            for m, predicted, sd in zip(result.campaign, fit.predicted, fit.predicted_sd, strict=True)
        ],
        "tensions": [
            {"kind": t.kind, "rows": list(t.rows), "predicted": t.predicted, "sd": t.sd, "z": t.z}
            for t in result.cross_predictions
        ],
        "optima": [
            {"values": o.values, "cost": o.cost, "starts": o.starts, "converged": o.converged} for o in fit.optima
        ],
        "failed_starts": fit.failed,
    }
    return plain(document)


def provenance(form: str, arm_file: ArmFile, campaign: Campaign | None, options: Mapping[str, Any]) -> dict[str, Any]:
    """Say what a result was made from, with what and how: the head of every result file."""
    return {
        "format": form,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "software": {name: version(name) for name in LIBRARIES} | {"python": platform.python_version()},
        "options": dict(options),
        "inputs": {
            "arm": {"path": arm_file.path, "sha256": arm_file.sha256},
            "campaign": {"path": campaign.path, "sha256": campaign.sha256} if campaign is not None else None,
        },
    }


def rows(campaign: Campaign) -> dict[str, list[Any]]:
    """Return what is known of each measurement, as columns."""
    return {
        "kind": [m.kind for m in campaign],
        "row": [m.where for m in campaign],
        "mode": [m.mode or "" for m in campaign],
        "point": [m.point or "" for m in campaign],
        "sigma": [m.sigma for m in campaign],
    }


def write_json(document: Mapping[str, Any], path: Path) -> None:
    """Write a document whole or not at all.

    Raises:
        InputError: the folder or the file can't be written; what was there before is untouched.
    """
    text = json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
    replace_file(path, lambda file: file.write(text.encode("utf-8")), make_folders=True)


def plain(value: Any) -> Any:
    """Return a value as JSON knows it."""
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "shape"):
        return plain(np.asarray(value).tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value
