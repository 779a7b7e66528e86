"""Makes a synthetic hammer test of the paper's arm: files as an analyser writes them, channel table, arm with points.

    python data/lcd_arm/hammer/generate.py          write the files beside this program
    python data/lcd_arm/hammer/generate.py --check  exit 0 if the files are those that it would write, 1 if not

The force is a half sine, the response to it exact: the closed form of each complex mode of M, C and H at the posture,
with the accelerometers' mass. Both then pass one filter, as in an analyser, noise is added, and the faults of `FAULTS`.
"""

import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import resample_poly

from ident.arm.arm import Arm
from ident.arm.chain import at_posture
from ident.arm.mechanics import point_positions, static_equilibrium, unflatten
from ident.arm.modes import linearize
from ident.description.file import read_arm
from ident.identify.binding import loads_of
from ident.measure import Load, to_si

HERE = Path(__file__).parent
ARM = HERE.parent / "arm.toml"
SEED = 20261124
ALPHA = (0, 30, 60, 80)
"""Postures q = alpha (1, -2, 1) [deg], as of campaign.csv."""
LOAD = "0.15 kg @ elbow + 0.15 kg @ tip"
"""Two triaxial accelerometers with their magnets."""
POINTS = {"elbow": "[0.9, 0.09, 0.105]"}
"""Points that arm.toml has not, on the end of link 2 [m]."""
NODES = {"tip": 1, "elbow": 2}
FORCES = {"z": ("tip", (0.0, 0.0, -1.0), -3), "y": ("tip", (0.0, 1.0, 0.0), 2)}
"""Where the hammer hits, along what, and the direction's number in a universal file."""
RATE, DURATION, TRIGGER, FINER = 200.0, 10.24, 0.25, 16
"""Sampling rate [Hz], duration of a record [s], time before the hit [s], and how much finer the exact solution is."""
HITS = 5
PEAK, SPREAD, PULSE = 150.0, 0.15, 0.025
"""Force of a hit [N], its relative spread, and its duration [s]."""
NOISE = {"force": 0.5, "acceleration": 0.1}
"""Standard deviation of noise [N, m/s^2]: of the sensors, and of what a factory floor shakes."""
MAINS = (60.0, 0.05)
"""Frequency [Hz] and amplitude [m/s^2] of what the accelerometers' cables pick up."""
FULL_SCALE = 250.0
"""Largest force [N] of the hammer's input."""
FAULTS = {(30, "z", 2): "double hit", (60, "y", 1): "overload"}
"""Faults by alpha, force and hit, which is repeated afterwards: so there are five good hits everywhere."""
WINDOW = {80: 0.3}
"""Decay [1/s] of the exponential window that the analyser has applied, by alpha."""
TABLE = HERE / "channels.csv"
COMMENTS = (
    "SYNTHETIC: computed with ident, not measured on any robot. Made by generate.py from ../arm.toml.",
    "Two triaxial accelerometers, hits at the tip downwards (z) and sideways (y), four postures, five good hits each.",
)


@dataclass(frozen=True)
class System:
    """Complex modes of an arm at a posture.

    Attributes:
        poles: (2n,) [1/s]
        residues: (O, I, 2n) of the accelerance, with s^2 in them: A(s) = direct + sum residue / (s - pole).
        direct: (O, I) [1/kg] accelerance beyond all modes.
    """

    poles: np.ndarray
    residues: np.ndarray
    direct: np.ndarray

    def accelerance(self, s: np.ndarray) -> np.ndarray:
        """Return the accelerance (O, I, F) [1/kg] at complex frequencies [1/s]."""
        return self.direct[:, :, None] + (self.residues[:, :, None] / (s[:, None] - self.poles)).sum(-1)

    def response(self, time: np.ndarray, peak: float, pulse: float, force: int) -> np.ndarray:
        """Return the accelerations (O, T) [m/s^2] to a half sine, exactly: zero before time 0, at rest then.

        For y' = p y + sin(k t) from rest, y = (k exp(p t) - k cos(k t) - p sin(k t)) / (p^2 + k^2) within the pulse.
        """
        k, p = np.pi / pulse, self.poles[:, None]
        within = np.clip(time, 0.0, pulse)
        y = (k * np.exp(p * within) - k * np.cos(k * within) - p * np.sin(k * within)) / (p**2 + k**2)
        free = y * np.exp(p * np.maximum(time - pulse, 0.0)) * (time > 0)
        return peak * ((self.residues[:, force] @ free).real + np.outer(self.direct[:, force], half_sine(time, pulse)))


def half_sine(time: np.ndarray, pulse: float) -> np.ndarray:
    """Return a half sine of height 1 from time 0 on."""
    return np.where((time > 0) & (time < pulse), np.sin(np.pi * time / pulse), 0.0)


def system(arm: Arm, posture: np.ndarray, load: str = LOAD) -> System:
    """Return the arm's modes seen by accelerometers along the axes of their bodies, and by the hammer."""
    M, C, H, outputs, inputs = (np.asarray(each) for each in _matrices(arm, jnp.asarray(posture), load))
    n = len(M)
    inverse = np.linalg.inv(M)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ H, -inverse @ C]])
    poles, right = np.linalg.eig(state)
    observed = outputs @ np.hstack([-inverse @ H, -inverse @ C]) @ right
    driven = np.linalg.solve(right, np.vstack([np.zeros_like(inputs), inverse @ inputs]))
    return System(poles, observed[:, None] * driven.T[None], outputs @ inverse @ inputs)


def _matrices(arm: Arm, posture: jax.Array, load: str) -> tuple[jax.Array, ...]:
    """Return M, C, H, and the maps from coordinates to what sensors see and from hits to what drives."""
    chain = at_posture(arm, posture, loads_of(arm, Load.parse(load)))
    at = static_equilibrium(chain)
    linear = linearize(chain, at)
    unit = jnp.eye(len(linear.M))
    motion = jax.vmap(lambda v: jax.jvp(lambda p: point_positions(chain, p), (at.phi,), (unflatten(v),))[1])(unit)
    names = [point.name for point in arm.points]
    axes = _link_axes(arm, posture)
    seen = [jnp.einsum("vc,cd->dv", motion[:, :, names.index(name)], axes[name]) for name in NODES]
    pushed = [motion[:, :, names.index(name)] @ jnp.asarray(direction) for name, direction, _ in FORCES.values()]
    return linear.M, linear.C, linear.H, jnp.concatenate(seen), jnp.stack(pushed, 1)


def _link_axes(arm: Arm, posture: jax.Array) -> dict[str, np.ndarray]:
    """Return the axes (3, 3), as columns, of the bodies that carry the points: all pins turn about z."""
    turned = dict(zip((joint.name for joint in arm.joints), np.cumsum(posture), strict=True))
    return {point.name: _about_z(float(turned[point.joint])) for point in arm.points}


def _about_z(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def records(seen: System, alpha: int, force: str, noise: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return force (B, T) [N] and accelerations (O, B, T) [m/s^2] of the hits at a posture, faults included."""
    faults = [FAULTS.get((alpha, force, hit), "") for hit in range(HITS)]
    every = [fault for hit in range(HITS) for fault in ([faults[hit], ""] if faults[hit] else [""])]
    made = [_hit(seen, list(FORCES).index(force), fault, WINDOW.get(alpha, 0.0), noise) for fault in every]
    return np.array([pushed for pushed, _ in made]), np.stack([answers for _, answers in made], 1)


def _hit(
    seen: System, force: int, fault: str, decay: float, noise: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    fine = np.arange(int((DURATION + 1.0) * RATE * FINER)) / (RATE * FINER) - TRIGGER
    peak, pulse = PEAK * (1 + SPREAD * noise.standard_normal()), PULSE * (1 + 0.05 * noise.standard_normal())
    peak *= 2.0 if fault == "overload" else 1.0
    pulses = [(0.0, peak), (0.09, 0.35 * peak)] if fault == "double hit" else [(0.0, peak)]
    pushed = sum(height * half_sine(fine - at, pulse) for at, height in pulses)
    answers = sum(seen.response(fine - at, height, pulse, force) for at, height in pulses)
    count = round(DURATION * RATE)
    both = resample_poly(np.vstack([pushed, answers]), 1, FINER, axis=1)[:, :count]
    time = np.arange(count) / RATE
    both[1:] += MAINS[1] * np.sin(2 * np.pi * MAINS[0] * time + 2 * np.pi * noise.random())
    both[0] += NOISE["force"] * noise.standard_normal(count)
    both[1:] += NOISE["acceleration"] * noise.standard_normal(both[1:].shape)
    both[0] = np.clip(both[0], -FULL_SCALE, FULL_SCALE)
    faded = both * np.exp(-decay * time)
    return faded[0], faded[1:]


def write_file(path: Path, force: str, pushed: np.ndarray, answers: np.ndarray, binary: bool = True) -> None:
    """Write the records of one posture and force as a universal file, in single precision.

    By hand: pyuff 2.5.8 writes binary samples in double precision even where the header says single.
    """
    point, _, direction = FORCES[force]
    parts = [_header()]
    ends = [(node, axis) for node in NODES.values() for axis in (1, 2, 3)]
    for block, (push, answer) in enumerate(zip(pushed, answers.swapaxes(0, 1), strict=True), 1):
        parts.append(_dataset(block, (NODES[point], direction), (13, "N"), push, binary))
        parts += [_dataset(block, end, (12, "m/s^2"), row, binary) for end, row in zip(ends, answer, strict=True)]
    path.write_bytes(b"".join(parts))


def _header() -> bytes:
    """Return a dataset 151: what the file is of, without a date."""
    lines = ["    -1", "   151", "LCD transfer arm", COMMENTS[0][:80], "generate.py", *["NONE"] * 4, "    -1"]
    return "".join(f"{line:<80}\n" if 1 < i < 9 else f"{line}\n" for i, line in enumerate(lines)).encode()


def _dataset(block: int, end: tuple[int, int], quantity: tuple[int, str], values: np.ndarray, binary: bool) -> bytes:
    """Return a dataset 58 of samples over time, binary (58b) with little end first."""
    data = values.astype("<f4").tobytes() if binary else _ascii(values)
    kind = (
        f"    58b{1:6d}{2:6d}{11:12d}{len(data):12d}" + "     0     0           0           0" if binary else "    58"
    )
    identity = ["SYNTHETIC", f"hit {block}", "NONE", "NONE", "NONE"]
    ends = f"{1:5d}{0:10d}{block:5d}{0:10d} {'NONE':>10}{end[0]:10d}{end[1]:4d} {'NONE':>10}{0:10d}{0:4d}"
    sampling = f"{2:10d}{len(values):10d}{1:10d}{0.0:13.5e}{1 / RATE:13.5e}{0.0:13.5e}"
    axes = [(17, "s"), quantity, (0, "NONE"), (0, "NONE")]
    lines = [
        kind,
        *identity,
        ends,
        sampling,
        *(f"{code:10d}{0:5d}{0:5d}{0:5d} {'NONE':<20} {unit:<20}" for code, unit in axes),
    ]
    head = "".join(f"{line:<80}\n" for line in lines)
    return b"    -1\n" + head.encode() + data + b"\n    -1\n"


def _ascii(values: np.ndarray) -> bytes:
    """Return numbers as 6E13.5, without the last line's end."""
    lines = ["".join(f"{value:13.5e}" for value in values[i : i + 6]) for i in range(0, len(values), 6)]
    return "\n".join(lines).encode()


def table() -> str:
    """Return the channel table."""
    columns = "file,channel,role,point,direction,frame,unit,full_scale,decay,q1 [deg],q2 [deg],q3 [deg],load"
    lines = [f"# {comment}" for comment in COMMENTS] + [columns]
    for alpha in ALPHA:
        where = f"{WINDOW.get(alpha, '')},{alpha},{-2 * alpha},{alpha},{LOAD}"
        axes = ("x", "y", "z")
        for force, (point, _, number) in FORCES.items():
            sign, axis = "-" if number < 0 else "+", axes[abs(number) - 1]
            words = f"{'-' if number < 0 else ''}{axis}"
            lines.append(f"{name(alpha, force)},{NODES[point]}:{sign}{axis.upper()} force,force,{point},{words},base,N,"
                         f"{FULL_SCALE:g},{where}")  # fmt: skip
        lines += [
            f"{name(alpha, '*')},{node}:+{axis.upper()} acceleration,response,{point},{axis},body,m/s^2,,{where}"
            for point, node in NODES.items()
            for axis in axes
        ]
    return "\n".join(lines) + "\n"


def name(alpha: int, force: str) -> str:
    """Return the name of the file of a posture and force."""
    return f"alpha{alpha:02d}_{force}.unv"


def arm_text() -> str:
    """Return the arm's file with the points of the accelerometers, before its end point."""
    text = ARM.read_text(encoding="utf-8")
    points = "".join(
        f'[[point]]\nname = "{point}"\njoint = "joint2"\n'
        f'position = {{ value = {place}, unit = "m", origin = "assumed", note = "an accelerometer" }}\n\n'
        for point, place in POINTS.items()
    )
    return text.replace("[[point]]", f"{points}[[point]]", 1)


def main(folder: Path = HERE) -> None:
    """Write arm, channel table and recordings."""
    (folder / "arm.toml").write_text(arm_text(), encoding="utf-8")
    (folder / "channels.csv").write_text(table(), encoding="utf-8")
    arm, noise = read_arm(folder / "arm.toml").arm, np.random.default_rng(SEED)
    for alpha in ALPHA:
        posture = np.array([to_si(alpha * turn, "deg", "angle") for turn in (1.0, -2.0, 1.0)])
        seen = system(arm, posture)
        for force in FORCES:
            write_file(folder / name(alpha, force), force, *records(seen, alpha, force, noise))


def check() -> int:
    """Tell whether the files beside this program are those that it writes."""
    with tempfile.TemporaryDirectory() as folder:
        main(Path(folder))
        same = [(HERE / path.name).read_bytes() == path.read_bytes() for path in Path(folder).iterdir()]
    return 0 if all(same) else 1


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    sys.exit(check() if "--check" in sys.argv else main())
