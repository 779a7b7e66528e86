"""A campaign into CSV that reads back equal."""

import csv
import io
from collections.abc import Iterable, Iterator
from pathlib import Path

from ident.files import remove_file, replace_file, together
from ident.measure.campaign import Campaign, Measurement
from ident.measure.columns import COLUMNS
from ident.measure.covariance import Group, covariance_path, covariance_text
from ident.measure.kinds import DRIVE_STATES, KINDS
from ident.measure.load import format_direction
from ident.measure.reading import parse_campaign
from ident.measure.setups import setups_path, setups_text
from ident.measure.text import format_number
from ident.units import si_factor

WRITTEN_UNITS = {"frequency": "Hz", "length": "mm", "rotation": "mrad", "damping_ratio": "1", "ratio": "1"}
"""Unit in which each measured quantity is written."""


def write_campaign(
    campaign: Campaign,
    path: str | Path,
    *,
    header_comments: Iterable[str] = (),
    relative_sigma: bool = False,
) -> None:
    """Write a campaign as CSV: postures in deg, frequencies in Hz, deflections in mm, every digit kept.

    The text is read back before it is written, so that no file is made that `read_campaign` would refuse. The
    files appear together or not at all. Correlations go into `CAMPAIGN.covariance.csv` beside it, frames of setups into
    `CAMPAIGN.setups.csv`; without any, such a file of an earlier campaign there is removed.

    Args:
        campaign: what to write.
        path: the file; an existing one is replaced.
        header_comments: comment lines for the head of the file, such as the origin of the numbers.
        relative_sigma: whether standard deviations are written as fractions of the value, where they are any.
    """
    text = campaign_text(campaign, header_comments=header_comments, relative_sigma=relative_sigma)
    data, beside = text.encode("utf-8", errors="backslashreplace"), covariance_path(path)
    groups = _groups(campaign)
    correlations = covariance_text(groups, Path(path).name).encode() if groups else None
    frames = setups_text(campaign.setups.each, Path(path).name).encode() if campaign.setups.each else None
    parse_campaign(data, path, correlations, frames)
    with together():
        _write_beside(beside, correlations)
        _write_beside(setups_path(path), frames)
        replace_file(Path(path), lambda file: file.write(data))


def _write_beside(path: Path, content: bytes | None) -> None:
    """Write a file that belongs to the campaign, or remove an earlier campaign's."""
    if content is None:
        remove_file(path)
    else:
        replace_file(path, lambda file: file.write(content))


def _groups(campaign: Campaign) -> list[Group]:
    """Return the groups of the campaign's rows as they are numbered when they are read again."""
    names = dict.fromkeys(m.group for m in campaign if m.group)
    several = {campaign.measurements[places[0]].group: matrix for places, matrix in campaign.correlated}
    return [Group(name, several.get(name, ((1.0,),))) for name in names]


def campaign_text(campaign: Campaign, *, header_comments: Iterable[str] = (), relative_sigma: bool = False) -> str:
    """Return a campaign as CSV text under comment lines; see `write_campaign`."""
    comments = [f"# {line}".rstrip() for comment in header_comments for line in comment.splitlines() or [""]]
    return "\n".join([*comments, format_campaign(campaign, relative_sigma=relative_sigma)])


def format_campaign(campaign: Campaign, *, relative_sigma: bool = False) -> str:
    """Return a campaign as CSV text, with the columns that are in use."""
    angles = [f"q{joint} [deg]" for joint in range(1, campaign.joints + 1)]
    rows = [dict(zip(angles, _degrees(m), strict=True)) | dict(_cells(m, relative_sigma)) for m in campaign]
    used = [name for name in COLUMNS if name in _ALWAYS or any(row.get(name) for row in rows)]
    text = io.StringIO()
    columns = ["kind", *angles, *used[1:]]
    writer = csv.DictWriter(text, columns, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


_ALWAYS = ("kind", "value", "unit")


def _degrees(m: Measurement) -> list[str]:
    return [_written(angle, si_factor("deg", "angle")) for angle in m.posture]


def _cells(m: Measurement, relative_sigma: bool) -> Iterator[tuple[str, str]]:
    unit = WRITTEN_UNITS[KINDS[m.kind]]
    factor = si_factor(unit, KINDS[m.kind])
    yield from (
        ("kind", m.kind),
        ("mode", m.mode or ""),
        ("of", m.of or ""),
        ("point", m.point or ""),
        ("joint", m.joint or ""),
        ("setup", m.setup),
        ("ramp", m.ramp),
        ("note", m.note),
    )
    yield "direction", format_direction(m.direction) if m.direction else ""
    yield "reference_point", m.reference_point or ""
    yield "reference_direction", format_direction(m.reference_direction) if m.reference_direction else ""
    yield "load", str(m.load) if m.load else ""
    yield "reference_load", str(m.reference_load) if m.reference_load else ""
    yield "drives", m.drives if m.drives != DRIVE_STATES[0] else ""
    yield from (("value", _written(m.value, factor)), ("unit", unit))
    if relative_sigma and m.sigma < abs(m.value):
        yield "relative_sigma", _written(m.sigma, abs(m.value))
    else:
        yield "sigma", _written(m.sigma, factor)
    yield "resolution", _written(m.resolution, factor) if m.resolution else ""
    yield "repeat", m.repeat
    yield "group", m.group


def _written(value: float, unit: float) -> str:
    """Return value/unit in the fewest digits, 15 at least, that read back as the same value; else in all."""
    exact = value / unit
    short = (float(f"{exact:.{digits}g}") for digits in (15, 16))
    return format_number(next((number for number in short if number * unit == value), exact))
