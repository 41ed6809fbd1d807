"""Heavy tails, biased groups, parameters that differ between surfaces, and several tables fitted together."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib.resources import files

import jsonschema
import numpy as np
import pytest
from samples import GRIP_SLIP, problem_of, search_briefly
from scipy import stats

import fitball
from fitball.cli.main import main
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.data.table import joined
from fitball.data.tables import load_tables
from fitball.errors import FitError, ParameterError, TableError
from fitball.inference.calibrate import run
from fitball.inference.comparison.left_out import GROUPS, IMPACTS, leave_out, make_folds
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import impact_terms, log_likelihood, log_posterior
from fitball.inference.likelihood.residuals import root_mean_squares
from fitball.inference.point.point_fit import maximum_posterior, point_fit, starting_points
from fitball.models.types import Status
from fitball.report.saved.fit_file import fit_text

RADIUS = fitball.Ball().radius


def table_of(**columns):
    """Wang's 21 impacts with measured columns replaced, and labels."""
    table = load_table("wang_all.csv")
    labels = columns.pop("labels", table.labels)
    return replace(
        table,
        measurements=tuple(replace(item, values=columns.get(item.name, item.values)) for item in table.measurements),
        redundant=(),
        labels=labels,
        notices=(),
    )


TRUE = {"mu": 0.55, "eps_10": 2e-3, "eps_slope": 0.0, "cor_10": 0.77, "cor_slope": -0.015, "e_x": 0.1, "offset": 0.0}
BALL = ("mu", "e_x", "offset", "cor_10", "cor_slope")


def simulated(mu, seed, labels):
    """Rebounds of the grip-slip ball with a friction coefficient an impact, and noise of 0.1 m/s and 4 rad/s."""
    chosen = fitball.model("grip-slip")
    impacts = load_table("wang_all.csv").impacts
    rng = np.random.default_rng(seed)
    rows = np.array([[TRUE[name] for name in chosen.parameter_names]] * 21)
    rows[:, list(chosen.parameter_names).index("mu")] = mu
    made = chosen.evaluate(chosen.parameter_names, rows, impacts)
    at = np.arange(21)
    return table_of(
        v_x2=made.v_x2[at, at] + 0.1 * rng.standard_normal(21),
        v_y2=made.v_y2[at, at] + 0.1 * rng.standard_normal(21),
        omega_2=made.omega_2[at, at] + 4.0 * rng.standard_normal(21),
        labels={"surface": labels},
    )


# Friction alone differs, where restitution would by default too.
ONE = {"mu": "surface", "cor_10": "none"}


def test_the_likelihood_written_out():
    """Student's t about the model of the impact's own surface plus the bias of its group."""
    table = load_table("wang_all.csv")
    labels = tuple("grass" if k % 3 == 0 else "clay" for k in range(21))
    table = replace(table, labels={**table.labels, "surface": labels})
    problem = problem_of(table, "grip-slip", noise="student-t", pool=ONE, offsets="group")
    rng = np.random.default_rng(4)
    values = np.array([[item.prior.quantile(np.array([p]))[0] for item in problem.free]
                       for p in rng.uniform(0.35, 0.65, 3)])  # fmt: skip
    values += 0.02 * np.abs(values) * rng.standard_normal(values.shape)
    columns = problem.all_values(values)
    found = log_likelihood(problem, values, problem.rebound(values))
    chosen = problem.model
    for draw_number in range(3):
        one = {name: column[draw_number] for name, column in columns.items()}
        total = 0.0
        for k in range(21):
            place = one[f"mu_place[{labels[k]}]"] * one["mu_spread"]
            prior = next(item.prior for item in problem.parameters if item.name == "mu")
            own = {**one, "mu": one["mu"] * np.exp(place) if prior.log else one["mu"] + place}
            impact = fitball.impacts(table.impacts.v_x1[k], table.impacts.v_y1[k], table.impacts.omega_1[k])
            made = chosen.rebound({name: own[name] for name in chosen.parameter_names}, impact)
            for name, noise in (("v_x2", "v_x_sd"), ("v_y2", "v_y_sd"), ("omega_2", "spin_sd")):
                centre = getattr(made, name)[0] + one[f"{name}_offset[{table.labels['group'][k]}]"]
                measured = table.measurement(name).values[k]
                total += stats.t(one["degrees_of_freedom"], centre, one[noise]).logpdf(measured)
        assert found[draw_number] == pytest.approx(total, rel=1e-10)


def test_a_level_out_of_bounds_is_impossible_and_not_clamped():
    table = replace(load_table("wang_all.csv"), labels={"surface": ("a",) * 10 + ("b",) * 11})
    problem = problem_of(table, "grip-slip", pool={"mu": "surface"}, priors={"mu": "normal(0.5, 0.1)"})
    values = np.array([[item.prior.quantile(np.array([0.5]))[0] for item in problem.free]])
    names = list(problem.free_names)
    values[0, names.index("mu_spread")] = 0.3
    values[0, names.index("mu_place[b]")] = -4.0
    status = problem.rebound(values).status[0]
    assert (status[:10] == Status.OK).all()
    assert (status[10:] == Status.LEVEL_OUT_OF_BOUNDS).all()
    assert log_posterior(problem, problem.to_coordinates(values))[0] == -np.inf


def best(table, **choices):
    """The maximum of the posterior of grip-slip, where only the table is known."""
    problem = problem_of(table, "grip-slip", **choices)
    return maximum_posterior(problem, starting_points(problem, np.random.default_rng(1), 4)).values


@pytest.fixture(scope="module")
def two_surfaces():
    labels = ("clay",) * 11 + ("grass",) * 10
    mu = np.where(np.array(labels) == "clay", 0.7, 0.4)
    table = simulated(mu, 8, labels)
    with pytest.MonkeyPatch.context() as patch:
        search_briefly(patch)
        return table, run(problem_of(table, "grip-slip", pool=ONE), Effort(seed=2, max_steps=400))


def test_surfaces_are_told_apart(two_surfaces):
    _, fit = two_surfaces
    found = {item.label: item for item in fit.levels}
    assert found["clay"].impacts == 11
    assert found["clay"].q025 < 0.7 < found["clay"].q975
    assert found["grass"].q025 < 0.4 < found["grass"].q975
    assert found["grass"].q975 < found["clay"].q025
    assert max(fit.parameters[name].q975 for name in ("v_x_sd", "v_y_sd")) < 0.25


def test_one_friction_for_both_surfaces_does_not_fit(two_surfaces):
    table, fit = two_surfaces
    assert best(table, pool={"all": "none"})["v_x_sd"] > 2.0 * fit.point.values["v_x_sd"]


def test_levels_are_shown_and_kept(two_surfaces):
    _, fit = two_surfaces
    content = json.loads(fit_text(fit))
    jsonschema.validate(content, json.loads((files("fitball.report") / "fit.schema.json").read_text("utf-8")))
    assert [item["label"] for item in content["levels"]] == ["clay", "grass"]
    assert {curve.label for curve in fit.predictive.curves} == {"clay", "grass"}


def test_an_outlier_moves_a_normal_fit_and_not_a_robust_one():
    labels = ("hard",) * 21
    table = simulated(0.55, 3, labels)
    spoilt = table.measurement("v_y2").values.copy()
    spoilt[4] += 3.0
    broken = table_of(
        v_x2=table.measurement("v_x2").values, v_y2=spoilt, omega_2=table.measurement("omega_2").values,
        labels={"surface": labels},
    )  # fmt: skip

    def line(data, noise):
        values = best(data, noise=noise)
        return values["cor_10"] + values["cor_slope"] * (data.impacts.v_y1 - 10.0), values

    clean, _ = line(table, "normal")
    normal, _ = line(broken, "normal")
    robust, values = line(broken, "student-t")
    assert np.max(np.abs(normal - clean)) > 5.0 * np.max(np.abs(robust - clean))
    assert values["degrees_of_freedom"] < 6.0
    assert values["v_y_sd"] < 0.2


def test_the_bias_of_a_group_is_an_offset_not_noise():
    table = load_table("wang_all.csv")
    groups = table.labels["group"]
    made = simulated(0.55, 6, groups)
    spins = made.measurement("omega_2").values + np.where(np.array(groups) == "backspin", 40.0, 0.0)
    biased = table_of(
        v_x2=made.measurement("v_x2").values, v_y2=made.measurement("v_y2").values, omega_2=spins,
        labels={"group": groups},
    )  # fmt: skip
    values = best(biased, offsets="group")
    gap = values["omega_2_offset[backspin]"] - 0.5 * (
        values["omega_2_offset[zero]"] + values["omega_2_offset[topspin]"]
    )
    assert gap == pytest.approx(40.0, abs=12.0)
    assert values["spin_sd"] < 0.6 * best(biased)["spin_sd"]
    # What is left of a column is told without the bias, as chi-square beside it counts.
    problem = problem_of(biased, "grip-slip", offsets="group")
    left = root_mean_squares(problem, np.array([values[name] for name in problem.free_names]))
    assert left["omega_2"] < 2.0 * values["spin_sd"]
    # The others of its group tell the bias of an impact that is left out; those of other groups do not.
    _residual, point = point_fit(problem, np.random.default_rng(1))
    folds, _notes = make_folds(biased, np.random.default_rng(1))
    chosen = [fold for fold in folds if fold.scheme in (IMPACTS, GROUPS)]
    missed, _notes = leave_out(problem, point, chosen, (), np.random.default_rng(1))
    errors = {one.scheme: one.errors["omega_2"][np.argsort(one.rows)] for one in missed}
    back = np.array(groups) == "backspin"
    assert abs(errors[IMPACTS][back].mean()) < 10.0 and errors[GROUPS][back].mean() == pytest.approx(-40.0, abs=15.0)


def test_joined_tables_are_the_rows_of_both():
    names = ("wang_zero_spin.csv", "wang_topspin.csv", "wang_backspin.csv")
    together, whole = load_tables(names), load_table("wang_all.csv")
    np.testing.assert_array_equal(together.impacts.v_x1, whole.impacts.v_x1)
    for item in whole.measurements:
        np.testing.assert_array_equal(together.measurement(item.name).values, item.values)
    assert together.labels["table"] == ("wang_zero_spin",) * 7 + ("wang_topspin",) * 7 + ("wang_backspin",) * 7
    assert len(together.notices) == sum(len(load_table(name).notices) for name in names)
    assert together.digest != joined([load_table(name) for name in names[::-1]]).digest
    assert load_tables(names[:1]).labels.keys() == load_table(names[0]).labels.keys()


def test_a_column_that_one_table_lacks_is_missing_there(tmp_path):
    """Two sessions, one without a camera for the spin: the likelihood is that of both tables apart."""
    full = load_table("wang_all.csv")
    rows = [",".join(f"{getattr(full.impacts, name)[k]:.2f}" for name in ("v_x1", "v_y1", "omega_1")) + "".join(
        f",{item.values[k]:.2f}" for item in full.measurements) for k in range(21)]  # fmt: skip
    (tmp_path / "a.csv").write_text("\n".join(["v_x1,v_y1,omega_1,v_x2,v_y2,omega_2", *rows[:8]]))
    (tmp_path / "b.csv").write_text(
        "\n".join(["v_x1,v_y1,omega_1,v_x2,v_y2", *(row.rsplit(",", 1)[0] for row in rows[8:])])
    )
    together = load_tables([tmp_path / "a.csv", tmp_path / "b.csv"])
    assert together.measurement("omega_2").measured.tolist() == [True] * 8 + [False] * 13
    assert "omega_2 was not measured in b" in together.remarks[-1]
    problem, alone = problem_of(together, "grip-slip"), problem_of(full, "grip-slip")
    values = np.array([[GRIP_SLIP[name] for name in alone.free_names]])
    whole = impact_terms(alone, values, alone.rebound(values))
    expected = whole["v_x2"].sum() + whole["v_y2"].sum() + whole["omega_2"][:, :8].sum()
    assert log_likelihood(problem, values, problem.rebound(values))[0] == pytest.approx(expected)


def test_tables_that_differ_are_not_joined(tmp_path):
    (tmp_path / "a.csv").write_text("v_x1,v_y1,v_x2,v_y2\n10,5,7,4\n11,6,8,4.5\n", encoding="utf-8")
    (tmp_path / "b.csv").write_text("v_x1,v_y1,v_2,theta_2\n10,5,8,30\n11,6,8.5,31\n", encoding="utf-8")
    (tmp_path / "c.csv").write_text("v_x1,v_y1,v_y2,v_y2_sd\n10,5,4,0.1\n11,6,4.5,0.1\n", encoding="utf-8")
    (tmp_path / "d.csv").write_text("v_x1,v_y1,omega_1,v_y2\n10,5,1,4\n11,6,2,4.5\n", encoding="utf-8")
    a = tmp_path / "a.csv"
    with pytest.raises(TableError, match=r"columns: v_x2, v_y2 in .*a\.csv; v_2, theta_2 in"):
        load_tables([a, tmp_path / "b.csv"])
    with pytest.raises(TableError, match=r"v_y2 has an sd in .*c\.csv and none in .*a\.csv"):
        load_tables([a, tmp_path / "c.csv"])
    with pytest.raises(TableError, match=r"incident columns differ: v_x1, v_y1 in .*a\.csv, v_x1, v_y1, omega_1 in"):
        load_tables([a, tmp_path / "d.csv"])
    with pytest.raises(TableError, match="table a is given twice"):
        load_tables([tmp_path / "a.csv", tmp_path / "a.csv"])


@pytest.mark.parametrize(
    ("choices", "error", "words"),
    [
        ({"noise": "studnt-t"}, ParameterError, "student-t"),
        ({"pool": {"nu": "surface"}}, ParameterError, "unknown parameter"),
        ({"pool": {"ball_mass": "surface"}}, ParameterError, "unknown parameter"),
        ({"pool": {"mu": "court"}}, FitError, "no label column 'court'"),
        ({"pool": {"mu": "surface"}}, FitError, "one label only"),
        ({"offsets": "court"}, FitError, "no label column 'court'"),
        # All of the ball is held; noise alone is no fit of a model.
        ({"fix": {name: TRUE[name] for name in BALL}}, FitError, "every parameter of model grip-slip is fixed"),
    ],
)
def test_impossible_structures_are_named(choices, error, words):
    table = replace(load_table("wang_all.csv"), labels={"surface": ("acrylic",) * 21})
    with pytest.raises(error, match=words):
        problem_of(table, "grip-slip", **choices)


def test_the_command_line_and_the_scene_say_the_same(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    asked = []

    def stop(problem, *_arguments, **_options):
        asked.append(problem)
        raise ParameterError("enough is known")

    monkeypatch.setattr("fitball.api.begin", stop)
    structure = ["--noise", "student-t", "--offsets", "group", "--pool", "mu=group"]
    assert main(["calibrate", "wang_all.csv", "--model", "grip-slip", *structure]) == 2
    (tmp_path / "scene.toml").write_text(
        '[model]\nname = "grip-slip"\n[measurement]\ndistribution = "student-t"\noffsets = "group"\n'
        '[pool]\nmu = "group"\n[surface]\nmu = { value = 0.55, sd = 0.05 }\n', encoding="utf-8",
    )  # fmt: skip
    assert main(["calibrate", "wang_all.csv", "--scene", "scene.toml"]) == 2
    one, other = asked
    assert {"mu_spread", "omega_2_offset[zero]", "degrees_of_freedom"} <= set(one.free_names) == set(other.free_names)
    values = np.array([[item.prior.quantile(np.array([0.4]))[0] for item in one.free]])
    densities = [log_likelihood(problem, values, problem.rebound(values))[0] for problem in asked]
    assert densities[0] == densities[1] > -np.inf
    capsys.readouterr()
    assert main(["calibrate", "wang_all.csv", "--noise", "gaussian"]) == 2
    assert "normal" in capsys.readouterr().err


def test_several_tables_on_the_command_line(tmp_path, monkeypatch, capsys, brief):
    monkeypatch.chdir(tmp_path)
    words = ["wang_zero_spin.csv", "wang_topspin.csv", "--model", "grip-slip", "--pool", "mu=table", "--point-only"]
    assert main(["calibrate", *words, "--full"]) == 0
    out, err = capsys.readouterr()
    assert "mu[wang_zero_spin]" in out
    assert "the scene of wang_zero_spin.csv is used for all tables" in err
    assert load_scene("wang_zero_spin.csv").mu == load_scene("wang_topspin.csv").mu
