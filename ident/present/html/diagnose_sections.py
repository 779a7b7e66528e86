"""What each stage of a diagnosis found, as a section of its page."""

from collections.abc import Iterator, Sequence

import jax.numpy as jnp
import numpy as np

from ident.assess.remedies import PROVED, Proof, Remedy, chosen
from ident.assess.task import CONFIDENT, MOVED, STIFFER, Task
from ident.assess.vibration import VibrationAssessment
from ident.identify.sample import CampaignSample
from ident.present.figures.diagnose import remedies_figure, sensitivities_figure, stiffness_figure, vibration_figure
from ident.present.figures.resonance import resonance_figure
from ident.present.html.page import Section, Table
from ident.present.html.picture import picture
from ident.present.text.basis import UNDRIVEN
from ident.present.text.resonance_words import grouped, sources_words
from ident.present.text.units import MM, is_stiffness, nmm_per_deg, unit_of
from ident.present.text.words import cut
from ident.vibrate.modal.branches import Branches
from ident.vibrate.modal.excitation import Excitation
from ident.vibrate.modal.resonance import ResonanceCrossing
from ident.vibrate.redesign.binomial import BinomialEstimate
from ident.vibrate.redesign.sensitivity import Sensitivities

SMALL = 0.005
"""Relative change of a stiffness that is not worth a word."""
SMALL_MOVE = 0.0005
"""Change of a mass centre [m] that is not worth a word."""
LISTED = 12
"""Sensitivities in the table."""
KINDS = {
    "torsion": "torsional stiffness",
    "mass centre": "mass centre",
    "both": "torsional stiffness and mass centre",
    "speed": "another speed",
}
"""How a kind of remedy is called."""


def stiffness_section(sampled: CampaignSample) -> Section:
    """Say how stiff the joints are, and how sure that is."""
    fitted = sampled.fitted
    known, draws = fitted.information, sampled.sample
    items = fitted.problem.parameters.items
    count = len(known.names)
    found = [
        f"{len(fitted.campaign)} measurements fix {known.rank} of {count} directions of the unknowns; "
        f"chi-squared {fitted.chi_squared:.3g} on {fitted.degrees_of_freedom} degrees of freedom."
    ]
    found += [f"Warning: {doubt}." for doubt in fitted.doubts]
    if known.rank < count:
        found.append("The other directions are filled by the prior: what follows holds as far as that does.")
    values = np.asarray(draws.posterior.parameters.values(jnp.asarray(draws.draws().T)))[:count]
    low, middle, high = np.quantile(values, (0.025, 0.5, 0.975), axis=1)
    rows = tuple(
        (item.name, f"{m:.4g}", f"{a:.4g} to {b:.4g}", _paper(item.name, float(m)), unit_of(item.name))
        for item, a, m, b in zip(items, low, middle, high, strict=True)
    )
    head = ("number", "median", "95 % interval", "in N mm/deg", "unit")
    short = [d for d in draws.diagnosis if not d.enough(draws.settings.target_ess)]
    note = "The chains are shorter than they should be: the intervals are rough." if short else ""
    table = Table("Identified numbers, from the posterior", head, rows, note)
    onward = "With these numbers and their spread the natural frequencies along the motion follow."
    above = np.flatnonzero(low > 0)  # coordinates, which may be about zero, have no ratio
    alt = "Each identified number with its interval, relative to its median"
    caption = "95 % interval of each number, relative to its median: the narrower, the surer."
    shown = [items[i].name for i in above], low[above], middle[above], high[above]
    pictures = (picture(stiffness_figure(*shown), alt, caption),) if len(above) else ()
    return Section("How stiff are the joints?", tuple(found), onward, (table,), pictures)


def _paper(name: str, value: float) -> str:
    return f"{nmm_per_deg(value):.4g}" if is_stiffness(name) else ""


def resonance_section(followed: Branches, shaken: Excitation, met: Sequence[ResonanceCrossing], title: str) -> Section:
    """Say where a pulley turns at a natural frequency."""
    groups = grouped(met)
    if not groups:
        found: tuple[str, ...] = ("No pulley comes near a natural frequency along this motion.",)
    else:
        found = tuple(_met(group) for group in groups[:4])
    rows = tuple(
        (
            sources_words([encounter.source for encounter in group]),
            str(group[0].label),
            f"{group[0].start:.2f} to {group[0].end:.2f}",
            f"{group[0].natural:.2f}",
            "crosses" if group[0].crossings else f"{100 * group[0].relative_distance:.1f} % off",
            f"{group[0].magnification:.1f}",
            f"{group[0].probability:.0%}",
        )
        for group in groups
    )
    head = ("excited by", "mode", "time [s]", "at [Hz]", "closest", "build-up [-]", "probability")
    note = "Build-up: amplitude of the mode over its static response to the same force, estimated."
    table = Table("Near-resonance, the most severe first", head, rows, note)
    drawn = picture(
        resonance_figure(followed, shaken, met, title=title),
        "Natural frequencies and pulley frequencies over time, intervals of near-resonance shaded",
        "Natural frequencies (bands: 5 to 95 % of the posterior) and the frequencies at which the pulleys turn.",
    )
    onward = "How far the arm really vibrates there depends on how long a pulley stays: simulate it."
    return Section("Does the drive meet a natural frequency?", found, onward, (table,) if rows else (), (drawn,))


def undriven_section() -> Section:
    """Say that nothing turns."""
    onward = "How far the arm vibrates by its motion alone is simulated."
    return Section("Does the drive meet a natural frequency?", (UNDRIVEN,), onward)


def _met(group: Sequence[ResonanceCrossing]) -> str:
    first = group[0]
    plural = "" if len(group) > 1 else "s"
    how = f"cross{plural and 'es'}" if first.crossings else f"come{plural} near"
    who = sources_words([encounter.source for encounter in group])
    return (
        f"{cut(who, 40)} {how} {first.label} ({first.natural:.2f} Hz) between {first.start:.2f} and {first.end:.2f} s."
    )


def vibration_section(task: Task, shaken: VibrationAssessment) -> Section:
    """Say how far the end vibrates, and whether that is too far."""
    response = shaken.simulated.response
    peak = np.abs(np.asarray(response.vibration)).max(1)
    found = [
        f"By the exact equations the end point vibrates by up to {MM * peak.max():.3g} mm "
        f"({'xyz'[int(peak.argmax())]}); the limit is {MM * task.limit:g} mm.",
        f"The limit is kept by {chance_words(shaken.keeps)}.",
    ]
    low, high = np.quantile(shaken.draws, (0.05, 0.95), axis=1)
    rows = tuple(
        (direction, f"{MM * p:.3f}", f"{MM * a:.3f} to {MM * b:.3f}")
        for direction, p, a, b in zip("xyz", peak, low, high, strict=True)
    )
    table = Table(
        "Largest vibration [mm]",
        ("direction", "exact", "5 to 95 % of the draws"),
        rows,
        "Vibration: how far the end is from where the sagging arm would be at rest. Draws by the fast method.",
    )
    drawn = picture(
        vibration_figure(response, task.limit),
        "Vibration of the end point in x, y and z over time, with the limit",
        f"Vibration of the end point; dashed: limit of {MM * task.limit:g} mm.",
    )
    if shaken.accepted:
        onward = "The vibration is small: nothing needs to be changed. What it depends on follows, to keep it so."
    else:
        onward = "That is too much, or too likely to be. Which numbers of the arm matter most?"
    return Section("How far does the arm vibrate?", tuple(found), onward, (table,), (drawn,))


def chance_words(chance: BinomialEstimate) -> str:
    """Say a probability with its interval."""
    low, high = chance.interval
    return (
        f"{100 * chance.share:.3g} % of {chance.draws} draws of the posterior "
        f"(95 % interval {100 * low:.3g} to {100 * high:.3g} %)"
    )


def sensitivity_section(found: Sensitivities) -> Section:
    """Say what changes the vibration most."""
    direction = "xyz"[int(np.argmax(found.amplitude))]
    order = found.order[:LISTED]
    most = [found.paths[i] for i in order[:3]]
    column = int(np.argmax(found.amplitude))
    said = (
        f"The largest vibration is that in {direction}. It depends most on {most[0]}, {most[1]} and {most[2]}: by "
        + ", ".join(f"{found.elasticity[i, column]:+.2g}" for i in order[:3])
        + " % for each percent.",
        "Drive ratios and masses move a resonance along the path; they are rarely free to choose.",
    )
    rows = tuple(
        (found.paths[i], f"{found.present[i]:.4g}", *(f"{value:+.2f}" for value in found.elasticity[i])) for i in order
    )
    head = ("number", "now [SI]", "x [% per %]", "y [% per %]", "z [% per %]")
    note = "At the present design, by exact derivatives: small changes only."
    drawn = picture(
        sensitivities_figure(found, order),
        "Bars of the sensitivity of the largest vibration to each number",
        f"Percent of the vibration in {direction} for one percent of each number.",
    )
    onward = (
        "Where something must be changed: torsional stiffness first, mass centres second, as in the paper; or speed."
    )
    return Section(
        "What matters most?", said, onward, (Table("Sensitivities, the strongest first", head, rows, note),), (drawn,)
    )


def remedies_section(task: Task, found: Sequence[Remedy]) -> Section:
    """Rank what can be done."""
    cures = [remedy for remedy in found if remedy.cures]
    moved = f" mass centres of the last joint's bodies by {100 * MOVED:g} % of their length," if task.centres else ""
    said = [
        f"{len(cures)} of {len(found)} remedies keep the limit with a probability of {100 * CONFIDENT:g} % or more."
        if cures
        else f"None of the {len(found)} remedies that were tried keeps the limit with {100 * CONFIDENT:g} %.",
        f"Tried: torsional stiffness from 1/{STIFFER:g} to {STIFFER:g} times,{moved} speeds from half to one and a "
        "half times, not above full speed. These ranges are assumed.",
    ]
    rows = tuple(
        (
            str(rank),
            change_words(task, remedy),
            f"{MM * remedy.largest:.3f}",
            f"{100 * remedy.keeps.share:.3g} %",
            f"{remedy.frequency:.2f}",
            f"{MM * remedy.deflection:.1f}",
            f"{remedy.amount:.2f}",
        )
        for rank, remedy in enumerate(found, 1)
    )
    head = ("rank", "change", "vibration [mm]", "keeps limit", "first mode [Hz]", "deflection [mm]", "amount [-]")
    note = (
        "Best first: what cures, torsion before mass centres before speed, each with the least change; then what helps."
        " Amount: change against the widest "
        "allowed; of speed, in powers of two. Deflection and first mode are side effects, the worse of both ends of "
        "the motion."
    )
    drawn = picture(
        remedies_figure([change_words(task, remedy) for remedy in found], found, task.limit),
        "Largest vibration after each remedy, with the limit",
        f"Expected largest vibration after each remedy; dashed: limit of {MM * task.limit:g} mm. Filled: cures.",
    )
    onward = "The first of them is simulated by the exact equations, and with draws that it was not chosen by."
    if len(cures) > 1:
        onward += f" If it does not hold, so is the next, {PROVED} at most."
    strong = tuple(i for i, remedy in enumerate(found) if remedy.cures)
    return Section("What cures it?", tuple(said), onward, (Table("Remedies", head, rows, note, strong),), (drawn,))


def proof_section(task: Task, found: Sequence[Remedy], proofs: Sequence[Proof]) -> Section:
    """Say which of the remedies that were tried again holds."""
    said = [line for remedy, proof in zip(found, proofs, strict=False) for line in _proof_in_words(task, remedy, proof)]
    if len(proofs) > 1:
        said.append("All were tried with the same draws, which thereby chose among them.")
    remedy, held = found[chosen(proofs)], proofs[-1].holds
    rows = tuple(
        (path, f"{remedy.before[path]:.4g}", f"{value:.4g}", _change(path, remedy.before[path], value), unit_of(path))
        for path, value in remedy.values.items()
    )
    head = ("number", "now", "after", "change", "unit")
    title = "What to change" if held else "What the first of them changes"
    return Section("Does it hold?", tuple(said), "", (Table(title, head, rows),) if rows else ())


def _proof_in_words(task: Task, remedy: Remedy, proof: Proof) -> Iterator[str]:
    largest = float(proof.amplitude.max())
    kept = "keeps" if largest <= task.limit else "does NOT keep"
    yield f"{change_words(task, remedy)}: {MM * largest:.3g} mm by the exact equations, which {kept} the limit."
    asked = "" if proof.keeps.share >= CONFIDENT else f"; {100 * CONFIDENT:g} % are asked for"
    yield f"With draws that it was not chosen by, the limit is kept by {chance_words(proof.keeps)}{asked}."


def _change(path: str, before: float, after: float) -> str:
    return f"x {after / before:.3f}" if is_stiffness(path) else f"{MM * (after - before):+.1f} mm"


def change_words(task: Task, remedy: Remedy) -> str:
    """Name a remedy by what it changes."""
    if remedy.kind == "speed":
        return f"speed {remedy.percent:.3g} % instead of {task.percent:.3g} %"
    return ", ".join(_changes(remedy)) or "nothing"


def _changes(remedy: Remedy) -> Iterator[str]:
    """Name each number that changes by more than is worth a word."""
    for path, value in remedy.values.items():
        before = remedy.before[path]
        if is_stiffness(path) and abs(value / before - 1) > SMALL:
            yield f"{path} x {value / before:.2f}"
        elif not is_stiffness(path) and abs(value - before) > SMALL_MOVE:
            yield f"{path} {MM * (value - before):+.0f} mm"
