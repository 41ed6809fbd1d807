"""Where priors end: what is left of their variance, and starts among parameters that are never possible."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import problem_of
from scipy import stats
from scipy.integrate import quad

from fitball.errors import FitError
from fitball.inference.identifiability.verdict import within_support
from fitball.inference.sampling import ensembles


def test_no_possible_start_is_a_fit_error(monkeypatch):
    problem = problem_of("wang_zero_spin.csv", "brody")
    monkeypatch.setattr(ensembles, "log_posterior", lambda _problem, pool: np.full(len(pool), -np.inf))
    middle = np.array(
        [[float(item.prior.coordinate(item.prior.quantile(np.array([0.5])))[0]) for item in problem.free]]
    )
    with pytest.raises(FitError, match="too few starting points"):
        ensembles.starting_positions(problem, middle, 0, 16, np.random.default_rng(1))


@pytest.mark.parametrize(("low", "high"), [(-0.005, 0.005), (0.0, 0.02), (-0.5, 0.5)])
def test_a_contraction_to_first_order_is_told_of_the_prior_with_its_ends(low, high):
    """Against the integral over a truncated normal times a normal likelihood about its median."""
    prior = replaced(problem_of("wang_zero_spin.csv", "grip-slip"), low, high)
    law = stats.truncnorm((low - prior.a) / prior.b, (high - prior.a) / prior.b, prior.a, prior.b)
    for contraction in (0.0, 0.5, 0.9):
        precision = contraction / (1.0 - contraction) / prior.b**2

        def moment(power, precision=precision):
            return quad(
                lambda x: x**power * law.pdf(x) * np.exp(-0.5 * precision * (x - law.median()) ** 2),
                max(low, -10.0 * prior.b), min(high, 10.0 * prior.b), epsabs=1e-12,
            )[0]  # fmt: skip

        mass, mean = moment(0), moment(1) / moment(0)
        expected = 1.0 - (moment(2) / mass - mean**2) / law.var()
        assert within_support(contraction, prior) == pytest.approx(expected, abs=0.01)
    if high > 0.1:
        assert within_support(0.9, prior) == pytest.approx(0.9, abs=0.01)
    else:
        assert within_support(0.9, prior) < 0.88


def replaced(problem, low, high):
    """The prior normal(0, 0.005) of an offset between other bounds."""
    prior = next(item.prior for item in problem.free if item.name == "offset")
    return replace(prior, lower=low, upper=high)
