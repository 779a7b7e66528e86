"""What tests of reports and figures share: fits that are stored, or made up of any size; whether a figure is tidy."""

from dataclasses import replace
from functools import cache

import jax.numpy as jnp
import numpy as np
from arms import DATA, lcd_arm
from matplotlib.backends.backend_agg import FigureCanvasAgg
from results import RESULTS

import ident
from ident.identify.fit import CampaignFit, fit_campaign
from ident.inference.information import information
from ident.inference.optima import Optimum
from ident.inference.parameters import Parameter, Parameters
from ident.inference.problem import Choice, InverseProblem
from ident.measure import Campaign, Load, Measurement, read_campaign
from ident.measure.kinds import DIFFERENCES, KINDS

HOSTILE = "a$b_{\\frac$ %n \n\t\x00 $$ 玻璃 \udcff <b>" + "x" * 300
"""A name that no picture may take for a formula, a break or a reason to grow."""


CAMPAIGN_FIT = RESULTS / "campaign.fit.json"
"""A fit of the shipped campaign: what is only told of one, need not search for it."""


@cache
def fitted(name):
    """The stored fit of the shipped campaign; that of Table 1 by one start."""
    if name == "campaign":
        return ident.load(CAMPAIGN_FIT).fitted
    return fit_campaign(lcd_arm(), read_campaign(DATA / "lcd_arm" / f"{name}.csv"), starts=1)


def made_up(parameters, measurements, *, prior_sd=1.0, seed=0):
    """A fit of a linear model that was never run, as large as one likes; half the parameters are left open."""
    rng = np.random.default_rng(seed)
    kinds = ("frequency", "deflection", "deflection_difference", "damping_ratio", "rotation", "rotation_difference")
    measured = []
    for i in range(measurements):
        kind = kinds[i % len(kinds)]
        point = "tip" if KINDS[kind] in ("length", "rotation") else None
        direction = (0.0, 1.0, 0.0) if point else None
        load = Load.parse("glass + 5 kg @ tip") if kind in DIFFERENCES else Load()
        posture = tuple(rng.uniform(-2, 2, 6))
        where = {"point": point, "direction": direction}
        measured.append(Measurement(kind=kind, posture=posture, value=0.03, sigma=1e-4, load=load, **where))
    campaign = Campaign("made up", measurements=tuple(measured))
    fields = ("k_bend", "k_tors", "tau_bend", "mass", "com.x", "offset.z")
    names = [f"a_rather_long_joint_name{i}.{fields[i % 6]}" for i in range(parameters)]
    positive = [not name.endswith((".x", ".z")) for name in names]
    centres = [3.2e5 if p else 0.1 for p in positive]
    items = tuple(
        Parameter((name,), p, centre, centre, prior_sd)
        for name, p, centre in zip(names, positive, centres, strict=True)
    )
    theta = np.log(centres) * positive + np.array(centres) * (1 - np.array(positive))
    theta = theta + rng.normal(size=parameters) * 0.02
    jacobian = rng.normal(size=(measurements, parameters)) * (np.arange(parameters) % 2)
    unknowns = Parameters(items)
    values = np.asarray(unknowns.values(jnp.asarray(theta)))
    sigma = np.full(measurements, 1e-4)
    known = information(jacobian / 1e-2, np.full(parameters, prior_sd), tuple(names))
    problem = InverseProblem(
        lambda p: p, jnp.full(measurements, 0.03), jnp.asarray(sigma), unknowns, tuple(m.kind for m in campaign)
    )
    predicted = 0.03 + rng.normal(size=measurements) * 1e-4
    optimum = Optimum(values, theta, 1.0, 3, True, np.empty((0, parameters)), known.sd)
    choice = Choice(None, True, np.zeros(measurements))
    made = CampaignFit(problem, (optimum,), 0, predicted, jacobian, known, choice, arm=lcd_arm(), campaign=campaign)
    return replace(made, combinations=tuple(direction for direction in known.directions if not direction.open))


def boxes(figure):
    """Bounding boxes of all that is written, and of the panels, after the layout was made."""
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw_without_rendering()
    words = []
    for axes in figure.axes:
        texts = [*axes.texts, axes.title, axes.xaxis.label, axes.yaxis.label]
        texts += axes.get_legend().get_texts() if axes.get_legend() else []
        for axis in (axes.xaxis, axes.yaxis) if axes.axison else ():
            low, high = sorted(axis.get_view_interval())
            for tick in axis.get_major_ticks():
                if low <= tick.get_loc() <= high and axis.get_visible():
                    texts += [label for label in (tick.label1, tick.label2) if label.get_visible()]
        words += [(t.get_text(), t.get_window_extent(renderer)) for t in texts if t.get_text() and t.get_visible()]
    words += [(t.get_text(), t.get_window_extent(renderer)) for t in figure.texts]
    return words


def assert_tidy(figure):
    """No two texts overlap, and none leaves the picture."""
    words = boxes(figure)
    width, height = figure.bbox.width, figure.bbox.height
    for text, box in words:
        assert box.x0 >= -1, text
        assert box.x1 <= width + 1, text
        assert box.y0 >= -1, text
        assert box.y1 <= height + 1, text
    for i, (one, a) in enumerate(words):
        for other, b in words[i + 1 :]:
            across = min(a.x1, b.x1) - max(a.x0, b.x0)
            along = min(a.y1, b.y1) - max(a.y0, b.y0)
            assert min(across, along) < 2.0, f"{one!r} lies on {other!r}"
