"""The linearisation against scipy's derivatives, real refits, closed forms."""

from dataclasses import replace

import numpy as np
import pytest
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
    sizes = np.array([NOISE[item.noise] for item in problem.observables])

    def residuals(u):
        # scipy's steps are for numbers of order one.
        q = x + problem.prior.width * u
        rebound = problem.forward.rebound(
            problem.values(q[None]),
            problem.rows.states,
            problem.rows.index,
        )
        made = np.stack(
            [rebound.column(item.column.name)[0] for item in problem.observables],
            axis=1,
        )
        z = ((problem.rows.y - made) / sizes)[np.isfinite(problem.rows.y)]
        centre = np.array([item.prior.location for item in problem.prior.parameters])
        # Of a flat prior the sd.
        pulls = (q - centre) / problem.prior.width
        if problem.contact_time is None:
            return np.concatenate([z, pulls])
        value, sd = problem.contact_time
        return np.concatenate([z, pulls, [(rebound.contact_time.mean() - value) / sd]])

    jacobian = least_squares(residuals, np.zeros(x.size), jac="3-point", max_nfev=1).jac
    return np.linalg.inv(jacobian.T @ jacobian) * np.outer(problem.prior.width, problem.prior.width)


def correlation(covariance):
    return covariance / np.sqrt(np.outer(*2 * [np.diag(covariance)]))


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
    found = (first.root @ first.root.T) * np.outer(first.sds, first.sds)
    np.testing.assert_allclose(
        found / np.sqrt(np.outer(*2 * [np.diag(exact)])),
        correlation(exact),
        atol=1e-6,
    )
    np.testing.assert_allclose(
        first.proposal.factor @ first.proposal.factor.T,
        found,
        rtol=1e-6,
        atol=1e-12,
    )
    np.testing.assert_allclose(first.proposal.centre, x, rtol=1e-12)


def test_a_refit_is_what_the_linearisation_says():
    problem = problem_of(table_of(REBOUND, "corr", count=12), None, "grip-slip", fix=NOISE)
    x = best(problem)
    first = first_order(problem, at(problem, x))
    shape = 0.02 * np.linspace(-1.0, 1.0, 12) ** 2
    direction = first.direction("v_x2", shape)
    y = problem.rows.y.copy()
    y[:, 0] += shape
    moved = replace(problem, rows=replace(problem.rows, y=y))
    before, after = (cells(each, x[None]).z[0].T.ravel() for each in (problem, moved))
    np.testing.assert_allclose(direction, after - before, rtol=1e-9, atol=1e-12)
    # Only part of it is left in its own column: the errors belong together.
    assert np.abs(direction[12:]).max() > 0.1 * np.abs(direction).max()
    again = best(moved, x)
    np.testing.assert_allclose(
        (again - x) / first.sds,
        first.moves(direction),
        rtol=0.05,
        atol=2e-3,
    )
    sds = np.linalg.norm(first.root, axis=1) * first.sds
    np.testing.assert_allclose(first.shifts(direction), first.moves(direction) * first.sds / sds)
    assert np.abs(first.shifts(direction)).max() > 0.05
    left = cells(moved, again[None]).z[0].T.ravel() - before
    np.testing.assert_allclose(
        first.after_refit(direction),
        left,
        atol=0.03 * np.abs(direction).max(),
    )
    assert np.linalg.norm(left) < 0.95 * np.linalg.norm(direction)


def test_residuals_are_column_after_column_of_what_was_measured():
    problem = problem_of(table_of(REBOUND, gaps=True), None, "grip-slip", fix=NOISE)
    first = first_order(problem, at(problem, near(problem, 1)[0]))
    y = problem.rows.y
    assert first.residual.size == np.isfinite(y).sum() < y.size
    order = [(k, row) for k in range(3) for row in range(10) if np.isfinite(y[row, k])]
    assert list(zip(first.column, first.rows, strict=True)) == order
    assert first.columns == REBOUND


def test_the_score_of_students_t_has_the_same_algebra():
    problem = problem_of(
        table_of(REBOUND, count=12),
        None,
        "grip-slip",
        noise="student-t",
        fix=NOISE,
    )
    q = near(problem, 1)
    point = at(problem, q[0])
    first = first_order(problem, point)
    gradient, curvature = Objective(problem, penalised=False).linearised(q)
    fitted = [problem.free.index(name) for name in first.names]
    measured = first.slopes[: first.residual.size]
    np.testing.assert_allclose(
        measured.T @ first.residual,
        -gradient[0, fitted] * first.sds,
        rtol=1e-6,
        atol=1e-9,
    )
    own = curvature[0][np.ix_(fitted, fitted)] * np.outer(first.sds, first.sds)
    np.testing.assert_allclose(measured.T @ measured, own, rtol=1e-6, atol=1e-6)
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
    problem = problem_of(table, None, "grip-slip", prior=wide, fix={"v_y_sd": 0.05})
    first = first_order(
        problem,
        at(problem, problem.coordinates({"cor_10": 0.7, "cor_slope": -0.01})),
    )
    assert first.freedom == {"v_y_sd": pytest.approx(7.0, abs=0.01)}
    assert (first.basis**2).sum() == pytest.approx(2.0, abs=0.01)


def test_stiffnesses_are_traded_unless_a_time_was_measured():
    problem = problem_of(table_of(REBOUND), scene_of(time=True, ball=True), "two-mass")
    first = first_order(problem, at(problem, near(problem, 1, 0.0)[0]))
    assert first.traded == {"k_y": ("k_theta",), "k_theta": ("k_y",)}
    assert {"ball_mass", "inertia_ratio"} <= {*first.names}
    problem = problem_of(table_of(TIMED), None, "two-mass")
    assert first_order(problem, at(problem, near(problem, 1, 0.0)[0])).traded == {}
    # Of a faster clock and another law of speed the clock is known, since the scene states it.
    problem = problem_of(table_of(REBOUND), scene_of(camera=True), "two-mass")
    traded = first_order(problem, at(problem, near(problem, 1, 0.0)[0])).traded
    assert traded == {"k_y": ("k_theta",), "k_theta": ("k_y",)}


def test_levels_that_agree_have_the_prior_of_a_search():
    problem = problem_of(
        table_of(REBOUND, labels=("surface",), count=16),
        None,
        "grip-slip",
        fix=NOISE,
    )
    x = near(problem, 1, 0.0)[0]
    for level in problem.forward.levels:
        one, other = (problem.free.index(level.name(label)) for label in level.labels)
        x[one] = x[other]
    first = first_order(problem, at(problem, x))
    found = first.root @ first.root.T * np.outer(first.sds, first.sds)
    wide = first.proposal.factor @ first.proposal.factor.T
    np.testing.assert_allclose(found, wide, rtol=1e-6, atol=1e-14)


def test_noise_is_known_to_two_measurements_each():
    problem = problem_of(table_of(REBOUND, count=12), None, "grip-slip")
    found = proposal(problem, near(problem, 1, 0.0)[0])
    k = problem.free.index("spin_sd")
    # ln of the noise: 2 n of the table, and the prior's.
    assert (found.factor[k] ** 2).sum() == pytest.approx(1.0 / (2 * 12 + 0.7**-2), rel=1e-6)


def test_a_scatter_that_vanishes_has_room():
    problem = problem_of(table_of(REBOUND, "sd", count=40), None, "grip-slip")
    x = near(problem, 1, 0.0)[0]
    k = problem.free.index("v_x_sd")
    x[k] = 1e-4
    stated = problem.rows.sd[:, 0]
    # Its square is known to sqrt(2 / sum(s^-4)).
    known = (2.0 / np.sum(stated**-4.0)) ** 0.25
    found = np.sqrt((proposal(problem, x).factor[k] ** 2).sum())
    assert 0.3 * known < found < 1.5 * known
    # Where the column is withheld its half-t prior alone says how far: scale 0.25, four degrees of
    # freedom.
    alone = proposal(problem.only(("v_y2", "omega_2")), x).factor[k]
    assert np.sqrt((alone**2).sum()) == pytest.approx(0.25 / np.sqrt(1.25), rel=1e-3)


def test_long_tables_are_thinned_and_streamed(monkeypatch):
    problem = problem_of(table_of(REBOUND, count=400), scene_of(time=True), "two-mass", fix=NOISE)
    x = near(problem, 1, 0.0)[0]
    point = at(problem, x)
    exact = first_order(problem, point)
    monkeypatch.setattr(module, "LONG", 100)
    monkeypatch.setattr("fitball.inference.density.AT_ONCE", 4000)
    first = first_order(problem, point)
    assert len(first.residual) == 300
    assert first.share == 0.25
    assert {*np.unique(first.rows)} == {*np.linspace(0, 399, 100).round()}
    np.testing.assert_allclose(
        first.root @ first.root.T,
        exact.root @ exact.root.T,
        rtol=1e-8,
        atol=1e-14,
    )
    shape = np.full(400, 0.1)
    small, whole = (one.shifts(one.direction("v_x2", shape)) for one in (first, exact))
    np.testing.assert_allclose(small, whole, atol=0.1 * np.abs(whole).max())
    assert np.abs(whole).max() > 1.0
    assert first.freedom["spin_sd"] == pytest.approx(exact.freedom["spin_sd"], abs=0.5)
    assert first.freedom["spin_sd"] > 397.0


def test_the_factor_of_an_inverse_holds_where_one_direction_is_known_far_better():
    rng = np.random.default_rng(1)
    sizes = np.geomspace(1.0, 1e12, 11)
    for _ in range(10):
        turn = np.linalg.qr(rng.normal(size=(11, 11)))[0]
        factor = factor_of_inverse(turn * sizes @ turn.T)
        assert np.abs(np.triu(factor, 1)).max() < 1e-12
        np.testing.assert_allclose(factor @ factor.T, turn / sizes @ turn.T, atol=1e-3)
