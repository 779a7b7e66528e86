"""The explorer's numbers as a report: slider values, and the response of the arm."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ident.arm.arm import stiffness_paths
from ident.report.report import Report, cut
from ident.report.words import unit_of
from ident.studies.look.predict_report import values_used

if TYPE_CHECKING:
    from ident.identify.values import Values
    from ident.studies.look.exploration import Exploration


def explore_sections(
    exploration: "Exploration",
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
    changed: Mapping[str, float] | None = None,
) -> Report:
    """Return the sliders of the page, and their initial values.

    Args:
        exploration: the input of the page.
        fit: fitted values of the arm.
        posterior: source of the marks.
        changed: numbers that were set, by path [SI].
    """
    arm, carried = exploration.arm, exploration.carried
    on_stroke = "place on the stroke" + " and speed" * bool(arm.drives)
    place = on_stroke if exploration.stroke else f"{len(arm.driven)} joint angles"
    mass = f"mass of {cut(carried.name, 30)}" if carried.kind == "payload" else f"mass at {cut(carried.name, 30)}"
    origin, cautions = values_used(fit, posterior, changed or {})
    lines = [f"Sliders: {len(stiffness_paths(arm))} stiffnesses, {mass} up to {carried.largest:g} kg, {place}."]
    lines += [f"Always on the arm: {exploration.fixed}."] if exploration.fixed else []
    lines += [f"Marks of 5 to 95 % at {len(exploration.bands)} stiffnesses."] if exploration.bands else []
    subject = f"{cut(arm.name, 60)} as a page to explore: open it in a browser"
    return Report(subject, answer=(*lines, *origin), findings=cautions)


def explore_rows(exploration: "Exploration") -> list[dict[str, Any]]:
    """Return a row for each number with a slider."""
    arm, carried = exploration.arm, exploration.carried
    rows = [{"name": p, "value": float(arm.get(p)), "unit": unit_of(p)} for p in stiffness_paths(arm)]
    return [*rows, {"name": f"{carried.kind} {carried.name}", "value": carried.present, "unit": "kg"}]
