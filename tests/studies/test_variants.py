"""`ident.variants`: each column is what the other studies say of that arm; what can't be compared is refused."""

import re
import tomllib
from dataclasses import replace
from types import SimpleNamespace

import equinox as eqx
import numpy as np
import pytest
from arms import DATA
from reports import assert_one_screen, too_wide
from results import assert_comes_back, assert_plain

import ident
from ident.errors import InputError
from ident.identify.values import Values
from ident.studies.cure.variants import Variant, VariantsOptions, VariantsResult, _basis
from ident.studies.cure.variants_report import QUANTITIES, differs

FILE = DATA / "lcd_arm" / "arm.toml"
FIT = DATA.parent / "tests" / "data" / "results" / "10" / "campaign.fit.json"
COMPUTED = dict(zip(QUANTITIES, (138.8, 4.12, 4.80, 26.3e-3, 153e-6, 0.709e-3, 31.6, None), strict=True))
QUICK = {"speed": 100.0, "profile": "trapezoid", "phases": "file", "limit": 0.6, "segments": 4}


@pytest.fixture(scope="module")
def stiffer(tmp_path_factory):
    path = tmp_path_factory.mktemp("variants") / "stiffer.toml"
    text = FILE.read_text(encoding="utf-8")
    assert text.count("value = 6.28e6") == 1
    path.write_text(text.replace("value = 6.28e6", "value = 12.56e6"), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def result(stiffer):
    return ident.variants([stiffer, FIT], **QUICK)


def parts_of(document):
    return [part for joint in document["joint"] for kind in ("shaft", "link") for part in joint.get(kind, ())]


@pytest.mark.slow
@pytest.mark.usefixtures("one_size")
def test_each_column_is_what_the_other_studies_say(result, stiffer):
    """Mass by the file itself, vibration and settling by the exact equations, modes and compliance by `predict`."""
    motion = {name: QUICK[name] for name in ("speed", "profile", "phases")}
    for each, arm, fit in zip(result.variants, (stiffer, FILE), (None, FIT), strict=True):
        numbers, posture = each.numbers, ((0.0, 0.0, 0.0),)
        masses = [part["mass"]["value"] for part in parts_of(tomllib.loads(arm.read_text(encoding="utf-8")))]
        assert numbers["mass"] == pytest.approx(sum(masses), rel=1e-12)
        (held,) = ident.predict(arm, posture=posture, tool=True, fit=fit).predictions
        frequencies = [numbers[f"frequency{i}"] for i in (1, 2)]
        assert frequencies == pytest.approx(held.analysis.modes.frequency[:2].tolist(), rel=1e-9)
        assert numbers["deflection"] == pytest.approx(np.linalg.norm(held.analysis.deflection["tip"]), rel=1e-9)
        assert numbers["compliance"] == pytest.approx(np.linalg.norm(held.tool.matrix[:3, :3], 2), rel=1e-9)
        moved = ident.simulate(arm, method="exact", fit=fit, rate=250.0, settled=result.options.settled, **motion)
        assert numbers["vibration"] == pytest.approx(moved.peak.max(), rel=0.01)
        assert numbers["settled"] == pytest.approx(max(row["settled"] for row in moved.table()), rel=0.01)


@pytest.mark.slow
@pytest.mark.usefixtures("one_size")
def test_the_best_motion_is_that_of_motion(result, stiffer):
    alone = ident.motion(stiffer, **QUICK)
    assert result.variants[0].numbers["best_time"] == pytest.approx(alone.motions.candidates[-1].ready, rel=1e-9)
    assert alone.motions.met(alone.motions.candidates[-1])


@pytest.mark.slow
@pytest.mark.usefixtures("one_size")
def test_what_differs_is_marked_and_named(result, tmp_path):
    table, report = assert_comes_back(result, tmp_path).table(), result.report(details=True)
    assert_plain(table)
    assert [row["variant"] for row in table] == ["stiffer", "campaign.fit"]
    assert f"* {result.variants[1].numbers['frequency2']:.2f}" in report
    assert "joint1.k_tors" in report
    assert re.search(r"mass \[kg\] +138\.8 +138\.8\n", report), "the same, so not marked"
    bars = {axes.get_title(loc="left"): axes.patches for axes in result.figures()[""].axes}
    assert len({bar.get_facecolor() for bar in bars["mass [kg]"]}) == 1
    assert len({bar.get_facecolor() for bar in bars["mode 1 at the end [Hz]"]}) == 2
    best = min(result.variants, key=lambda each: each.numbers["best_time"])
    assert f"Next: ident motion {best.motions.basis.arm_file.path}" in result.report()


def test_one_percent_is_a_difference_and_so_is_no_motion():
    assert not differs(1.009, 1.0)
    assert differs(1.011, 1.0)
    assert differs(None, 1.0)
    assert not differs(None, None)


def made_up(count, **values):
    """Variants of one arm with numbers of their own, as if computed."""
    basis = replace(_basis(FILE, VariantsOptions()), **values)
    each = ({name: x and x * (1 + 0.1 * i) for name, x in COMPUTED.items()} for i in range(count))
    motions = SimpleNamespace(basis=basis, recommended=None)
    return [Variant("a_long_name.fit", basis.arm_file, motions, numbers) for numbers in each]


def test_eight_columns_fit_on_a_screen():
    report = VariantsResult(tuple(made_up(8)), VariantsOptions()).report()
    assert_one_screen(report)
    assert not too_wide(report)
    (mass,) = (line for line in report.splitlines() if line.startswith("  mass"))
    assert mass.split()[2:] == ["138.8", *(word for i in range(1, 8) for word in ("*", f"{138.8 * (1 + 0.1 * i):.4g}"))]
    (best,) = (line for line in report.splitlines() if line.startswith("  best motion"))
    assert best.split()[3:] == ["-"] * 8
    assert f"Next: ident design {FILE}" in report, "where no motion keeps the limit"


def test_of_posteriors_no_probability_of_a_difference_is_given():
    drawn = made_up(2, posterior=Values("draws.nc", "", {"joint1.k_tors": np.array([3e5, 4e5])}))
    report = VariantsResult(tuple(drawn), VariantsOptions()).report()
    assert "no probability of a difference is given" in report
    assert "--posterior draws.nc" in report
    assert "no probability" not in VariantsResult(tuple(made_up(2)), VariantsOptions()).report()


def without_drives(file):
    return replace(file, arm=eqx.tree_at(lambda arm: (arm.drives, arm.belts), file.arm, ((), ())))


@pytest.mark.parametrize(
    ("others", "words"),
    [
        ((), "arms: got 1 of them, expected 2 to 8 variants; give each its file"),
        ((FILE,) * 8, "arms: got 9 of them, expected 2 to 8 variants; give each its file"),
        ((without_drives,), r".*arm\.toml: got no drive that excites, expected imbalance .*"),
        ((lambda file: file.replace({"stroke.speed": 1.0}),), r".* in 31\.\d+ s, as of the first variant; compare .*"),
        ((lambda file: file.replace({"glass.mass": 9.0}),), r".*: got the tool tip, glass of 9 kg, expected the .*"),
        ((FIT.with_name("arm.predict.json"),), r".*: got a result of predict, expected an arm file, or a result of .*"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_line(others, words):
    file = ident.read_arm(FILE)
    with pytest.raises(InputError, match=f"^{words}$"):
        ident.variants([file, *(each(file) if callable(each) else each for each in others)])
