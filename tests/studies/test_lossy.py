"""All that moves an arm of constant damping ratio: sources and causes of its runs, balancing, a calmer motion."""

import re

import numpy as np
import pytest
from source_runs import FILE, HEAD, TRUTH, measure, one_core, table, true_arm  # noqa: F401

import ident
from ident.arm.arm import loss_paths
from ident.description.file import read_arm

pytestmark = pytest.mark.slow

RATIO = '[damping]\nratio = { value = 0.01, origin = "assumed" }\n\n'


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Runs of an arm of 1.2 %, in whose file 1 % is assumed."""
    place = tmp_path_factory.mktemp("lossy")
    text = re.sub(r"(?m)^tau_(bend|tors) = .*\n", "", FILE.read_text())
    (place / "arm.toml").write_text(text.replace("[[joint]]", f"{RATIO}[[joint]]", 1))
    arm = true_arm().replace({path.replace(".loss_", ".tau_"): 0.0 for path in loss_paths(true_arm())})
    arm = arm.replace(dict.fromkeys(loss_paths(arm), 0.024))
    for seed, speed in enumerate((12.0, 15.0)):
        measure(place, arm, speed, seed=seed)
    return place


@pytest.fixture(scope="module")
def result(folder):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ident.studies.cause.source_study.FURTHER", (10.0,))
        return ident.source(table(folder, (12.0, 15.0)))


def test_sources_are_found_and_with_them_the_loss_factors(result):
    assert not result.doubtful
    for row in result.table():
        size = "eccentricity" if row["kind"] == "imbalance" else "error"
        assert abs(row["amplitude"] - TRUTH[f"{row['drive']}.{size}"]) < 4 * row["sd"]
    found = result.study.found
    sd = dict(zip(found.problem.prior.groups, np.sqrt(np.diag(found.covariance)), strict=False))
    lossy = {path: value for path, value in result.parameters.items() if ".loss_" in path}
    assert lossy
    assert all(abs(np.log(value / 0.024)) < 4 * sd[path.partition(".")[2]] for path, value in lossy.items())
    assert sd["loss_tors"] < 0.1


def test_triage_names_the_drive(folder):
    (folder / "triage.csv").write_text(HEAD + "run12.csv,y,y,12,a,\n")
    found = ident.triage(folder / "triage.csv")
    assert found.sections().verdict.word == "DRIVE"
    assert found.table()[0]["follows"].startswith("drive2 x 1")


def test_masses_and_a_motion_vibrate_less(folder, result, tmp_path):
    file = result.save(tmp_path)[0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("ident.studies.cure.balance_study.ARMS", 4)
        balance = ident.balance(file, radius={"drive2": 90.0}, speed=12.0)
    assert balance.found.left[0] < 0.5, "the median of the peak, as a share"
    arm = read_arm(folder / "arm.toml").arm
    assert float(arm.get("joint1.loss_tors")) == 0.02
    calm = ident.motion(
        folder / "arm.toml", speed=100.0, profile="trapezoid", rate=125.0, limit=0.6, time=6.0, segments=4
    )
    as_it_is, *_, found = calm.motions.candidates
    assert found.worst < as_it_is.worst
