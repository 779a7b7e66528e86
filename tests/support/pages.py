"""Pages to test with: one as a careful author writes it, one of texts that mean harm."""

from functools import cache

import numpy as np
from matplotlib.figure import Figure

from ident.report.page import Page, Picture, Section, picture
from ident.report.report import Table, Verdict

HOSTILE = (
    "<script>window.ran = 1; alert(1)</script>",
    '"><img src=x onerror="window.ran = 1">',
    "'><svg/onload=window.ran=1>",
    "</style></title></caption><iframe src=https://example.com></iframe>",
    "javascript:window.ran=1",
    "{{7*7}} {% raw %} {# note #} ${7*7} &lt;b&gt;",
    "right\u202eto left\u2066 \x00 bell\a line\nbreak \udcff \ufeff",
    "w" * 500,
)
HOSTILE_SVG = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="90" height="60"><script>window.top.ran = 1</script>'
    '<image href="https://example.com/x.png" width="9" height="9"/><rect width="90" height="60"/></svg>'
)


def drawing(points=50):
    figure = Figure(figsize=(9, 4), layout="constrained")
    left, right = figure.subplots(1, 2)
    x = np.linspace(0, 10, points)
    left.plot(x, np.exp(-0.3 * x) * np.cos(5 * x))
    left.set_xlabel("time [s]")
    right.scatter(np.cos(37 * x), np.sin(91 * x), s=4)
    return figure


def table(columns=7, rows=12):
    head = ("parameter", *(f"quantity {j} [N mm/deg]" for j in range(1, columns)))
    cells = tuple((f"joint{i}.k_tors", *(f"{1e5 * (i + j):.4g}" for j in range(1, columns))) for i in range(rows))
    return Table("Joint stiffnesses", head, cells, note="Emphasised: not supported by the data.", strong=(3, 7))


@cache
def stops():
    """The figures of the sample page, drawn once for all its tests."""
    return picture(drawing(), "A decaying oscillation", "The stop."), picture(drawing(9), "A ring", "Residuals.")


def sample_page(kind="caution"):
    words = Table(
        "Explanations that were tried",
        ("explanation", "chi-squared", "verdict"),
        (("elastic joints", "48.2", "dropped"), ("slack of joint 2", "33.9", "kept, for its evidence is much larger")),
    )
    sections = (
        Section("Noise", ("Repeats scatter as stated.", "Nothing drifts.")),
        Section(
            "Elastic joints",
            ("Chi-squared is 48.2 on 31 degrees of freedom.", table(), words),
            stops(),
        ),
    )
    return Page(
        "Diagnosis of lcd_arm",
        "43 measurements",
        Verdict("NOT DECIDED", "The model holds once joint 2 has slack.", kind),
        (("Cause", "Slack of joint 2."), ("Caution", "Joints 1 to 3 are known within 6 %.")),
        sections,
        Table("Files", ("what", "file", "SHA-256"), (("arm", "arm.toml", "9f86d081884c7d65" * 4),)),
        (("ident", "0.1.0"), ("seed", "7")),
    )


def hostile_page():
    """Each of the texts in each place where a text can stand."""
    cells = Table(HOSTILE[0], HOSTILE, (HOSTILE, HOSTILE[::-1]), note=HOSTILE[1], strong=(1,))
    section = Section(HOSTILE[7], (*HOSTILE, cells), hostile_pictures())
    sections = tuple(Section(text, (text,)) for text in HOSTILE)
    pairs = tuple((text, text) for text in HOSTILE)
    verdict = Verdict(HOSTILE[0] + HOSTILE[7], HOSTILE[0] + HOSTILE[7], "caution")
    return Page(HOSTILE[0] + HOSTILE[7], HOSTILE[1], verdict, pairs, (section, *sections), cells, pairs)


@cache
def hostile_pictures():
    """Its figures, drawn once."""
    return Picture(HOSTILE_SVG, HOSTILE[1], HOSTILE[7]), picture(titled(), HOSTILE[6], HOSTILE[0])


def titled():
    """A figure whose title holds all but what matplotlib itself refuses: half a surrogate pair."""
    figure = drawing()
    figure.suptitle((HOSTILE[6] + "--" + HOSTILE[0]).replace("\udcff", ""), parse_math=False)
    return figure
