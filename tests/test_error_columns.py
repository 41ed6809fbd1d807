"""Columns of errors by the names that people give them; other than sds are refused."""

import numpy as np
import pandas
import pytest
from made_tables import written
from numpy.testing import assert_allclose

import fitball
from fitball.base.errors import InputError

# Impacts across the court: v_y1, v_y2, error of v_y2 [m/s].
ROWS = np.array([[7.57, 5.416, 0.5], [10.89, 8.091, 0.03], [9.6, 7.235, 0.03], [7.13, 5.732, 0.5]])

SIGMA = "\N{GREEK SMALL LETTER SIGMA}"


def codes_of(table):
    return [note.code for note in table.notices]


def faults_of(source, **reading):
    with pytest.raises(InputError) as caught:
        fitball.load_table(source, **reading)
    return [(fault.code, fault.column) for fault in caught.value.faults]


NAMES = [
    *("v_y2_err", "v_y2 err", "v_y2_error", "v_y2 error", "err_v_y2", "error of v_y2", "vy2Err"),
    *(
        "u(v_y2)",
        "u_v_y2",
        "u(v_y2) [m/s]",
        "sigma_v_y2",
        "\N{GREEK SMALL LETTER SIGMA}(v_y2)",
        "\N{GREEK SMALL LETTER SIGMA}_v_y2 (m/s)",
        "s_v_y2",
    ),
    *("v_y2 uncertainty [m/s]", "v_y2_unc", "uncertainty in v_y2", "v_y2_std", "sd(v_y2)"),
    *("std(v_y2)", "std dev of v_y2", "v_y2 stdev", "Standard deviation v_y2", "v_y2_stderr"),
    *("v_y2 SE", "v_y2_sem", "Δv_y2", "∆v_y2 [m/s]", "delta_v_y2", "δ v_y2", "dv_y2", "d(v_y2)"),
    *(
        "± v_y2",
        "v_y2 ±",
        "v_y2 +/-",
        "v_y2 (±)",
        "v_y2 (sd)",
        "v_y2 [err.]",
        "+/- v_y2",
        "v_y2 [m/s] error",
        "v_y2_abs_err",
    ),
    *("Fehler v_y2", "v_y2 Fehler [m/s]", "Unsicherheit von v_y2", "Standardabweichung v_y2"),
    *("erreur v_y2", "incertitude de v_y2", "v_y2 écart-type", "error v_y2", "incertezza v_y2"),
    *("v_y2_err_1sigma", "standard uncertainty v_y2", "V_Y2_ERR", "v_y2.err", "v_y2-err"),
    *(
        "±",
        "+/-",
        "error",
        "err [m/s]",
        "Fehler",
        "uncertainty",
        "SD",
        "\N{GREEK SMALL LETTER SIGMA}",
        "±.1",
        "std. dev.",
    ),
]


@pytest.mark.parametrize("name", NAMES)
def test_errors_by_their_usual_names_are_standard_deviations(name):
    table = fitball.load_table({"v_y1": ROWS[:, 0], "v_y2": ROWS[:, 1], name: ROWS[:, 2]})
    assert_allclose(table.sd["v_y2"], ROWS[:, 2])
    assert codes_of(table) == ["errors-read"]
    assert {*table.labels} == {"id"}


def test_errors_have_the_unit_that_is_stated_or_that_of_their_column(tmp_path):
    head = "v_1 [km/h],v_1 err,theta_1,u(theta_1) [rad],v_2 [m/s],v_2 error [cm/s]"
    table = fitball.load_table(written(tmp_path, f"{head}\n36,3.6,30,0.1,8,20\n72,7.2,35,0.2,9,30"))
    assert_allclose(table.sd["v_1"], [1.0, 2.0])
    assert_allclose(table.sd["theta_1"], [0.1, 0.2])
    assert_allclose(table.sd["v_2"], [0.2, 0.3])


PERCENT = [
    *("v_y2 error [%]", "v_y2_err_pct", "v_y2 err (%)", "error [%]", "± [%]", "± %", "%  error"),
    *("v_y2 rel. error [%]", "relative error of v_y2 [%]", "CV v_y2 [%]", "v_y2_sd [%]"),
    *("percent error v_y2", "u(v_y2) [%]", "Fehler [%]", "v_y2 Fehler in Prozent", "RSD [%]"),
]


@pytest.mark.parametrize("name", PERCENT)
def test_errors_in_percent_are_shares_of_the_value(name):
    table = fitball.load_table({"v_y1": ROWS[:, 0], "v_y2": ROWS[:, 1], name: [3.0, 3, 3, 2]})
    assert_allclose(table.sd["v_y2"], ROWS[:, 1] * [0.03, 0.03, 0.03, 0.02], rtol=1e-14)


def test_percent_of_several_columns_of_other_units(tmp_path):
    head = "drop_height [cm],error [%],rebound_height [cm],error [%],contact_time [ms],± [%]"
    path = written(tmp_path, f"{head}\n254,1,140,2,5,10\n200,1,112,2,5.1,10\n")
    table = fitball.load_table({"v_y1 [km/h]": [36, 38], "v_y1 ± [%]": [2, 2], "v_y2": [7, 8]})
    assert_allclose(table.sd["v_y1"], [0.2, 0.02 * 38 / 3.6])
    plain = "drop_height [cm],drop_height_sd,rebound_height [cm],rebound_height_sd"
    plain = f"{plain},contact_time [ms],contact_time_sd\n254,2.54,140,2.8,5,0.5\n"
    same = fitball.load_table(written(tmp_path, f"{plain}200,2,112,2.24,5.1,0.51\n", "same.csv"))
    read = fitball.load_table(path)
    for name in ("v_y1", "v_y2", "contact_time"):
        assert_allclose(read.sd[name], same.sd[name], rtol=1e-12)


def test_relative_errors_without_a_unit_are_asked_for(tmp_path):
    rows = {"v_y1": ROWS[:, 0], "v_y2": ROWS[:, 1]}
    share = fitball.load_table(rows | {"v_y2 rel. error [1]": [0.02] * 4})
    assert_allclose(share.sd["v_y2"], 0.02 * ROWS[:, 1])
    assert faults_of(rows | {"v_y2 rel. error": [0.02] * 4}) == [("not-one-sd", "v_y2_sd")]


@pytest.mark.parametrize("name", ["cor_err", "u(cor)", "COR sd", "cor ±"])
def test_errors_of_a_coefficient_of_restitution(name):
    """0.81 ± 0.01 of 2.1 m/s is 1.701 ± 0.021 m/s."""
    speed = np.array([2.1, 3.0])
    table = fitball.load_table({"v_y1": speed, "cor": [0.81, 0.79], name: [0.01, 0.01]})
    assert_allclose(table.values["v_y2"], [1.701, 2.37])
    assert_allclose(table.sd["v_y2"], 0.01 * speed)
    percent = {"v_y1": speed, "cor": [0.8, 0.5], "cor error [%]": [2.0, 2.0]}
    assert_allclose(fitball.load_table(percent).sd["v_y2"], [0.016 * 2.1, 0.01 * 3.0])
    points = {"v_y1": speed, "cor [%]": [80.0, 50.0], "cor error [%]": [2.0, 2.0]}
    assert_allclose(fitball.load_table(points).sd["v_y2"], 0.02 * speed)


def test_a_share_of_nothing_is_no_error():
    rows = {"v_x1": [9.0, 8.0], "v_y1": [5.0, 5.0], "omega_1": [0.0, 10.0], "v_y2": [4.0, 4.0]}
    rows["omega_1 error [%]"] = [5.0, 5.0]
    assert faults_of(rows) == [("no-sd", "omega_1_sd")]
    assert fitball.load_table(rows, ignore="omega_1_sd").sd == {}


@pytest.mark.parametrize(
    "names",
    [
        ["v_y2_err_low", "v_y2_err_high"],
        ["v_y2 error -", "v_y2 error +"],
        ["v_y2_err_minus", "v_y2_err_plus"],
        ["+ error v_y2", "- error v_y2"],
        ["v_y2_errup", "v_y2_errdown"],
        ["v_y2_lower", "v_y2_upper"],
        ["v_y2 lo", "v_y2 hi"],
        ["v_y2_q025", "v_y2_q975"],
        ["v_y2_ci_low", "v_y2_ci_high"],
        ["v_y2_var"],
        ["variance of v_y2"],
        ["U(v_y2)"],
        ["v_y2 95% CI"],
        ["v_y2_U95"],
        [f"v_y2 ± 2{SIGMA}"],
        ["accuracy of v_y2"],
    ],
)
def test_errors_that_are_no_standard_deviation_are_refused(names):
    rows = {"v_y1": ROWS[:, 0], "v_y2": ROWS[:, 1]}
    rows |= {name: (k + 1.0) * ROWS[:, 2] for k, name in enumerate(names)}
    assert faults_of(rows) == [("not-one-sd", "v_y2_sd")]
    # The remedies: they are left out, or a standard deviation is there.
    assert fitball.load_table(rows, ignore="v_y2_sd").sd == {}
    assert_allclose(fitball.load_table(rows | {"v_y2_sd": ROWS[:, 2]}).sd["v_y2"], ROWS[:, 2])


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        # Differences, flags, and columns of another quantity.
        ("v_y2 error", [0.1, -0.2, 0.1, 0.3]),
        ("error", [0, 0, 1, 0]),
        ("error [deg]", [1, 2, 1, 2]),
        ("delta_v_y2", [12.0, 18.0, 16.0, 12.0]),
        ("error", [7.0, 8.0, 7.5, 9.0]),
        ("temperature_err", [0.1, 0.1, 0.1, 0.2]),
        ("v_y2_high", [1, 0, 1, 0]),
        ("sd card", [1, 1, 2, 2]),
        ("std", ["a", "b", "a", "b"]),
        ("v_x2_err", [0.1, 0.1, 0.2, 0.1]),
    ],
)
def test_what_has_a_name_of_errors_and_no_such_numbers_is_none(name, numbers):
    table = fitball.load_table({"v_y1": ROWS[:, 0], "v_y2": ROWS[:, 1], name: numbers})
    assert table.sd == {}
    assert "errors-read" not in codes_of(table)


@pytest.mark.parametrize(
    "names", [["err_1", "err_2"], ["v_x2_err"], ["error 2"], ["v_y2 err", "v_y2 error"]]
)
def test_errors_of_no_column_that_is_there_are_named(names):
    table = {"v_y1": ROWS[:, 0], "v_y2": ROWS[:, 1]}
    table |= {name: [0.1, 0.2, 0.1, 0.2] for name in names}
    (note,) = [note for note in fitball.load_table(table).notices if note.code == "not-used"]
    assert f"'{names[-1]}'" in note.text


def test_columns_of_one_name_are_errors_of_those_before_them(tmp_path):
    path = written(tmp_path, "v_y1,±,v_y2,±\n5,0.1,4,0.2\n6,0.2,5,0.3\n")
    for source in (path, pandas.read_csv(path)):
        table = fitball.load_table(source)
        assert_allclose(table.sd["v_y1"], [0.1, 0.2])
        assert_allclose(table.sd["v_y2"], [0.2, 0.3])


def test_errors_of_a_column_by_the_name_of_the_user():
    rows = {"Vin": ROWS[:, 0], "Vout": ROWS[:, 1], "Vout error": ROWS[:, 2]}
    table = fitball.load_table(rows, columns={"v_y1": "Vin", "v_y2": "Vout"})
    assert_allclose(table.sd["v_y2"], ROWS[:, 2])
    rows["my errors"] = rows.pop("Vout error")
    columns = {"v_y1": "Vin", "v_y2": "Vout", "v_y2_sd": "my errors [%]"}
    table = fitball.load_table(rows, columns=columns)
    assert_allclose(table.sd["v_y2"], 0.01 * ROWS[:, 1] * ROWS[:, 2])


@pytest.mark.parametrize("named", ["v_in", "v_in (m/s)", "v_in [m/s]"])
@pytest.mark.parametrize("error", ["u(v_in) (m/s)", "v_in error (m/s)", "v_in_sd", "sd v_in [m/s]"])
def test_errors_of_a_column_that_the_user_names_with_its_unit(named, error):
    rows = {"v_in (m/s)": [5.0, 10.0], error: [0.05, 0.1], "v_y2": [3.9, 7.3]}
    columns = {"v_y1": named}
    assert_allclose(fitball.load_table(rows, columns=columns).sd["v_y1"], [0.05, 0.1])


def test_errors_of_columns_that_are_not_known_are_proposed_with_them():
    rows = {"V1": ROWS[:, 0], "theta_1": [90.0] * 4, "v out": ROWS[:, 1], "v out err": ROWS[:, 2]}
    with pytest.raises(InputError) as caught:
        fitball.load_table(rows)
    assert "v_2=v out,v_2_sd=v out err" in str(caught.value)


def test_of_two_columns_of_errors_the_one_of_our_name_counts():
    rows = {"v_y1": ROWS[:, 0], "v_y2": ROWS[:, 1], "v_y2_err": 2.0 * ROWS[:, 2]}
    table = fitball.load_table(rows | {"v_y2_sd": ROWS[:, 2]})
    assert_allclose(table.sd["v_y2"], ROWS[:, 2])


def test_twelve_normal_impacts_weighed_by_their_errors():
    """Restitution 0.75 with errors of 0.03 and 0.5 m/s: the weighted mean of the ratios."""
    speed = np.linspace(7.0, 12.0, 12)
    error = np.where(np.arange(12) % 3, 0.03, 0.5)
    rebound = 0.75 * speed + error * np.random.default_rng(3).standard_normal(12)
    named = fitball.load_table({"v_y1": speed, "v_y2": rebound, "v_y2_err": error})
    ours = fitball.load_table({"v_y1": speed, "v_y2": rebound, "v_y2_sd": error})
    assert_allclose(named.sd["v_y2"], ours.sd["v_y2"])
    assert_allclose(named.values["v_y2"], ours.values["v_y2"])
