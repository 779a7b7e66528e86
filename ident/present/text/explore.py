"""What `ident explore` prints: what the page it has written is about."""

from collections.abc import Mapping
from typing import Any

from ident.arm.arm import stiffness_paths
from ident.assess.exploration import Exploration
from ident.identify.values import Values
from ident.present.text.basis import changes_in_words, values_in_words
from ident.present.text.units import unit_of
from ident.present.text.words import cut, paragraphs


def explore_report(
    exploration: Exploration,
    *,
    fit: Values | None = None,
    posterior: Values | None = None,
    changed: Mapping[str, float] | None = None,
) -> str:
    """Say which sliders the page has, and what its numbers begin with.

    Args:
        exploration: what the page knows of the arm.
        fit: fitted values that the arm has taken over.
        posterior: draws that the marks are from.
        changed: numbers that were set, by path [SI].
    """
    arm, carried = exploration.arm, exploration.carried
    on_stroke = "place on the stroke" + " and speed" * bool(arm.drives)
    place = on_stroke if exploration.stroke else f"{len(arm.driven)} joint angles"
    mass = f"mass of {cut(carried.name, 30)}" if carried.kind == "payload" else f"mass at {cut(carried.name, 30)}"
    head = [
        f"{cut(arm.name, 60)}, to be explored in a browser",
        f"  sliders: {len(stiffness_paths(arm))} stiffnesses, {mass} up to {carried.largest:g} kg, {place}",
        f"  always on it: {exploration.fixed}" if exploration.fixed else "",
        f"  marks of 5 to 95 % at {len(exploration.bands)} stiffnesses" if exploration.bands else "",
        *values_in_words(fit, posterior),
        *changes_in_words(changed or {}),
    ]
    return paragraphs([filter(None, head)])


def slider_rows(exploration: Exploration) -> list[dict[str, Any]]:
    """Return a row for each number that has a slider."""
    arm, carried = exploration.arm, exploration.carried
    rows = [{"name": p, "value": float(arm.get(p)), "unit": unit_of(p)} for p in stiffness_paths(arm)]
    return [*rows, {"name": f"{carried.kind} {carried.name}", "value": carried.present, "unit": "kg"}]
