"""Eight impacts at once: the number type against numpy and mpmath, the bounce against the scalar kernel."""

from __future__ import annotations

import math

import mpmath
import numba
import numpy as np
import pytest
from samples import COMPOSITIONS

import fitball
from fitball.bench.problems import hard_cases
from fitball.models.kernels import bounce
from fitball.models.kernels.dual import WIDTH, choose
from fitball.models.kernels.lanes import number
from fitball.models.kernels.lanes.number import any_of, lane_array, largest
from fitball.models.two_mass import _each, _incident, _room
from fitball.models.types import OUTPUTS
from fitball.values import Impacts, OwnImpacts

ULPS = 1.5


@numba.njit(error_model="numpy", nogil=True)
def functions(x, out):
    given, found = lane_array(x), lane_array(out)
    for row in range(len(x)):
        sine, cosine = number.sin_cos(given[row])
        found[4 * row] = number.exp(-given[row])
        found[4 * row + 1], found[4 * row + 2] = sine, cosine
        found[4 * row + 3] = number.log(given[row])


@pytest.mark.parametrize(("low", "high"), [(1e-12, 1e-3), (1e-3, 2.0), (0.5, 1.6), (1.5, 30.0), (30.0, 600.0)])
def test_elementary_functions_are_right_to_an_ulp_and_a_half(low, high):
    x = np.random.default_rng(1).uniform(low, high, (40, WIDTH))
    found = np.empty((160, WIDTH))
    functions(x, found)
    with mpmath.workprec(200):
        for place, exact in enumerate((lambda v: mpmath.exp(-v), mpmath.sin, mpmath.cos, mpmath.log)):
            for value, got in zip(x.ravel(), found[place::4].ravel(), strict=True):
                want = exact(mpmath.mpf(value))
                assert abs(got - want) < ULPS * math.ulp(float(want)), (place, value)


def test_the_ends_of_their_ranges():
    x = np.array([[0.0, 700.0, 1e5, -1e5, -700.0, 1.0, 0.5 * math.pi, math.pi]])
    found = np.empty((4, WIDTH))
    functions(np.abs(x), found)
    assert found[0, 0] == 1.0 and found[1, 0] == 0.0 and found[2, 0] == 1.0 and found[3, 5] == 0.0
    assert found[0, 1] == pytest.approx(math.exp(-700.0), rel=1e-15)
    assert found[1, 2] == pytest.approx(math.sin(1e5), abs=1e-15)
    assert found[1, 7] == pytest.approx(math.sin(math.pi), rel=1e-9)


@numba.njit(error_model="numpy", nogil=True)
def arithmetic(x, out):
    a, b, found = lane_array(x)[0], lane_array(x)[1], lane_array(out)
    found[0], found[1], found[2], found[3] = a + b, a - 2, 3 * b, a / b
    found[4], found[5], found[6], found[7] = min(a, b), max(a, 0.0), -abs(a), math.sqrt(abs(b))
    found[8] = choose((a < b) & (a >= 0.0), 1.0, choose((a > b) | ~(b <= 0.0), b.real, 2))
    a += b
    a *= 2.0
    a -= 1.0
    found[9] = a
    return any_of(a > 1e300), any_of(a > -1e300), largest(a)


def test_arithmetic_is_that_of_numpy_bit_for_bit():
    a, b = x = np.random.default_rng(2).normal(size=(2, WIDTH))
    found = np.empty((10, WIDTH))
    never, ever, top = arithmetic(x, found)
    inner = np.where((a > b) | ~(b <= 0.0), b, 2.0)
    want = (
        a + b, a - 2, 3 * b, a / b, np.minimum(a, b), np.maximum(a, 0.0), -np.abs(a), np.sqrt(np.abs(b)),
        np.where((a < b) & (a >= 0.0), 1.0, inner), (a + b) * 2.0 - 1.0,
    )  # fmt: skip
    assert found.tobytes() == np.array(want).tobytes()
    assert (never, ever, top) == (False, True, found[9].max())


def alone(chosen, values, impacts):
    """What the scalar kernel gives."""
    made = _room(len(values), len(impacts))
    given = chosen.rows(chosen.parameter_names, values), chosen.codes, *_incident(impacts)
    for _part in _each(given, np.arange(made[1].size), made):
        pass
    return made


def solved(chosen, values, impacts):
    found = chosen.evaluate(chosen.parameter_names, values, impacts)
    return np.array([getattr(found, name) for name in OUTPUTS]), found.regime, found.status


def left(chosen, values, impacts):
    """How many are not plain."""
    given = chosen.rows(chosen.parameter_names, values), chosen.codes, *_incident(impacts)
    return bounce.bounce_batch(*given, *_room(len(values), len(impacts)), np.zeros(bounce.LANE_ROOM))


WIDE = {
    "mass_ratio": (0.75, 0.99), "k_y": (5e3, 1e5), "k_theta": (2.0, 300.0), "mu": (0.02, 1.5),
    "eps_10": (-8e-3, 8e-3), "eps_slope": (-1e-4, 1e-4), "cor_10": (0.5, 0.8), "cor_slope": (-0.02, 0.0),
    "zeta_theta": (0.01, 2.0), "inertia_split": (0.2, 0.9),
}  # fmt: skip


def wide(chosen, draws, seed):
    """Draws and impacts of all regimes, some without an answer."""
    rng = np.random.default_rng(seed)
    values = np.stack([rng.uniform(*WIDE[name], draws) for name in chosen.parameter_names], axis=1)
    speeds = rng.uniform(0.0, 25.0, 21), rng.uniform(1.0, 20.0, 21), rng.uniform(-400.0, 400.0, 21)
    return values, Impacts(*speeds, rng.uniform(0.5, 0.8, 21))


@pytest.mark.parametrize(("name", "closures"), COMPOSITIONS)
def test_lanes_give_what_the_scalar_kernel_gives(name, closures):
    chosen = fitball.model(name, **closures)
    values, impacts = wide(chosen, 400, 3)
    out, regime, status = solved(chosen, values, impacts)
    want, regime_alone, status_alone = alone(chosen, values, impacts)
    np.testing.assert_array_equal(status, status_alone)
    np.testing.assert_array_equal(regime, regime_alone)
    speed = np.hypot(impacts.v_x1, impacts.v_y1) + chosen.ball.radius * np.abs(impacts.omega_1)
    time = want[3]
    scales = speed, speed, speed / chosen.ball.radius, time, time, speed * time, speed / chosen.ball.radius * time
    for found, right, scale in zip(out, want, scales, strict=True):
        error = np.abs(found - right) / scale
        # An event time is as sharp as the slope of its function.
        assert np.nanmax(error) < 1e-12 and np.nanquantile(error, 0.999) < 1e-14
    # Else there would be nothing to see.
    assert chosen.closures.torsion == "rigid" or left(chosen, values, impacts) < 0.75 * regime.size


def test_what_a_posterior_asks_is_solved_in_lanes(wang_impacts):
    chosen = fitball.model("two-mass")
    typical = np.array([spec.typical for spec in chosen.parameters])
    values = typical * np.random.default_rng(4).normal(1.0, 0.02, (200, len(typical)))
    _, regime, status = solved(chosen, values, wang_impacts)
    # Beside those that have no answer.
    assert left(chosen, values, wang_impacts) - np.count_nonzero(status) < 0.01 * regime.size


@pytest.mark.parametrize("closures", [{}, {"offset": "grip", "torsion": "free"}])
def test_neighbours_and_splits_change_no_bit(closures):
    chosen = fitball.model("two-mass", **closures)
    values, impacts = wide(chosen, 50, 5)
    whole = solved(chosen, values, impacts)
    by_draw = [solved(chosen, values[k : k + 1], impacts) for k in range(50)]
    for place, array in enumerate(whole):
        assert np.concatenate([part[place] for part in by_draw], axis=-2).tobytes() == array.tobytes()
    order = np.random.default_rng(6).permutation(50)
    shuffled = solved(chosen, values[order], impacts)
    assert shuffled[0].tobytes() == whole[0][:, order].tobytes()
    own = OwnImpacts(*(np.tile(column, (50, 1)) for column in impacts.states()))
    assert solved(chosen, values, own)[0].tobytes() == whole[0].tobytes()


def test_hard_impacts_are_no_different_among_plain_ones():
    """A hard impact in one lane, plain ones in the others: both have the bits that they have alone."""
    for case in hard_cases()[::4]:
        chosen, hard = case.model, case.impacts
        values = np.array([[case.parameters[name] for name in chosen.parameter_names]])
        plain = Impacts(*np.array([[14.0, 12.0, 100.0], [6.0, 9.0, -50.0], [17.0, 5.0, 20.0]]).T)
        alone = [solved(chosen, values, impacts)[0] for impacts in (hard, plain)]
        together = Impacts(*(np.append(a, b) for a, b in zip(hard.states()[:3], plain.states()[:3], strict=True)))
        if hard.cor is None:
            found = solved(chosen, values, together)[0]
            assert found.tobytes() == np.concatenate(alone, axis=2).tobytes(), case.name
