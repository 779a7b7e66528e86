"""The arm itself as a section of a page: drawn to scale, and what looks odd about its numbers."""

from ident.assess.arm_view import ArmView
from ident.present.figures.show import show_figure
from ident.present.html.page import Section
from ident.present.html.picture import picture
from ident.present.text.show import sums

ALT = "The arm from the side and from above, with its bodies, mass centres, joints and points, and its first modes."
CAPTION = (
    "To scale. Boxes are the bodies' shapes, or, dashed, boxes of the same inertia; the area of a black dot is in "
    "proportion to the mass. Below, the first modes over the arm at rest; a mode has no amplitude."
)


def arm_section(view: ArmView) -> Section:
    """Return masses and reach of an arm, what looks odd, and its picture."""
    odd = [f"Looks odd: {each}." for each in view.oddities] or ["None of its numbers looks odd."]
    failure = [f"No modes: {view.failure}."] if view.failure else []
    drawn = (picture(show_figure(view), ALT, CAPTION),)
    return Section("The arm with the identified numbers", (f"{sums(view)}.", *failure, *odd), pictures=drawn)
