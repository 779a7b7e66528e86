"""The next command of each report: no circle, accepted by the program, and the same question as before."""

import ast
import inspect
import re
import shlex
import sys
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from shutil import copyfile
from types import SimpleNamespace

import pytest
from commands import ARM

import ident
from ident.cli import command
from ident.inference.priors import Prior
from ident.studies import MODULES, module_of
from ident.studies.following import AGAIN, CONTAINED, PRINTING, kept_in, next_command
from ident.studies.motion_options import HeldMotionOptions
from ident.studies.options import Options, default_of, specs
from ident.studies.shared import ArmOptions, ProblemOptions, SamplesOptions

PACKAGE = Path(ident.__file__).parent
CAMPAIGN, FIT, LOG = ARM.with_name("campaign.csv"), Path("an arm.fit.json"), Path("path.csv")
PROPOSED = re.compile(r"^(?:(.*): )?ident (\w+)\b *(.*)$", re.DOTALL)
WITHOUT = {"explore", "export", "joint"}
"""Studies whose report proposes nothing."""
FURTHER = {"diagnose": ("ident motion {arm}", "ident design {arm}", "ident simulate {arm} --set joint1.k_tors=3e5")}
"""Steps whose command is put together."""
MADE = re.compile(r"\{result\}\.(csv|toml)")
"""Motions, arms and campaigns that a command has written: with these its next one asks something else."""
GIVEN = {
    "limit": 0.4,
    "speed": 20.0,
    "profile": "cycloid",
    "retract": True,
    "smoothing": 0.1,
    "dwell": 1.0,
    "phases": "file",
    "errors": "30:60",
    "elastic_belts": True,
    "load": "5 kg @ tip",
    "set": ["link2.mass=30.25"],
    "fix": ["*.k_bend", "joint1.k_tors"],
    "tie": ["joint2.k_tors=joint3.k_tors"],
    "uncertain": ["link3.mass:5%"],
    "free": ["link2.mass:0.1", "joint2.offset.x"],
    "no_uncertain": True,
    "prior_sd": 0.5,
    "no_prior": True,
    "prior": ["joint1.k_tors=catalogue:1e5:2e5:3e5"],
    "discrepancy": ["deflection:0.1"],
    "trust_values": ["7"],
    "robust": "huber",
    "soft_base": 0.5,
    "columns": ["a=joint1:rad,b=time:ms"],
    "units": "N mm/deg",
    "force": True,
}


def literals(node):
    """The texts of a file; of what is put in, an X."""
    if isinstance(node, ast.JoinedStr):
        yield "".join(part.value if isinstance(part, ast.Constant) else "X" for part in node.values)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node.value
    else:
        yield from (text for child in ast.iter_child_nodes(node) for text in literals(child))


def steps():
    """Each next step that a report may name, with its study."""
    for study, module in sorted(MODULES.items()):
        path = PACKAGE.parent.joinpath(*f"{module}_report".split(".")).with_suffix(".py")
        texts = [*literals(ast.parse(path.read_text(encoding="utf-8"))), *FURTHER.get(study, ())]
        for text in sorted({text.replace("{{", "{").replace("}}", "}") for text in texts}):
            if (proposed := PROPOSED.match(text)) and proposed[2] in MODULES:
                yield study, text


STEPS = [*steps()]


def options_of(study):
    return getattr(module_of(study), f"{study.capitalize()}Options", Options)


def given_options(study):
    """Options of a study with all at once that the next command should repeat."""
    kind = options_of(study)
    return kind(**{each.name: GIVEN[each.name] for each, _ in specs(kind) if each.name in {*GIVEN} - {*kind.refuses}})


def test_every_report_leads_on():
    assert {study for study, _ in STEPS} == {*MODULES} - WITHOUT


def test_nothing_leads_in_a_circle():
    """Where nothing was changed, measured or written in between; the same command again has a further flag."""
    graph = {}
    for study, text in STEPS:
        before, following, rest = PROPOSED.match(text).groups()
        assert following != study or before or "--" in rest, text
        if following != study and not before and not MADE.search(rest):
            graph.setdefault(study, set()).add(following)
    TopologicalSorter(graph).prepare()
    assert graph["resonance"] == {"simulate"}
    assert graph["sample"] == {"plan", "resonance"}
    with pytest.raises(CycleError):
        TopologicalSorter({**graph, "simulate": {"resonance"}}).prepare()


@pytest.fixture
def parsed(monkeypatch):
    """The options of a command, which stops before it computes."""
    options, make = [], command._options
    monkeypatch.setattr(command, "_options", lambda kind, values: options.append(make(kind, values)) or options[-1])
    monkeypatch.setattr("ident.cli.running.start", sys.exit)
    return options


def inputs_taken(study):
    return () if study == "modal" else inspect.signature(getattr(module_of(study), study)).parameters


def inputs_of(study, *, along):
    """What a study may have been given, as files."""
    takes = inputs_taken(study)
    given = {"arm": ARM, "campaign": CAMPAIGN, "trace": LOG, "runs": LOG}
    given |= {"fit": FIT} if "fit" in takes else {}
    given |= {"path": LOG} if along and "path" in takes else {}
    return {name: SimpleNamespace(path=str(path)) for name, path in given.items()}


@pytest.mark.parametrize("along", [False, True], ids=["stroke", "path"])
@pytest.mark.parametrize(("study", "text"), STEPS, ids=lambda each: each[-40:])
def test_the_next_command_is_accepted_and_asks_the_same(study, text, along, run, tmp_path, parsed):
    copyfile(CAMPAIGN, tmp_path / "campaign.csv")
    text = text if PROPOSED.match(text)[3] else f"{text} {{campaign}}"  # the report puts it behind
    text = text.replace(" $(cat {result}.prior)", "").replace("CAMPAIGN", "{campaign}").replace("X", "{campaign}")
    inputs, given = inputs_of(study, along=along), given_options(study)
    with kept_in(tmp_path):
        words = next_command(text, inputs, given, "campaign")
    arguments = shlex.split(re.sub("^.*: (?=ident)", "", words))[1:]
    assert run(*arguments) == (0, "", ""), words
    assert ("--out" in arguments) == (arguments[0] not in PRINTING)
    left_out = {each for mark, own in CONTAINED.items() if mark in text for each in own}
    taken = {*inputs} & {*inputs_taken(arguments[0])} - left_out
    assert ("--fit" in arguments) == ("fit" in taken)
    assert ("--path" in arguments) == ("path" in taken or " --path " in text)
    left_out |= {"profile", "retract"} if "path" in taken else set()
    left_out |= set() if "fit" in taken or "path" in taken else {"force"}
    (options,) = parsed
    own, other = ({each.name: each for each, _ in specs(type(x))} for x in (options, given))
    for name in {*AGAIN} & {*own}:
        again = name in other and name not in {*left_out, *options.refuses}
        again &= name != "load" or "plan" not in (study, arguments[0])  # a plan has several
        if f" --{name} " not in text:
            assert getattr(options, name) == (getattr(given, name) if again else default_of(own[name])), name


def test_what_poses_the_question_is_given_again():
    """All that studies have in common, but for what only computes more or less of the same."""
    kinds = (ProblemOptions, ArmOptions, SamplesOptions, HeldMotionOptions)
    assert {each.name for kind in kinds for each, _ in specs(kind)} - {*AGAIN} == {"seed"}


def test_of_defaults_and_of_the_usual_folder_nothing_is_said():
    inputs = {"arm": SimpleNamespace(path="arm.toml"), "fit": None}
    options = options_of("resonance")()
    assert next_command("ident simulate {arm}", inputs, options, "arm") == "ident simulate arm.toml"
    options = options_of("simulate")()
    assert next_command("ident motion {arm}", inputs, options, "arm") == "ident motion arm.toml", "its own limit"


def test_a_prior_is_written_as_it_is_read():
    for text in ("log-normal:200000.0:0.25", "log-uniform:1e5:3e5", "catalogue:1e5:2e5:3e5"):
        assert Prior.parse(str(Prior.parse(text))) == Prior.parse(text)
