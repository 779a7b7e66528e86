"""The explorer in a browser: its numbers are those of ident, it asks for nothing, and hostile names do nothing."""

import re

import jax.numpy as jnp
import numpy as np
import pytest
from arms import lcd_arm, random_arm
from commands import posterior
from equinox import filter_jit

from ident.arm.arm import Arm, loss_paths, stiffness_paths
from ident.arm.chain import at_posture
from ident.arm.fields import ALPHA
from ident.arm.mechanics import flat, point_positions, static_equilibrium, unflatten
from ident.arm.modes import linearize
from ident.arm.multibody import Command, multibody, residual
from ident.arm.parts import Body, Joint, Point
from ident.arm.rotations import matvec, transpose
from ident.studies.look.explore import ExploreOptions, explore
from ident.studies.look.predict import PredictOptions, predict
from ident.studies.working.resonance import ResonanceOptions, resonance

pytestmark = pytest.mark.slow

CAMPAIGN = "data/lcd_arm/campaign.csv"
SIX = random_arm(np.random.default_rng(0), 6)
LOSSY = lcd_arm().replace(dict.fromkeys(loss_paths(lcd_arm())[:4], 0.002) | {ALPHA: 0.1})
"""With damping times in all directions, loss factors in four of six, and damping by mass."""
ROWS = "[...document.querySelectorAll('#modes tr')].map((row) => [...row.cells].map((c) => c.innerText.trim()))"
HOSTILE = "</script><img src=x onerror=alert(1)><!--"


@pytest.fixture(scope="module")
def lcd_page(tmp_path_factory, root):
    folder = tmp_path_factory.mktemp("explore")
    posterior(folder / "draws.nc", draws=20)
    result = explore(
        root / "data/lcd_arm/arm.toml",
        ExploreOptions(load="glass"),
        posterior=folder / "draws.nc",
        measured=root / CAMPAIGN,
    )
    return result, result.save(folder)[0]


@pytest.fixture(scope="module")
def root(request):
    return request.config.rootpath


@pytest.fixture(scope="module")
def plain_page(browser, tmp_path_factory):
    """The paper's arm, which can be asked for any numbers."""
    folder = tmp_path_factory.mktemp("plain")
    return explore(lcd_arm()).save(folder)[0]


@pytest.fixture(scope="module")
def six_page(browser, tmp_path_factory):
    return explore(SIX).save(tmp_path_factory.mktemp("six"))[0]


@pytest.fixture(scope="module")
def lossy_page(browser, tmp_path_factory):
    return explore(LOSSY).save(tmp_path_factory.mktemp("lossy"))[0]


def until(page, condition):
    """Wait; playwright's own way evaluates text, which the page's policy refuses."""
    for _ in range(200):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(50)
    raise AssertionError(condition)


def solved(opened, posture, mass, numbers, arm):
    """What the page computes at a posture [deg], with stiffnesses by path."""
    k = [[numbers[f"{joint.name}.{field}"] for field in ("k_bend", "k_tors")] for joint in arm.joints]
    script = """([q, mass, k]) => {
        const { at, dampingRatio } = explorer, s = at(q, mass, k);
        return s && { frequency: s.modes.map((m) => m.frequency), label: s.modes.map((m) => m.label),
            ratio: s.modes.slice(0, 4).map((_, i) => dampingRatio(s, i)),
            moved: s.line.map((p, i) => p.map((x, c) => x - s.rigid[i][c])) };
    }"""
    return opened.page.evaluate(script, [list(posture), mass, k])


@pytest.mark.parametrize(("arm", "page", "posture", "load"), [
    (lcd_arm(), "plain_page", (0, 0, 0), "own weight"),
    (lcd_arm(), "plain_page", (71, -142, 71), "glass"),
    (LOSSY, "lossy_page", (46, -92, 46), "own weight"),
    (SIX, "six_page", (10, 20, -30, 40, 50, 60), "glass"),
])  # fmt: skip
def test_frequencies_and_deflections_are_those_of_predict(arm, page, posture, load, request, browser_page):
    rng = np.random.default_rng(1)
    numbers = {p: float(arm.get(p)) * 4.0 ** rng.uniform(-1, 1) for p in stiffness_paths(arm)}
    mass = {"own weight": 0.0, "glass": float(arm.payloads[0].body.mass)}[load]
    options = PredictOptions(posture=(posture,), load=load, set=numbers, modes=3 * len(arm.joints))
    expected = predict(arm, options).analyses[0]
    with browser_page(request.getfixturevalue(page), 800, 600) as opened:
        found = solved(opened, posture, mass, numbers, arm)
    np.testing.assert_allclose(found["frequency"], expected.modes.frequency, rtol=1e-9)
    assert found["label"] == list(map(str, expected.labels))
    np.testing.assert_allclose(found["ratio"], expected.damping_ratio[:4], rtol=1e-3)
    np.testing.assert_allclose(found["moved"][-1], list(expected.deflection.values())[-1], atol=1e-12)


def test_another_mass_of_the_payload_is_that_of_predict(plain_page, browser_page):
    arm, share = lcd_arm(), 1.7
    glass = arm.payloads[0].body
    numbers = {p: float(arm.get(p)) for p in stiffness_paths(arm)}
    changed = {f"glass.inertia.{end}": share * float(glass.inertia[i, i]) for i, end in enumerate(("xx", "yy", "zz"))}
    changed["glass.mass"] = share * float(glass.mass)
    expected = predict(arm, PredictOptions(load="glass", set=changed, modes=9)).analyses[0]
    with browser_page(plain_page, 800, 600) as opened:
        found = solved(opened, (0, 0, 0), share * float(glass.mass), numbers, arm)
    np.testing.assert_allclose(found["frequency"], expected.modes.frequency, rtol=1e-9)


@pytest.mark.parametrize(
    ("load", "mass", "soft_base"), [("2 kg @ tip", 2.0, None), ("glass + 3.5 kg @ tip + 30 N -z @ tip", 3.5, 0.4)]
)
def test_masses_forces_and_a_base_that_gives_are_those_of_predict(tmp_path, browser_page, load, mass, soft_base):
    options = {"load": load, "soft_base": soft_base}
    result = explore(lcd_arm(), ExploreOptions(payload="tip", posture=(30, -60, 30), **options))
    expected = predict(lcd_arm(), PredictOptions(posture=((30, -60, 30),), modes=6, **options)).analyses[0]
    with browser_page(result.save(tmp_path / "page.html")[0], 800, 600) as opened:
        until(opened.page, "document.querySelector('#command').value !== ''")
        assert opened.page.evaluate("explorer.state().mass") == mass
        found = opened.page.evaluate("explorer.numbers().modes.slice(0, 6).map((m) => m.frequency)")
        command = opened.page.input_value("#command").splitlines()[0]
    np.testing.assert_allclose(found, expected.modes.frequency, rtol=1e-9)
    assert ("--soft-base=0.4" in command) is bool(soft_base)
    assert ("--load=glass + 30 N -z @ tip + 3.5 kg @ tip'" in command) is bool(soft_base)


def test_an_arm_that_collapses_has_no_answer(plain_page, browser_page):
    arm = lcd_arm()
    with browser_page(plain_page, 800, 600) as opened:
        assert solved(opened, (0, 0, 0), 0.0, dict.fromkeys(stiffness_paths(arm), 10.0), arm) is None


ALPHA, SPEED = 40.0, 100.0


out_of_balance, places = filter_jit(residual), filter_jit(point_positions)


@filter_jit
def at_rest(arm, posture):
    """The arm held there, its equilibrium, and the equations about that."""
    chain = at_posture(arm, posture)
    at = static_equilibrium(chain)
    return chain, at, linearize(chain, at)


@pytest.fixture(scope="module")
def forcing(browser):
    """Phasors of the torques by the exact equations of motion, a column for each drive, and what they act on.

    A pin that hardly turns with a very large ratio is a held arm with a pulley that turns; the phase makes up for the
    angle of the pin. By the first harmonic over sixteen phases of the pulley.
    """
    arm = lcd_arm()
    posture = np.radians([ALPHA, -2 * ALPHA, ALPHA])
    chain, at, _ = at_rest(arm, posture)
    y = flat(matvec(transpose(chain.frame), at.phi))
    phases, ratio = 2 * np.pi * np.arange(16) / 16, 1e7

    def torques(drive, j, rate):
        quiet = {f"{each.name}.eccentricity": 0.0 for each in arm.drives if each.name != drive.name}
        columns = []
        for phase in phases:
            own = {
                f"{drive.name}.ratio": ratio,
                f"{drive.name}.phase": phase - (ratio * float(posture[j])) % (2 * np.pi),
            }
            model = multibody(arm.replace({**quiet, **own}))
            qd = rate / ratio * np.eye(3)[j]
            columns.append(out_of_balance(model, Command(posture, qd, np.zeros(3)), y, np.zeros(9), np.zeros(9)))
        harmonic = -2 * np.mean([np.asarray(c) * np.exp(-1j * p) for c, p in zip(columns, phases, strict=True)], 0)
        turned = [matvec(chain.frame, unflatten(jnp.asarray(part))) for part in (harmonic.real, harmonic.imag)]
        return np.asarray(flat(turned[0])) + 1j * np.asarray(flat(turned[1]))

    rates = np.array([40.0, 25.0, 30.0])
    found = np.stack([torques(drive, j, rates[j]) for j, drive in enumerate(arm.drives)], 1)
    return chain, at, rates, found


def test_torques_of_the_turning_masses_are_those_of_the_exact_equations(forcing, plain_page, browser_page):
    _, _, rates, expected = forcing
    script = """([q, rates]) => {
        const total = ({ pull, weight }, w) => pull.map((x, i) => x * w ** 2 + weight[i]);
        return explorer.at(q, 0).torques.map((parts, d) => parts.map((part) => total(part, rates[d])));
    }"""
    with browser_page(plain_page, 800, 600) as opened:
        found = np.array(opened.page.evaluate(script, [[ALPHA, -2 * ALPHA, ALPHA], rates.tolist()]))
    np.testing.assert_allclose(found[:, 0] + 1j * found[:, 1], expected.T, atol=2e-5 * np.abs(expected).max())


def test_steady_response_at_its_peaks_is_that_of_the_damped_equations(plain_page, browser_page):
    """Against a complex solve of H + i w C - w^2 M at each resonance of each drive, with all drives at worst phases."""
    arm = lcd_arm()
    chain, at, linear = at_rest(arm, np.radians([ALPHA, -2 * ALPHA, ALPHA]))
    M, C, H = (np.asarray(x) for x in (linear.M, linear.C, linear.H))
    slope = np.stack([_slope(chain, at.phi, i) for i in range(9)], 1)
    script = """([alpha, low]) => {
        const { model, driveRates, steadyResponse } = explorer, full = driveRates(model, alpha, 100).rates;
        const s = explorer.at(model.stroke.direction.map((d) => d * alpha * 180 / Math.PI), 0);
        const passed = s.modes.flatMap((m) => full.map((r) => 100 * m.omega / r));
        const peaks = passed.filter((p) => p > low && p < 120);
        return { peaks: peaks.map((p) => { const { rates, signs } = driveRates(model, alpha, p);
            return { speed: p, rates, signs, size: steadyResponse(s, rates, signs) }; }),
            torques: s.torques.map((parts) => parts.map(({ pull, weight }) => [pull, weight])) };
    }"""
    with browser_page(plain_page, 800, 600) as opened:
        found = opened.page.evaluate(script, [np.radians(ALPHA), 1.0])
    assert len(found["peaks"]) > 8
    for peak in found["peaks"]:
        total = np.zeros(3)
        for (real, imaginary), w, sign in zip(found["torques"], peak["rates"], peak["signs"], strict=True):
            Q = np.array([w**2, 1.0]) @ np.array(real) + 1j * sign * (np.array([w**2, 1.0]) @ np.array(imaginary))
            total += np.abs(slope @ np.linalg.solve(H + 1j * w * C - w**2 * M, Q))
        assert np.abs(total - peak["size"]).max() < 1e-6 * total.max(), peak["speed"]


def test_the_worst_posture_is_found_between_the_places(plain_page, browser_page):
    """Against 3000 places along the stroke, each solved on its own."""
    script = """(speeds) => {
        const { model, at, driveRates, steadyResponse } = explorer, most = speeds.map(() => 0);
        for (let i = 0; i <= 3000; i++) {
            const alpha = 142 * i / 3000, s = at(model.stroke.direction.map((d) => d * alpha), 0);
            speeds.forEach((speed, k) => {
                const { rates, signs } = driveRates(model, alpha * Math.PI / 180, speed);
                most[k] = Math.max(most[k], ...steadyResponse(s, rates, signs));
            });
        }
        return speeds.map((speed, k) => explorer.worst(speed) / most[k]);
    }"""
    with browser_page(plain_page, 800, 600) as opened:
        until(opened.page, "document.querySelector('#response path')")
        ratios = opened.page.evaluate(script, [3, 7, 10, 20])
    assert 0.95 < min(ratios) <= max(ratios) < 1.2


def _slope(chain, phi, i):
    """How the end point moves with one coordinate, by a central difference [m/rad]."""
    step = np.asarray(unflatten(jnp.asarray(1e-5 * np.eye(9)[i])))
    there, back = (np.asarray(places(chain, np.asarray(phi) + side * step))[:, -1] for side in (1, -1))
    return np.asarray(there - back) / 2e-5


def test_pulleys_turn_as_in_resonance(plain_page, browser_page):
    turning = resonance(lcd_arm(), ResonanceOptions(speed=10.0)).excitation
    motion = resonance(lcd_arm(), ResonanceOptions(speed=10.0)).basis.motion
    places = np.array([100, 300, 500, 800])
    alpha = np.asarray(motion(turning.time[places])[0])[0]
    script = "(a) => a.map((x) => explorer.driveRates(explorer.model, x, 10).rates.map((w) => w / (2 * Math.PI)))"
    with browser_page(plain_page, 800, 600) as opened:
        found = np.array(opened.page.evaluate(script, alpha.tolist()))
    np.testing.assert_allclose(found.T, turning.frequency[:, places], rtol=2e-3)


def test_the_page_shows_its_numbers_and_asks_for_nothing(lcd_page, browser_page):
    result, path = lcd_page
    arm = result.exploration.arm
    analysis = predict(arm, PredictOptions(posture=((60, -120, 60),), modes=6)).analyses[0]
    with browser_page(path, 1280, 900) as opened:
        opened.page.select_option("#measured", index=3)
        until(opened.page, "document.querySelector('#command').value.includes('60,-120,60')")
        rows = opened.page.evaluate(ROWS)
        tip = [float(x) for x in opened.page.locator("#static td").all_inner_texts()[:3]]
        shown = opened.page.inner_text("#static")
        bars = opened.page.locator(".scale i").count()
        until(opened.page, "document.querySelectorAll('#campbell circle').length === 16")
        assert opened.page.locator("#response path").count() == 2
        assert opened.alone
        assert not opened.complaints
    assert [float(row[1]) for row in rows] == pytest.approx(analysis.modes.frequency, abs=5e-5)
    assert [row[0] for row in rows] == list(map(str, analysis.labels))
    assert "5.777" in rows[[row[0] for row in rows].index("vertical bending 1")][4]
    assert tip == pytest.approx(list(1e3 * analysis.deflection["tip"]), abs=5e-4)
    assert "16.98" in shown
    assert bars == 2, "a bar for each number of the posterior"


def test_what_is_on_the_screen_is_what_the_command_prints(lcd_page, browser_page, run, root):
    _, path = lcd_page
    address = "#joint1.k_tors=500000&mass=3.65&speed=25&place=30"
    with browser_page(path, 1000, 800) as opened:
        opened.page.goto(opened.address + address)
        opened.page.reload()
        until(opened.page, "document.querySelector('#command').value.includes('500000')")
        command = opened.page.input_value("#command").splitlines()
        frequencies = opened.page.evaluate("explorer.numbers().modes.slice(0, 6).map((m) => m.frequency)")
        assert opened.page.evaluate("location.hash") == address
        opened.page.click("#reset")
        until(opened.page, "location.hash === ''")
    words = command[0].split()
    assert words[:2] == ["ident", "predict"]
    code, out, err = run(*(word.strip("'") for word in words[1:]))
    assert (code, err) == (0, "")
    modes = re.findall(r"^ +\d +[a-z]+ (?:bending|torsion) \d +(\d+\.\d{4}) ", out, re.MULTILINE)
    printed = [float(frequency) for frequency in modes]
    assert printed == pytest.approx(frequencies, abs=5e-5)
    assert command[1].startswith("ident resonance")
    assert "--speed=25" in command[1]


def test_a_mode_is_compared_with_itself_where_frequencies_have_crossed(plain_page, browser_page):
    with browser_page(plain_page, 1000, 800) as opened:
        opened.page.goto(f"{opened.address}#joint1.k_tors=180000")
        opened.page.reload()
        until(opened.page, "document.querySelector('#modes tr')")
        rows = opened.page.evaluate(ROWS)
        first = opened.page.evaluate("explorer.at([71, -142, 71], 0).modes.map((m) => [m.label, m.frequency])")
    assert [row[0] for row in rows[:2]] == [first[1][0], first[0][0]] == ["lateral torsion 1", "vertical bending 1"]
    assert [float(row[2]) for row in rows[:2]] == pytest.approx([first[1][1], first[0][1]], abs=5e-5)


@pytest.mark.parametrize(
    "address",
    [
        "#joint1.k_tors=NaN&mass=1e99&place=-1e9&mode=77&speed=0",
        "#%00&mass=<img src=x>&q=1,2",
        "#mode=1.5&sweep=9&__proto__=1",
    ],
)
def test_an_address_that_means_harm_is_numbers_within_the_sliders(lcd_page, browser_page, address):
    _, path = lcd_page
    with browser_page(path, 800, 600) as opened:
        opened.page.goto(opened.address + address)
        opened.page.reload()
        until(opened.page, "document.querySelector('#command').value !== ''")
        state = opened.page.evaluate("explorer.state()")
        assert opened.page.locator("#modes tr").count() == 6
        assert not opened.complaints
    assert 0 <= state["mass"] <= 14.6
    assert 0 <= state["place"] <= 142
    assert 1 <= state["speed"] <= 120


def test_hostile_names_do_nothing(tmp_path, browser_page):
    body = Body("body", 10.0, (0.5, 0.0, 0.0), np.diag([0.1, 1.0, 1.0]))
    joints = (Joint(HOSTILE, k_bend=1e5, k_tors=1e5, link=(body,)),)
    arm = Arm(HOSTILE, joints, (Point("'\"><svg onload=alert(2)>", HOSTILE, (1.0, 0.0, 0.0)),))
    path = explore(arm).save(tmp_path / "page.html")[0]
    with browser_page(path, 800, 600) as opened:
        until(opened.page, "document.querySelector('#command').value !== ''")
        assert opened.page.locator("img").count() == 0
        assert opened.page.inner_text("h1") == HOSTILE
        assert opened.alone
        assert not opened.complaints


def test_sliders_and_modes_are_moved_by_keys(lcd_page, browser_page):
    _, path = lcd_page
    with browser_page(path, 1280, 900) as opened:
        page = opened.page
        page.focus("#slider-3")
        before = page.evaluate("explorer.numbers().modes[0].frequency")
        for _ in range(5):
            page.keyboard.press("ArrowRight")
        until(page, "location.hash.includes('joint1.k_bend')")
        assert page.evaluate("explorer.numbers().modes[0].frequency") > before
        assert "N m/rad" in page.get_attribute("#slider-3", "aria-valuetext")
        assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
        page.focus("#modes input:checked")
        page.keyboard.press("ArrowDown")
        until(page, "location.hash.includes('mode=1')")
        every = "[...document.querySelectorAll('input, select, textarea')]"
        assert page.evaluate(f"{every}.every((e) => e.labels?.length || e.getAttribute('aria-label'))")
        assert "Hz" in page.inner_text("#spoken")


@pytest.mark.parametrize(("width", "dark"), [(320, False), (390, True), (768, False), (1280, True)])
def test_it_fits_a_phone_in_light_and_dark(lcd_page, six_page, browser_page, width, dark):
    for path in (lcd_page[1], six_page):
        with browser_page(path, width, 800, dark=dark) as opened:
            until(opened.page, "document.querySelector('#campbell path')")
            assert opened.overhang <= 0
            lightness = opened.page.evaluate("getComputedStyle(document.body).backgroundColor")
            assert (lightness == "rgb(255, 255, 255)") is not dark
            assert not opened.complaints


def test_who_wants_no_motion_sees_none(lcd_page, browser):
    page = browser.new_page(reduced_motion="reduce")
    page.goto(lcd_page[1].resolve().as_uri())
    until(page, "document.querySelector('#command').value !== ''")
    picture = "document.querySelector('#above').innerHTML"
    first = page.evaluate(picture)
    page.wait_for_timeout(300)
    assert page.evaluate(picture) == first
    assert page.inner_text("#play") == "Play"
    page.close()


def test_the_file_is_small_and_admits_one_script(lcd_page):
    text = lcd_page[1].read_text(encoding="utf-8")
    data = re.search(r'<script id="data" type="application/json">(.*?)</script>', text, re.DOTALL)[1]
    script = re.search(r"<script>(.*?)</script>", text, re.DOTALL)[1]
    assert len(data) < 1_000_000
    assert len(script) < 300_000
    assert "<" not in data
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy
