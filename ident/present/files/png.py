"""Figures as PNG files."""

import warnings
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ident.files import replace_file

DPI = 130


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG, whole or not at all; what `Figure.savefig` writes, which draws it twice."""
    figure.set_dpi(DPI)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
        replace_file(path, FigureCanvasAgg(figure).print_png, make_folders=True)
