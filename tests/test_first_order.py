"""The linearisation against scipy's derivatives, real refits, closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import least_squares
from support.density import REBOUND, TIMED, near, problem_of, scene_of, table_of
from support.fits import NOISE, at, best

from fitball.inference.density import cells
from fitball.inference.judgement import first_order as module
from fitball.inference.judgement.first_order import factor_of_inverse, first_order, proposal
from fitball.inference.search.objective import Objective


def by_scipy(problem, x):
    """Covariance (free, free) in coordinates of a problem with normal or flat priors and known
    noise, by scipy's derivatives of residuals written out.
    """
    rows = problem.rows
    # Of a flat prior the sd.
    width = problem.prior.width
    priors = [parameter.prior for parameter in problem.prior.parameters]
    centre = np.array([prior.location for prior in priors])
    columns = [observable.column.name for observable in problem.observables]
    noises = [NOISE[observable.noise] for observable in problem.observables]

    def residuals(u):
        # scipy's steps are for numbers of order one.
        q = x + width * u
        values = problem.values(q[None])
        rebound = problem.forward.rebound(values, rows.states, rows.index)
        predicted = [rebound.column(name)[0] for name in columns]
        z = (rows.y - np.transpose(predicted)) / noises
        measured = np.isfinite(rows.y)
        pieces = [z[measured], (q - centre) / width]
        if problem.contact_time is not None:
            value, sd = problem.contact_time
            late = rebound.contact_time.mean() - value
            pieces.append([late / sd])
        return np.concatenate(pieces)

    start = np.zeros(x.size)
    jacobian = least_squares(residuals, start, jac="3-point", max_nfev=1).jac
    of_unit_steps = np.linalg.inv(jacobian.T @ jacobian)
    return of_unit_steps * np.outer(width, width)


def sds_of(covariance):
    return np.sqrt(np.diag(covariance))


def covariance_of(first):
    """Covariance (free, free) of a linearisation."""
    root = first.root * first.sds[:, None]
    return root @ root.T


def residuals_at(problem, x):
    """Standardised residuals at coordinates (free,), column after column."""
    (z,) = cells(problem, x[None]).z
    return z.T.ravel()


def grip_slip(table, **choices):
    """A problem of a table under the model of three balances."""
    return problem_of(table, None, "grip-slip", **choices)


@pytest.mark.parametrize("timed", [False, True])
def test_standard_errors_are_scipys(timed):
    problem = problem_of(
        table_of(REBOUND, gaps=True, count=14),
        scene_of(time=timed),
        "two-mass",
        fix=NOISE,
    )
    x = best(problem)
    first = first_order(problem, at(problem, x))
    exact = by_scipy(problem, x)
    covariance = covariance_of(first)
    # In units of scipy's standard errors.
    units = np.outer(sds_of(exact), sds_of(exact))
    assert_allclose(covariance / units, exact / units, atol=1e-6)
    factor = first.proposal.factor
    assert_allclose(factor @ factor.T, covariance, rtol=1e-6, atol=1e-12)
    assert_allclose(first.proposal.centre, x, rtol=1e-12)


def test_a_refit_is_what_the_linearisation_says():
    table = table_of(REBOUND, "corr", count=12)
    problem = grip_slip(table, fix=NOISE)
    x = best(problem)
    first = first_order(problem, at(problem, x))
    shape = 0.02 * np.linspace(-1.0, 1.0, 12) ** 2
    direction = first.direction("v_x2", shape)
    y = problem.rows.y.copy()
    y[:, 0] += shape
    moved_rows = replace(problem.rows, y=y)
    moved = replace(problem, rows=moved_rows)
    before = residuals_at(problem, x)
    after = residuals_at(moved, x)
    assert_allclose(direction, after - before, rtol=1e-9, atol=1e-12)
    # Only part of it is left in its own column: the errors belong together.
    largest = np.abs(direction).max()
    other_columns = direction[12:]
    assert np.abs(other_columns).max() > 0.1 * largest
    refitted = best(moved, x)
    moves = first.moves(direction)
    exact_moves = (refitted - x) / first.sds
    assert_allclose(exact_moves, moves, rtol=0.05, atol=2e-3)
    shifts = first.shifts(direction)
    sds = np.linalg.norm(first.root, axis=1) * first.sds
    assert_allclose(shifts, moves * first.sds / sds)
    assert np.abs(shifts).max() > 0.05
    change = residuals_at(moved, refitted) - before
    assert_allclose(first.after_refit(direction), change, atol=0.03 * largest)
    assert np.linalg.norm(change) < 0.95 * np.linalg.norm(direction)


def test_residuals_are_column_after_column_of_what_was_measured():
    problem = grip_slip(table_of(REBOUND, gaps=True), fix=NOISE)
    (x,) = near(problem, 1)
    first = first_order(problem, at(problem, x))
    measured = np.isfinite(problem.rows.y)
    assert first.residual.size == measured.sum()
    assert measured.sum() < measured.size
    columns, rows = np.nonzero(measured.T)
    assert first.column.tolist() == columns.tolist()
    assert first.rows.tolist() == rows.tolist()
    assert first.columns == REBOUND


def test_the_score_of_students_t_has_the_same_algebra():
    table = table_of(REBOUND, count=12)
    problem = grip_slip(table, noise="student-t", fix=NOISE)
    q = near(problem, 1)
    point = at(problem, q[0])
    first = first_order(problem, point)
    gradient, curvature = Objective(problem, penalised=False).linearised(q)
    fitted = [problem.free.index(name) for name in first.names]
    slopes = first.slopes[: first.residual.size]
    exact_gradient = -gradient[0, fitted] * first.sds
    assert_allclose(slopes.T @ first.residual, exact_gradient, rtol=1e-6, atol=1e-9)
    units = np.outer(first.sds, first.sds)
    of_fitted = curvature[0][np.ix_(fitted, fitted)]
    exact_curvature = of_fitted * units
    assert_allclose(slopes.T @ slopes, exact_curvature, rtol=1e-6, atol=1e-6)
    assert "degrees_of_freedom" not in first.names


def test_freedom_of_a_straight_line_is_two_less():
    speed = np.linspace(4.0, 16.0, 9)
    table = table_of(REBOUND, count=9)
    values = {
        "v_x1": np.zeros(9),
        "v_y1": speed,
        "omega_1": np.zeros(9),
        "v_y2": (0.8 - 0.01 * speed) * speed,
    }
    table = replace(table, values=values)
    wide = {"cor_10": "uniform(0.1, 1)", "cor_slope": "normal(-0.01, 1)"}
    problem = grip_slip(table, prior=wide, fix={"v_y_sd": 0.05})
    x = problem.coordinates({"cor_10": 0.7, "cor_slope": -0.01})
    first = first_order(problem, at(problem, x))
    assert first.freedom == {"v_y_sd": pytest.approx(7.0, abs=0.01)}
    freedom_of_line = np.sum(first.basis**2)
    assert freedom_of_line == pytest.approx(2.0, abs=0.01)


def truth_in(problem):
    """Coordinates (free,) of the truth."""
    (x,) = near(problem, 1, 0.0)
    return x


def two_mass_at_truth(columns, scene):
    """The linearisation of the two-mass model at the truth."""
    problem = problem_of(table_of(columns), scene, "two-mass")
    return first_order(problem, at(problem, truth_in(problem)))


def test_stiffnesses_are_traded_unless_a_time_was_measured():
    stiffnesses = {"k_y": ("k_theta",), "k_theta": ("k_y",)}
    first = two_mass_at_truth(REBOUND, scene_of(time=True, ball=True))
    assert first.traded == stiffnesses
    assert {"ball_mass", "inertia_ratio"} <= {*first.names}
    timed = two_mass_at_truth(TIMED, None)
    assert timed.traded == {}
    # Of a faster clock and another law of speed the clock is known, since the scene states it.
    filmed = two_mass_at_truth(REBOUND, scene_of(camera=True))
    assert filmed.traded == stiffnesses


def test_levels_that_agree_have_the_prior_of_a_search():
    table = table_of(REBOUND, labels=("surface",), count=16)
    problem = grip_slip(table, fix=NOISE)
    x = truth_in(problem)
    for level in problem.forward.levels:
        names = map(level.name, level.labels)
        k, other = map(problem.free.index, names)
        x[k] = x[other]
    first = first_order(problem, at(problem, x))
    factor = first.proposal.factor
    wide = factor @ factor.T
    assert_allclose(covariance_of(first), wide, rtol=1e-6, atol=1e-14)


def test_each_measurement_adds_two_to_the_information_about_its_noise():
    problem = grip_slip(table_of(REBOUND, count=12))
    sd = sd_in_proposal(problem, truth_in(problem), "spin_sd")
    # ln of the noise: 2 n of the table, and the prior's.
    precision = 2 * 12 + 0.7**-2
    assert sd**2 == pytest.approx(1.0 / precision, rel=1e-6)


def sd_in_proposal(problem, x, name):
    """Standard deviation of a coordinate in the proposal at coordinates (free,)."""
    k = problem.free.index(name)
    factor = proposal(problem, x).factor
    return np.linalg.norm(factor[k])


def test_a_scatter_that_vanishes_has_room():
    problem = grip_slip(table_of(REBOUND, "sd", count=40))
    x = truth_in(problem)
    x[problem.free.index("v_x_sd")] = 1e-4
    stated = problem.rows.sd[:, 0]
    # Its square is known to sqrt(2 / sum(s^-4)).
    exact = (2.0 / np.sum(stated**-4.0)) ** 0.25
    sd = sd_in_proposal(problem, x, "v_x_sd")
    assert 0.3 * exact < sd < 1.5 * exact
    # Where the column is withheld its half-t prior alone says how far: scale 0.25, four degrees of
    # freedom.
    withheld = problem.only_columns(("v_y2", "omega_2"))
    sd_of_prior = sd_in_proposal(withheld, x, "v_x_sd")
    assert sd_of_prior == pytest.approx(0.25 / np.sqrt(1.25), rel=1e-3)


def test_long_tables_are_thinned_and_streamed(monkeypatch):
    table = table_of(REBOUND, count=400)
    problem = problem_of(table, scene_of(time=True), "two-mass", fix=NOISE)
    point = at(problem, truth_in(problem))
    exact = first_order(problem, point)
    monkeypatch.setattr(module, "LONG_ROWS", 100)
    monkeypatch.setattr("fitball.inference.density.STATES_AT_ONCE", 4000)
    first = first_order(problem, point)
    assert len(first.residual) == 300
    assert first.share == 0.25
    evenly_spread = np.linspace(0, 399, 100).round()
    assert {*np.unique(first.rows)} == {*evenly_spread}
    assert_allclose(
        first.root @ first.root.T,
        exact.root @ exact.root.T,
        rtol=1e-8,
        atol=1e-14,
    )
    shape = np.full(400, 0.1)
    thinned_shifts = first.shifts(first.direction("v_x2", shape))
    exact_shifts = exact.shifts(exact.direction("v_x2", shape))
    largest = np.abs(exact_shifts).max()
    assert_allclose(thinned_shifts, exact_shifts, atol=0.1 * largest)
    assert largest > 1.0
    freedom = first.freedom["spin_sd"]
    assert freedom == pytest.approx(exact.freedom["spin_sd"], abs=0.5)
    assert freedom > 397.0


def test_the_factor_of_an_inverse_holds_where_a_direction_is_far_better_determined():
    rng = np.random.default_rng(1)
    sizes = np.geomspace(1.0, 1e12, 11)
    for _ in range(10):
        square = rng.normal(size=(11, 11))
        turn, _ = np.linalg.qr(square)
        factor = factor_of_inverse(turn * sizes @ turn.T)
        above_diagonal = np.triu(factor, 1)
        assert np.abs(above_diagonal).max() < 1e-12
        inverse = turn / sizes @ turn.T
        assert_allclose(factor @ factor.T, inverse, atol=1e-3)
