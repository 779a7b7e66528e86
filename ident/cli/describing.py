"""Commands about files: what an arm is and what its names are, what a result says."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from ident.cli import running
from ident.cli.command import NoFigureOption, OutOption, plain
from ident.cli.output import output, say_notes
from ident.errors import InputError, Problem
from ident.studies.new import KINDS
from ident.text import read_bytes

NEXT = """Example numbers: every one is marked as assumed, or simulated. Next:
  ident show {arm}          the arm drawn, and what looks odd
  ident show {arm} --names  the names that commands and campaigns take
  ident check {campaign}     what the measurements can tell
  ident fit {campaign}       the stiffnesses"""
RESULTS = (".json", ".nc")
"""How result files end."""
STARTS = (b"{", b"\x89HDF")
"""How result files begin."""

ShownArgument = Annotated[
    Path,
    typer.Argument(
        metavar="file",
        help="an arm (.toml, .urdf or .xml), or a result: .json, or .nc of sample and diagnose",
    ),
]


@plain("show")
def show(
    file: ShownArgument,
    posture: Annotated[
        str | None, typer.Option("--posture", "-q", help="joint angles of the drawn arm in degrees, as 30,-60,30")
    ] = None,
    names: Annotated[
        bool, typer.Option("--names", help="list the names that options, campaigns and --set take, and draw nothing")
    ] = False,
    out: OutOption = Path("out"),
    no_figure: NoFigureOption = False,
) -> None:
    """Draw an arm and say what looks odd about it, list its names, or print a saved result again.

    Of an arm: masses and reach, first modes, every number with its origin, and a warning for each that looks wrong.
    Writes into the folder given by --out ARM.show.png, and ARM.show.modes.svg, in which the first modes move: any
    browser opens it. With --names: numbers with value, unit and origin, joints, points, loads, modes, kinds of
    measurement, and the words that options choose from. Of a result: the report, as the command printed it that has
    written the file. Names and results write nothing.
    """
    if is_result(file):
        for flag, given in (("--posture", posture is not None), ("--names", names)):
            if given:
                raise InputError(Problem(flag, "it for a result", "an arm", "leave it out"))
        _show_result(file)
        return
    if names:
        if posture is not None:
            raise InputError(Problem("--posture", "it with --names", "one of them", "drop one"))
        _list_names(file)
        return
    running.check_folder(out)
    running.start()
    from ident.studies import reading
    from ident.studies.show import show as draw

    try:
        picture = draw(file, None if posture is None else reading.postures([posture], "--posture")[0])
    except InputError as error:
        flags = {"posture": "--posture"}
        raise InputError(replace(p, where=flags.get(p.where, p.where)) for p in error.problems) from None
    output().say(picture.report())
    output().document = picture.document
    for path in () if no_figure else picture.save_figures(out):
        output().wrote(path)


def is_result(file: Path) -> bool:
    """Tell by its end, and else by its beginning, whether a file is a result, and no arm.

    Raises:
        InputError: there is no such file.
    """
    if file.suffix in RESULTS:
        return True
    expected = "an arm description (TOML, URDF or MJCF) or a result file of ident (.json or .nc)"
    return read_bytes(file, expected).startswith(STARTS)


def _show_result(file: Path) -> None:
    running.start()
    from ident.studies.load import load

    result = load(file)
    say_notes(result.notes)
    output().say(result.report())
    output().document = result.document


def _list_names(arm: Path) -> None:
    running.start()
    from ident.studies.show import names

    found = names(arm)
    output().say(found.report(), nl=False)
    output().document = found.document


@plain("new")
def new(
    kind: Annotated[str, typer.Argument(help=f"{' or '.join(KINDS)}; with --robot, the folder")],
    folder: Annotated[Path | None, typer.Argument(help="folder to make")] = None,
    robot: Annotated[
        Path | None, typer.Option("--robot", "--urdf", help="robot description (URDF or MJCF) to take the arm from")
    ] = None,
    tip: Annotated[
        str | None,
        typer.Option("--tip", help="link, body or site of it that the arm ends with; default: the end of the chain"),
    ] = None,
) -> None:
    """Write an arm and a campaign with example numbers into a new folder, ready to run and to be filled in.

    As `ident new scara my_robot`, or `ident new my_robot --robot robot.urdf`. Writes arm.toml, in which every number
    has a comment or an origin, and campaign.csv, simulated with stiffnesses that it states.
    """
    from ident.studies import new as study

    if robot is not None and folder is None:
        folder = Path(kind)
    elif robot is not None:
        remedy = "as ident new my_robot --robot robot.urdf"
        raise InputError(Problem("", "a kind and --robot", "one of them", remedy))
    if tip is not None and robot is None:
        raise InputError(Problem("--tip", "a tip without --robot", "a robot description that has it", "leave it out"))
    if folder is None:
        raise InputError(Problem("", "no folder", "the folder to make", f"as ident new {KINDS[0]} my_robot"))
    running.check_folder(folder)
    if robot is None:
        made = study.new(kind, folder)
    else:
        running.start()
        made = study.new_from_robot(robot, folder, tip)
    say_notes(made.notes)
    output().document = lambda: {"notes": list(made.notes)} if made.notes else {}
    for path in made.paths:
        output().wrote(path)
    output().say(NEXT.format(arm=made.paths[0], campaign=made.paths[1]))
