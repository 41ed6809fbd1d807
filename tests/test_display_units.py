"""Units that people read, against factors written out by hand: of every spec and column, on every
page.
"""

import ast
import re
from dataclasses import replace
from math import pi
from pathlib import Path

import numpy as np
import pytest
from support.films import Camera, bounces, filmed
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.base import display_units
from fitball.base.columns import COLUMNS
from fitball.base.numbers import Unit
from fitball.data.scene import CameraSection, Scene
from fitball.exports import engine, engine_page, parameter_set
from fitball.inference import noise
from fitball.inference.derived import quantities
from fitball.inference.forward import CalibratedRange
from fitball.inference.problem.camera import CAMERA_SPECS
from fitball.models.specs import SPECS
from fitball.report import fit_page, fit_tables
from fitball.report import plan as plan_page
from fitball.report import predict as predict_page
from fitball.report import simulate as simulate_page
from fitball.report import track as track_page
from fitball.uses.drops import drop_test

# By symbol the unit of SI that it is read for, and how much of that it is: the SI brochure, 360
# degrees a turn.
BY_HAND = {
    "%": ("", 1.0 / 100.0),
    "mm": ("m", 1.0 / 1000.0),
    "cm": ("m", 1.0 / 100.0),
    "ms": ("s", 1.0 / 1000.0),
    "us": ("s", 1.0 / 1_000_000.0),
    "ms/m": ("s/m", 1.0 / 1000.0),
    "deg": ("rad", 2.0 * pi / 360.0),
    "rpm": ("rad/s", 2.0 * pi / 60.0),
    "g": ("kg", 1.0 / 1000.0),
    "kN/m": ("N/m", 1000.0),
    "cm^2/rad": ("m^2/rad", 1.0 / 10_000.0),
    "mm/(m/s)": ("m/(m/s)", 1.0 / 1000.0),
    "1e-3 s/m": ("1/(m/s)", 1.0 / 1000.0),
    **{symbol: (symbol, 1.0) for symbol in ("", "m", "s", "m/s", "rad/s", "N", "N m/rad")},
}
NAMED = {
    name: unit
    for name, unit in vars(display_units).items()
    if isinstance(unit, Unit) and unit is not display_units.SI
}
ROOT = Path(fitball.__file__).parent


def agrees(unit, si=None):
    """Whether a unit has the factor that its symbol has by hand, and reads what is in `si`."""
    of, size = BY_HAND[unit.name]
    return unit.factor * size == pytest.approx(1.0, rel=1e-14) and si in (None, of)


def shows(text, value, symbol):
    """Whether a text begins with `value` [SI] in the unit `symbol`, rounded as it is printed."""
    number = re.match(r"[+-]?[\d,]+(\.\d*)?", text)[0].replace(",", "")
    decimals = len(number.partition(".")[2])
    return abs(float(number) - value / BY_HAND[symbol][1]) <= 0.5001 * 10.0**-decimals


def unit_of(head):
    """The symbol in the brackets of a head."""
    brackets = re.search(r"\[(.*)\]", head)
    return brackets[1] if brackets else ""


def rows_of(report, head):
    """The rows of the first table that has a column `head`."""
    blocks = [
        *report.summary,
        *(block for section in report.sections for block in section.blocks),
    ]
    tables = [block.rows for block in blocks if hasattr(block, "rows")]
    return next(rows for rows in tables if any(head in row for row in rows))


def derived():
    """All derived quantities: of tennis balls at the speed of the pace test, of fast ones, of
    drops.
    """
    fast = table_of()
    fast[["v_x1", "v_y1", "v_x2", "v_y2"]] *= 3.0
    for frame, model in (
        (table_of(), "two-mass"),
        (fast, "two-mass"),
        (table_of(drop=True), "grip-slip"),
    ):
        problem = fit_by_hand(frame, model=model).problem
        rows = problem.rows
        known = CalibratedRange(rows.states, rows.index, problem.scene.ball_value().radius)
        yield from (quantity.spec for quantity in quantities(problem.forward, known, problem.scene))


@pytest.mark.parametrize("name", NAMED)
def test_every_unit_has_the_factor_of_its_symbol(name):
    assert agrees(NAMED[name])


def test_every_quantity_is_shown_in_a_unit_of_its_own():
    specs = [*SPECS.values(), *CAMERA_SPECS.values(), *COLUMNS.values()]
    specs += [column.noise for column in COLUMNS.values() if column.noise]
    specs += noise.StudentT.parameters
    derived_specs = {spec.name: spec for spec in derived()}
    assert {*derived_specs} >= {
        "k_theta/k_y",
        "cor_median",
        "eps_median",
        "court_pace",
        "cor_254cm",
        "rebound_254cm",
    }
    wrong = [
        spec.name
        for spec in [*specs, *derived_specs.values()]
        if not agrees(spec.display_unit, spec.unit)
    ]
    assert not wrong
    # Angles and times of contacts are not read in SI, times of flights are.
    flights = {"flight_time_1", "flight_time_2", "bounce_time", "bounce_interval"}
    in_si = {spec.name for spec in specs if spec.display_unit.name in ("rad", "s")}
    assert in_si == flights


def test_a_unit_is_written_once():
    """Elsewhere units have names: a literal factor could be another one."""
    written = [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for file in ROOT.rglob("*.py")
        if file.name not in ("display_units.py", "numbers.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "Unit"
        and any(isinstance(argument, ast.Constant | ast.BinOp) for argument in node.args)
    ]
    assert not written


def test_the_page_of_a_simulation():
    result = fitball.simulate(
        model="two-mass",
        impact="v_1=20, theta_1=35 deg, omega_1=-1000 rpm",
    )
    report = simulate_page.report(result)
    assert "20.00 m/s at 35.0 degrees, spin -1000 rpm" in report.title
    values = result.frames["outcome"].set_index("quantity")["value"]
    titles = {column.title: name for name, column in COLUMNS.items()}
    titles |= {
        "greatest compression": "peak_compression",
        "greatest normal force": "peak_force",
    }
    rows = rows_of(report, "quantity")
    assert {"contact_time", "v_x2", "peak_compression"} <= {titles[row["quantity"]] for row in rows}
    for row in rows:
        assert shows(row["value"], values[titles[row["quantity"]]], row["unit"])
    time = values["contact_time"]
    (text,) = re.findall(r"after (\S+) ms", report.summary[0].lines[0])
    assert shows(text, time, "ms")
    assert shows(rows_of(report, "to [ms]")[-1]["to [ms]"], time, "ms")
    set_values = result.frames["parameters"].set_index("parameter")["value"]
    for row in rows_of(report, "parameter"):
        assert shows(row["value"], set_values[row["parameter"]], row["unit"])


def test_the_page_of_a_prediction():
    complete = fit_by_hand()
    fit = replace(complete, alternatives=())
    fit.__dict__["built"] = complete.built
    result = fit.predict(impact="v_1=15..25:4, theta_1=30 deg, omega_1=10")
    frame = result.frames["predictions"]
    rows = rows_of(predict_page.report(result), "impact")
    for k, row in enumerate(rows):
        for head, value in (("v_1 [m/s]", 15.0 + 10.0 * k / 3.0), ("theta_1 [deg]", pi / 6.0)):
            assert shows(row[head], value, unit_of(head))
        for head in (head for head in row if head.partition(" [")[0] in ("v_x2", "theta_2")):
            mine = frame[frame["column"] == head.partition(" [")[0]]
            assert shows(row[head], mine["median"].iloc[k], unit_of(head))
    assert any("theta_2 [deg]" in row for row in rows)


def test_the_page_of_a_plan():
    result = fit_by_hand(scene=Scene()).plan(
        speed="15..25:2",
        angle="20..60:2",
        spin="0..100:2",
        count=2,
        target="offset,mu",
    )
    plan = result.frames["plan"]
    target = result.frames["targets"]
    report = plan_page.report(result)
    for row, chosen in zip(rows_of(report, "angle [deg]"), plan.to_dict("records"), strict=True):
        assert shows(row["angle [deg]"], chosen["theta_1"], "deg")
        assert shows(row["speed [m/s]"], chosen["v_1"], "m/s")
        assert shows(row["sd of offset [mm]"], chosen["sd(offset)"], "mm")
    for row in rows_of(report, "now"):
        assert row["unit"] == {"offset": "mm", "mu": ""}[row[""]]
        assert shows(row["now"], target.loc[row[""], "now"], row["unit"])
    words = re.findall(r"at (\S+) deg,", report.summary[0].lines[0])
    assert words and {*words} <= {"20", "60"}


def test_the_page_of_a_fit():
    fit = fit_by_hand()
    frame = fit.predictions
    rows = fit_tables.impact_table(fit).rows
    for row, state in zip(rows, frame.drop_duplicates("row").to_dict("records"), strict=True):
        assert shows(row["angle [deg]"], state["theta_1"], "deg")
        assert shows(row["speed [m/s]"], state["v_1"], "m/s")


def test_rebounds_of_drops_are_in_centimetres():
    heights = {"drop_height": [2.54] * 3, "rebound_height": [1.40, 1.41, 1.405]}
    fit = fitball.calibrate(heights, point_only=True)
    head = "rebound from 254 cm [cm], 95 %"
    row = rows_of(fit_page.report(fit), head)[0]
    rebound = drop_test(fit.run.table, fit.run.scene)["rebound"][0]
    assert rebound == pytest.approx(1.405, abs=1e-3)
    assert shows(row[head], rebound, "cm")


def test_the_page_of_a_film():
    rng = np.random.default_rng(20)
    scene = Scene(camera=CameraSection(fps=240.0, court=0.0), columns={"x": "x [m]"})
    film = fitball.track(
        filmed(bounces(7, rng), Camera(240, fold=2), rng), scene=scene, progress=False
    )
    report = track_page.report(film)
    for row, known in zip(rows_of(report, "session"), film.session.to_dict("records"), strict=True):
        heads = [head for head in row if unit_of(head) in ("mm", "deg")]
        assert {*heads} == {"noise_x [mm]", "noise_y [mm]", "court [mm]", "noise_angle [deg]"}
        for head in heads:
            si = BY_HAND[unit_of(head)][0]
            assert shows(row[head], known[f"{head.partition(' [')[0]} [{si}]"], unit_of(head))
    rows = {row["parameter"]: row["prior"] for row in rows_of(report, "prior")}
    for name, spec in CAMERA_SPECS.items():
        stated = getattr(film.scene.camera, name)
        if name == "row_delay":
            # The film states no row time.
            assert stated is None
            assert name not in rows
            continue
        value = stated if isinstance(stated, float | int) else stated.value
        assert shows(rows[name], value, spec.display_unit.name)


def test_the_settings_of_an_engine():
    parameter_values = parameter_set.set_of_model(fitball.model(), {})
    settings = engine.settings(parameter_values, fitball.impacts(8.0, 9.0, 10.0), 0.4)
    row = engine_page.setting_row(parameter_values, settings, ("v_x2", "omega_2"), 0.005)
    for kind, errors in (("error", settings.errors), ("rms", settings.rms)):
        for name, symbol in (("v_x2", "m/s"), ("omega_2", "rad/s")):
            assert shows(row[f"{kind} {name} [{symbol}]"], errors[name], symbol)
    exported = fitball.export(model="two-mass", to="engine", at="v_1=17, theta_1=30 deg, omega_1=0")
    (text,) = exported.contents.values()
    assert "17.0 m/s at 30.0 deg" in text
