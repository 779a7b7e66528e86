"""A sheet to measure by: the hammer or tap tests of a plan as a page to print, and the channel table of their files."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.description.file import ArmFile
from ident.description.rewriting import arm_text, point_text, with_first
from ident.errors import InputError, refusal
from ident.files import together, write_text
from ident.identify.candidates import HammerPlan, with_pins
from ident.measure import Load
from ident.measure.channels import ARM, CHANNELS, FORCE, RESPONSE, TAP, is_table
from ident.measure.load import parse_direction
from ident.measure.recordings import is_recording
from ident.measure.table import csv_text
from ident.report.handout import inputs_table
from ident.report.page import Page, Section, picture, provenance, write_page
from ident.report.report import cut
from ident.report.templates import template_of
from ident.report.words import counted, degrees
from ident.studies.look.arm_view import ArmView, arm_view
from ident.studies.look.show_figure import (
    PITCH,
    Mark,
    Panel,
    draw_frame,
    draw_solid,
    label,
    span_of,
    views,
)
from ident.studies.stiffness.plan_report import angle_cells
from ident.text import as_word, one_line, read_text

if TYPE_CHECKING:
    from ident.identify.plan import CampaignPlan


@dataclass(frozen=True)
class SheetPosture:
    """A posture of the sheet.

    Attributes:
        number: from 1.
        test: what the plan says of it.
        angles: joint angles as in the plan's campaign, by column.
        word: what is done to the arm: `tap`, or `hit` with a measured force, for which input 1 of the recorder is.
        load: load case, the sensors included where their mass is known.
        sensors: input of the recorder, point, and positive direction of each.
        pushes: file without its ending, point, and direction of each.
    """

    number: int
    test: HammerPlan
    angles: Mapping[str, str]
    word: str
    load: Load
    sensors: tuple[tuple[str, ...], ...]
    pushes: tuple[tuple[str, ...], ...]


def sheet_postures(plan: "CampaignPlan", tests: Iterable[HammerPlan], tap: bool, mass: float) -> Iterator[SheetPosture]:
    """Yield the postures of a plan's tests, with a mass [kg] of sensors at each point; vertical pushes go down."""
    word, first = (TAP, 1) if tap else ("hit", 2)
    for number, test in enumerate(tests, 1):
        sensors, hits = ([at.replace(" ", " +") for at in places] for places in (test.sensors, test.hits))
        inputs = tuple((f"{i}", *at.split()) for i, at in enumerate(sensors, first))
        pushes = tuple((f"p{number}_{word}{i}", *at.replace("+z", "-z").split()) for i, at in enumerate(hits, 1))
        own = [(mass, point) for point in {point for _, point, _ in inputs} if mass]
        load = replace(test.load, masses=(*test.load.masses, *own))
        yield SheetPosture(number, test, angle_cells(plan, test.posture), word, load, inputs, pushes)


# -------- Files

COMMENT = "Made by `ident plan` before any recording: fill in unit, sensitivity, rate [Hz] where the files have none."


def write_sheet(
    folder: Path, file: ArmFile, postures: Sequence[SheetPosture], head: Mapping[str, Any]
) -> tuple[Path, ...]:
    """Write `sheet.html`, `channels.csv` and the arm into a folder, where `ident modal` looks for the recordings.

    Raises:
        InputError: the folder has recordings that another table describes, or it can't be written to.
    """
    placed, text = with_used_pins(file, {point for each in postures for _, point, _ in (*each.sensors, *each.pushes)})
    columns = ("file", "channel", "role", "point", "direction", "unit", "sensitivity", "rate", *postures[0].angles)
    rows = (row for each in postures for row in channel_rows(each))
    table = csv_text((*columns, "load", "excitation", "taps"), rows, [COMMENT])
    page, channels, arm = (folder / name for name in ("sheet.html", CHANNELS, ARM))
    recorded = folder.is_dir() and any(is_recording(each) and not is_table(each) for each in folder.iterdir())
    if recorded and not (channels.is_file() and channels.read_bytes() == table.encode()):
        got, remedy = "recordings by another channel table", "choose another folder (--out), or move them away"
        raise refusal(one_line(str(folder)), got, "a folder without recordings", remedy)
    with together():
        write_page(sheet_page(placed, postures, head, folder.name), page)
        write_text(channels, table)
        write_text(arm, text)
    return page, channels, arm


def with_used_pins(file: ArmFile, used: set[str]) -> tuple[ArmFile, str]:
    """Return the arm with the pins in use as points, and its text; one without a TOML file as `arm_text` writes it."""
    pins = [point for point in with_pins(file.arm).points if point.name in used and point not in file.arm.points]
    placed = replace(file, arm=eqx.tree_at(lambda a: a.points, file.arm, (*pins, *file.arm.points)))
    if not file.path.endswith(".toml"):
        return placed, arm_text(placed.arm, origin="derived")
    text, new = read_text(Path(file.path), "an arm"), "".join(point_text(pin, "derived") for pin in pins)
    try:
        return placed, with_first("point", text, new, file.path) if pins else text
    except InputError:  # points within a line
        return placed, arm_text(placed.arm, origin="derived")


def channel_rows(each: SheetPosture) -> Iterator[dict[str, str]]:
    """Yield the rows of a posture in the channel table: for each file the force, if measured, and the responses."""
    tap = each.word == TAP
    state = {**each.angles, "load": str(each.load), "excitation": TAP * tap}
    for file, *push in each.pushes:
        forces = [] if tap else [(FORCE, "1", *push)]
        for role, i, point, axis in (*forces, *((RESPONSE, *sensor) for sensor in each.sensors)):
            taps = f"{each.test.count}" if tap or role == FORCE else ""
            row = {"file": f"{file}*", "channel": i, "role": role, "point": point, "direction": axis, "taps": taps}
            yield state | row


# -------- Page


def sheet_page(file: ArmFile, postures: Sequence[SheetPosture], head: Mapping[str, Any], folder: str) -> Page:
    """Return the sheet as a page: what to do, then a page for each posture."""
    body: Any = template_of("ident.studies.stiffness", "plan_sheet.html.jinja").module
    sections = [Section("What to do", (body.steps(postures[0], folder, CHANNELS, as_word(folder)),))]
    for each in postures:
        view, title = arm_view(file, each.test.posture), f"Posture {each.number}: {degrees(each.test.posture)}"
        hung = tuple(s for s in view.solids if s.kind != "payload" or s.name in each.test.load.payloads)
        drawn = picture(posture_figure(replace(view, solids=hung), each), title, body.caption)
        sections.append(Section(title, (body.posture(each, file.arm.driven, view.points),), (drawn,)))
    kind = "Tap" if postures[0].word == TAP else "Hammer"
    title = f"{kind} test of {cut(file.arm.name, 60)}: {counted(len(postures), 'posture')}"
    return Page(title, str(head["created"])[:10], None, (), tuple(sections), inputs_table(head), provenance(head))


# -------- Picture

WIDTH, TALL, BESIDE, ROOM = 6.9, 3.6, 1.45, 0.35
"""Width of the picture, height of both views together, room for labels next to them and for their titles [inch]."""
THIN = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
BLOCK = {"arrowstyle": "simple,head_width=1.1,tail_width=0.5", "facecolor": "white", "edgecolor": "black"}


def posture_figure(view: ArmView, each: SheetPosture) -> Figure:
    """Draw an arm from the side and from above in black, with sensors and their axes, and where to push."""
    low, high = span_of(view)
    size = float((high - low).max() or 1.0)
    corners = [np.sort(seen.of(np.stack([low - 0.15 * size, high + 0.15 * size], 1)), 1) for seen in views(view)]
    wide, tall = np.ptp(corners, 2).T
    scale = float(min((WIDTH - 2 * BESIDE) / wide.max(), TALL / tall.sum()))
    tall = np.maximum(tall, PITCH * (len(each.sensors) + len(each.pushes)) / scale)
    top = float(scale * tall.sum() + 2 * ROOM)
    figure = Figure(figsize=(WIDTH, top))
    for seen, corner, height in zip(views(view), corners, tall, strict=True):
        corner[1] = corner[1].mean() + np.array([-0.5, 0.5]) * height
        panel = Panel(seen, corner[:, 0], corner[:, 1], scale, (BESIDE, 0.0))
        top -= panel.inches[1] + ROOM
        axes = panel.place(figure, ((WIDTH - panel.inches[0]) / 2, top))
        axes.set_axis_off()
        axes.set_title(seen.name, fontsize=9, loc="left")
        _draw(axes, view, panel, each, 0.12 * size)
    return figure


def _draw(axes: Axes, view: ArmView, panel: Panel, each: SheetPosture, length: float) -> None:
    """Draw one view, with arrows of a length [m] that do not point along it."""
    for solid in view.solids:
        draw_solid(axes, solid, panel.seen)
        axes.patches[-1].set(facecolor="none", edgecolor="black", alpha=1.0)
    axes.plot(*panel.seen.of(view.line()), color="black", linewidth=1.4, marker="o", markerfacecolor="white")
    draw_frame(axes, np.zeros(3), np.eye(3), panel.seen, 1.2 * length, named="black")
    marks = list[Mark]()
    for size, pushes, style, marker in ((length, each.sensors, THIN, "s"), (-length, each.pushes, BLOCK, "x")):
        for name, point, axis in pushes:
            near, way = panel.seen.of(view.points[point]), panel.seen.of(np.array(parse_direction(axis)))
            axes.plot(*near, marker=marker, color="black", markersize=6, zorder=8)
            near = near + max(-0.3 * size, 0.0) * way[::-1]  # a block arrow stands next to the axis of a sensor
            far = near + size * way
            marks.append(Mark(f"{name}: {point} {axis}", far, False))
            if way.any():
                start, end = (near, far) if size > 0 else (far, near)
                axes.annotate("", tuple(end), tuple(start), arrowprops=style, zorder=8)
    for sign in (-1, 1):
        own = [mark for mark in marks if (mark.place[0] > (panel.low[0] + panel.high[0]) / 2) == (sign > 0)]
        label(axes, own, panel, 1, sign)
