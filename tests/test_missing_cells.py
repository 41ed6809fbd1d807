"""Tables with cells that were not measured, through likelihood, fits, checks, predictions and files."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from samples import GRIP_SLIP, coordinates_of, drop_table, problem_of, same_values, synthetic
from scipy import stats
from validation.ranks import Bounces

import fitball
from fitball.data.balances import scene_balances
from fitball.data.read import load_table
from fitball.data.scene import Scene, load_scene
from fitball.data.table import Measurement
from fitball.errors import FitError
from fitball.inference.adequacy.describe import largest_misfits
from fitball.inference.adequacy.looks import Tables, distributions, links
from fitball.inference.adequacy.refit import refit
from fitball.inference.comparison.results import criteria
from fitball.inference.identifiability.examine import active_impacts
from fitball.inference.identifiability.information import fisher_information
from fitball.inference.identifiability.profile import coverage
from fitball.inference.likelihood.posterior import log_likelihood, log_posterior, measured_terms, pointwise
from fitball.inference.likelihood.residuals import Weighting, default_noise, residual_slopes, residuals
from fitball.inference.point.least_squares import least_squares
from fitball.inference.point.point_fit import maximum_posterior
from fitball.inference.prediction.drop_test import drop_test
from fitball.inference.prediction.new_impacts import observed_observables
from fitball.inference.prediction.posterior_predictive import replicated
from fitball.inference.problem.subsample import part_of, thinned_rows, withheld
from fitball.report.saved.fit_file import fit_text, read_fit
from fitball.report.saved.netcdf_files import read_data

WANG = load_table("wang_all.csv")
SDS = {"v_x2": 0.25, "v_y2": 0.25, "omega_2": 10.0}
TRUTH = {**GRIP_SLIP, "degrees_of_freedom": 5.0, "velocity_sd": 0.3, "v_x_sd": 0.3, "v_y_sd": 0.2, "spin_sd": 8.0}


def with_gaps(table, seed=1, share=0.3, columns=None):
    """The table with some cells of its columns taken away, never all of a row."""
    rng = np.random.default_rng(seed)
    gone = rng.random((len(table.measurements), len(table))) < share
    gone[:, gone.all(axis=0)] = False
    measurements = []
    for item, mine in zip(table.measurements, gone, strict=True):
        gap = mine if columns is None or item.name in columns else np.zeros_like(mine)
        sd = None if item.sd is None else np.where(gap, np.nan, item.sd)
        measurements.append(replace(item, values=np.where(gap, np.nan, item.values), sd=sd))
    return replace(table, measurements=tuple(measurements), redundant=())


GAPPY = with_gaps(WANG)


def stating(table):
    """The table with an sd in every cell, each its own."""
    count = len(table)
    return replace(
        table,
        measurements=tuple(
            replace(item, sd=SDS[item.name] * np.linspace(0.5, 2.0, count)) for item in table.measurements
        ),
    )


def polar(table):
    """The table told in speeds and angles."""
    along, up, spin = table.measurements
    speed, angle = np.hypot(along.values, up.values), np.arctan2(up.values, along.values)
    return replace(
        table,
        measurements=(replace(along, name="v_2", values=speed), replace(up, name="theta_2", values=angle), spin),
        redundant=(),
    )


def values_of(problem):
    missing = {name: item.prior.quantile(np.array([0.6]))[0] for name, item in
               ((item.name, item) for item in problem.free)}  # fmt: skip
    return np.array([[{**missing, **TRUTH}[name] for name in problem.free_names]])


def cell_by_cell(problem, values):
    """Log likelihood (impacts,) by scipy's densities, one measured cell after the other."""
    made, columns = problem.rebound(values), {name: item[0] for name, item in problem.all_values(values).items()}
    predicted = {
        "v_x2": made.v_x2[0], "v_y2": made.v_y2[0], "omega_2": made.omega_2[0],
        "v_2": np.hypot(made.v_x2[0], made.v_y2[0]), "theta_2": np.arctan2(made.v_y2[0], made.v_x2[0]),
    }  # fmt: skip
    noise = {"v_x2": "v_x_sd", "v_y2": "v_y_sd", "omega_2": "spin_sd", "v_2": "speed_sd", "theta_2": "angle_sd"}
    density = np.zeros(len(problem.table))
    for item in problem.table.measurements:
        for k, value in enumerate(item.values):
            if np.isnan(value):
                continue
            size = columns.get(noise[item.name], columns.get("velocity_sd"))
            if item.name == "theta_2" and noise[item.name] not in columns:
                size = columns["velocity_sd"] / predicted["v_2"][k]
            if item.sd is not None:
                size = np.hypot(size, item.sd[k])
            centre = predicted[item.name][k]
            if problem.group_bias is not None:
                centre = centre + columns[f"{item.name}_offset[{problem.table.labels['group'][k]}]"]
            law = stats.norm if "degrees_of_freedom" not in columns else stats.t(columns["degrees_of_freedom"])
            density[k] += law.logpdf((value - centre) / size) - np.log(size)
    return density


KINDS = ({}, {"noise": "student-t"}, {"offsets": "group"}, {"pool": {"mu": "group"}})
TABLES = {"fitted": GAPPY, "stated": stating(WANG), "polar": polar(WANG)}


@pytest.mark.parametrize(("name", "asked"), [
    *product(TABLES, KINDS),
    *((name, {"velocity_noise": "tied"}) for name in TABLES),
])  # fmt: skip
def test_the_likelihood_is_that_of_the_cells_that_are_there(name, asked):
    table = TABLES[name]
    table = table if table is GAPPY else with_gaps(table, 2)
    problem = problem_of(table, "grip-slip", **asked)
    assert [item.observed.size for item in problem.observables] == [
        int(np.isfinite(item.values).sum()) for item in table.measurements
    ]
    values = values_of(problem)
    exact = cell_by_cell(problem, values)
    whole, _scored = pointwise(problem, values, ("omega_2",))
    np.testing.assert_allclose(whole[0], exact, rtol=1e-10, atol=1e-10)
    assert log_likelihood(problem, values, problem.rebound(values))[0] == pytest.approx(exact.sum(), rel=1e-11)


@pytest.mark.parametrize("noise", ["normal", "student-t"])
def test_uncertain_incidence_leaves_the_marginal_of_the_cells_that_are_there(noise):
    """The joint normal of an impact, with a Jacobian by differences, over the cells that were measured."""
    rng = np.random.default_rng(3)
    factor = rng.standard_normal((len(WANG), 3, 3)) * np.array([0.02, 0.02, 1.0])[:, None]
    covariance = factor @ factor.transpose(0, 2, 1)
    table = replace(GAPPY, incident_covariance=covariance, incident_sd={"v_x1": np.sqrt(covariance[:, 0, 0])})
    problem = problem_of(table, "grip-slip", noise=noise)
    values = values_of(problem)
    columns = {name: item[0] for name, item in problem.all_values(values).items()}
    given, names = problem.impacts, ("v_x2", "v_y2", "omega_2")

    def rebounds(move):
        there = fitball.impacts(given.v_x1 + move[0], given.v_y1 + move[1], given.omega_1 + move[2])
        made = problem.rebound(values, there)
        return np.stack([getattr(made, name)[0] for name in names], axis=1), made.regime[0]

    centre, regime = rebounds(np.zeros(3))
    jacobian = np.stack([(rebounds(1e-5 * e)[0] - rebounds(-1e-5 * e)[0]) / 2e-5 for e in np.eye(3)], axis=2)
    observed = np.stack([item.values for item in table.measurements], axis=1)
    sds = np.array([columns["v_x_sd"], columns["v_y_sd"], columns["spin_sd"]])
    whole, _scored = pointwise(problem, values, names)
    compared = 0
    reach = [3.5 * np.sqrt(np.diagonal(covariance, axis1=1, axis2=2)).max(axis=0) * sign for sign in (-1, 1)]
    steady = np.all([rebounds(move * axis)[1] == regime for move in reach for axis in np.eye(3)], axis=0)
    for k in np.flatnonzero(steady):
        there = np.isfinite(observed[k])
        joint = np.diag(sds**2) + jacobian[k] @ covariance[k] @ jacobian[k].T
        if noise == "normal":
            mean, part = centre[k][there], joint[np.ix_(there, there)]
            exact = stats.multivariate_normal(mean, part).logpdf(observed[k][there])
            assert whole[0, k] == pytest.approx(exact, rel=1e-6)
        else:
            # Heavy tails are taken column by column in Cholesky's order: whitened by that of the part.
            root = np.linalg.cholesky(joint[np.ix_(there, there)])
            z = np.linalg.solve(root, observed[k][there] - centre[k][there])
            law = stats.t(columns["degrees_of_freedom"])
            assert whole[0, k] == pytest.approx(np.sum(law.logpdf(z) - np.log(np.diag(root))), rel=1e-6)
        compared += not there.all()
    assert compared >= 5
    weighting = Weighting(default_noise(problem), penalised=False)
    count = int(np.isfinite(observed).sum())
    assert residuals(problem, values, weighting).shape[1] == count


def test_what_was_nowhere_measured_is_as_if_not_there(tmp_path):
    lines = ["v_x1,v_y1,omega_1,v_x2,v_y2,omega_2"]
    made = [item.values for item in WANG.measurements]
    given = WANG.impacts
    rows = [[given.v_x1[k], given.v_y1[k], given.omega_1[k], *(column[k] for column in made)] for k in range(21)]
    full = [",".join(f"{value:.2f}" for value in row) for row in rows]
    spinless = [row.rsplit(",", 1)[0] + "," for row in full]
    place, other = tmp_path / "t.csv", tmp_path / "other" / "t.csv"
    other.parent.mkdir()
    place.write_text("\n".join(lines + spinless))
    other.write_text("\n".join([lines[0].rsplit(",", 1)[0], *(row[:-1] for row in spinless)]))
    one, two = problem_of(place, "grip-slip"), problem_of(other, "grip-slip")
    assert one.free_names == two.free_names and [item.name for item in one.observables] == ["v_x2", "v_y2"]
    same_values(one.observables, two.observables)
    assert one.notes == two.notes
    # Rows without any measurement change nothing.
    nothing = ["15,6,100,,,", "14,7,-20,nan,-,NA"]
    place.write_text("\n".join([lines[0], nothing[0], *full, nothing[1]]))
    other.write_text("\n".join(lines + full))
    one, two = problem_of(place, "grip-slip"), problem_of(other, "grip-slip")
    same_values(one.observables, two.observables)
    coordinates = one.to_coordinates(values_of(one))
    np.testing.assert_array_equal(log_posterior(one, coordinates), log_posterior(two, coordinates))


def test_derivatives_and_counts_are_of_the_cells_that_are_there():
    problem = problem_of(GAPPY, "grip-slip")
    values, count = values_of(problem), sum(int(item.measured.sum()) for item in GAPPY.measurements)
    weighting = Weighting({name: TRUTH[name] for name in ("v_x_sd", "v_y_sd", "spin_sd")}, penalised=False)
    at = problem.to_coordinates(values)
    exact = residual_slopes(problem, at, weighting)[0]
    for k in range(problem.dimension):
        step = 1e-6 * np.eye(problem.dimension)[k]
        there, back = (residuals(problem, problem.to_values(at + sign * step), weighting)[0] for sign in (1, -1))
        np.testing.assert_allclose(exact[:, k], (there - back) / 2e-6, rtol=1e-4, atol=1e-4)
    assert exact.shape[0] == count < 63
    squares = least_squares(problem, values)
    assert squares.degrees_of_freedom == count - len(squares.stderr.keys() - {"v_x_sd", "v_y_sd", "spin_sd"})
    assert criteria(problem, [dict(zip(problem.free_names, values[0], strict=True))]).measurements == count
    full = problem_of(WANG, "grip-slip")
    assert coverage(problem) < coverage(full)
    shown = [k for k, item in enumerate(problem.free) if not item.name.endswith("_sd")]
    slopes = (exact * problem.prior.width)[:, shown]
    at_noise = dict(zip(problem.free_names, values[0], strict=True)).items() & weighting.noise.items()
    assert len(at_noise) == 3
    np.testing.assert_allclose(
        fisher_information(problem, at[0], scene=False)[np.ix_(shown, shown)], slopes.T @ slopes, rtol=1e-9
    )
    # Each cell tells something of its own noise: twice the squared slope of its logarithm.
    information = fisher_information(problem, at[0], scene=False)
    k = problem.free_names.index("spin_sd")
    width = problem.prior.width[k]
    assert information[k, k] == pytest.approx(2.0 * GAPPY.measurements[2].measured.sum() * width**2)
    # Where only the speed away from the court is known, a restitution acts in the impacts that have it.
    alone = problem_of(replace(GAPPY, measurements=(GAPPY.measurements[1],)), "grip-slip")
    acting = active_impacts(alone, alone.to_coordinates(values_of(alone)), ())["cor_10"]
    known = [name for name, there in zip(WANG.ids, GAPPY.measurements[1].measured, strict=True) if there]
    assert acting.acting == len(known) < 21 and set(acting.impacts) <= set(known)


def test_residuals_of_gaps_are_looked_at_where_they_are():
    problem = problem_of(GAPPY, "grip-slip")
    point = maximum_posterior(problem, values_of(problem))
    fit = refit(problem, point)
    masks = [item.measured for item in GAPPY.measurements]
    assert [places.tolist() for places in fit.places] == [np.flatnonzero(mask).tolist() for mask in masks]
    assert fit.measured.size == sum(mask.sum() for mask in masks)
    for column, item in enumerate(problem.observables):
        gap = item.observed - item.predict(point.rebound)[0]
        np.testing.assert_allclose(fit.measured[fit.rows(column)], gap / point.values[item.noise])
    assert fit.freedom.sum() == pytest.approx(fit.measured.size - fit.leverage.sum())
    few = replace(GAPPY.measurements[0], values=np.where(np.arange(21) < 8, GAPPY.measurements[0].values, np.nan))
    rare = problem_of(
        replace(GAPPY, measurements=(few, *GAPPY.measurements[1:])), "grip-slip", velocity_noise="separate"
    )
    other = refit(rare, maximum_posterior(rare, values_of(rare)))
    assert [other.noises[other.noise_of(k)] for k in range(3)] == ["v_x_sd", "v_y_sd", "spin_sd"]
    for misfit in largest_misfits(problem, point, Tables(fit, fit.measured[None])):
        row, name = WANG.ids.index(misfit.id), misfit.column
        assert misfit.measured == WANG.measurement(name).values[row]
        assert not np.isnan(GAPPY.measurement(name).values[row])
    made = np.random.default_rng(1).standard_normal((50, fit.measured.size))
    tables = Tables(fit, np.concatenate([fit.measured[None], made]))
    both = masks[0] & masks[1]
    a, b = (np.full(21, np.nan) for _ in range(2))
    a[masks[0]], b[masks[1]] = fit.measured[fit.rows(0)], fit.measured[fit.rows(1)]
    linked = {(look.column, look.over): float(look.seen[0]) for look in links(tables)}
    expected = np.sum(a[both] * b[both]) / np.sqrt(np.sum(a[both] ** 2) * np.sum(b[both] ** 2))
    assert linked[0, "v_y2"] == pytest.approx(expected)
    # Of left-out probabilities the missing ones take no part: uniform ones pass, whatever stands in the gaps.
    uniform = np.full((3, 21), np.nan)
    for k, mask in enumerate(masks):
        uniform[k, mask] = (np.arange(mask.sum()) + 0.5) / mask.sum()
    assert all(look.seen[0] < 0.06 for look in distributions(tables, uniform))


def test_leaving_out_and_parts_keep_gaps():
    problem = problem_of(GAPPY, "grip-slip")
    values = values_of(problem)
    whole, _ = pointwise(problem, values, ("v_x2",))
    for rows in ([3], [0, 4, 5, 20]):
        left = withheld(problem, np.array(rows))
        rest = log_likelihood(left, values, left.rebound(values))[0]
        assert rest == pytest.approx(whole[0].sum() - whole[0, rows].sum())
        part = part_of(problem, np.array(rows))
        assert log_likelihood(part, values, part.rebound(values))[0] == pytest.approx(whole[0, rows].sum())
    # A spin that one impact alone has: without that impact there is none, and the rest is still there.
    spin = np.full(21, np.nan)
    spin[7] = 350.0
    lonely = replace(WANG, measurements=(*WANG.measurements[:2], replace(WANG.measurements[2], values=spin)))
    problem = problem_of(lonely, "grip-slip")
    left = withheld(problem, np.array([7]))
    assert [item.name for item in left.observables] == ["v_x2", "v_y2"]
    assert np.isfinite(maximum_posterior(left, values_of(left)).log_posterior)
    with pytest.raises(FitError, match="no measurement is left"):
        withheld(problem, np.arange(21))


def test_a_part_of_a_large_table_has_some_of_what_is_rare():
    count = 900
    rng = np.random.default_rng(8)
    take = rng.integers(0, 21, count)
    table = replace(
        WANG,
        impacts=WANG.impacts.take(take),
        measurements=tuple(replace(item, values=item.values[take]) for item in WANG.measurements),
        redundant=(), ids=tuple(map(str, range(count))), labels={},
    )  # fmt: skip
    spin = np.full(count, np.nan)
    spin[::150] = table.measurements[2].values[::150]
    problem = problem_of(
        replace(table, measurements=(*table.measurements[:2], replace(table.measurements[2], values=spin))),
        "grip-slip",
    )
    rows = thinned_rows(problem, 100)
    assert np.isin(np.arange(0, count, 150), rows).all() and rows.size <= 106


@pytest.mark.parametrize("missing", [np.nan, 0.0])
def test_intervals_hold_the_truth_as_often_as_they_say(missing):
    """Of simulated tables that lack 30 % of the spins; a missing spin that is read as zero is seen at once."""
    template = problem_of(WANG, "grip-slip", velocity_noise="separate")
    names = ("mu", "e_x", "offset", "cor_10", "cor_slope", "spin_sd")
    inside, far = 0, 0.0
    replicates = 40 if np.isnan(missing) else 3
    for seed in range(replicates):
        made = synthetic(template, TRUTH, seed).table
        spin = made.measurements[2].values.copy()
        spin[np.random.default_rng(100 + seed).choice(21, 6, replace=False)] = missing
        read = replace(made.measurements[2], values=spin)
        problem = problem_of(
            replace(made, measurements=(*made.measurements[:2], read)), "grip-slip", velocity_noise="separate"
        )
        at = coordinates_of(problem, maximum_posterior(problem, values_of(problem)).values)
        information = fisher_information(problem, at, scene=False) + np.eye(problem.dimension)
        sds = np.sqrt(np.diag(np.linalg.inv(information))) * problem.prior.width
        off = np.abs(at - coordinates_of(problem, TRUTH)) / sds
        mine = [problem.free_names.index(name) for name in names]
        inside += int(np.sum(off[mine] < 1.0))
        far = max(far, float(off[mine].max()))
    share = inside / (replicates * len(names))
    if np.isnan(missing):
        # 240 intervals of 68 %: three sds of their share are 0.09.
        assert 0.57 < share < 0.79 and far < 4.5
    else:
        assert far > 10.0


def test_a_simulated_table_has_the_same_gaps(tmp_path):
    place = tmp_path / "t.csv"
    place.write_text(
        "v_x1,v_y1,omega_1,v_x2,v_y2,v_y2_sd,omega_2\n15,5,0,11,4,0.1,\n14,7,0,9,,,290\n13,9,0,8,7,0.2,260\n"
    )
    table = load_table(place)
    made = Bounces(str(place), "grip-slip").simulated(
        values_of(problem_of(table, "grip-slip"))[0], np.random.default_rng(2)
    )
    for one, other in zip(table.measurements, made.table.measurements, strict=True):
        assert one.measured.tolist() == other.measured.tolist()
    assert np.isnan(made.table.measurements[1].sd).tolist() == [False, True, False]


def test_restitution_as_measured_needs_every_speed():
    with pytest.raises(FitError, match=r"needs v_y2 of every impact, and .* have none"):
        problem_of(GAPPY, "two-mass", closures={"cor": "measured"})


def test_a_gappy_table_goes_to_a_folder_and_back(tmp_path, brief):
    fit = fitball.calibrate(with_gaps(stating(WANG), 4), scene=Scene(), model="grip-slip", point_only=True, cores=1)
    folder = fit.save(tmp_path / "fit")
    table, _force = read_data(read_fit(folder).source, folder / "data.nc")
    same_values(table.measurements, fit.problem.table.measurements)
    predictions = (folder / "predictions.csv").read_text()
    assert "nan" not in predictions
    first = next(row for row in predictions.splitlines()[1:] if row.split(",")[2] == "")
    impact, output = first.split(",")[:2]
    assert np.isnan(fit.problem.table.measurement(output).values[WANG.ids.index(impact)])
    assert "NaN" not in fit_text(fit)
    content = json.loads((folder / "fit.json").read_text())
    assert content["least_squares"]["degrees_of_freedom"] == sum(
        int(item.measured.sum()) for item in table.measurements
    ) - 5  # fmt: skip
    page = (folder / "report.html").read_text()
    assert ">nan" not in page and "nan |" not in page
    observables, _notes = observed_observables(read_fit(folder).fitted, table)
    assert all(item.observed.size == 21 and item.rows is None for item in observables)


def test_balances_say_what_an_impact_lacks():
    balances = scene_balances(GAPPY, load_scene("wang_all.csv"))
    for k, (along, up, spin) in enumerate(zip(*(item.measured for item in GAPPY.measurements), strict=True)):
        assert (balances.cor.reasons[k] == "") == up
        assert (balances.e_x.reasons[k] == "") == (along and spin)
        if along and up and not spin:
            assert balances.offset.reasons[k] == "omega_2 not measured" and balances.mu_bar.reasons[k] == ""


def test_a_drop_test_with_gaps_is_one_of_the_drops_that_were_measured():
    whole = drop_table(np.random.default_rng(1), 5)
    values = whole.measurements[0].values.copy()
    values[[1, 3]] = np.nan
    time = np.full(5, np.nan)
    time[[1, 3]] = 5e-3
    gappy = replace(
        whole, measurements=(replace(whole.measurements[0], values=values), Measurement("contact_time", time))
    )
    problem = problem_of(gappy, "brody")
    point = maximum_posterior(problem, values_of(problem))
    told = drop_test(problem, point, None, np.random.default_rng(1))
    assert told is not None
    # Five speeds were dropped from, at three of them the rebound was measured.
    assert [row.speed for row in told.speeds] == pytest.approx(whole.impacts.v_y1[[0, 2, 4]])
    assert [row.measured for row in told.speeds] == pytest.approx((values / whole.impacts.v_y1)[[0, 2, 4]])


@pytest.mark.parametrize("table", [GAPPY, stating(GAPPY)], ids=["fitted noise", "stated sds"])
def test_draws_tell_of_each_impact_what_was_measured_there(table):
    """One log likelihood an impact, of the cells that it has; new measurements in the shape of the table."""
    problem = problem_of(table, "grip-slip")
    values = problem.prior.draw(np.random.default_rng(2), 400)
    values = values[np.isfinite(log_posterior(problem, problem.to_coordinates(values)))][:20]
    made = replicated(problem, values, np.random.default_rng(3))
    names, terms = [item.name for item in problem.observables], measured_terms(problem, values)
    whole = np.sum([terms[name] for name in names], axis=0)
    assert np.allclose(whole, pointwise(problem, values, names)[0], rtol=1e-12)
    assert np.allclose(whole.sum(axis=1), log_likelihood(problem, values, problem.rebound(values)), rtol=1e-12)
    for item in table.measurements:
        known = np.ones(len(table), dtype=bool) if item.sd is None else item.measured
        assert np.array_equal(np.isfinite(made[item.name]).all(axis=0), known)
