"""A result against something independent of ident: asserted, and kept for `docs/conformance.md`.

`agrees` is `numpy.testing.assert_allclose` that says what is compared with what. Where the environment names a folder,

    IDENT_CONFORMANCE=/tmp/records python -m pytest -m ""
    python docs/conformance_page.py /tmp/records

each comparison leaves a line of JSON there, from which that page is made; nothing is computed or typed a second time.

    python tests/support/conformance.py /tmp/records 10

picks ten lines of those at random, of ten tests, and runs these with the computed value moved by ten tolerances: each
must fail.
"""

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import numpy as np

FOLDER, MOVED = "IDENT_CONFORMANCE", "IDENT_CONFORMANCE_MOVED"
"""Names of variables: where records go; which lines are moved by ten tolerances, each as `group: what: source`."""
GROUPS = ("mechanics", "statics", "modal", "inference", "verdict rates", "vibration", "balancing", "formats")
TOLERANCES = 10
NEARLY = 1e-6
"""Numbers whose sizes differ by less count as equally large: which of them is shown must not hang on rounding."""


def agrees(computed, expected, group, what, source, *, rtol=0.0, atol=0.0, largest=0.0, unit=""):
    """Assert that each |computed - expected| <= atol + rtol |expected| + largest max |expected|."""
    computed, expected = (each + 0.0 for each in (np.asarray(computed), np.asarray(expected)))
    least = atol + (largest * np.abs(expected).max() if largest else 0.0)
    allowed = np.broadcast_to(least + rtol * np.abs(expected), np.broadcast_shapes(computed.shape, expected.shape))
    both = [np.broadcast_to(each, allowed.shape) for each in (computed, expected)]
    shown = _largest(both[1] if np.any(expected) else both[0])
    if _is_moved(group, what, source):
        computed = both[0].copy()
        computed[shown] += TOLERANCES * (allowed[shown] or np.spacing(abs(both[1][shown])))
        both[0] = computed
    np.testing.assert_allclose(computed, expected, rtol=rtol, atol=least)
    off = np.abs(both[0] - both[1])
    used = np.divide(off, allowed, out=np.zeros(allowed.shape), where=allowed > 0)
    said = ((rtol, "relative"), (atol, "absolute"), (largest, "of the largest"))
    _keep(
        group,
        what,
        source,
        expected=_number(both[1][shown]),
        computed=_number(both[0][shown]),
        tolerance=float(allowed[shown]),
        rule=", ".join(f"{value:.3g} {word}" for value, word in said if value) or "exact",
        unit=unit,
        numbers=int(allowed.size),
        used=float(np.nanmax(used)),
    )


def within(value, low, high, group, what, source, *, unit="", **said):
    """Assert that low < value < high: a band that a source states, or the one in which a difference lies.

    Args:
        value: a number.
        low, high: the band.
        group, what, source: of the line.
        unit: of the numbers.
        said: `expected`, `computed` and `rule` in words, where numbers alone do not say it; `note`, the reason;
            `differs`, of a source that ident does not agree with: the band says by how much.
    """
    value, half = float(value), (high - low) / 2
    if _is_moved(group, what, source):
        value += TOLERANCES * half
    assert low < value < high, f"{what}: got {value:g}, expected {low:g} to {high:g}"
    band = f"{low:.4g} to {high:.4g}"
    found = {"expected": band, "computed": value, "rule": band, "unit": unit} | said
    used = abs(value - (low + high) / 2) / half
    _keep(group, what, source, tolerance=half, numbers=1, used=used, **found)


def counted(count, of, low, high, group, what, source, *, expected):
    """Assert that low <= count <= high of so many; `expected` is the share that is promised, or a text."""
    count, of, low, high = int(count), int(of), int(np.ceil(low)), int(np.floor(high))
    if _is_moved(group, what, source):
        count += TOLERANCES * max(high - low, 1)
    assert low <= count <= high, f"{what}: got {count} of {of}, expected {low} to {high}"
    _keep(
        group,
        what,
        source,
        expected=expected if isinstance(expected, str) else f"{expected:.4g} of {of}",
        computed=f"{count} of {of}",
        tolerance=(high - low) / 2,
        rule=f"{low} to {high}",
        unit="",
        numbers=of,
        used=abs(count - (low + high) / 2) / max((high - low) / 2, 0.5),
    )


def states(holds, group, what, source, *, expected, computed, rule, **said):
    """Assert a statement in words, with its numbers as they are printed; `note` and `differs` as of `within`."""
    holds = bool(holds) and not _is_moved(group, what, source)
    assert holds, f"{what}: got {computed}, expected {expected}"
    texts = {"expected": expected, "computed": computed, "rule": rule}
    _keep(group, what, source, **texts, tolerance=0.0, unit="", numbers=1, used=0.0, **said)


def _largest(values):
    """Return the index of the first number that is about as large as the largest."""
    size = np.nan_to_num(np.abs(values))
    return np.unravel_index(np.argmax(size.ravel() >= (1 - NEARLY) * size.max()), size.shape)


def _number(value):
    """Return a number, of a complex one its size."""
    return float(np.abs(value)) if np.iscomplexobj(value) else float(value)


def _is_moved(*line):
    return ": ".join(line) in os.environ.get(MOVED, "").splitlines()


def _keep(group, what, source, *, differs=False, note="", **found):
    """Append a comparison that held to the records, where they are kept."""
    assert group in GROUPS, group
    if folder := os.environ.get(FOLDER):
        test = os.environ.get("PYTEST_CURRENT_TEST", "").rpartition(" (")[0]
        line = {"group": group, "what": what, "source": source, "test": test, "differs": differs, "note": note}
        Path(folder).mkdir(parents=True, exist_ok=True)
        with (Path(folder) / f"{os.getpid()}.jsonl").open("a", encoding="utf-8") as file:
            file.write(json.dumps(line | found) + "\n")


def records(folder):
    """Return what the tests of a run have kept, by line: group, what and source."""
    lines = {}
    for path in sorted(Path(folder).glob("*.jsonl")):
        for text in path.read_text(encoding="utf-8").splitlines():
            each = json.loads(text)
            lines.setdefault((each["group"], each["what"], each["source"]), []).append(each)
    return lines


def main(folder, count=10, seed=0):
    """Run the tests of some lines with the computed values moved; return how many of them do not fail."""
    lines = sorted((line, min(each["test"] for each in kept)) for line, kept in records(folder).items())
    if not lines:
        sys.exit(f"{folder}: no records")
    random.Random(int(seed)).shuffle(lines)
    chosen = {}
    for line, test in lines:
        if len(chosen) < int(count) and test.partition("[")[0] not in {each.partition("[")[0] for each in chosen}:
            chosen[test] = ": ".join(line)
    moved = {name: value for name, value in os.environ.items() if name != FOLDER} | {MOVED: "\n".join(chosen.values())}
    call = [sys.executable, "-m", "pytest", "-q", "-m", "", "-rA", "--tb=no", "-p", "no:cacheprovider", *chosen]
    said = subprocess.run(call, env=moved, capture_output=True, text=True, check=False).stdout.splitlines()
    failed = {test: any(each.startswith(f"FAILED {test}") for each in said) for test in chosen}
    for test, line in chosen.items():
        print("fails" if failed[test] else "DOES NOT FAIL", line, test, sep=" | ")
    return sum(not each for each in failed.values())


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
