"""Write a page to explore an arm by hand: sliders, and the response of the arm."""

from collections.abc import Mapping
from dataclasses import field
from math import degrees, radians
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ident.errors import Problem, refusal, require
from ident.studies import reading
from ident.studies.door import DEFAULT, study
from ident.studies.options import STROKE_PROFILES, option
from ident.studies.result import Result
from ident.studies.shared import FARTHEST, ArmOptions, is_angle, with_numbers

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.values import Values
    from ident.measure import Campaign
    from ident.studies.look.exploration import Exploration
    from ident.vibrate.motion import Motion

BESIDE = 0.05
"""Tolerance [deg] of a posture from the stroke."""


class ExploreOptions(ArmOptions):
    """Options of `ident.explore`: the initial state of the page, and the payload of its slider."""

    payload: str = option("", "payload or point whose mass can be changed; default: the first payload, or the end")
    posture: tuple[float, ...] = option(
        (), "joint angles in degrees to begin with, as 30,-60,30", short="-q", read=reading.several
    )
    speed: float = option(10.0, "percent of full speed to begin with", low=1.0, high=120.0)
    profile: str | None = option(
        None, "how the stroke's speed rises and falls; the arm file's by default", choices=STROKE_PROFILES
    )
    draws: int = option(200, "draws of the posterior", low=2, high=100_000)

    def problems(self) -> list[Problem]:
        """Return a negative mass or stiffness, or an invalid posture."""
        wrong = Problem("posture", f"{self.posture}", f"several angles within {FARTHEST:g} deg", "as (30, -60, 30)")
        return [*super().problems(), *([] if all(map(is_angle, self.posture)) else [wrong])]


class ExploreResult(Result):
    """An arm as a page: one HTML file that loads nothing and computes by itself.

    The table has a row for each stiffness [SI] and mass [kg] with a slider: name, value, unit. There is no figure: the
    page draws.

    Attributes:
        arm: the arm as in its file.
        exploration: the input of the page.
        options: the options of the call.
        posture: (driven,) [deg] initial posture of the page.
        fit: fitted values of the arm.
        posterior: draws of the arm's numbers.
    """

    arm: "ArmFile"
    exploration: "Exploration"
    options: ExploreOptions = field(default_factory=ExploreOptions)
    posture: tuple[float, ...] = ()
    fit: "Values | None" = None
    posterior: "Values | None" = None

    form = "ident-explore/1"
    subject = "arm.name"
    suffix = ".html"
    shown, drawn = ("exploration", "fit", "posterior", "options.set"), ()
    listed = ("exploration",)
    made_from = ("arm", "fit", "posterior", "exploration.measured")

    def page(self) -> str:
        """Return the page as HTML."""
        from ident.studies.look.explore_page import Start, explore_page

        options = self.options
        start = Start(self.posture, options.speed, options.soft_base, options.set)
        return explore_page(self.exploration, self.arm, start, fit=self.fit, posterior=self.posterior)

    def _write(self, path: Path, head: Mapping[str, Any]) -> tuple[Path, ...]:
        from ident.files import write_text

        write_text(path, self.page())
        return (path,)


@study
def explore(
    arm: "ArmFile",
    options: ExploreOptions = DEFAULT,
    *,
    fit: "Values | None" = None,
    posterior: "Values | None" = None,
    measured: "Campaign | None" = None,
) -> ExploreResult:
    """Make a page to change stiffnesses, payload, speed and posture of an arm by hand.

    It shows the arm and its modes, natural frequencies [Hz] along the motion against the pulleys', static deflection
    and steady response, computed by the page itself: no network, no server.

    Args:
        arm: the arm.
        options: initial posture, load and speed; numbers to change.
        fit: fitted values for the arm: a result, or its file.
        posterior: draws for marks at 5 and 95 % of each stiffness, or the file of `ident sample`; the arm takes their
            medians unless it has fitted values.
        measured: a campaign, whose values are shown next to the computed ones.

    Raises:
        InputError: a posture of the wrong length, an unknown load or number, an arm without any point; a file that does
            not match the arm.
    """
    from ident.identify.modal_analysis import modal_analysis
    from ident.measure import Load
    from ident.studies.look.exploration import exploration

    changed = with_numbers(arm.arm, fit or posterior, options.set)
    draws, load = posterior.without(options.set) if posterior else {}, Load.parse(options.load)
    posture, extension = options.posture or _middle(changed), _extension(changed, options.profile)
    modal_analysis(changed, tuple(map(radians, posture)), load)  # an arm that collapses there has nothing to show
    if options.posture:
        _check_on_stroke(changed, options.posture)
    made = exploration(changed, load, options.payload, extension, draws, measured)
    return ExploreResult(arm, made, options, posture, fit, posterior)


def _check_on_stroke(arm: "Arm", posture: tuple[float, ...]) -> None:
    import numpy as np

    if arm.stroke is not None:
        direction, q = np.asarray(arm.stroke.direction), np.array(posture)
        alpha = q @ direction / (direction @ direction)
        if np.abs(q - alpha * direction).max() > BESIDE:
            got, expected = f"{posture} deg", f"a posture on the stroke, as {tuple((30 * direction).tolist())}"
            raise refusal("posture", got, expected, "the page moves the arm along its [stroke]")


def _middle(arm: "Arm") -> tuple[float, ...]:
    """Return the middle of the stroke [deg], where the pulleys turn; all angles zero without a stroke."""
    if arm.stroke is None:
        return (0.0,) * len(arm.driven)
    alpha = round(degrees(float(arm.stroke.folded) + float(arm.stroke.unfolded)) / 2)
    return tuple(float(share) * alpha for share in arm.stroke.direction)


def _extension(arm: "Arm", profile: str | None) -> "Motion | None":
    from ident.vibrate.motion import stroke

    if arm.stroke is None:
        require(profile is None, "profile", "it for an arm without a stroke", "a [stroke] in the file", "drop it")
        return None
    return stroke(arm.stroke, profile=profile)
