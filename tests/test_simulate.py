"""One impact through time: balances of momentum, phases, bands of draws, values by hand, the
figure.
"""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from support.made_fit import made_fit, table_of

import fitball
from fitball.models.types import regime_name
from fitball.report.style import saved, styled
from fitball.uses.simulate import DRAWS

IMPACT = "v_1=20, theta_1=35 deg, omega_1=-1000 rpm"
ALONG = 20 * np.cos(np.radians(35))
DOWN = 20 * np.sin(np.radians(35))
STATE = fitball.impacts(ALONG, DOWN, -1000 * np.pi / 30)
MASS = 0.0576
RADIUS = 0.03302


def by_hand(impact=IMPACT, model="two-mass+normal=total", **fix):
    return fitball.simulate(model=model, impact=impact, fix=fix)


@pytest.mark.parametrize("model", ["two-mass+normal=total", "thesis-exact"])
def test_forces_change_the_momentum_of_the_ball(model):
    found = by_hand(model=model)
    frame = found.frames["history"]
    outcome = found.frames["outcome"].set_index("quantity")["value"]
    impulse = {
        name: np.trapezoid(frame[name], frame["time"])
        for name in ("friction_force", "normal_force")
    }
    # Friction has a corner at each phase.
    assert impulse["friction_force"] == pytest.approx(MASS * (outcome["v_x2"] - ALONG), rel=2e-3)
    if "total" in model:
        assert impulse["normal_force"] == pytest.approx(MASS * (outcome["v_y2"] + DOWN), rel=1e-4)
    assert (
        frame["friction_force"].abs() <= frame["friction_limit"].abs() * (1 + 1e-9) + 1e-9
    ).all()
    assert_allclose(
        frame["slip"],
        frame["v_x"] - RADIUS * frame["omega_shell"],
        atol=1e-9,
    )


def test_phases_are_those_of_the_rebound_and_change_where_slip_ends():
    found = by_hand()
    phases = found.frames["phases"]
    time = found.frames["history"]["time"].iloc[-1]
    values = found.frames["parameters"].set_index("parameter")["value"].to_dict()
    model = fitball.model("two-mass+normal=total")
    made = model.rebound(values, STATE)
    assert ", ".join(phases["phase"]) == regime_name(int(made.regime[0]))
    assert len(phases) > 1
    assert time == pytest.approx(made.contact_time[0])
    assert phases["start"][0] == 0.0
    assert_array_equal(phases["start"][1:], phases["end"][:-1])
    edge = phases["end"][0]
    around = model.history(values, STATE, np.array([edge * (1 - 1e-6), edge]))
    assert 0.0 < around.courses["slip"][0] < 1e-3
    assert abs(around.courses["slip"][1]) < 1e-9


def test_bands_are_quantiles_of_draws_at_shares_of_their_own_contact():
    fit = made_fit(table_of(36, ("clay", "hard")), model="two-mass")
    found = fitball.simulate(fit, impact=IMPACT, level={"surface": "Hard"})
    frame = found.frames["history"]
    outcome = found.frames["outcome"].set_index("quantity")
    draws = fit.draws.values
    names = [spec.name for spec in fit.problem.forward.model.parameters]
    at = {name: draws.get(f"{name}[hard]", draws.get(name)) for name in names}
    rows = np.linspace(0, 399, DRAWS).astype(int)
    model = fit.problem.forward.model
    slips = []
    times = model.rebound({name: one[rows] for name, one in at.items()}, STATE).contact_time[:, 0]
    for row, time in zip(rows, times, strict=True):
        one = model.history(
            {name: values[row] for name, values in at.items()},
            STATE,
            np.array([0.25, 0.5]) * time,
        )
        slips.append(one.courses["slip"])
    ends = np.quantile(slips, [0.025, 0.84], axis=0)
    assert_allclose(frame.loc[[60, 120], "slip_q025"], ends[0], rtol=1e-12, atol=1e-12)
    assert_allclose(frame.loc[[60, 120], "slip_q84"], ends[1], rtol=1e-12, atol=1e-12)
    assert_allclose(outcome.loc["contact_time", "q975"], np.quantile(times, 0.975))
    assert "extrapolated" not in {note.code for note in found.notes}
    held = fitball.simulate(made_fit(model="two-mass", fix={"k_y": 2e4}), impact=IMPACT)
    assert [note.code for note in held.notes] == ["held"]
    far = fitball.simulate(fit, impact="v_1=60, theta_1=35", level={"surface": "hard"})
    assert "extrapolated" in {note.code for note in far.notes}


def test_draws_without_an_answer_are_left_out_and_said():
    fit = made_fit(model="two-mass")
    ratio = fit.draws.values["mass_ratio"]
    rng = np.random.default_rng(2)
    for share, banded in ((0.3, True), (0.7, False)):
        # COR cannot exceed the mass ratio.
        ratio[:] = np.where(rng.uniform(size=400) < share, 0.4, 0.87)
        found = fitball.simulate(fit, impact=IMPACT)
        assert [note.code for note in found.notes] == ["no-answer"]
        assert (found.frames["history"]["y_q025"].notna() == banded).all()


def test_values_by_hand_are_numbers_or_published_ones():
    found = (
        by_hand(mu="literature:clay", k_y="1e4")
        .frames["parameters"]
        .set_index("parameter")["value"]
    )
    assert found["mu"] == pytest.approx(0.73)
    assert found["k_y"] == 1e4
    assert found["k_theta"] == fitball.model("two-mass").specs["k_theta"].typical


@pytest.mark.parametrize("case", ["fit", "drop", "point", "values"])
def test_the_figure_shows_the_courses(case):
    found = by_hand()
    if case != "values":
        kind = "two-mass"
        frame = None
        impact = IMPACT
        if case == "drop":
            kind = "two-mass+normal=total"
            frame = table_of(12, drop=True)
            impact = "v_y1=7"
        found = fitball.simulate(
            made_fit(frame, model=kind, sampled=case != "point"),
            impact=impact,
        )
    figure = styled(found._layout.figures()["history"])
    frame = found.frames["history"]
    assert saved(figure).startswith(b"\x89PNG")
    assert len(figure.axes) == (2 if case == "drop" else 4)
    assert_allclose(
        figure.axes[0].lines[0].get_xydata(),
        1e3 * frame[["time", "y"]].to_numpy(),
    )
    assert len(figure.axes[0].collections) == (2 if case in ("fit", "drop") else 0)
    assert ("no-band" in {note.code for note in found.notes}) == (case == "point")
    assert (
        ("omega_2" in found.report(full=False))
        == (case != "drop")
        == (not found.frames["phases"].empty)
    )
    if case != "drop":
        state = found.frames["impact"].iloc[0]
        values = found.frames["outcome"].set_index("quantity")["value"]
        dots = [line.get_ydata()[0] for line in figure.axes[2].lines if line.get_marker() == "o"]
        ends = np.array([[state["v_x1"], state["omega_1"]], [values["v_x2"], values["omega_2"]]])
        assert_allclose(dots, (ends * [1.0, state["radius"]]).ravel())
        widths = [patch.get_width() for patch in figure.axes[0].patches]
        assert_allclose(
            widths,
            1e3 * (found.frames["phases"]["end"] - found.frames["phases"]["start"]),
        )
