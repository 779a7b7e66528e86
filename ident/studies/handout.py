"""Results as pages to hand over, in HTML and PDF, from the report that the terminal prints."""

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import require
from ident.files import together
from ident.studies.result import Result

if TYPE_CHECKING:
    from ident.report.page import Page
    from ident.studies.bind import Bound


def page_of(result: "Result | Bound") -> "Page":
    """Return a result as a page: report with details, figures, inputs by hash; files have names, but no folders."""
    from ident.report import handout
    from ident.report.page import picture

    if not isinstance(result, Result):
        return result.handout()
    titled = [(figure.get_suptitle() or result.name, figure) for figure in result.figures().values()]
    return handout.page_of(result.sections(), result.head, [picture(figure, title, title) for title, figure in titled])


def hand_over(
    result: "Result | Bound",
    folder: str | Path,
    *,
    page: bool = True,
    pdf: bool = False,
    font: str | Path | None = None,
) -> tuple[Path, ...]:
    """Write a result as one page that needs no other file, under its name; return the paths.

    Args:
        result: a result, or several by `ident.bind`.
        folder: where the page goes.
        page: whether it is written as HTML.
        pdf: whether it is written as a PDF in A4, which needs `pip install 'ident-arm[pdf]'`.
        font: TrueType font of the PDF for letters that DejaVu Sans lacks.

    Raises:
        InputError: a letter that no font has, a file that is no font, no package for PDF; a file can't be written.
    """
    from ident.report.page import write_page

    check_pdf(pdf, font)
    made, place = page_of(result), Path(folder) / result.name
    paths = {end: place.with_name(place.name + end) for end in (*[".html"] * page, *[".pdf"] * pdf)}
    with together():
        if page:
            write_page(made, paths[".html"])
        if pdf:
            from ident.report.pdf import write_pdf

            write_pdf(made, paths[".pdf"], font)
    return tuple(paths.values())


def check_pdf(pdf: bool, font: str | Path | None = None) -> None:
    """Refuse a PDF if the package for it is not installed, and a font that is none, or for no PDF.

    Raises:
        InputError: one of these.
    """
    require(pdf or not font, "font", "a font without a PDF", "one with a PDF", "ask for a PDF, too (`pdf`)")
    if pdf:
        installed, remedy = find_spec("fpdf") and find_spec("fpdf.enums"), "pip install 'ident-arm[pdf]'"
        require(installed, "", "a PDF without the package fpdf2", "the extra pdf of ident", remedy)
        from ident.report.pdf import Paper

        Paper("", font)
