"""Tables of many rows: shared among threads, and fitted by way of samples of them."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from samples import problem_of

import fitball
from fitball.bench.problems import enlarged, spread_draws
from fitball.cli.main import main
from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.inference.calibrate import run as calibrate_problem
from fitball.inference.effort import Effort
from fitball.inference.identifiability import information
from fitball.inference.identifiability.examine import active_impacts
from fitball.inference.identifiability.information import prior_draws
from fitball.inference.likelihood.posterior import densities, log_posterior
from fitball.inference.likelihood.residuals import IMPOSSIBLE
from fitball.inference.point import least_squares as least_squares_room
from fitball.inference.point import point_fit as point
from fitball.inference.point.least_squares import least_squares
from fitball.inference.point.point_fit import STARTS, maximum_posterior, point_fit, starting_points
from fitball.inference.prediction.posterior_predictive import predictive
from fitball.inference.prediction.reach import SPANNING, calibrated_range, spanning_impacts
from fitball.inference.problem import problem as asked
from fitball.inference.problem import subsample
from fitball.inference.problem.problem import Problem
from fitball.inference.problem.subsample import thinned_problem
from fitball.inference.results.results import Posterior
from fitball.inference.results.source import source_of
from fitball.report.figures import canvas
from fitball.report.figures.registry import draw
from fitball.report.fit.document import fit_document, page, render
from fitball.report.fit.folder import prediction_rows
from fitball.report.form import numbers
from fitball.report.form.document import on_terminal
from fitball.report.saved.fit_file import fit_text
from fitball.report.saved.netcdf_files import read_data, write_data
from fitball.values import same
from fitball.wording import Screen


def long_problem(rows, **choices):
    return problem_of(enlarged(load_table("wang_all.csv"), rows), scene=load_scene("wang_all.csv"), **choices)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_threads_change_no_digit(threads, wang_impacts):
    draws = spread_draws(50)
    problem = long_problem(21)
    names = problem.model.parameter_names
    whole = problem.model.evaluate(names, draws, wang_impacts)
    parts = asked.evaluate_in_parts(problem.model, names, draws, wang_impacts, threads)
    for name in ("v_x2", "v_y2", "omega_2", "contact_time", "regime", "status"):
        np.testing.assert_array_equal(getattr(parts, name), getattr(whole, name))


def test_a_thinned_problem_is_the_same_problem_on_fewer_rows():
    problem = long_problem(500)
    small = thinned_problem(problem, 60)
    assert len(small.impacts) == 60
    rows = [int(name) - 1 for name in small.table.ids]
    np.testing.assert_array_equal(small.impacts.v_y1, problem.impacts.v_y1[rows])
    for thin, full in zip(small.observables, problem.observables, strict=True):
        np.testing.assert_array_equal(thin.observed, full.observed[rows])
    angles = np.arctan2(problem.impacts.v_y1, problem.impacts.v_x1)
    kept = angles[rows]
    assert kept.min() == angles.min()
    assert kept.max() == angles.max()
    assert np.max(np.diff(np.sort(kept))) < 0.2
    assert thinned_problem(small, 60) is small


@pytest.mark.parametrize(("model", "part"), [("two-mass", 10**6), ("grip-slip", 10**6), ("grip-slip", 50)])
def test_the_road_by_way_of_samples_ends_where_the_direct_one_does(model, part, monkeypatch):
    """Also where the last steps are taken by the triangle of the derivatives of `part` rows at a time."""
    problem = long_problem(120, model=model)
    starts = starting_points(problem, np.random.default_rng(3), 6)
    direct, peak = least_squares(problem, starts), maximum_posterior(problem, starts)
    monkeypatch.setattr(point, "STARTS", 6)
    monkeypatch.setattr(point, "SEARCHED", 24)
    monkeypatch.setattr(point, "GROWTH", 3)
    for place in (least_squares_room, subsample):
        monkeypatch.setattr(place, "PART", part)
    squares, found = point_fit(problem, np.random.default_rng(3))
    assert squares.chi_square == pytest.approx(direct.chi_square, rel=1e-6)
    assert squares.starts >= 6
    for name, error in direct.stderr.items():
        assert (squares.stderr[name] is None) == (error is None)
        assert error is None or squares.stderr[name] == pytest.approx(error, rel=1e-3)
    assert found.log_posterior == pytest.approx(peak.log_posterior, abs=0.01)
    # The problem that is fitted last is the whole one.
    assert found.rebound.v_x2.shape[-1] == 120


def test_a_sample_that_misleads_is_outvoted_by_the_table(monkeypatch):
    """Rows that the first search does not see still decide where the fit ends."""
    problem = long_problem(240, model="grip-slip")
    shift = np.where(np.arange(240) % 2 == 0, 0.4, -0.4)
    observables = tuple(
        replace(item, observed=item.observed + shift) if item.name == "v_x2" else item for item in problem.observables
    )
    shifted = replace(problem, observables=observables)
    monkeypatch.setattr(point, "SEARCHED", 20)
    squares, _ = point_fit(shifted, np.random.default_rng(1))
    starts = starting_points(shifted, np.random.default_rng(1), STARTS)
    assert squares.chi_square == pytest.approx(least_squares(shifted, starts).chi_square, rel=1e-6)


def test_a_part_of_a_large_table_counts_for_the_whole(monkeypatch):
    problem = long_problem(600, model="grip-slip")
    at = problem.to_coordinates(starting_points(problem, np.random.default_rng(2), 1))[0]
    whole = information.fisher_information(problem, at, scene=False)
    monkeypatch.setattr(information, "LOOKED_AT", 150)
    part = information.fisher_information(problem, at, scene=False)
    # A quarter of the rows, laid evenly over incidence, tells a sum over all of them to some percent.
    np.testing.assert_allclose(np.diag(part), np.diag(whole), rtol=0.15)


@pytest.fixture
def evaluated(monkeypatch):
    """Draws times impacts of every evaluation of a model, derivatives counted with it."""
    sizes = []
    original = Problem._evaluate

    def counted(problem, columns, impacts):
        sizes.append(len(next(iter(columns.values()))) * len(impacts))
        return original(problem, columns, impacts)

    whole = Problem.differentiated

    def differentiated(problem, coordinates):
        sizes.append(len(coordinates) * len(problem.impacts) * (1 + problem.dimension))
        return whole(problem, coordinates)

    monkeypatch.setattr(Problem, "_evaluate", counted)
    monkeypatch.setattr(Problem, "differentiated", differentiated)
    return sizes


def test_batches_change_no_number_and_stay_below_the_ceiling(monkeypatch, evaluated):
    problem = long_problem(60, model="grip-slip")
    values = starting_points(problem, np.random.default_rng(2), 16)
    draws = values[np.arange(128) % len(values)] * np.random.default_rng(3).uniform(0.99, 1.01, (128, 1))
    kept = Posterior(problem.free_names, draws.reshape(2, 8, 8, -1), np.zeros((2, 8, 8)), draws)
    at_point = maximum_posterior(problem, values[:1])

    def everything():
        made = predictive(problem, at_point, kept, np.random.default_rng(1))
        names = ("observed", "median", "mean_q16", "sd", "point")
        return (
            log_posterior(problem, problem.to_coordinates(draws)),
            densities(problem, draws, measured=False).scene,
            prior_draws(problem, np.random.default_rng(4), 50, 100),
            np.array([[getattr(item, name) for name in names] for item in made.observables]),
            made.regimes,
            active_impacts(problem, problem.to_coordinates(draws[:20]), made.regimes),
        )

    *whole, regimes, evidence = everything()
    monkeypatch.setattr(subsample, "CELLS", 900)
    # Curves for figures have as many points whatever the table.
    monkeypatch.setattr("fitball.inference.prediction.posterior_predictive.curves", lambda *_: {})
    evaluated.clear()
    *parts, regimes_again, evidence_again = everything()
    assert len(evaluated) > 20 and max(evaluated) <= 900
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one, other)
    assert regimes == regimes_again
    for name, look in evidence.items():
        again = evidence_again[name]
        assert replace(again, share_doubtful=0.0) == replace(look, share_doubtful=0.0)
        assert again.share_doubtful == pytest.approx(look.share_doubtful, abs=1e-12)


def test_memory_does_not_grow_with_draws_times_impacts():
    problem = long_problem(20_000, model="grip-slip")
    at = problem.to_coordinates(starting_points(thinned_problem(problem, 100), np.random.default_rng(2), 1))
    tracemalloc.start()
    try:
        # Eight million cells: at once they take more than a gigabyte.
        density = log_posterior(problem, np.repeat(at, 400, axis=0))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert np.isfinite(density).all()
    assert peak < 400e6


def test_a_long_table_may_have_a_large_chi_square():
    """What the model cannot evaluate is told by the mean square residual, not by the sum."""
    problem = long_problem(60, model="grip-slip", fix={"velocity_sd": 1e-3, "spin_sd": 1e-2})
    found = least_squares(problem, starting_points(problem, np.random.default_rng(3), 4))
    assert found.chi_square > IMPOSSIBLE**2


@pytest.fixture(scope="module")
def long_fits():
    """Point fits of the same kind of table, 310 and 1,240 rows."""
    return [
        calibrate_problem(long_problem(rows, model="grip-slip"), Effort(point_only=True, cores=1))
        for rows in (310, 1240)
    ]


def test_text_and_files_do_not_grow_with_rows(long_fits, tmp_path):
    lines = [render(fit, tmp_path).splitlines() for fit in long_fits]
    assert abs(len(lines[0]) - len(lines[1])) <= 4 and len(lines[1]) < 300
    first = on_terminal(fit_document(long_fits[1], folder=tmp_path), Screen(100, False, False))
    assert first.count("\n") < 60
    assert "... and 1,200 more: predictions.csv" in lines[1] and "... and 1,200 more: balances.csv" in lines[1]
    for text in (fit_text, lambda fit: page(fit, {})):
        short, long = (len(text(fit)) for fit in long_fits)
        assert long < 1.05 * short
    assert all(len(fit.fitted.impacts) <= SPANNING for fit in long_fits)


def test_files_list_some_of_very_many_impacts(long_fits, monkeypatch, tmp_path):
    """Evenly spread, first and last among them; terminal and page say how many of how many."""
    monkeypatch.setattr(numbers, "LISTED", 100)
    fit = long_fits[1]
    rows = list(prediction_rows(fit))
    names = [row["id"] for row in rows[:100]]
    assert len(rows) == 300 and (names[0], names[-1]) == (fit.problem.table.ids[0], fit.problem.table.ids[-1])
    assert np.ptp(np.diff([fit.problem.table.ids.index(name) for name in names])) <= 1
    words = "predictions.csv, which lists 100 of all 1,240, evenly spread"
    assert words in " ".join(render(fit, tmp_path).split())
    assert "<code>predictions.csv</code>, which lists 100 of all 1,240" in page(fit, {})
    assert len(list(fit.balances.rows(numbers.listed_places(1240)))) == 100


def test_figures_draw_some_of_many_impacts(long_fits, monkeypatch):
    monkeypatch.setattr(canvas, "MOST_POINTS", 50)
    for kind in ("residuals", "predictive", "curves"):
        figure = draw(kind, long_fits[1])
        drawn = [line for axis in figure.axes for line in axis.get_lines() if line.get_linestyle() == "None"]
        # Tables repeat 21 impacts; means over bins are fewer than dots.
        assert {len(line.get_xdata()) for line in drawn if len(line.get_xdata()) > 25} == {50}
        assert figure.get_suptitle().startswith("grip-slip on wang_all")
    # All impacts are in the densities of residuals.
    densities = [
        mesh for axis in draw("residuals", long_fits[1]).axes for mesh in axis.collections if mesh.get_rasterized()
    ]
    assert len(densities) == 15
    for mesh in densities:
        assert np.sum(mesh.get_array() ** 2) == pytest.approx(1240)
    assert canvas.shown_rows(np.arange(20)).tolist() == list(range(20))


def test_a_long_fit_is_read_back_whole(long_fits, tmp_path, capsys):
    fit = long_fits[1]
    folder = fitball.Fit.from_results(fit).save(tmp_path / "fit")
    # Every row is in the files that hold rows.
    assert len((folder / "predictions.csv").read_text(encoding="utf-8").splitlines()) == 3 * 1240 + 1
    assert len((folder / "balances.csv").read_text(encoding="utf-8").splitlines()) == 1241
    saved = fitball.load_fit(folder)
    np.testing.assert_array_equal(saved.impacts.v_y1, fit.problem.impacts.v_y1)
    assert len(saved.fitted.impacts) <= SPANNING
    assert main(["plot", str(folder), "residuals", "--out", str(tmp_path), "--quiet"]) == 0
    (folder / "data.nc").unlink()
    # To predict takes no data, and a look at the range what fit.json holds.
    assert main(["predict", str(folder), "--impact", "v=17, theta=30"]) == 0
    assert main(["plot", str(folder), "residuals", "--out", str(tmp_path)]) == 2
    assert "data.nc: no such file" in capsys.readouterr().err


def test_spanning_impacts_have_the_same_range():
    rng = np.random.default_rng(8)
    points = rng.standard_normal((5000, 3)) * (4.0, 2.0, 60.0) + (15.0, 9.0, 50.0)
    given = fitball.impacts(points[:, 0], np.abs(points[:, 1]) + 0.5, points[:, 2])
    few = spanning_impacts(given, 0.033)
    assert len(few) <= SPANNING
    # A place all around lies as far outside the one as outside the other: 2 % of the size of the cloud at most.
    angle = np.linspace(0.0, 2.0 * np.pi, 7)[:-1]
    new = fitball.impacts(
        15.0 + 25.0 * np.cos(angle), 26.0 + 25.0 * np.sin(angle), 50.0 + 900.0 * np.cos(3.0 * angle)
    )
    one, other = (calibrated_range(item, new, 0.033, True, ()) for item in (given, few))
    assert one.limits == other.limits
    np.testing.assert_allclose(other.hull_distance, one.hull_distance, atol=0.5)
    assert np.all(other.hull_distance >= one.hull_distance - 1e-9)
    assert len(spanning_impacts(given.take(np.arange(200)), 0.033)) == 200


def test_data_are_read_back_as_they_were(tmp_path):
    """Labels may be called anything; stated sds and force records are kept."""
    path = tmp_path / "t.csv"
    path.write_text("id,impact,a/b,v_y1,v_y2,v_y2_sd\nx,1,,5,4,0.1\ny,2,über,6,4.7,0.2\n", encoding="utf-8")
    records = tmp_path / "t_force.csv"
    times = np.arange(0.0, 6e-3, 1e-4)
    force = 1000.0 * np.maximum(np.sin(np.pi * (times - 1e-3) / 4e-3), 0.0) * (times < 5e-3)
    rows = [f"y,{1e3 * t:.3f},{f:.3f}" for t, f in zip(times, force, strict=True)]
    records.write_text("\n".join(["id,t [ms],F [N]", *rows]) + "\n", encoding="utf-8")
    problem = problem_of(path)
    write_data(problem, tmp_path / "data.nc")
    found, force = read_data(source_of(problem), tmp_path / "data.nc")
    assert (found.ids, found.labels) == (("x", "y"), {"impact": ("1", "2"), "a/b": ("", "über")})
    (item,) = found.measurements
    np.testing.assert_array_equal(item.sd, [0.1, 0.2])
    assert same(replace(force, source=""), replace(problem.force, source=""))
