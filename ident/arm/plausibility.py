"""Implausible numbers of an arm: possible, so that no reader refuses them, but unlikely.

A mass centre beyond its link, an inertia of no body of that size, a stiffness that its load bends by degrees, a
length in the wrong unit. Each check is a rule of thumb, wide enough that a sound arm passes; each finding names the
number and what would be expected. Geometry is that of the zero posture, in which all frames are parallel.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ident.arm.arm import Arm, inertia_of_mass, stiffness_paths
from ident.arm.belts import belt_mismatches
from ident.arm.fields import ALPHA, DAMPING, LOSS, STIFFNESS
from ident.arm.parts import Body
from ident.arm.sizes import Link, carried, link_end, links, reach_of, to_box, to_segment

LONGEST, SHORTEST = 20.0, 0.05
"""Reach [m] beyond which metres and millimetres were probably mixed up."""
DENSEST, LIGHTEST = 23e3, 10.0
"""Densities [kg/m^3]: osmium has 22,600; 10 is less than any frame that carries."""
SPARSEST, MOST_COMPACT = 0.05, 5e3
"""Mass over the cube of the reach [kg/m^3]: 10 to 1500 on arms that are sold, 0.3 on the arms of space stations."""
LIGHTER = 100.0
"""Implausible mass ratio of both neighbours' main bodies to a link's: at most 20 on 15 arms, 1000 for grams as kg."""
NEGLIGIBLE = 1e-3
"""Share of the total mass below which a body's mass centre does not matter, as for very light fingers."""
ENDS = 0.8
"""Share of the reach below which an end point on another link than the last is not the hand."""
MOST_GIVING = 0.02
"""Largest angle [rad] of a bushing under the weight beyond it, held out level: a degree."""
PROPORTION = 20.0
"""Implausible factor between stiffnesses of one arm, if their loads do not explain it; assumed, and tested on sound
arms and on mistakes (tests/benchmarks/oddities.py)."""
LOWEST, HIGHEST = 0.5, 200.0
"""First natural frequencies [Hz] of arms; assumed."""
MOST_SAG = 0.02
"""Static deflection of the end point as a share of the reach; assumed."""
MOST_DAMPED = 0.3
"""Damping ratio of one of the first modes; assumed."""
LONG = 0.2
"""Share of the reach from which a link is long: the links before and after the elbow, not turret or wrist; assumed."""
ALIKE, LEAST_ALIKE = 0.6, 3
"""Implausible share and number of bodies with the same inertia, if their links are not alike; assumed."""
UNLIKE = 3.0
"""Factor between lengths, or masses, of links that are not alike; assumed."""
FLATTEST, LARGEST_BOX = 0.1, 3.0
"""Edge of the box of a link's mass and inertia, over the link's length: 0.12 to 2.5 on the long links of 15 arms."""
FARTHEST_TURN, LEAST_TURN = 25.0, 0.12
"""Range of a pin [rad]: four turns; seven degrees; assumed."""


@dataclass(frozen=True)
class Oddity:
    """An implausible number.

    Attributes:
        path: the number, or its vector or part: `link2.com`.
        got: the implausible value.
        expected: the expected value, and a possible cause.
    """

    path: str
    got: str
    expected: str

    def __str__(self) -> str:
        return f"{self.path}: {self.got}; expected {self.expected}"


def oddities(
    arm: Arm, extents: Mapping[str, Float[np.ndarray, "2 3"]] | None = None, free: Collection[str] | None = None
) -> tuple[Oddity, ...]:
    """Return the implausible numbers of an arm, one finding for each.

    Args:
        arm: one arm, with concrete numbers.
        extents: lowest and highest corner of bodies with a shape, (2, 3) [m] in their joint's axes, by name.
        free: fitted numbers, by path, to compare only these; all by default.
    """
    reach, extents = reach_of(arm), extents or {}
    every = links(arm)
    found = list(_lengths(arm, reach)) or list(_whole(arm, reach))
    found = found or [*_bodies(every, reach, extents), *_light(arm), *_placeholders(every, reach, extents)]
    found += [] if found else [*_giving(arm), *_proportion(arm, free)]  # wrong masses affect all of these
    found += _end_point(arm, reach)
    first: dict[str, Oddity] = {}
    for each in (*found, *_limits(arm), *_drives(arm)):
        first.setdefault(each.path, each)
    return tuple(first.values())


def behaviour_oddities(
    arm: Arm,
    frequency: Float[np.ndarray, "m"],
    damping_ratio: Float[np.ndarray, "m"],
    energy: Float[np.ndarray, "2 N"],
    sag: float,
) -> Iterator[Oddity]:
    """Yield implausible properties of an arm at a posture.

    Args:
        arm: the arm.
        frequency: (m,) [Hz] natural frequencies, ascending.
        damping_ratio: (m,) [-] of the same modes.
        energy: (2, N) [-] strain energy of the first mode in bending and torsion of each joint.
        sag: [m] static deflection of the end point.
    """
    field, joint = np.unravel_index(int(np.argmax(energy)), energy.shape)
    path = f"{arm.joints[joint].name}.{STIFFNESS[field]}"
    first, reach = float(frequency[0]), reach_of(arm)
    if not LOWEST <= first <= HIGHEST:
        got = f"the first natural frequency is {first:.3g} Hz, {100 * energy[field, joint]:.0f} % of its energy is here"
        yield Oddity(path, got, f"{LOWEST:g} to {HIGHEST:g} Hz; check stiffnesses, masses and their units")
    if sag > MOST_SAG * reach:
        got = f"the end point sags by {1e3 * sag:.3g} mm, {100 * sag / reach:.2g} % of the reach of {reach:.3g} m"
        yield Oddity(path, got, f"less than {100 * MOST_SAG:g} %")
    if damping_ratio.max() > MOST_DAMPED:
        worst = int(damping_ratio.argmax())
        by_mass = float(arm.get(ALPHA)) / (4 * np.pi * float(frequency[worst])) > float(damping_ratio[worst]) / 2
        way = LOSS[field] if arm.joints[joint].loss_bend is not None else DAMPING[field]
        at = ALPHA if by_mass else f"{arm.joints[joint].name}.{way}"
        said = {"alpha": "alpha is in 1/s", "loss": "a loss factor is twice the ratio", "tau": "tau is in seconds"}
        got = f"mode {worst + 1} has a damping ratio of {100 * damping_ratio[worst]:.3g} %"
        words = said[at.partition(".")[2].partition("_")[0]]
        yield Oddity(at, got, f"below {100 * MOST_DAMPED:g} %; {words}")


def _lengths(arm: Arm, reach: float) -> Iterator[Oddity]:
    """Yield lengths in the wrong unit: too long for an arm, or a thousandth of the other lengths."""
    vectors = {f"{joint.name}.offset": joint.offset for joint in arm.joints}
    vectors |= {f"{point.name}.position": point.position for point in arm.points}
    sizes = {path: float(np.linalg.norm(vector)) for path, vector in vectors.items()}
    far = {path: size for path, size in sizes.items() if size > LONGEST}
    unit = 'unit = "mm" where the numbers are millimetres'
    if reach < SHORTEST:
        yield Oddity("reach", f"the whole arm is {1e3 * reach:.3g} mm long", 'some metres; unit = "m"?')
    elif len(far) > 2:
        yield Oddity("reach", f"the arm is {reach:.4g} m long", f"at most {LONGEST:g} m; {unit}")
    else:
        yield from (Oddity(path, f"{size:.4g} m", f"at most {LONGEST:g} m; {unit}") for path, size in far.items())
    for path, size in sizes.items():
        if 3e-5 < size < 5e-3 and 0.05 * reach < 1e3 * size < 2 * reach:
            yield Oddity(path, f"{1e3 * size:.3g} mm in an arm of {reach:.3g} m", f'{1e3 * size:.3g} m; unit = "m"?')


def _whole(arm: Arm, reach: float) -> Iterator[Oddity]:
    """Yield a total mass that does not match the reach (too heavy even without the heaviest body)."""
    masses = [0.0, *(float(body.mass) for body in arm.bodies)]
    whole, heavy = sum(masses), sum(masses) - max(masses) > MOST_COMPACT * reach**3
    if heavy or 0 < whole < SPARSEST * reach**3:
        unit, size = ("g", 1e-3) if heavy else ("t", 1e3)
        expected = f'{size * whole:.3g} kg; unit = "{unit}", or kg in a robot description?'
        yield Oddity("bodies.mass", f"{whole:.4g} kg on a reach of {reach:.3g} m", expected)


def _light(arm: Arm) -> Iterator[Oddity]:
    """Yield masses of bodies in the wrong unit for their neighbours."""
    own = [max(((float(body.mass), body.name) for body in (*j.shaft, *j.link)), default=(0.0, "")) for j in arm.driven]
    heavy = [each for each in own if each[0] > 0]
    for (before, _), (mass, name), (after, _) in zip(heavy, heavy[1:], heavy[2:], strict=False):
        if LIGHTER * mass < min(before, after):
            got = f"{1e3 * mass:.3g} g between {before:.3g} and {after:.3g} kg"
            yield Oddity(f"{name}.mass", got, f'{1e3 * mass:.3g} kg; unit = "kg"?')


def _end_point(arm: Arm, reach: float) -> Iterator[Oddity]:
    """Yield an end point far before the arm's end: the last point that the file lists."""
    names = [joint.name for joint in arm.joints]
    if arm.points and (place := names.index(arm.points[-1].joint)) < len(names) - 1:
        lengths = [float(np.linalg.norm(link_end(arm, n))) for n in range(place)]
        along = sum(lengths) + float(np.linalg.norm(arm.points[-1].position))
        if along < ENDS * reach:
            got = f"{arm.points[-1].name}, {along:.3g} m of {reach:.3g} m reach"
            yield Oddity("end point", got, "the hand's: list that point last")


def _bodies(every: Sequence[Link], reach: float, extents: Mapping[str, np.ndarray]) -> Iterator[Oddity]:
    """Yield bodies away from their link, or too heavy for their size."""
    masses = {body.name: float(body.mass) for link in every for body in link.bodies}
    total = sum(masses.values())
    for link in every:
        for body in link.bodies:
            mass, com = float(body.mass), np.asarray(body.com)
            extent = extents.get(body.name)
            if mass > NEGLIGIBLE * total:
                yield from _place(f"{body.name}.com", com, link, reach, extent)
            if extent is not None:
                yield from _density(f"{body.name}.mass", mass, extent)
            elif mass > NEGLIGIBLE * total:
                yield from _gyration(f"{body.name}.inertia", mass, np.asarray(body.inertia), link, com, reach)
            if len(masses) > 2 and mass > 50 * (total - mass):
                got = f"{mass:.4g} kg, all other bodies have {total - mass:.3g} kg"
                yield Oddity(f"{body.name}.mass", got, 'less; unit = "g"?')


def _place(path: str, com: np.ndarray, link: Link, reach: float, extent: np.ndarray | None) -> Iterator[Oddity]:
    """Yield a mass centre beyond the ends of its link, or far off it."""
    length = float(np.linalg.norm(link.end))
    along = float(com @ link.end) / length if length else 0.0
    beyond = max(-along, along - length) if length else 0.0
    aside = to_segment(com, link.end) if extent is None else to_box(link.end, extent)
    allowed = 0.25 * reach + 0.5 * length if extent is None else 0.05 * reach + 0.1 * length
    where = ", ".join(f"{x:.4g}" for x in com + 0.0)
    size = float(np.linalg.norm(com))
    if length > SHORTEST and size < 2e-3 and 0.2 * length < 1e3 * size < 1.2 * length:
        yield Oddity(path, f"{1e3 * size:.3g} mm on a link of {length:.3g} m", f'{1e3 * size:.3g} m; unit = "m"?')
    elif beyond > 0.25 * length + 0.05 * reach:
        got = f"({where}) m, {beyond:.3g} m beyond the ends of its link, which is {length:.3g} m long"
        yield Oddity(path, got, f"a mass centre between the link's ends{_thousandth(com, length or reach)}")
    elif aside > allowed:
        what = "its mass centre" if extent is None else "its shape"
        got = f"({where}) m: {what} is {aside:.3g} m away from its link"
        yield Oddity(path, got, f"less than {allowed:.2g} m{_thousandth(com, length or reach)}")


def _thousandth(vector: np.ndarray, length: float) -> str:
    return '; unit = "mm"?' if float(np.linalg.norm(vector)) > 50 * length else ""


def _density(path: str, mass: float, extent: np.ndarray) -> Iterator[Oddity]:
    """Yield a mass impossible for any material in a box of that size."""
    size = extent[1] - extent[0]
    volume = float(np.prod(size))
    if not (volume > 0 and mass > 0) or LIGHTEST < mass / volume < DENSEST:
        return
    edges = " x ".join(f"{edge:.3g}" for edge in size)
    heavy = mass / volume >= DENSEST
    expected = f"{'at most' if heavy else 'above'} {DENSEST if heavy else LIGHTEST:,.0f} kg/m^3; check kg, g, m and mm"
    yield Oddity(path, f"{mass:.4g} kg in {edges} m, {mass / volume:.3g} kg/m^3", expected)


def _gyration(
    path: str, mass: float, inertia: np.ndarray, link: Link, com: np.ndarray, reach: float
) -> Iterator[Oddity]:
    """Yield an inertia whose radius of gyration is larger than the body, or tiny."""
    largest = float(np.linalg.eigvalsh(inertia)[-1])
    if not (mass > 0 and largest > 0):
        return
    size = max(float(np.linalg.norm(link.end)), float(np.linalg.norm(com)), 0.1 * reach)
    radius = (largest / mass) ** 0.5
    if radius > size or radius < 0.003 * size:
        got = f"{largest:.3g} kg m^2 of {mass:.3g} kg, a radius of gyration of {radius:.3g} m"
        expected = f"about {0.3 * size:.2g} m on a link of {size:.2g} m, some {mass * (0.3 * size) ** 2:.1g} kg m^2"
        yield Oddity(path, got, f'{expected}; unit = "kg*mm^2", or about the mass centre?')


def _placeholders(every: Sequence[Link], reach: float, extents: Mapping[str, np.ndarray]) -> Iterator[Oddity]:
    """Yield findings on all bodies together, as in a description with placeholder masses."""
    if same := _alike([(link, body) for link in every for body in link.bodies if body.name not in extents], reach):
        yield same
    long = [link for link in every if link.bodies and float(np.linalg.norm(link.end)) > LONG * reach]
    if len(long) < 2:
        return
    lengths = np.array([np.linalg.norm(link.end) for link in long])
    shown = ", ".join(body.name for link in long for body in link.bodies)
    whole = [_together(link.bodies) for link in long]
    if all(
        mass > 0 and np.linalg.norm(com) < 0.005 * each for (mass, com, _), each in zip(whole, lengths, strict=True)
    ):
        got = f"the mass centres of all long links ({shown}) are at their joints"
        yield Oddity("bodies.com", got, f"near the middle of links of {lengths.min():.2g} to {lengths.max():.2g} m")
    if same or any(body.name in extents for link in long for body in link.bodies):
        return
    edges = np.array([_longest_edge(mass, inertia) for mass, _, inertia in whole])
    if (edges > 0).all() and ((edges < FLATTEST * lengths).all() or (edges > LARGEST_BOX * lengths).all()):
        got = f"boxes of the inertias of all long links ({shown}) are {edges.min():.2g} to {edges.max():.2g} m long"
        yield Oddity("bodies.inertia", got, f"{lengths.min():.2g} to {lengths.max():.2g} m, as the links are")


def _alike(bodies: Sequence[tuple[Link, Body]], reach: float) -> Oddity | None:
    """Return the finding that most bodies share one inertia, though their links or masses differ."""
    tensors = [np.asarray(body.inertia) for _, body in bodies]
    groups = ([np.allclose(other, one, rtol=1e-6, atol=0) for other in tensors] for one in tensors if one.any())
    most = max(groups, key=sum, default=[])
    if sum(most) < max(LEAST_ALIKE, ALIKE * len(bodies)):
        return None
    group = [pair for pair, is_same in zip(bodies, most, strict=True) if is_same]
    length = np.array([np.linalg.norm(link.end) for link, _ in group])
    mass = np.array([float(body.mass) for _, body in group])
    if length.max() < UNLIKE * max(length.min(), 0.02 * reach) and mass.max() < UNLIKE * mass.min():
        return None
    moments = ", ".join(f"{x:.3g}" for x in np.linalg.eigvalsh(np.asarray(group[0][1].inertia)))
    masses = f"{mass.min():.3g}" + f" to {mass.max():.3g}" * bool(mass.max() > mass.min())
    got = f"{len(group)} bodies of {masses} kg have one inertia, {moments} kg m^2, on links up to {length.max():.2g} m"
    n = int(length.argmax())
    expected = f"the inertia of each: a box of {mass[n]:.3g} kg and {length[n]:.2g} m has"
    return Oddity("bodies.inertia", got, f"{expected} {mass[n] * length[n] ** 2 / 12:.2g} kg m^2 across; placeholders?")


def _together(bodies: Sequence[Body]) -> tuple[float, np.ndarray, np.ndarray]:
    """Return mass, mass centre and inertia about it of bodies together."""
    mass = sum(float(body.mass) for body in bodies)
    com = np.asarray(sum(float(body.mass) * np.asarray(body.com) for body in bodies)) / (mass or 1.0)
    inertia = np.zeros((3, 3))
    for body in bodies:
        inertia += np.asarray(body.inertia) + inertia_of_mass(float(body.mass), np.asarray(body.com) - com)
    return mass, com, inertia


def _longest_edge(mass: float, inertia: np.ndarray) -> float:
    """Return the longest edge [m] of the solid box of a mass and inertia."""
    moments = np.linalg.eigvalsh(inertia)
    return float(np.sqrt(max(6 * (moments[2] + moments[1] - moments[0]) / mass, 0.0))) if mass > 0 else 0.0


def _giving(arm: Arm) -> Iterator[Oddity]:
    """Yield stiffnesses that deflect by degrees under the weight beyond them, held out level."""
    g = float(np.linalg.norm(arm.gravity))
    level = True  # whether every axis up to here is along gravity, so that torsion never carries weight
    for joint, beyond in zip(arm.joints, carried(arm), strict=True):
        moment = g * beyond.mass * beyond.distance
        level = level and bool(g) and abs(float(np.asarray(joint.axis) @ np.asarray(arm.gravity))) > 0.999 * g
        for field in STIFFNESS[: 1 if level else 2]:
            k = np.inf if (k := getattr(joint, field)) is None else float(k)
            if moment > MOST_GIVING * k:
                angle = moment / k
                much = f"{np.degrees(angle):.2g} deg" if angle < 0.5 else "over"
                got = f"{k:.3g} N m/rad carries {beyond.mass:.3g} kg at {beyond.distance:.2g} m: bent {much} by weight"
                yield Oddity(f"{joint.name}.{field}", got, f"above {moment / MOST_GIVING:.1g} N m/rad")


def _proportion(arm: Arm, free: Collection[str] | None) -> Iterator[Oddity]:
    """Yield free stiffnesses far from all others of their direction, which the inertia they carry does not explain."""
    inertia = dict(zip((joint.name for joint in arm.joints), (each.inertia for each in carried(arm)), strict=True))
    k = {path: float(arm.get(path)) for path in stiffness_paths(arm) if free is None or path in free}
    loaded = {path: value / inertia[path.partition(".")[0]] for path, value in k.items()}

    def ratios(path: str) -> tuple[float, float, float]:
        """Return the ratios to the median of its direction, plain and relative to load, and to the overall median."""
        others = [each for each in k if each != path]
        like = [each for each in others if each.partition(".")[2] == path.partition(".")[2]] or [path]
        plain, by_load = (each[path] / float(np.median([each[p] for p in like])) for each in (k, loaded))
        return plain, by_load, k[path] / float(np.median([k[each] for each in others]))

    while len(k) > 1:
        found = {path: ratios(path) for path in k}
        odd = [path for path, (a, b, _) in found.items() if min(a, b) > PROPORTION or max(a, b) < 1 / PROPORTION]
        if not odd:
            return
        path = max(odd, key=lambda each: abs(np.log(found[each][0])) + abs(np.log(found[each][2])))  # of two, by all
        ratio = found[path][0]
        much = f"{ratio:.2g} times" if ratio > 1 else f"1/{1 / ratio:.2g} of"
        got = f"{k[path]:.3g} N m/rad, {much} the median of all other {path.partition('.')[2]}"
        near = f"something near {k.pop(path) / ratio:.1g} N m/rad"
        yield Oddity(path, got, f"{near}; 1 N m/deg is 57 N m/rad, 1 N mm/deg is 0.057")


def _limits(arm: Arm) -> Iterator[Oddity]:
    """Yield ranges of angles that look like degrees given as radians, or the other way."""
    ranges = {f"{joint.name}.limits": joint.limits for joint in arm.driven}
    if arm.stroke:
        ranges["stroke.folded"] = (float(arm.stroke.unfolded), float(arm.stroke.folded))
    for path, (low, high) in ranges.items():
        width = abs(high - low)
        shown = f"{np.degrees(low):.4g} to {np.degrees(high):.4g} deg"
        if FARTHEST_TURN < width < np.inf:
            yield Oddity(path, shown, f'some turns at most; unit = "deg", {low:.4g} to {high:.4g}?')
        elif 0 < width < LEAST_TURN:
            yield Oddity(path, shown, f'a wider range; unit = "rad", {np.degrees(np.degrees(width)):.3g} deg wide?')


def _drives(arm: Arm) -> Iterator[Oddity]:
    """Yield drives and belts of an unlikely size, and belts that cannot run."""
    for drive in arm.drives:
        ratio, eccentricity = abs(float(drive.ratio)), float(drive.eccentricity)
        if not 5 <= ratio <= 1000:
            yield Oddity(f"{drive.name}.ratio", f"{float(drive.ratio):g}", "30 to 320 for a harmonic drive")
        if eccentricity > 0.1:
            yield Oddity(f"{drive.name}.eccentricity", f"{eccentricity:g} m", 'some millimetres; unit = "mm"?')
        errors = {f"{drive.name}.error": drive.error} | {f"{e.name}.amplitude": e.amplitude for e in drive.errors}
        for path, error in errors.items():
            if float(error) > 0.01:
                yield Oddity(path, f"{np.degrees(float(error)):.3g} deg", 'some arc minutes; unit = "arcsec"?')
    for belt in arm.belts:
        for end in ("driver_radius", "driven_radius"):
            if not 1e-3 < (radius := float(getattr(belt, end))) < 0.5:
                yield Oddity(f"{belt.name}.{end}", f"{radius:g} m", 'some centimetres; unit = "mm"?')
    for each in belt_mismatches(arm):
        other = f" or driven_radius = {1e3 * each.radius:.6g} mm" if each.radius > 0 else ""
        got = f"one span would grow by {1e3 * each.stretch:.4g} mm over the stroke, {1e3 * each.allowed:.3g} slacken it"
        yield Oddity(each.belt, got, f"{each.drive}.ratio = {each.ratio:.6g}{other}")
