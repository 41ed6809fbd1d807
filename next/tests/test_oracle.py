"""The Taylor oracle against more digits and closed forms; the kernels against the oracle."""

import mpmath
import numpy as np
import pytest
from support import answers, bounces, taylor
from support.taylor import OUTPUTS

import fitball
from fitball.models.types import Status
from fitball.values import Impacts


def distance(one, other, impact, outputs=OUTPUTS):
    """The largest difference of two answers over the scale of an output."""
    sizes = dict(zip(OUTPUTS, answers.scales(impact, other.contact_time, other.gap_time), strict=True))
    return max(abs(float(getattr(one, name)) - float(getattr(other, name))) / sizes[name] for name in outputs)


def seeded(seed, count, options=None, wide=False):
    """So many random bounces that have an answer: options, parameters, impact, answer."""
    rng = np.random.default_rng(seed)
    while count > 0:
        chosen = options or bounces.random_options(rng)
        values, impact = bounces.random_bounce(rng, chosen, wide)
        answer = taylor.solve(chosen, values, impact)
        if answer.status == "OK":
            count -= 1
            yield chosen, values, impact, answer


def test_digits_beyond_change_nothing_and_another_arithmetic_agrees():
    """Sixty digits against thirty, of decimal numbers and of mpmath's."""
    few = taylor.FIFTY._replace(digits=30)
    binary = taylor.Numbers(mpmath.mpf, mpmath.sqrt, mpmath.log, 30)
    for options, values, impact, _ in seeded(2, 2):
        exact = taylor.solve(options, values, impact, kind=taylor.FIFTY)
        with mpmath.workdps(30):
            for other in (taylor.solve(options, values, impact, kind=kind) for kind in (few, binary)):
                for name in OUTPUTS:
                    one, two = (mpmath.mpf(str(getattr(made, name))) for made in (exact, other))
                    assert abs(one - two) < mpmath.mpf("1e-24") * abs(one)


@pytest.mark.parametrize("kept", [1.0, 0.97, 0.5, 0.14, 0.13, 0.02])
def test_damping_by_shooting_has_closed_forms(kept):
    """Below exp(-2) the release at zero force is overdamped: b is imaginary, zeta = cosh, -ln e = 2 b coth b."""
    zeta, force, contact = taylor.damping(kept, False, taylor.DOUBLE)
    wanted = -np.log(kept) / np.hypot(np.log(kept), np.pi)
    assert zeta == pytest.approx(wanted, rel=1e-12, abs=1e-15)
    assert contact == pytest.approx(np.pi / np.sqrt(1.0 - wanted**2), rel=1e-12)
    zeta, force, contact = taylor.damping(kept, True, taylor.DOUBLE)
    assert force == contact
    b = np.arccos(zeta + 0j)
    assert -np.log(kept) == pytest.approx((2.0 * b / np.tan(b)).real, abs=1e-13)
    assert contact == pytest.approx((2.0 * b / np.sin(b)).real, rel=1e-12)


def test_the_law_of_restitution_has_its_value_slope_and_ends():
    """Written out anew in powers of v/v_0, where these exist; without a slope a constant, continuously."""
    for cor_10, slope, cap in ((0.776, -0.0157, 0.874), (0.7, -0.06, 1.0), (0.7, 0.01, 0.9)):

        def law(v, cor_10=cor_10, slope=slope, cap=cap):
            return taylor.law(cor_10, slope, cap, v, np.log)

        assert law(10.0) == pytest.approx(cor_10, rel=1e-14)
        assert (law(10.001) - law(9.999)) / 2e-3 == pytest.approx(slope, rel=1e-6)
        if slope < 0.0:
            share = -10.0 * slope / cor_10
            q = np.log(1.0 - share) / np.log(cor_10 / cap)
            v_0 = 10.0 * (share / (1.0 - share)) ** (-1.0 / q)
            assert law(37.0) == pytest.approx(cap * (1.0 + (37.0 / v_0) ** q) ** (-1.0 / q), rel=1e-13)
    assert taylor.law(0.7, -0.07, 1.0, 10.0, np.log) is None
    for slope in (1e-9, 0.0, -1e-9):
        assert taylor.law(0.7, slope, 0.9, 30.0, np.log) == pytest.approx(0.7, abs=2e-8)


def kernel(options, values, impact):
    model = fitball.model(bounces.text_of(options))
    names = [spec.name for spec in model.parameters]
    states = Impacts(*(np.array([number]) for number in impact))
    return model.evaluate(names, np.array([[values[name] for name in names]]), states)


@pytest.mark.parametrize("wide", [False, True])
def test_kernels_agree_with_the_oracle(wide):
    """Random bounces of all products of options; where double precision of the oracle is not enough, fifty digits."""
    rng, regimes, refused = np.random.default_rng(7), set(), set()
    for _ in range(250):
        options = bounces.random_options(rng)
        values, impact = bounces.random_bounce(rng, options, wide)
        found, answer = kernel(options, values, impact), taylor.solve(options, values, impact)
        status = Status(int(found.status[0, 0])).name
        assert answer.status == status
        if status != "OK":
            refused.add(status)
            assert all(np.isnan(getattr(found, name)[0, 0]) for name in OUTPUTS)
            continue
        made = taylor.Answer("OK", *(getattr(found, name)[0, 0] for name in OUTPUTS))
        # A phase of less than a billionth of the contact may be named or not.
        if distance(made, answer, impact) > 1e-13 or found.regime[0, 0] not in {answer.regime(), answer.regime(1e-9)}:
            answer = taylor.solve(options, values, impact, kind=taylor.FIFTY)
        assert distance(made, answer, impact) < 1e-13, (options, values, impact)
        assert found.regime[0, 0] in {answer.regime(), answer.regime(1e-9)}, (options, values, impact)
        regimes.add(f"{answer.regime(1e-9):o}"[::-1])
    heads = {"1", "2", "132", "131", "231", "232", "31", "32", "12", "134", "234"}
    assert all(any(regime.startswith(head) for regime in regimes) for head in heads)
    assert any("5" in regime for regime in regimes) and max(map(len, regimes)) >= (7 if wide else 5)
    assert refused <= {"TORSION_TOO_SOFT"} and bool(refused) == wide
