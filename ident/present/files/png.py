"""Figures as PNG files."""

import warnings
from pathlib import Path

from matplotlib.figure import Figure

from ident.files import replace_file

DPI = 130


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole or not at all."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        replace_file(path, lambda file: figure.savefig(file, format="png", dpi=DPI), make_folders=True)
