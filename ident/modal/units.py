"""What the numbers of a channel are in SI: by the channel table and the file, never by a guess."""

import numpy as np

from ident.errors import InputError, Problem
from ident.measure.channels import QUANTITIES, ChannelRow
from ident.text import quoted
from ident.units import GRAVITIES, POUNDS, STANDARD_GRAVITY, sensor_factor

_MOTION = "m/s^2, g_0, m/s or mm"
EXAMPLES = {"force": "N", "response": _MOTION, "reference": _MOTION, "time": "s"}


def quantity_and_factor(row: ChannelRow, unit: str) -> tuple[str, float]:
    """Return what a channel measures, a name in `ident.units.QUANTITIES`, and SI units per number of its file.

    Args:
        row: of the channel table.
        unit: as the file says it; empty where it says none.

    Raises:
        InputError: neither says a unit, they contradict each other, or it is none of what the role measures.
    """
    if not (row.unit or unit):
        expected = f"a unit such as {EXAMPLES[row.role]}: neither the file nor the table has one"
        raise InputError(
            Problem(row.where, f"no unit of channel {quoted(row.channel)}", expected, "fill the cell", "unit")
        )
    quantity, factor = _measured(row, row.unit or unit)
    if row.sensitivity is not None:
        if not row.unit or sensor_factor(unit, quantity) is not None:
            got = f"a sensitivity of channel {quoted(row.channel)}, whose file is in {quoted(unit or row.unit)}"
            expected = "numbers of the file for one unit of the table"
            raise InputError(Problem(row.where, got, expected, "leave the cell empty", "sensitivity"))
        return quantity, factor / row.sensitivity
    _check_agreement(row, unit, quantity, factor)
    return quantity, factor


def _measured(row: ChannelRow, unit: str) -> tuple[str, float]:
    """Return quantity and factor of a unit, which must be one of what the row's role measures."""
    possible = (row.quantity,) if row.quantity else QUANTITIES[row.role]
    for quantity in possible:
        factor = sensor_factor(unit, quantity)
        if factor is not None:
            return quantity, factor
    named = "displacement" if row.quantity == "length" else row.quantity or row.role
    expected = f"a unit of {named}, such as {EXAMPLES[row.role]}"
    remedy = "correct the unit" if row.unit else "write the unit and the sensitivity into the table"
    raise InputError(Problem(row.where, f"{quoted(unit)} of channel {quoted(row.channel)}", expected, remedy, "unit"))


def _check_agreement(row: ChannelRow, unit: str, quantity: str, factor: float) -> None:
    """Refuse a unit of the table that contradicts the file's."""
    if not (row.unit and unit):
        return
    said = sensor_factor(unit, quantity)
    if said is None or not np.isclose(said, factor, rtol=1e-6):
        got = f"{quoted(row.unit)} of channel {quoted(row.channel)}"
        remedy = "give its sensitivity" if said is None else "correct one of them, or leave the cell empty"
        raise InputError(Problem(row.where, got, f"{quoted(unit)}, as in the file", remedy, "unit"))


def unit_remark(row: ChannelRow, unit: str) -> str:
    """Return what is said of a unit that means something else elsewhere; empty for others."""
    written = row.unit or unit
    meant = {**dict.fromkeys(GRAVITIES, f"standard gravity, {STANDARD_GRAVITY} m/s^2"), **dict.fromkeys(POUNDS, "lbf")}
    return f"{quoted(written)} of {quoted(row.channel)} is read as {meant[written]}" if written in meant else ""
