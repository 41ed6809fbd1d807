"""The Taylor oracle against other digits and another arithmetic; the kernels against the oracle."""

import mpmath
import numpy as np
import pytest
from support import answers, bounces, taylor
from support.taylor import OUTPUTS

import fitball
from fitball.base.values import Impacts
from fitball.models.types import Status


def distance(one, other, impact, outputs=OUTPUTS):
    """The largest difference of two answers over the scale of an output."""
    sizes = dict(
        zip(OUTPUTS, answers.scales(impact, other.contact_time, other.gap_time), strict=True)
    )
    return max(
        abs(float(getattr(one, name)) - float(getattr(other, name))) / sizes[name]
        for name in outputs
    )


def test_digits_beyond_change_nothing_and_another_arithmetic_agrees():
    """Sixty digits against thirty, of decimal numbers and of mpmath's."""
    few = taylor.FIFTY._replace(digits=30)
    binary = taylor.Numbers(mpmath.mpf, mpmath.sqrt, mpmath.log, 30)
    rng = np.random.default_rng(2)
    for options in (bounces.random_options(rng), bounces.random_options(rng)):
        values, impact = bounces.random_bounce(rng, options)
        exact = taylor.solve(options, values, impact, kind=taylor.FIFTY)
        assert exact.status == "OK"
        with mpmath.workdps(30):
            for other in (
                taylor.solve(options, values, impact, kind=kind) for kind in (few, binary)
            ):
                for name in OUTPUTS:
                    one, two = (mpmath.mpf(str(getattr(made, name))) for made in (exact, other))
                    assert abs(one - two) < mpmath.mpf("1e-24") * abs(one)


def kernel(options, values, impact):
    model = fitball.model(bounces.text_of(options))
    names = [spec.name for spec in model.parameters]
    states = Impacts(*(np.array([number]) for number in impact))
    return model.evaluate(names, np.array([[values[name] for name in names]]), states)


@pytest.mark.parametrize("wide", [False, True])
def test_kernels_agree_with_the_oracle(wide):
    """Random bounces of all products of options; where double precision of the oracle is not
    enough, fifty digits.
    """
    rng = np.random.default_rng(7)
    regimes = set()
    refused = set()
    for _ in range(250):
        options = bounces.random_options(rng)
        values, impact = bounces.random_bounce(rng, options, wide)
        found = kernel(options, values, impact)
        answer = taylor.solve(options, values, impact)
        status = Status(int(found.status[0, 0])).name
        assert answer.status == status
        if status != "OK":
            refused.add(status)
            assert all(np.isnan(getattr(found, name)[0, 0]) for name in OUTPUTS)
            continue
        made = taylor.Answer("OK", *(getattr(found, name)[0, 0] for name in OUTPUTS))
        # A phase of less than a billionth of the contact may be named or not.
        if distance(made, answer, impact) > 1e-13 or found.regime[0, 0] not in {
            answer.regime(),
            answer.regime(1e-9),
        }:
            answer = taylor.solve(options, values, impact, kind=taylor.FIFTY)
        assert distance(made, answer, impact) < 1e-13, (options, values, impact)
        assert found.regime[0, 0] in {answer.regime(), answer.regime(1e-9)}, (
            options,
            values,
            impact,
        )
        regimes.add(f"{answer.regime(1e-9):o}"[::-1])
    heads = {"1", "2", "132", "131", "231", "232", "31", "32", "12", "134", "234"}
    assert all(any(regime.startswith(head) for regime in regimes) for head in heads)
    assert any("5" in regime for regime in regimes)
    assert max(map(len, regimes)) >= (7 if wide else 5)
    assert refused <= {"TORSION_TOO_SOFT"}
    assert bool(refused) == wide
