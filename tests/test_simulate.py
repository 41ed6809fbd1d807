"""One impact through time: balances of momentum, phases, bands of draws, values by hand, the
figure.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.models.types import regime_name
from fitball.report.style import draw_styled, image_bytes
from fitball.uses.simulate import BAND_DRAWS

IMPACT = "v_1=20, theta_1=35 deg, omega_1=-1000 rpm"
ALONG = 20 * np.cos(np.radians(35))
DOWN = 20 * np.sin(np.radians(35))
SPIN = -1000 * np.pi / 30
STATE = fitball.impacts(ALONG, DOWN, SPIN)
MASS = 0.0576
RADIUS = 0.03302


def by_hand(impact=IMPACT, model="two-mass+normal=total", **fix):
    return fitball.simulate(model=model, impact=impact, fix=fix)


@pytest.mark.parametrize("model", ["two-mass+normal=total", "thesis-exact"])
def test_forces_change_the_momentum_of_the_ball(model):
    result = by_hand(model=model)
    frame = result.frames["history"]
    outcome = result.frames["outcome"].set_index("quantity")["value"]
    along = np.trapezoid(frame["friction_force"], frame["time"])
    upward = np.trapezoid(frame["normal_force"], frame["time"])
    # Friction has a corner at each phase.
    change = MASS * (outcome["v_x2"] - ALONG)
    assert along == pytest.approx(change, rel=2e-3)
    if "total" in model:
        change = MASS * (outcome["v_y2"] + DOWN)
        assert upward == pytest.approx(change, rel=1e-4)
    limit = frame["friction_limit"].abs() * (1 + 1e-9) + 1e-9
    assert (frame["friction_force"].abs() <= limit).all()
    slip = frame["v_x"] - RADIUS * frame["omega_shell"]
    assert_allclose(frame["slip"], slip, atol=1e-9)


def test_phases_are_those_of_the_rebound_and_change_where_slip_ends():
    result = by_hand()
    phases = result.frames["phases"]
    time = result.frames["history"]["time"].iloc[-1]
    values = result.frames["parameters"].set_index("parameter")["value"].to_dict()
    model = fitball.model("two-mass+normal=total")
    rebound = model.rebound(values, STATE)
    assert ", ".join(phases["phase"]) == regime_name(int(rebound.regime[0]))
    assert len(phases) > 1
    assert time == pytest.approx(rebound.contact_time[0])
    assert phases["start"][0] == 0.0
    assert_array_equal(phases["start"][1:], phases["end"][:-1])
    edge = phases["end"][0]
    around = np.array([edge * (1 - 1e-6), edge])
    before, after = model.history(values, STATE, around).courses["slip"]
    assert 0.0 < before < 1e-3
    assert abs(after) < 1e-9


def test_bands_are_quantiles_of_draws_at_shares_of_their_own_contact():
    fit = fit_by_hand(table_of(36, ("clay", "hard")), model="two-mass")
    result = fitball.simulate(fit, impact=IMPACT, level={"surface": "Hard"})
    frame = result.frames["history"]
    outcome = result.frames["outcome"].set_index("quantity")
    model = fit.problem.forward.model
    rows = np.linspace(0, 399, BAND_DRAWS).astype(int)
    on_hard = {}
    for spec in model.parameters:
        draws = fit.draws.values
        pooled = draws.get(spec.name)
        on_hard[spec.name] = draws.get(f"{spec.name}[hard]", pooled)[rows]
    times = model.rebound(on_hard, STATE).contact_time[:, 0]
    slips = []
    for k, time in enumerate(times):
        draw = {name: values[k] for name, values in on_hard.items()}
        history = model.history(draw, STATE, np.array([0.25, 0.5]) * time)
        slips.append(history.courses["slip"])
    low, high = np.quantile(slips, [0.025, 0.84], axis=0)
    # 240 steps of the contact: a quarter, and half of it.
    shown = frame.loc[[60, 120]]
    assert_allclose(shown["slip_q025"], low, rtol=1e-12, atol=1e-12)
    assert_allclose(shown["slip_q84"], high, rtol=1e-12, atol=1e-12)
    assert_allclose(outcome.loc["contact_time", "q975"], np.quantile(times, 0.975))
    assert "extrapolated" not in {note.code for note in result.notes}
    far = fitball.simulate(fit, impact="v_1=60, theta_1=35", level={"surface": "hard"})
    assert "extrapolated" in {note.code for note in far.notes}
    fixed = fit_by_hand(model="two-mass", fix={"k_y": 2e4})
    result = fitball.simulate(fixed, impact=IMPACT)
    assert [note.code for note in result.notes] == ["held"]


def test_draws_without_an_answer_are_left_out_and_said():
    fit = fit_by_hand(model="two-mass")
    ratio = fit.draws.values["mass_ratio"]
    rng = np.random.default_rng(2)
    for share, banded in ((0.3, True), (0.7, False)):
        # COR cannot exceed the mass ratio.
        without_answer = rng.uniform(size=400) < share
        ratio[:] = np.where(without_answer, 0.4, 0.87)
        result = fitball.simulate(fit, impact=IMPACT)
        assert [note.code for note in result.notes] == ["no-answer"]
        drawn = result.frames["history"]["y_q025"].notna()
        assert (drawn == banded).all()


def test_values_by_hand_are_numbers_or_published_ones():
    result = by_hand(mu="literature:clay", k_y="1e4")
    values = result.frames["parameters"].set_index("parameter")["value"]
    assert values["mu"] == pytest.approx(0.73)
    assert values["k_y"] == 1e4
    specs = fitball.model("two-mass").specs
    assert values["k_theta"] == specs["k_theta"].typical


@pytest.mark.parametrize("case", ["fit", "drop", "point", "values"])
def test_the_figure_shows_the_courses(case):
    result = by_hand()
    if case != "values":
        kind = "two-mass"
        frame = None
        impact = IMPACT
        if case == "drop":
            kind = "two-mass+normal=total"
            frame = table_of(12, drop=True)
            impact = "v_y1=7"
        fit = fit_by_hand(frame, model=kind, sampled=case != "point")
        result = fitball.simulate(fit, impact=impact)
    figure = draw_styled(result._layout.figures()["history"])
    assert image_bytes(figure).startswith(b"\x89PNG")
    height = figure.axes[0]
    course = result.frames["history"][["time", "y"]]
    assert_allclose(height.lines[0].get_xydata(), 1e3 * course.to_numpy())
    bands = 2 if case in ("fit", "drop") else 0
    assert len(height.collections) == bands
    assert ("no-band" in {note.code for note in result.notes}) == (case == "point")
    phases = result.frames["phases"]
    if case == "drop":
        assert len(figure.axes) == 2
        assert "omega_2" not in result.report(full=False)
        assert phases.empty
    else:
        assert len(figure.axes) == 4
        assert "omega_2" in result.report(full=False)
        assert not phases.empty
        state = result.frames["impact"].iloc[0]
        values = result.frames["outcome"].set_index("quantity")["value"]
        # Speeds of the ball and of its surface, before and after.
        ends = [
            state["v_x1"],
            state["radius"] * state["omega_1"],
            values["v_x2"],
            state["radius"] * values["omega_2"],
        ]
        dots = [line for line in figure.axes[2].lines if line.get_marker() == "o"]
        assert_allclose([dot.get_ydata()[0] for dot in dots], ends)
        widths = [patch.get_width() for patch in height.patches]
        assert_allclose(widths, 1e3 * (phases["end"] - phases["start"]))
