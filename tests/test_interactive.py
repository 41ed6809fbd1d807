"""The page with sliders: its numbers are the kernel's, its courses the model's, and it holds in a browser."""

from __future__ import annotations

import json
import math
import shutil
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from headless import Browser, find_browser
from test_export_ports import fitted
from test_report_browser import complaints
from test_total_bounce import ball_of

from fitball.api.simulating import Subject
from fitball.cli.main import main
from fitball.data.read import load_table
from fitball.exports.interactive import RPM, interactive_page, round_impact
from fitball.exports.port.face import total_moment
from fitball.exports.port.languages import javascript_script
from fitball.exports.port.port import make_port
from fitball.inference.prediction.outputs import golden
from fitball.inference.prediction.reach import total_rebound, valid_range
from fitball.models.types import OUTPUTS, regime_name
from fitball.report.form.palette import PHASES
from fitball.values import Impacts

FOUND, NODE = find_browser(), shutil.which("node")
needs_browser = pytest.mark.skipif(FOUND is None, reason="no browser is installed: the page is made but not opened")
PHONE, SCREEN = 400, 1280
READ = """(() => {
  const said = document.getElementById("said").dataset, found = {...said};
  const rows = document.querySelectorAll("#rebound tbody tr");
  for (const row of rows) found[row.dataset.name] = Number(row.dataset.value);
  return found;
})()"""
SETTINGS = (
    {},
    {"speed": 30, "angle": 16, "spin": 2500},
    {"speed": 12.5, "angle": 60, "spin": -3000, "mu": 0.3},
    {"speed": 20, "angle": 35, "mu": 0.9, "cor": 0.7},
    {"speed": 65, "angle": 80, "spin": 6000},
    {"speed": 3, "angle": 90, "spin": 0, "mu": 0},
)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    if FOUND is None:
        pytest.skip("no browser is installed")
    with Browser(FOUND, tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.fixture(scope="module")
def models():
    dropped = replace(fitted("two-mass", normal="total"), tangential=False, impacts=Impacts([0, 0], [5, 8], [0, 0]))
    return {
        "preset": replace(Subject.from_fit(None, "two-mass", {}).fitted, impacts=load_table("wang_all").impacts),
        "measured": ball_of("two-mass, measured"),
        "thesis": ball_of("thesis"),
        "brody": ball_of("brody"),
        "drop": dropped,
    }


@pytest.fixture(scope="module")
def pages(models, tmp_path_factory):
    """Pages whose origin would end the script, were it let."""
    folder, found = tmp_path_factory.mktemp("interactive"), {}
    for name, model in models.items():
        found[name] = folder / f"{name}.html"
        origin = 'table "a</script><b>.csv" <!-- <script>'
        found[name].write_text(interactive_page(model, round_impact(model), "A test.", origin), encoding="utf-8")
    return found


def value(browser, session, text):
    return browser.call("Runtime.evaluate", session, expression=text, returnByValue=True)["result"].get("value")


def moved(browser, session, changes):
    """What the page says once the sliders stand there."""
    for name, number in changes.items():
        value(
            browser,
            session,
            f"""(() => {{ const field = document.getElementById("{name}-number");
            field.value = {number}; field.dispatchEvent(new Event("input")); }})()""",
        )
    return value(browser, session, READ)


def expected(model, changes):
    """The same from the kernel: the start's valid range, other friction and restitution."""
    start = round_impact(model)
    v_x, v_y, omega = (float(column[0]) for column in (start.v_x1, start.v_y1, start.omega_1))
    point, cor = dict(zip(model.names, model.point, strict=True)), None
    if model.tangential:
        speed = changes.get("speed", math.hypot(v_x, v_y))
        angle = math.radians(changes.get("angle", math.degrees(math.atan2(v_y, v_x))))
        v_x, v_y = (0.0 if angle == math.pi / 2 else speed * math.cos(angle)), speed * math.sin(angle)
        omega = changes.get("spin", omega * RPM) / RPM
        point["mu"] = changes.get("mu", point["mu"])
    else:
        v_y = changes.get("speed", v_y)
    if model.model.needs_cor:
        cor = np.array([changes.get("cor", 0.75)])
    else:
        point["cor_10"] = changes.get("cor", point["cor_10"])
    other = replace(model, point=np.array([point[name] for name in model.names]))
    return total_rebound(other, valid_range(model), Impacts([v_x], [v_y], [omega], cor))


@needs_browser
@pytest.mark.parametrize("name", ["preset", "measured", "thesis", "brody", "drop"])
def test_the_pages_numbers_are_those_of_the_kernel(browser, pages, models, name):
    session = browser.open(pages[name], SCREEN)
    for changes in SETTINGS:
        model = models[name]
        own = changes if model.tangential else {key: changes[key] for key in changes if key in ("speed", "cor")}
        value(browser, session, 'document.getElementById("reset").click()')
        found = moved(browser, session, own)
        rebound, outside = expected(model, own)
        if rebound.status[0, 0] != 0:
            # Of the thesis alone: the page's port takes the ball as rigid there.
            assert name == "thesis" and int(found["extrapolated"]) & 4
            continue
        assert found["status"] == "0" and found["regime"] == regime_name(rebound.regime[0, 0])
        assert int(found["extrapolated"]) == int(outside[0])
        for output in ("v_x2", "v_y2", "omega_2") if model.tangential else ("v_y2",):
            assert found[output] == pytest.approx(getattr(rebound, output)[0, 0], rel=1e-10, abs=1e-9), (own, output)
        timed = ["contact_time"] * model.model.has_time + ["gap_time"] * model.model.has_gaps
        timed += ["gap_path", "gap_turn"] * (model.model.has_gaps and model.tangential)
        assert [name for name in found if name in OUTPUTS[3:]] == timed
        for output in timed:
            assert found[output] == pytest.approx(getattr(rebound, output)[0, 0], rel=1e-10, abs=1e-12)
    browser.call("Page.close", session)


@needs_browser
@pytest.mark.parametrize(("width", "scheme"), [(PHONE, "light"), (SCREEN, "dark")])
@pytest.mark.parametrize("name", ["preset", "drop"])
def test_the_page_holds_in_a_browser(browser, pages, name, width, scheme):
    visit = browser.visit(pages[name], width, scheme)
    assert complaints(visit, pages[name]) == []
    assert visit.layout["width"] == width
    assert visit.layout["paper"] == ("rgb(255, 255, 255)" if scheme == "light" else "rgb(21, 24, 28)")


@needs_browser
def test_keys_move_a_slider_and_what_hangs_on_it(browser, pages):
    session = browser.open(pages["preset"], PHONE)
    before = value(browser, session, READ)
    value(browser, session, 'document.getElementById("angle").focus()')
    for _ in range(3):
        for kind in ("keyDown", "keyUp"):
            browser.call("Input.dispatchKeyEvent", session, type=kind, key="ArrowRight", code="ArrowRight",
                         windowsVirtualKeyCode=39)  # fmt: skip
    shown = value(browser, session, 'document.getElementById("angle-number").value')
    assert float(shown) == pytest.approx(44.3)
    assert value(browser, session, READ)["v_y2"] > before["v_y2"]
    # Half a number changes nothing, and what is not one neither.
    now = value(browser, session, READ)
    assert moved(browser, session, {"speed": '""'}) == now and moved(browser, session, {"mu": 99}) == now
    # A line at the start's own friction joins the curve.
    lines = 'document.querySelectorAll("#curve-v_x2 path").length'
    assert value(browser, session, lines) == 1
    moved(browser, session, {"mu": 0.4})
    assert value(browser, session, lines) == 2
    assert "Not the start's own friction" in value(browser, session, 'document.getElementById("said").textContent')
    # More than the core can return with: said, not drawn.
    found = moved(browser, session, {"cor": 0.95})
    assert found["status"] == "2" and "v_y2" not in found
    assert "exceeds mass_ratio" in value(browser, session, 'document.getElementById("said").textContent')
    browser.call("Page.close", session)


@pytest.mark.skipif(NODE is None, reason="no node here: the course is made but not run")
@pytest.mark.parametrize(
    "closures",
    [
        {},
        {"torsion": "rigid"},
        {"release": "zero_displacement", "spin": "shell"},
        {"offset": "grip", "normal": "total"},
    ],
)
def test_courses_are_those_of_the_model(closures, tmp_path):
    """Cut at a time by the port, followed piece by piece by `Model.history`."""
    model = fitted("two-mass", **closures)
    port = make_port(model, golden(model, model.impacts), "a test", (total_moment,))
    values = {model.names[k]: float(model.point[k]) for k in model.model_columns}
    shares, states = np.linspace(0.001, 0.999, 41), ((15, 10, 3), (6, 16, -200), (3, 12, 300), (8, 8, 242.28))
    script = (
        f"const p = {javascript_script(port, ('total_moment', 'newScratch', 'CODES'))}; const s = p.newScratch();"
    )
    script += f"console.log(JSON.stringify({json.dumps(states)}.map(state => {json.dumps(shares.tolist())}.map("
    (tmp_path / "check.js").write_text(script + "k => p.total_moment(p.ROW, p.CODES, ...state, NaN, k, s)))))")
    done = subprocess.run([NODE, tmp_path / "check.js"], capture_output=True, text=True, check=True)
    for state, moments in zip(states, json.loads(done.stdout), strict=True):
        impact = Impacts(*([item] for item in state))
        time = float(model.model.rebound(values, impact).contact_time[0])
        history = model.model.history(values, impact, shares * time)
        found = {name: np.array([moment[name] for moment in moments]) for name in moments[0]}
        assert np.all(found["status"] == 0)
        np.testing.assert_array_equal(found["phase"], history.phase)
        for mine, theirs in (("y", "y"), ("v_y", "v_y"), ("v_x", "v_x"), ("omega_core", "omega_1"),
                             ("omega_shell", "omega_2"), ("normal_force", "normal_force")):  # fmt: skip
            course = getattr(history, theirs)
            np.testing.assert_allclose(found[mine], course, rtol=0.0, atol=1e-11 * np.max(np.abs(course)))
        largest = np.max(history.normal_force)
        np.testing.assert_allclose(found["friction_force"], history.friction_force, rtol=0.0, atol=1e-5 * largest)


def test_the_verb_writes_the_page(small_fit, tmp_path, capsys):
    place = tmp_path / "page.html"
    assert main(["simulate", "--html", "--fit", str(small_fit), "--out", str(place)]) == 0
    text = place.read_text(encoding="utf-8")
    assert "As fitted to" in text and "http" not in text.replace("http://www.w3.org/2000/svg", "")
    # Slip and grip have the colours that they have in figures and films.
    assert "--slide: {}; --back: {}; --grip: {}; --hold: {}; --free: {};".format(*PHASES) in text
    assert main(["simulate", "--html", "--model", "brody", "--set", "mu=0.5", "--impact", "v=30, theta=16, spin=100",
                 "--out", str(tmp_path)]) == 0  # fmt: skip
    assert '"start": 30.0' in (tmp_path / "interactive_brody.html").read_text(encoding="utf-8")
    capsys.readouterr()
    for words, said in (
        (["--out", str(place)], "--overwrite"),
        (["--example", "fig8"], "leave out --example"),
        (["--json"], "leave out --json"),
        (["--impact", "v=30, theta=16", "--set", "mu=0.5", "--fit", str(small_fit)], "leave out --model and --set"),
        (["--set", "mew=0.5"], "unknown parameter 'mew'"),
    ):
        assert main(["simulate", "--html", *words]) == 2, words
        assert said in capsys.readouterr().err
