"""Make the campaigns of `ident new` anew, after a template arm has changed: `python tests/support/templates.py`."""

from pathlib import Path

import jax

from ident.description.file import read_arm
from ident.measure.reading import campaign_text
from ident.studies.look.example import Example, example

TEMPLATES = Path(__file__).parents[2] / "ident" / "description" / "templates"


def made(arm: Path) -> tuple[Example, str]:
    """Return the campaign on a template arm, and its text."""
    found = example(read_arm(arm).arm)
    return found, campaign_text(found.campaign, header_comments=found.comments)


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    for arm in sorted(TEMPLATES.glob("*.toml")):
        arm.with_suffix(".csv").write_text(made(arm)[1], encoding="utf-8")
