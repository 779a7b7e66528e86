"""The names of an arm as a list: what commands, options and campaigns take."""

import math
from collections.abc import Iterator, Mapping, Sequence

from ident.assess.arm_names import ArmNames
from ident.present.text.words import cut, degrees, paragraphs


def names_report(
    names: ArmNames,
    kinds: Mapping[str, str],
    choices: Mapping[str, Sequence[str]],
    columns: Mapping[str, Sequence[str]],
) -> str:
    """Return every name of an arm, by what takes it.

    Args:
        names: of the arm.
        kinds: SI unit of each kind of measurement.
        choices: words that options have to choose from, by command and flag.
        columns: words that columns of a campaign have to choose from.
    """
    arm = names.arm_file.arm
    joints = [_joint(joint.name, joint.limits, joint.driven) for joint in arm.joints]
    loads = [f"  {each.body.name:26s} {float(each.body.mass):.4g} kg on {each.joint}" for each in arm.payloads]
    points = [f"  {point.name:26s} on {point.joint}" for point in arm.points]
    end = arm.points[-1].name if arm.points else "POINT"
    return paragraphs(
        [
            [f"Names of {cut(arm.name, 60)}"],
            [
                "Numbers [SI] (--set, --fix, --tie, --free, --change, ...), by a factor or a difference",
                *_number_names(names),
            ],
            ["Joints, in the order of --posture and of the columns q1, q2, ...", *joints],
            ["Points (column point; the last one is the end point)", *points] if points else [],
            [
                "Loads (--load, columns load and reference_load)",
                *loads,
                f"  '5 kg @ {end}', '20 N -z @ {end}', sums by ' + '",
            ],
            _mode_names(names),
            ["Kinds of measurement (column kind; --discrepancy), with the unit that a value is kept in"],
            [f"  {kind:26s} {unit}" for kind, unit in kinds.items()],
            ["Words that columns of a campaign choose from", *_words(columns)],
            ["Words that options choose from", *_words(choices)],
        ]
    )


def _number_names(names: ArmNames) -> Iterator[str]:
    for each in names.numbers:
        by = "factor" if each.factor else "difference"
        yield f"  {each.path:26s} {each.value + 0.0:>14.7g} {each.unit:10s} {each.origin:11s} {by}"


def _words(choices: Mapping[str, Sequence[str]]) -> Iterator[str]:
    yield from (f"  {name:26s} {', '.join(words)}" for name, words in choices.items())


def _rows(texts: Mapping[str, str]) -> Iterator[str]:
    yield from (f"  {name:26s} {text}" for name, text in texts.items())


def _joint(name: str, limits: tuple[float, float], driven: bool) -> str:
    low, high = (math.degrees(limit) for limit in limits)
    within = "turns freely" if math.isinf(low) else f"{low:.4g} to {high:.4g} deg"
    return f"  {name:26s} {within if driven else 'no pin'}"


def _mode_names(names: ArmNames) -> list[str]:
    if not names.modes:
        return []
    head = f"Modes at {degrees(names.posture)} under its own weight (column mode; also as 'vertical 1', 'torsion 2')"
    return [head, *_rows({label: f"{frequency:.4g} Hz" for label, frequency in names.modes})]
