"""Products that are known better than their factors: constructed covariances, and Wang's table."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from samples import TWO_MASS, coordinates_of, problem_of, synthetic

from fitball.data.read import load_table
from fitball.data.scene import load_scene
from fitball.inference.identifiability.eigendirections import _with_third, eigendirections
from fitball.inference.identifiability.fisher import fisher_information, inverse, prior_sds
from fitball.inference.identifiability.products import known_products, log_covariance, log_steps, monomial_error
from fitball.inference.problem.build import Choices, build_problem


def covariance_of(exponents, error, spread=1.0):
    """Everything is known to `spread`, but the monomials of the rows of `exponents` to `error`."""
    exponents = np.atleast_2d(np.asarray(exponents, dtype=float))
    precision = np.eye(exponents.shape[1]) / spread**2
    for one in exponents:
        precision += np.outer(one, one) / error**2
    return np.linalg.inv(precision)


@pytest.mark.parametrize(
    "exponents",
    [[1, 1, 0, 0], [1, 0, -1, 0], [0, 2, -1, 0], [0, 1, 0, 2], [1, 1, -1, 0], [0, 1, 2, 1], [2, -1, 0, 1]],
)
def test_a_product_that_is_known_is_found_with_its_exponents(exponents):
    (found,) = known_products(covariance_of(exponents, 0.03))
    np.testing.assert_array_equal(found.exponents, exponents)
    assert found.error == pytest.approx(0.03, rel=0.01)


def test_of_several_exponents_those_that_are_known_best_are_told():
    """Known to 0.78 of its best factor with exponents 1 and 1, to 0.4 with 1 and 2."""
    (found,) = known_products(np.array([[1.0, -0.57], [-0.57, 0.36]]))
    np.testing.assert_array_equal(found.exponents, [1, 2])
    assert found.error == pytest.approx(0.4)


def test_sparse_products_come_first_and_hide_what_only_repeats_them():
    found = known_products(covariance_of([[1, 1, 0, 0], [0, 0, 1, -1]], 0.05))
    assert [item.exponents.tolist() for item in found] == [[1, 1, 0, 0], [0, 0, 1, -1]]
    found = known_products(covariance_of([[1, -1, 0, 0], [0, 1, 1, 1]], 0.05))
    assert found[0].exponents.tolist() == [1, -1, 0, 0]
    assert [1, 0, 1, 1] in [np.abs(item.exponents).tolist() for item in found[1:]]


def test_a_triple_has_to_beat_the_pairs_in_it():
    """A product of two is known to 0.1, a third factor to 0.12, all three to 0.09: no news."""
    product, third, between = 0.1, 0.12, (0.09**2 - 0.1**2 - 0.12**2) / 2.0
    covariance = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0 + product**2, between], [0.0, between, third**2]])
    assert monomial_error(np.ones(3), covariance) == pytest.approx(0.09)
    assert [item.exponents.tolist() for item in known_products(covariance)] == [[1, 1, 0]]


def test_what_is_known_apart_is_no_product():
    assert known_products(np.diag([0.1, 0.2, 1.0]) ** 2) == []
    # A weak correlation is no knowledge of a product: 0.95 of the better part.
    assert known_products(np.array([[1.0, -0.55], [-0.55, 1.0]])) == []
    assert known_products(np.array([[1.0, np.nan], [np.nan, np.nan]])) == []
    # Where one part is known as well, the other is told by it.
    assert known_products(np.array([[1e-4, 0.0], [0.0, 1.0]])) == []


def inner():
    name = "wang_zero_spin.csv"
    return build_problem(load_table(name), load_scene(name), Choices(closures={"normal": "inner"}))


# The maximum of the posterior on Wang's table.
INNER = TWO_MASS | {
    "mass_ratio": 0.887, "k_y": 1.81e4, "k_theta": 17.6, "mu": 0.606, "eps_10": 2.8e-3, "eps_slope": 1.1e-4,
    "cor_10": 0.779, "cor_slope": -0.0152, "velocity_sd": 0.24, "spin_sd": 12.0,
}  # fmt: skip


def test_with_the_inner_mass_alone_mass_ratio_times_friction_is_named():
    """In sliding, mu times the mass on the spring is what pushes: the table knows that product best of all."""
    problem = inner()
    found = eigendirections(problem, coordinates_of(problem, INNER)).sentences
    (known,) = (item for item in found if item.startswith("mass_ratio mu is known to "))
    assert "but mass_ratio to " in known and " and mu to " in known
    assert any(item.startswith("k_theta/k_y is known to ") for item in found)


def test_parameters_that_may_be_negative_or_vanish_have_no_logarithm():
    problem = inner()
    at = coordinates_of(problem, INNER)
    steps = log_steps(problem, at, range(problem.dimension))
    known = {name for name, step in zip(problem.free_names, steps, strict=True) if np.isfinite(step)}
    assert known == {"mass_ratio", "k_y", "k_theta", "mu", "cor_10"}
    assert steps[problem.free_names.index("k_y")] == pytest.approx(1.0)
    # A uniform prior from 0.3 to 1 has an sd of 0.7 over the root of 12.
    assert steps[0] == pytest.approx(0.7 / np.sqrt(12.0) / 0.887)
    at[problem.free_names.index("cor_10")] = 0.0
    assert np.isnan(log_steps(problem, at, range(problem.dimension))[problem.free_names.index("cor_10")])


def test_the_default_model_has_no_such_product():
    problem = synthetic(problem_of("wang_zero_spin.csv"), TWO_MASS)
    found = eigendirections(problem, coordinates_of(problem, TWO_MASS)).sentences
    assert len(found) == 1 and found[0].startswith("k_theta/k_y is known to ")


def test_what_a_sentence_has_told_is_not_told_again():
    """Without a contact time the ratio of the stiffnesses is both what is open and a product that is known."""
    problem = replace(synthetic(problem_of("wang_zero_spin.csv"), TWO_MASS), contact_time=None)
    at = coordinates_of(problem, TWO_MASS)
    assert any(np.count_nonzero(item.exponents) == 2 for item in known_products(log_covariance(problem, at, None)))
    (told,) = (item for item in eigendirections(problem, at).sentences if "k_theta" in item and "k_y" in item)
    assert told.startswith("k_theta/k_y is known to ") and told.endswith("only through the priors")


def test_first_order_and_draws_agree_on_a_normal_posterior():
    problem = inner()
    at = coordinates_of(problem, INNER)
    first = log_covariance(problem, at, None)
    names = [item.name for item in problem.free if item.name in ("mass_ratio", "k_y", "k_theta", "mu", "cor_10")]
    assert first.shape == (5, 5) and len(names) == 5
    # A hundredth of the spread, so that logarithms of draws are linear in the draws.
    sds = prior_sds(problem) * problem.prior.width
    covariance = inverse(fisher_information(problem, at, scene=True), 1.0) * np.outer(sds, sds)
    draws = np.random.default_rng(1).multivariate_normal(at, 1e-4 * covariance, 20000)
    sampled = log_covariance(problem, at, SimpleNamespace(draws=problem.to_values(draws)))
    np.testing.assert_allclose(np.sqrt(np.diag(1e4 * sampled)), np.sqrt(np.diag(first)), rtol=0.05)


def test_a_third_factor_is_told_where_two_alone_are_not_known():
    covariance = covariance_of([1, 1, -1, 0], 0.3, spread=5.0)
    pair = np.array([0.0, 1.0, -1.0, 0.0])
    assert monomial_error(pair, covariance) > 3.0
    exponents, error = _with_third(pair, covariance)
    assert exponents.tolist() == [1, 1, -1, 0]
    assert error == pytest.approx(0.3, rel=0.01)
    # A third that helps by a quarter is not worth its name.
    helped = np.array([[0.09, -0.0858, 0.0], [-0.0858, 1.16, 1.0], [0.0, 1.0, 1.0]])
    pair = np.array([0.0, 1.0, -1.0])
    assert monomial_error(np.array([1.0, 1.0, -1.0]), helped) == pytest.approx(0.7 * monomial_error(pair, helped))
    assert _with_third(pair, helped)[0].tolist() == pair.tolist()
    # Where two alone are known, they stay alone.
    exponents, error = _with_third(pair, covariance_of(pair, 0.2))
    assert exponents.tolist() == pair.tolist()
    assert error == pytest.approx(0.2, rel=0.02)
