"""Values from another study's result: fitted values, and draws of a posterior."""

from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import refusal, require
from ident.studies.shared import ArmOptions, as_file

if TYPE_CHECKING:
    from ident.arm.arm import Arm
    from ident.description.file import ArmFile
    from ident.identify.values import Draws, Robot, Values
    from ident.studies.saved import Saved
    from ident.studies.stiffness.fit import FitResult
    from ident.studies.stiffness.sample import SampleResult


def fitted_values(
    fit: "Values | FitResult | str | Path", arm: "Arm | ArmFile", options: ArmOptions | None = None
) -> "Values":
    """Return fitted values from any of their sources, with the objections to them.

    Args:
        fit: a result, its file, or values that were read before, which are returned unchanged.
        arm: numbers are matched to this arm; it stands on the options' base.
        options: the base of the arm, the set numbers, and whether another robot's values are accepted.

    Raises:
        InputError: neither a fit nor its file, a fit without any number of this arm, or one of another robot.
    """
    from ident.identify.values import Values
    from ident.studies.result_values import read_fit

    own, options = as_file(arm), options or ArmOptions()
    if isinstance(fit, Values):
        return fit
    if isinstance(fit, str | Path):
        values, robot, base = read_fit(fit, own.arm)
    elif hasattr(fit, "values_of"):
        values, robot, base = fit.values_of(own.arm)
    else:
        raise refusal("fit", f"a {type(fit).__name__}", "a result of ident.fit, or its file", "give that")
    if base != options.soft_base:  # its compliance would count twice, or in the wrong place
        got, expected = (f"a base that gives at {x:g} m" if x else "a rigid base" for x in (base, options.soft_base))
        remedy = f"give `soft_base` {base:g} here, too" if base else "fit with `soft_base`, too"
        raise refusal("fit", f"values that were fitted on {got}", expected, remedy)
    return _of_this_robot(values, robot, own, options)


def _of_this_robot(values: "Values", robot: "Robot", own: "ArmFile", options: ArmOptions) -> "Values":
    """Refuse values that were identified on another robot."""
    from ident.identify.values import Robot, of_this_robot

    designed = [path for path, origin in own.origins.items() if origin == "designed"]
    here = Robot.of(own.arm, own.sha256)
    return of_this_robot(values, robot, here, changed=options.set, designed=designed, force=options.force)


def drawn_values(
    posterior: "Values | SampleResult | str | Path | None",
    arm: "Arm | ArmFile",
    count: int,
    seed: int | None = None,
    options: ArmOptions | None = None,
) -> "Values | None":
    """Return draws of a posterior from any of their sources; None for none.

    Args:
        posterior: a result, its file, or draws that were chosen before, which are returned unchanged.
        arm: numbers are matched to this arm.
        count: draws, at most.
        seed: of a random choice; without one the draws are spread evenly over the chains.
        options: the set numbers, and whether another robot's draws are accepted.

    Raises:
        InputError: no posterior, one without any number of this arm, or one of another robot.
    """
    from ident.identify.values import Values

    if posterior is None or isinstance(posterior, Values):
        return posterior
    own, draws = as_file(arm), _draws(posterior)
    return _of_this_robot(draws.some(own.arm, count, seed), draws.robot, own, options or ArmOptions())


def drawn_groups(
    posterior: "Values | SampleResult | str | Path | None",
    arm: "Arm | ArmFile",
    count: int,
    fresh: int,
    seed: int = 0,
    options: ArmOptions | None = None,
) -> "tuple[Values | None, Values | None]":
    """Return two disjoint groups of draws, to search with and to verify with; None for none.

    Args:
        posterior: a result, its file, or draws that were chosen before: the first group, without a second.
        arm: numbers are matched to this arm.
        count: draws of the first group, at most.
        fresh: draws of the second, at most.
        seed: of the choice.
        options: the set numbers, and whether another robot's draws are accepted.
    """
    from ident.identify.values import Values

    if posterior is None or isinstance(posterior, Values):
        return posterior, None
    own, draws = as_file(arm), _draws(posterior)
    first, second = draws.two_groups(own.arm, count, fresh, seed)
    return _of_this_robot(first, draws.robot, own, options or ArmOptions()), second


def _draws(posterior: "SampleResult | Saved | str | Path") -> "Draws":
    from ident.studies.result_values import read_posterior

    if isinstance(posterior, str | Path):
        return read_posterior(posterior)
    got, expected = f"a {type(posterior).__name__}", "a result of ident.sample, or its file"
    require(hasattr(posterior, "posterior_draws"), "posterior", got, expected, "give that")
    return posterior.posterior_draws()
