"""Predictions of impacts whose incident state is uncertain: against direct Monte Carlo and first order."""

from __future__ import annotations

import json
import math

import numpy as np
import pandas as pd
import pytest
from scipy.stats import norm
from test_predict import LEVELS, bounce, fitted_grip_slip

import fitball
from fitball.cli.main import main
from fitball.data.lines import parse_impact, parse_uncertain_impact
from fitball.errors import ParameterError
from fitball.inference.prediction.new_impacts import predict_new
from fitball.models.types import STATUS_REASON, Status

# Speed [m/s], angle [deg], spin [rad/s], and an sd of each. The first grips, the second is between slip and grip.
STATES = ((15.0, 50.0, 20.0), (16.0, 24.0, 30.0))
SDS = (0.8, 1.5, 15.0)
TABLE = "id,v_1,theta_1,omega_1,v_1_sd,theta_1_sd,omega_1_sd\n" + "".join(
    ",".join(map(str, (f"i{k}", *state, *SDS))) + "\n" for k, state in enumerate(STATES)
)
EXACT = "\n".join(",".join(line.split(",")[:4]) for line in TABLE.splitlines()) + "\n"


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    place = tmp_path_factory.mktemp("uncertain") / "new.csv"
    place.write_text(TABLE, encoding="utf-8")
    return fitball.load_table(place, rebound=False)


@pytest.fixture(scope="module")
def fitted():
    return fitted_grip_slip(draws=4000)


@pytest.fixture(scope="module")
def found(fitted, table):
    return predict_new(fitted, table.impacts, seed=3, incident_covariance=table.incident_covariance)


def drawn_states(rng, state, count):
    speed, angle, spin = (mean + sd * rng.standard_normal(count) for mean, sd in zip(state, SDS, strict=True))
    return speed * np.cos(np.radians(angle)), speed * np.sin(np.radians(angle)), spin


def direct(fitted, row, count=200_000):
    """Rebounds of drawn parameters at drawn states, and the noise of new measurements."""
    rng = np.random.default_rng(17)
    values = fitted.draws[rng.integers(len(fitted.draws), size=count)]
    v_x, v_y, omega = bounce(values, *drawn_states(rng, STATES[row], count))
    noise = {"v_x2": values[:, 5], "v_y2": values[:, 5], "omega_2": values[:, 6]}
    rebound = {"v_x2": v_x, "v_y2": v_y, "omega_2": omega}
    data = {name: array + noise[name] * rng.standard_normal(count) for name, array in rebound.items()}
    return rebound, data


@pytest.mark.parametrize("row", [0, 1])
def test_intervals_against_direct_monte_carlo(fitted, found, row):
    rebound, data = direct(fitted, row)
    for name in rebound:
        output = found.output(name)
        for truth, quantiles in ((rebound[name], output.rebound), (data[name], output.measured)):
            sd = np.std(truth)
            # Standard error of a normal quantile from 4000 draws: below 0.045 sd at 2.5 %, and 0.02 at the median.
            np.testing.assert_allclose(quantiles[:, row], np.quantile(truth, LEVELS), atol=0.13 * sd)
        assert output.sd[row] == pytest.approx(np.std(data[name]), rel=0.05)
        assert output.mean[row] == pytest.approx(np.mean(data[name]), abs=0.06 * np.std(data[name]))


def test_speed_and_angle_move_the_components_together(fitted, table, found):
    """The control: without the correlation of v_x1 and v_y1 the spread of the rebound is another one."""
    covariance = table.incident_covariance
    alone = covariance * np.eye(3)
    other = predict_new(fitted, table.impacts, seed=3, incident_covariance=alone)
    assert abs(covariance[1, 0, 1]) > 0.4 * math.sqrt(covariance[1, 0, 0] * covariance[1, 1, 1])
    rebound = direct(fitted, 1)[0]
    truth = width(np.quantile(np.arctan2(rebound["v_y2"], rebound["v_x2"]), LEVELS))
    kept, lost = (width(item.output("theta_2").rebound[:, 1]) for item in (found, other))
    assert kept == pytest.approx(truth, rel=0.06)
    # A faster ball at the same angle leaves at nearly the same angle.
    assert lost > 1.12 * truth


def width(levels):
    """Standard deviation of a normal with these 16 and 84 % quantiles."""
    return 0.5 * (levels[3] - levels[1]) / norm.ppf(0.84)


def test_what_the_incident_state_adds_is_first_order_where_the_bounce_is_smooth(fitted, table):
    small = 0.01 * table.incident_covariance
    found = predict_new(fitted, table.impacts, seed=3, incident_covariance=small)
    names = [name for name in fitted.names if name in fitted.model.parameter_names]
    rows = fitted.draws[:200, [fitted.names.index(name) for name in names]]
    slopes = fitted.model.jacobian(names, np.ascontiguousarray(rows), table.impacts, ()).inputs[:, 0]
    for k, name in enumerate(("v_x2", "v_y2", "omega_2")):
        variance = np.einsum("di,ij,dj->d", slopes[:, k], small[0], slopes[:, k])
        # Half squared differences of 4000 pairs: relative error of the sd 1/sqrt(2 * 4000), that is 0.011.
        assert found.output(name).shares.incident[0] == pytest.approx(math.sqrt(variance.mean()), rel=0.05)


def test_shares_add_up(fitted, table, found):
    fixed = predict_new(fitted, table.impacts, seed=3)
    for name in ("v_x2", "v_y2", "omega_2"):
        output = found.output(name)
        parts = output.shares
        total = parts.parameters**2 + parts.incident**2 + parts.measurement**2
        np.testing.assert_allclose(np.sqrt(total), output.sd, rtol=0.05)
        alone = np.hypot(parts.parameters, parts.measurement)
        np.testing.assert_allclose(alone, fixed.output(name).sd, rtol=0.05)
        noise = {"v_x2": 0.4, "v_y2": 0.4, "omega_2": 12.0}[name]
        np.testing.assert_allclose(parts.measurement, noise, rtol=0.05)
        assert fixed.output(name).shares is None


def test_no_uncertainty_is_the_same_bytes(table):
    fitted = fitted_grip_slip(draws=300)
    fixed = predict_new(fitted, table.impacts, seed=3)
    nothing = predict_new(fitted, table.impacts, seed=3, incident_covariance=np.zeros((2, 3, 3)))
    for one, other in zip(fixed.outputs, nothing.outputs, strict=True):
        for name in ("point", "rebound", "measured", "mean", "sd"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        assert not other.shares.incident.any()
    again = predict_new(fitted, table.impacts, seed=3, incident_covariance=table.incident_covariance)
    twice = predict_new(fitted, table.impacts, seed=3, incident_covariance=table.incident_covariance)
    for one, other in zip(again.outputs, twice.outputs, strict=True):
        assert one.measured.tobytes() == other.measured.tobytes()


def test_a_state_that_may_be_no_impact_is_told(fitted):
    covariance = np.zeros((1, 3, 3))
    covariance[0, 1, 1] = 0.5**2
    found = predict_new(fitted, fitball.impacts(10.0, 0.5), seed=1, incident_covariance=covariance)
    (share,) = found.failures
    assert share[STATUS_REASON[Status.NO_IMPACT]] == pytest.approx(norm.cdf(-1.0), abs=0.025)
    assert found.output("v_y2").rebound[0, 0] > 0.0


def test_an_uncertain_impact_in_words():
    impacts, covariance = parse_uncertain_impact("v=38±1 mph, theta=18 +/- 0.5 deg, spin=950+-50 rpm back")
    theta, mph, degree = math.radians(18.0), 0.44704, math.pi / 180.0
    along = np.array([math.cos(theta), math.sin(theta)]) * mph
    turned = 38.0 * mph * np.array([-math.sin(theta), math.cos(theta)]) * 0.5 * degree
    np.testing.assert_allclose(covariance[0, :2, :2], np.outer(along, along) + np.outer(turned, turned), rtol=1e-12)
    assert covariance[0, 2, 2] == pytest.approx((50.0 * math.pi / 30.0) ** 2)
    assert not covariance[0, 2, :2].any()
    assert impacts.omega_1[0] == pytest.approx(-950.0 * math.pi / 30.0)
    assert impacts.v_x1[0] == parse_impact("v=38 mph, theta=18, spin=950 rpm back").v_x1[0]
    with pytest.raises(ParameterError, match="which only predict uses"):
        parse_impact("v=38±1 mph, theta=18")
    assert parse_uncertain_impact("v=38 mph, theta=18")[1] is None


@pytest.mark.parametrize(
    "text", ["v=38±0 mph, theta=18", "v=38±1e999 mph, theta=18", "v=38±-1, theta=18", "v=38±, theta=18"]
)
def test_a_bad_standard_deviation_is_quoted(text):
    with pytest.raises(ParameterError) as caught:
        parse_impact(text)
    assert f"impact '{text}'" in str(caught.value)


def test_at_the_command_line(small_fit, tmp_path, capsys):
    (tmp_path / "new.csv").write_text(TABLE, encoding="utf-8")
    (tmp_path / "exact.csv").write_text(EXACT, encoding="utf-8")
    place = tmp_path / "out.csv"
    assert main(["predict", str(small_fit), str(tmp_path / "new.csv"), "--full", "--out", str(place)]) == 0
    out, err = capsys.readouterr()
    assert "sd due to" in out
    assert "incident state" in out
    assert "drawn with each posterior draw" in err and "did not converge" in err
    frame = pd.read_csv(place)
    assert (frame["v_x2_sd_incident [m/s]"] > 0.1).all()
    assert {"v_x2_sd_parameters [m/s]", "theta_2_sd_measurement [deg]"} <= set(frame.columns)
    assert main(["predict", str(small_fit), str(tmp_path / "new.csv"), "--json", "--exact-incidence"]) == 0
    told, plain = json.loads(capsys.readouterr().out), None
    assert "is not used" in " ".join(told.pop("notes"))
    assert main(["predict", str(small_fit), str(tmp_path / "exact.csv"), "--json"]) == 0
    text = capsys.readouterr().out
    plain = json.loads(text)
    plain.pop("notes")
    assert plain == told
    assert "sd_incident" not in text
    assert (
        main(
            [
                "predict",
                str(small_fit),
                "--full",
                "--impact",
                "v=38±1 mph, theta=18",
                "--impact",
                "v=38 mph, theta=18",
            ]
        )
        == 0
    )
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("v_x2 [m/s]")]
    assert len(lines) == 4
    assert float(lines[1].split()[-2]) > 0.1
    assert float(lines[3].split()[-2]) == 0.0
