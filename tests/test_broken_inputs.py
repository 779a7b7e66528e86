"""Some 1500 broken inputs: each is read all the same, or refused in one line for each mistake; nothing else ends it.

They are drawn from a seed, so that a failure comes back. What is accepted stops before anything is computed of it.
"""

import gc
import json
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from arms import lcd_arm
from broken import (
    NUMBERS,
    WORDS,
    broken_bytes,
    broken_documents,
    broken_mat,
    broken_tdms,
    broken_texts,
    broken_wav,
    damaged,
    pick,
)
from commands import ARM, log, posterior
from figures import CAMPAIGN_FIT
from hammer_files import FOLDER
from recording_files import ANSWER, FORCE, LVM, TIME, files, uff
from results import RESULTS
from three_joints import WITH_HAND, WITHOUT_MESHES

import ident
from ident.codec import Store
from ident.errors import InputError
from ident.identify.problem import pose
from ident.identify.unknowns import stiffness_parameters
from ident.measure import parse_campaign
from ident.measure.channels import read_channels
from ident.measure.log import parse_log
from ident.measure.recordings import read_recording
from ident.measure.trace import parse_trace
from ident.studies.motion_options import basis_of
from ident.studies.options import flag_of, specs
from ident.studies.result import other_inputs
from ident.studies.saved import files_of
from ident.studies.shared import as_file
from ident.studies.values import drawn_values, fitted_values
from ident.vibrate.simulate import sample_times

CAMPAIGN, TABLE = ARM.with_name("campaign.csv"), ARM.with_name("table1.csv")
LONGEST = 1000
"""Characters of a line that says what is wrong."""


def refused(read):
    """Tell whether something is refused, as it should be."""
    try:
        read()
    except InputError as error:
        for problem in error.problems:
            line = str(problem)
            assert len(line.splitlines()) == 1, line
            assert len(line) < LONGEST, line
            assert line.isprintable(), line
            assert problem.got, line
            assert problem.expected, line
            assert problem.remedy, line
        return True
    return False


def share_refused(cases, read):
    """Return the share of cases that are refused; show one that ends otherwise."""
    found = []
    for number, case in enumerate(cases):
        try:
            found.append(refused(partial(read, case)))
        except Exception as error:
            error.add_note(f"case {number}: {case!r:.3000}")
            raise
    return np.mean(found)


def test_campaigns():
    arm = lcd_arm()
    cases = broken_texts(np.random.default_rng(1), CAMPAIGN.read_text(), 100)
    assert 0.5 < share_refused(cases, lambda data: pose(arm, parse_campaign(data, "bad.csv")).problem) < 1


def test_arm_files(tmp_path):
    def read(data):
        (tmp_path / "bad.toml").write_bytes(data)
        ident.read_arm(tmp_path / "bad.toml")

    assert 0.5 < share_refused(broken_texts(np.random.default_rng(2), ARM.read_text(), 125), read) < 1


@pytest.mark.parametrize(
    ("name", "text", "read"), [("bad.urdf", WITH_HAND, ident.read_urdf), ("bad.xml", WITHOUT_MESHES, ident.read_mjcf)]
)
def test_robot_descriptions(tmp_path, monkeypatch, name, text, read):
    monkeypatch.chdir(tmp_path)

    def read_file(data):
        (tmp_path / name).write_bytes(data)
        read(tmp_path / name, stiffness=(1e5, 1e5))

    assert 0.4 < share_refused(broken_texts(np.random.default_rng(21), text, 50), read_file) < 1
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_logs(tmp_path):
    log(tmp_path / "good.csv")
    cases = broken_texts(np.random.default_rng(3), (tmp_path / "good.csv").read_text(), 75)
    assert 0.5 < share_refused(cases, lambda data: parse_log(data, "bad.csv", ["joint1", "joint2", "joint3"])) < 1


def test_traces():
    rows = [f"{k / 100},{k % 7},{0.5 * (k % 3)}\n" for k in range(40)]
    cases = broken_texts(np.random.default_rng(4), "time [s],x [mm],z [mm]\n" + "".join(rows), 75)
    assert 0.5 < share_refused(cases, lambda data: parse_trace(data, "bad.csv")) < 1


@pytest.mark.parametrize("end", ["uff", "mat", "h5", "lvm", "tdms", "wav"])
def test_recordings(tmp_path, end):
    good = next(path for path in files(tmp_path) if path.suffix == f".{end}")

    def read(data):
        good.write_bytes(data)
        read_recording(good)

    assert (
        0.4
        < share_refused(broken_bytes(np.random.default_rng(12), good.read_bytes(), 10 if end == "mat" else 30), read)
        <= 1
    )


def good_uff(folder):
    uff(folder / "good.uff", 0)
    return (folder / "good.uff").read_text()


RECORDINGS = {
    "uff": lambda rng, folder: broken_texts(rng, good_uff(folder), 40),
    "lvm": lambda rng, folder: broken_texts(rng, LVM, 40),
    "mat": lambda rng, folder: broken_mat(rng, {"t": TIME, "f": FORCE, "y": ANSWER}, 40),
    "wav": lambda rng, folder: broken_wav(rng, bytes(range(64)) * 2, 40),
    "tdms": lambda rng, folder: broken_tdms(rng, 20),
}
"""Files that are whole, but hold what they should not."""


@pytest.mark.parametrize("end", RECORDINGS)
def test_recordings_of_other_contents(tmp_path, end):
    path = tmp_path / f"bad.{end}"

    def read(data):
        path.write_bytes(data)
        read_recording(path)

    share = share_refused(RECORDINGS[end](np.random.default_rng(15), tmp_path), read)
    assert (0 if end in ("tdms", "mat") else 0.1) <= share < 1


def test_tables_of_samples(tmp_path):
    rows = [f"{k / 100},{k % 7},{0.5 * (k % 3)}\n" for k in range(40)]
    text = "time [s],hammer [N],tip [m/s^2]\n" + "".join(rows)

    def read(data):
        (tmp_path / "bad.csv").write_bytes(data)
        read_recording(tmp_path / "bad.csv")

    assert 0.3 < share_refused(broken_texts(np.random.default_rng(13), text, 50), read) < 1


def test_channel_tables(tmp_path):
    def read(data):
        (tmp_path / "bad.csv").write_bytes(data)
        read_channels(tmp_path / "bad.csv")

    assert (
        0.3
        < share_refused(broken_texts(np.random.default_rng(14), (FOLDER / "channels.csv").read_text(), 75), read)
        < 1
    )


def test_fits(tmp_path):
    arm, path, rng = lcd_arm(), tmp_path / "bad.fit.json", np.random.default_rng(5)
    whole = json.loads(CAMPAIGN_FIT.read_text())
    short = {key: whole[key] for key in ("format", "options", "inputs", "summary", "robot")}

    def read(document):
        path.write_text(json.dumps(document))
        fitted_values(path, arm)

    def read_bytes(data):
        path.write_bytes(data)
        fitted_values(path, arm)

    assert 0.1 < share_refused(broken_documents(rng, short, 100), read) < 1
    assert 0.3 < share_refused(broken_texts(rng, json.dumps(short), 50), read_bytes) < 1
    head = json.dumps(short).encode()
    assert 0.3 < share_refused([b"[" * n + head for n in (1, 10**4, 10**6)], read_bytes) <= 1


def test_results(tmp_path):
    """What is loaded can be printed, and says to which inputs and options it belongs."""
    path = tmp_path / "bad.fit.json"
    whole = json.loads(CAMPAIGN_FIT.read_text())
    result = ident.load(CAMPAIGN_FIT)

    def read(document):
        path.write_text(json.dumps(document))
        ident.load(path).report()

    assert 0.1 < share_refused(broken_documents(np.random.default_rng(6), whole, 30), read) < 1
    heads = broken_documents(np.random.default_rng(17), {key: whole[key] for key in ("options", "inputs")}, 30)
    long = SimpleNamespace(form="ident-fleet/10", name=result.name, suffix=".json", inputs=result.inputs)
    for head in heads:
        (tmp_path / f"{result.name}.json").write_text(json.dumps({"format": result.form, **head}))
        other_inputs(long, tmp_path)


@pytest.mark.parametrize("command", ["fit", "check", "predict", "show", "spectrum", "rerun", "modal", "sample"])
def test_an_empty_name(run, command):
    code, out, err = run(command, "")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.startswith("ident: channels.csv: got " if command == "modal" else "ident: .: got ")


def test_a_name_that_leaves_no_room_for_those_of_files_beside_it(run, tmp_path):
    path = tmp_path / f"{'x' * 245}.csv"
    path.write_bytes(TABLE.read_bytes())
    assert len(ident.read_campaign(path)) == len(ident.read_campaign(TABLE))
    code, out, err = run("sample", path, f"--arm={ARM}")
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert "got file name too long" in err


def test_a_hundred_thousand_bad_rows_are_twenty_lines_and_a_count(tmp_path):
    text = TABLE.read_text()
    header = next(line for line in text.splitlines() if line.startswith("kind"))
    (tmp_path / "many.csv").write_text(header + "\nfrequency\n" * 100_000)
    with pytest.raises(InputError) as caught:
        ident.read_campaign(tmp_path / "many.csv")
    *lines, last = str(caught.value).splitlines()
    assert len(lines) == 20
    assert len(caught.value.problems) > 99_999
    assert last == f"and {len(caught.value.problems) - 20} more problems; correct those above first"


def test_identities_of_unfinished_runs(tmp_path):
    good = {"arm file": "a" * 64, "campaign": "b" * 64, "number of starts": "16"}
    rng = np.random.default_rng(18)
    texts = [*broken_texts(rng, json.dumps(good, indent=1), 60), b"[" * 100_000, b'{"a":' * 100_000]
    documents = [json.dumps(each).encode() for each in broken_documents(rng, good, 20)]

    def read(data):
        (tmp_path / "run.json").write_bytes(data)
        Store(tmp_path, good)

    assert 0.5 < share_refused([*texts, *documents], read) < 1


DEFAULTS = """starts = 1
no-figure = true
out = "results"
robust = "t"
prior-sd = 0.5
[fit]
fix = ["joint1.k_bend"]
seed = 3
[predict]
posture = "30,-60,30"
"""
VALUES_OF_FLAGS = (
    *("5", "-5", "1.5", "true", "nan", "1e400", "9" * 400, "'x'", "''", "[]", "[1]", "[[1]]", "{}", "{a = 1}"),
    *("1979-05-27", "07:32:00", '"\\u0000"', "'a=b'", "['a=b', 'a=c']", "[true]", "[{a = 1}]"),
)


def broken_defaults(rng, count):
    """Yield files of defaults: texts with mistakes, and good TOML with other values, tables and lists of tables."""
    yield from broken_texts(rng, DEFAULTS, count // 2)
    names = ("fit", "predict", "starts", "fix", "seed", "out", "arm", "tie", "robust", "no-figure", "help", "json")
    for _ in range(count // 2):
        table = pick(rng, ("", "", "[fit]", "[[fit]]", "[fit.fix]", "[predict]", "[a.b]"))
        pairs = {pick(rng, names): pick(rng, VALUES_OF_FLAGS) for _ in range(rng.integers(1, 3))}
        yield "\n".join([table, *(f"{name} = {value}" for name, value in pairs.items())]).encode()


def test_defaults(run, tmp_path):
    """With a campaign that is not there to stop at."""
    refused_ones = 0
    for text in broken_defaults(np.random.default_rng(19), 30):
        (tmp_path / "ident.toml").write_bytes(text)
        code, out, err = run("fit", tmp_path / "nowhere.csv")
        assert code == 2, text
        assert out == "" or out.startswith("defaults from"), text
        assert all(line.startswith("ident: ") for line in err.splitlines()), text
        refused_ones += "nowhere.csv" not in err
    assert 10 < refused_ones < 30
    assert [path.name for path in tmp_path.iterdir()] == ["ident.toml"]


@pytest.mark.filterwarnings("error::pytest.PytestUnraisableExceptionWarning")
def test_posteriors(tmp_path):
    arm, path = lcd_arm(), tmp_path / "bad.nc"
    posterior(tmp_path / "good.nc")

    def read(data):
        path.write_bytes(data)
        drawn_values(path, arm, 5)
        ident.load(path)

    cases = broken_bytes(np.random.default_rng(7), (tmp_path / "good.nc").read_bytes(), 75)
    assert 0.1 < share_refused(cases, read) <= 1
    gc.collect()  # what is thrown away must not complain


SAVED = sorted(RESULTS.glob("*.json"))


@pytest.mark.parametrize("good", SAVED, ids=lambda path: path.name.split(".")[-2])
def test_saved_results(tmp_path, good):
    """Damaged at places of their report, and of the rest: what commands do with one before they compute."""
    arm, path, rng = ident.read_arm(ARM), tmp_path / good.name, np.random.default_rng(SAVED.index(good))
    document = json.loads(good.read_text())
    study = document["format"].removeprefix("ident-").partition("/")[0]
    take = {"fit": fitted_values, "source": partial(drawn_values, count=5)}.get(study)

    def show():
        saved = ident.load(path)
        for details, width, colour in ((False, 60, True), (True, 100, False)):
            saved.report(details=details, width=width, colour=colour)
        json.dumps([saved.document(), saved.table(), saved.notes, saved._repr_html_()], allow_nan=False)
        return files_of(saved.inputs, tmp_path), saved.options

    def read(data):
        path.write_text(json.dumps(data))
        readers = [show, *([partial(take, path, arm)] if take else [])]
        return max([refused(each) for each in readers])

    rest = {name: value for name, value in document.items() if name not in ("report", "texts")}
    cases = [document | {"report": each} for each in damaged(rng, document["report"], 15)]
    cases += [{**each, "report": document["report"], "texts": document["texts"]} for each in damaged(rng, rest, 15)]
    assert sum(map(read, cases)) > 3


KINDS = [
    *(ident.CheckOptions, ident.FitOptions, ident.ProfileOptions, ident.SampleOptions, ident.PlanOptions),
    *(ident.PredictOptions, ident.ResonanceOptions, ident.SimulateOptions, ident.SpectrumOptions, ident.SweepOptions),
    ident.DesignOptions,
]
FORMS = {
    "fix": "{path}",
    "tie": "{path}={path}",
    "free": "{path}:{number}",
    "prior": "{path}={prior}:{number}:{number}",
    "discrepancy": "{kind}:{number}",
    "set": "{path}={number}",
    "vary": "{path}={number}:{number}x",
    "change": "{path}={path}={number}:{number}:{number}",
    "load": "{number} kg @ {point}",
    "posture": "{number},{number},{number}",
    "sigma": "{kind}={number}",
    "cost": "{kind}={number}",
}
"""How the text of an option may look; of any other it is a number or a word."""


def option_text(rng, name, paths):
    """Return the text of an option: of its form, with paths of the arm among the words that it is made of."""
    words = {
        "path": lambda: pick(rng, paths) if rng.random() < 0.9 else pick(rng, WORDS),
        "number": lambda: pick(rng, NUMBERS) if rng.random() < 0.7 else f"{rng.lognormal(0, 8):.3g}",
        "kind": lambda: pick(rng, ("frequency", "deflection", "posture", "hammer", "sway")),
        "prior": lambda: pick(rng, ("log-normal", "log-uniform", "catalogue", "flat")),
        "point": lambda: pick(rng, ("tip", "glass", "nowhere")),
    }
    form = FORMS.get(name, "{number}") if rng.random() < 0.9 else pick(rng, WORDS)
    parts = form.split("{")
    return parts[0] + "".join(
        words[key]() + rest for key, _, rest in (part.partition("}") for part in parts[1:] if "}" in part)
    )


def some_options(rng, kind, paths):
    """Return texts of one to three options of a kind, by their names."""
    every = specs(kind)
    chosen = [every[i][0].name for i in rng.choice(len(every), min(len(every), rng.integers(1, 4)), replace=False)]
    return {name: [option_text(rng, name, paths) for _ in range(rng.integers(1, 3))] for name in chosen}


def made(kind, texts):
    """Return the options that the command line makes of texts; what it does not read itself, typer has read."""
    given = {}
    for each, spec in specs(kind):
        for text in texts.get(each.name, ())[:1]:
            if spec.read:
                given[each.name] = spec.read(texts[each.name] if spec.repeated else text, flag_of(each))
            elif isinstance(each.default, bool):
                given[each.name] = True
            else:
                given[each.name] = as_typer_reads(text, str(each.type))
    return kind(**given)


def as_typer_reads(text, words):
    for make in (int,) if "int" in words else (float,) if "float" in words else ():
        try:
            return make(text)
        except ValueError:
            return None
    return text


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_options(kind):
    arm, rng = ident.read_arm(ARM), np.random.default_rng(KINDS.index(kind))

    def use(texts):
        options = made(kind, texts)
        if hasattr(options, "unknowns"):
            stiffness_parameters(arm.arm, options.unknowns)
        if hasattr(options, "hold"):
            sample_times(basis_of(as_file(arm), options).motion, getattr(options, "rate", 500.0))

    cases = [some_options(rng, kind, arm.arm.paths()) for _ in range(30)]
    assert 0.3 < share_refused(cases, use) < 1


def test_flags(run):
    """What the command line makes of a flag's text, with a file that is not there to stop at."""
    rng = np.random.default_rng(8)
    for kind in KINDS:
        name = kind.__name__.removesuffix("Options").lower()
        for each, spec in specs(kind):
            if isinstance(each.default, bool) or rng.random() < 0.3:
                continue
            code, out, err = run(name, "nowhere", f"{flag_of(each)}={pick(rng, NUMBERS + WORDS)}")
            assert (code, out) == (2, ""), err
            assert "nowhere" in err or flag_of(each) in err or spec.argument in err
            assert "Traceback" not in err
