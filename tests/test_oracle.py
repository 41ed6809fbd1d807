"""The Taylor oracle against other digits and another arithmetic; the kernels against the oracle."""

import mpmath
import numpy as np
import pytest
from support import answers, bounces, taylor, taylor_series
from support.taylor import OUTPUTS

import fitball
from fitball.base.values import Ball, Impacts
from fitball.models.types import Status


def distance(one, other, impact, outputs=OUTPUTS):
    """The largest difference of two answers over the scale of an output."""
    scales = answers.scales(impact, other.contact_time, other.gap_time)
    sizes = dict(zip(OUTPUTS, scales, strict=True))
    distances = []
    for name in outputs:
        difference = float(getattr(one, name)) - float(getattr(other, name))
        distances.append(abs(difference) / sizes[name])
    return max(distances)


def test_digits_beyond_change_nothing_and_another_arithmetic_agrees():
    """Sixty digits against thirty, of decimal numbers and of mpmath's."""
    few = taylor_series.FIFTY._replace(digits=30)
    binary = taylor_series.Numbers(mpmath.mpf, mpmath.sqrt, mpmath.log, 30)
    rng = np.random.default_rng(2)
    for options in (bounces.random_options(rng), bounces.random_options(rng)):
        values, impact = bounces.random_bounce(rng, options)
        exact = taylor.solve(options, values, impact, kind=taylor_series.FIFTY)
        assert exact.status == "OK"
        with mpmath.workdps(30):
            for kind in (few, binary):
                other = taylor.solve(options, values, impact, kind=kind)
                for name in OUTPUTS:
                    wanted = mpmath.mpf(str(getattr(exact, name)))
                    number = mpmath.mpf(str(getattr(other, name)))
                    assert abs(number - wanted) < mpmath.mpf("1e-24") * abs(wanted)


def kernel(options, values, impact):
    """The rebound by the kernel, (1, 1)."""
    model = fitball.model(bounces.text_of(options), ball=Ball(*taylor.BALL))
    names = [spec.name for spec in model.parameters]
    row = [values[name] for name in names]
    states = Impacts(*(np.array([number]) for number in impact))
    return model.solve(model.ball, names, np.array([row]), states, None)


def names_its_regime(answer, regime):
    """Whether the phases are those of the answer; one of less than a billionth of the contact may
    be named or not.
    """
    return regime in {answer.regime(), answer.regime(1e-9)}


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
        numbers = [getattr(found, name)[0, 0] for name in OUTPUTS]
        if status != "OK":
            # Other laws end where restitution would be none; the oracle says so too.
            if options["cor"] == "saturating":
                refused.add(status)
            assert np.isnan(numbers).all()
            continue
        case = (options, values, impact)
        of_kernel = taylor.Answer("OK", *numbers)
        regime = found.regime[0, 0]
        agrees = distance(of_kernel, answer, impact) <= 1e-13
        if not agrees or not names_its_regime(answer, regime):
            answer = taylor.solve(options, values, impact, kind=taylor_series.FIFTY)
        assert distance(of_kernel, answer, impact) < 1e-13, case
        assert names_its_regime(answer, regime), case
        regimes.add(f"{answer.regime(1e-9):o}"[::-1])
    for head in ("1", "2", "132", "131", "231", "232", "31", "32", "12", "134", "234"):
        assert any(regime.startswith(head) for regime in regimes), head
    assert any("5" in regime for regime in regimes)
    longest = max(map(len, regimes))
    assert longest >= (7 if wide else 5)
    assert refused <= {"TORSION_TOO_SOFT"}
    assert bool(refused) == wide
