"""The arm itself as a section of a page: drawn to scale, and what looks odd about its numbers."""

from ident.assess.arm_view import ArmView
from ident.present.figures.show import show_figure
from ident.present.html.explore.page import script_hash
from ident.present.html.moving_modes import READABLE, moving_modes
from ident.present.html.page import Frame, Picture, Section
from ident.present.html.picture import picture
from ident.present.text.show import sums

ALT = "The arm from the side and from above, with its bodies, mass centres, joints and points."
CAPTION = (
    "To scale. Boxes are the bodies' shapes, or, dashed, boxes of the same inertia; the area of a black dot is in "
    "proportion to the mass."
)
MODES_ALT = "The first modes of the arm, swinging about the arm at rest."
MODES_CAPTION = "The first modes, over the arm at rest (grey): all at one pace, far too slow; a mode has no amplitude."


def arm_section(view: ArmView, title: str) -> Section:
    """Return masses and reach of an arm, what looks odd, and its picture."""
    odd = [f"Looks odd: {each}." for each in view.oddities] or ["None of its numbers looks odd."]
    failure = [f"No modes: {view.failure}."] if view.failure else []
    drawn = [picture(show_figure(view, modes=False), ALT, CAPTION)]
    if view.analysis:
        still, moving = moving_modes(view, still=True), moving_modes(view)
        drawn.append(Picture(still, MODES_ALT, MODES_CAPTION, READABLE, moving))
    return Section(title, (f"{sums(view)}.", *failure, *odd), pictures=tuple(drawn))


def explorer_section(page: str, command: str) -> Section:
    """Return the explorer of an arm, within the report, and the command that makes it by itself."""
    words = (
        "Stiffnesses, payload, speed and place are changed with sliders; the Campbell diagram, the modes, the static"
    )
    frame = Frame(
        page,
        script_hash(),
        "The arm with sliders: modes, Campbell diagram, static deflection and steady response",
        "The explorer. It computes in the browser, with the exact mechanics, and asks for nothing.",
    )
    return Section(
        "The arm, to be changed by hand", (f"{words} deflection and the steady response follow.", command), frame=frame
    )
