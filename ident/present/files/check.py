"""What a check found, as rows."""

from typing import Any

from ident.identify.check import CampaignCheck


def check_rows(check: CampaignCheck) -> list[dict[str, Any]]:
    """Return a row for each parameter: verdict, and standard deviations of theta by the data alone [-].

    NaN where the model has no answer.
    """
    sd = check.data_sd
    return [
        {
            "parameter": name,
            "verdict": verdict,
            "data_sd": float(sd[0, i]) if len(sd) else float("nan"),
            "worst_data_sd": float(sd[:, i].max()) if len(sd) else float("nan"),
        }
        for i, (name, verdict) in enumerate(zip((item.name for item in check.items), check.verdicts, strict=True))
    ]
