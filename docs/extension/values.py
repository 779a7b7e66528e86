"""Numbers of the manual, computed by the program when the manual is built.

A page marks what is computed by `<!-- value: NAME -->...<!-- end -->`; what stands between is for who reads the page as
it is, and `tests/test_docs.py` compares it with what is computed.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from sphinx.application import Sphinx

import ident
from ident.arm.parts import Servo

MARK = re.compile(r"(<!-- value: (?P<name>[\w ]+) -->)(?P<shown>.*?)(<!-- end -->)", re.DOTALL)
ARM = Path(__file__).parents[2] / "data" / "lcd_arm" / "arm.toml"
SERVOS = (22.0, 100.0, 1000.0)
"""Stiffnesses of a servo at the motor [N m/rad] that the page shows."""
SPLIT = 0.05
"""Shift of a mode above which the motor's mode splits it in two."""


def predicted(servo: float | None) -> ident.PredictResult:
    """Return the modes of the shipped arm, unfolded: with a servo of a stiffness at the motor, or with the brake on."""
    arm = ident.read_arm(ARM).arm
    if servo is None:
        return ident.predict(arm, modes=6)
    return ident.predict(replace(arm, servos=(Servo("servo", "joint1", k_servo=servo),)), modes=7, drives="servo")


@cache
def torsions() -> Mapping[float | None, list[float]]:
    """Return the frequencies [Hz] of the torsional modes, and of the motor's, by the servo's stiffness."""
    still = predicted(None)
    labelled = list(zip(still.labels[0], still.frequencies[0].tolist(), strict=True))
    vertical = [hertz for label, hertz in labelled if label.startswith("vertical")]
    found: dict[float | None, list[float]] = {None: [hertz for label, hertz in labelled if "torsion" in label]}
    for servo in SERVOS:
        modes = predicted(servo).frequencies[0].tolist()
        found[servo] = [hertz for hertz in modes if not np.isclose(hertz, vertical, rtol=1e-6).any()]
    return found


def shift(servo: float, mode: int) -> float:
    """Return by how much a servo moves a torsional mode, as a share of its frequency with the brake on."""
    held = torsions()[None][mode]
    return min((hertz / held - 1 for hertz in torsions()[servo]), key=abs)


def in_percent(share: float) -> str:
    """Write a shift with two digits that count, at least two decimals: `-0.277 %`."""
    return f"{100 * share:+.3f} %" if abs(share) < 0.01 else f"{100 * share:+.2g} %"


def servo_table() -> str:
    """Return what a servo does to the shipped arm, a row for each stiffness."""
    lines = ["| servo at the motor [N m/rad] | lateral torsion 1 | lateral torsion 2 |", "|---|---|---|"]
    for servo in SERVOS:
        first, second = shift(servo, 0), shift(servo, 1)
        words = in_percent(second)
        if abs(second) > SPLIT:
            held = torsions()[None][1]
            low, high = sorted(sorted(torsions()[servo], key=lambda hertz: abs(hertz - held))[:2])
            words = f"split in two by the motor's mode, at {low:.1f} and {high:.1f} Hz"
        lines.append(f"| {servo:g} | {in_percent(first)} | {words} |")
    return "\n\n" + "\n".join(lines) + "\n\n"


VALUES: Mapping[str, Callable[[], str]] = {"servo table": servo_table}
"""What is computed, by name."""


def filled(text: str) -> str:
    """Return a page with what is computed in its places.

    Raises:
        KeyError: a name that nothing computes.
    """
    return MARK.sub(lambda match: f"{match[1]}{VALUES[match['name']]()}{match[4]}", text)


def fill(app: Sphinx, page: str, source: list[str]) -> None:
    """Put what is computed into a page that is read."""
    source[0] = filled(source[0])


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill pages when they are read."""
    app.connect("source-read", fill)
    return {"parallel_read_safe": True}
