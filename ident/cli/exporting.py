"""The command `ident export`: what was identified, in the robot's own description."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli import running
from ident.cli.command import plain
from ident.cli.output import output
from ident.errors import InputError
from ident.studies.options import Options, renamed


@plain("export")
def export(
    result: Annotated[Path, typer.Argument(help="result of ident fit (.fit.json) or ident sample (.sample.nc)")],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="file to write: .xml (MJCF), .urdf, .toml or .json", show_default=False)
    ],
    arm: Annotated[
        Path | None, typer.Option("--arm", help="description to write into; default: the one that was fitted")
    ] = None,
    posture: Annotated[
        str | None,
        typer.Option("--posture", "-q", help="joint angles in degrees, as 30,-60,30, where MJCF is exact under weight"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="write into the description of another robot, too")] = False,
) -> None:
    """Write what was identified into the robot's own description, or as JSON.

    MJCF gets three passive hinges before each driven one, URDF a comment, both .joints.toml beside them, by which ident
    reads them; an arm file the values, with the origin calibrated. Of a posterior the medians are written.
    """
    running.start()
    from ident.studies import reading
    from ident.studies.export import export as write

    at = None if posture is None else reading.postures([posture], "--posture")[0]
    try:
        written = write(result, out, arm=arm, posture=at, force=force)
    except InputError as error:
        raise InputError(renamed(Options, problem) for problem in error.problems) from None
    for path in written:
        output().wrote(path)
