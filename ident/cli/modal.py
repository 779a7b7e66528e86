"""The command `ident modal`: from the files of a hammer or ambient test to a campaign."""

from pathlib import Path
from typing import Annotated

import typer

from ident.cli.command import NoFigureOption, OutOption, StrictOption, command, finish, leave
from ident.cli.output import output
from ident.studies.modal import ModalOptions, modal_test, new_channels


@command(ModalOptions)
def modal_command(
    tests: Annotated[
        Path,
        typer.Argument(help="folder of recordings: UFF, CSV, MAT, LVM, TDMS, WAV or HDF5, see docs/commands/modal.md"),
    ],
    options: ModalOptions,
    channels: Annotated[
        Path | None, typer.Option("--channels", help="channel table, a CSV file; default: channels.csv in the folder")
    ] = None,
    arm: Annotated[Path | None, typer.Option("--arm", help="arm description; default: arm.toml in the folder")] = None,
    init: Annotated[bool, typer.Option("--init", help="write the channel table to fill in, and stop")] = False,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
    strict: StrictOption = False,
) -> None:
    """Make a campaign of the files of a hammer test, or of one without force: modes with their covariance, names.

    Says which hits do not count, which lines are those of what turned, and which modes have no certain name, and why.
    Writes TESTS.modal.csv (a campaign for ident fit), .covariance.csv, .nc, .json and three figures for each posture
    into the folder given by --out.
    """
    if init:
        path, rows = new_channels(tests, channels, arm)
        output().wrote(path)
        output().say(f"{rows} channels to fill in; then: ident modal {tests}")
        return
    result = modal_test(tests, channels, arm, options)
    finish(result, out, no_figure)
    leave(result, strict=strict)
