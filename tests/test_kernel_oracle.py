"""The closed-form solver against the independent integration, over prior draws and every closure."""

from __future__ import annotations

import numpy as np
import pytest
from samples import COMPOSITIONS

from fitball.models.oracle import oracle_rebound
from fitball.models.registry import model
from fitball.models.two_mass import TwoMassModel
from fitball.models.types import Phase, Status, unpack_regime
from fitball.values import Impacts

DRAWS = 100
# Stiffer joints make the integration that serves as oracle slow, not the solver; the hard cases have them.
SOFT_ENOUGH = 150.0


@pytest.mark.parametrize(("name", "closures"), COMPOSITIONS)
def test_rebound_agrees_with_integration(name, closures, wang_impacts, draw_priors):
    chosen = model(name, **closures)
    assert isinstance(chosen, TwoMassModel)
    rng = np.random.default_rng(20041)
    values = draw_priors(chosen, rng, DRAWS)
    names = chosen.parameter_names
    if "k_theta" in names:
        column = names.index("k_theta")
        values = values[values[:, column] < SOFT_ENOUGH]
    solved = 0
    for row in values:
        k = int(rng.integers(len(wang_impacts)))
        impact = Impacts(
            wang_impacts.v_x1[k : k + 1],
            wang_impacts.v_y1[k : k + 1],
            wang_impacts.omega_1[k : k + 1],
            np.array([0.6 + 0.3 * rng.uniform()]),
        )
        fast = chosen.evaluate(names, row[None, :], impact)
        slow = oracle_rebound(chosen.closures, chosen.ball, dict(zip(names, row, strict=True)), impact)
        assert fast.status[0, 0] == slow.status[0]
        if fast.status[0, 0] != Status.OK:
            assert np.isnan(fast.v_x2[0, 0])
            continue
        solved += 1
        assert unpack_regime(int(fast.regime[0, 0])) == unpack_regime(int(slow.regime[0]))
        speed = float(np.hypot(impact.v_x1[0], impact.v_y1[0]))
        # 1e-11 of the incident speed: both sides round at 1e-16 over some hundred operations, and an event
        # time is only as sharp as the slope of its function.
        assert abs(fast.v_x2[0, 0] - slow.v_x2[0]) < 1e-11 * speed
        assert abs(fast.v_y2[0, 0] - slow.v_y2[0]) < 1e-14 * speed
        assert abs(fast.omega_2[0, 0] - slow.omega_2[0]) < 1e-11 * speed / chosen.ball.radius
        time, fastest = slow.contact_time[0], speed / chosen.ball.radius + abs(impact.omega_1[0])
        assert abs(fast.contact_time[0, 0] - time) < 1e-13 * time
        assert abs(fast.gap_time[0, 0] - slow.gap_time[0]) < 1e-13 * time
        assert abs(fast.gap_path[0, 0] - slow.gap_path[0]) < 1e-12 * speed * time
        assert abs(fast.gap_turn[0, 0] - slow.gap_turn[0]) < 1e-12 * fastest * time
    assert solved > 20


def test_the_sample_holds_every_kind_of_phase(wang_impacts, draw_priors):
    """What the comparison above covers: first and second slip, both directions, grip from the start."""
    rng = np.random.default_rng(5)
    chosen = model("two-mass", offset="grip")
    found = chosen.evaluate(chosen.parameter_names, draw_priors(chosen, rng, 400), wang_impacts)
    sequences = {unpack_regime(int(code)) for code in np.unique(found.regime[found.status == 0])}
    forward, backward = Phase.SLIDE_FORWARD, Phase.SLIDE_BACKWARD
    assert {(forward,), (forward, Phase.GRIP, backward), (forward, Phase.GRIP, forward)} <= sequences
    assert any(sequence[0] is Phase.GRIP for sequence in sequences)
    assert any(Phase.HOLD in sequence for sequence in sequences)


def test_landing_impulse_matters(wang_impacts):
    """Without the landing impulse a light shell would leave the same rebound as none: it must not."""
    parameters = {
        "mass_ratio": 0.87, "k_y": 1.9e4, "k_theta": 18.0, "mu": 0.56, "eps_10": 2.4e-3,
        "eps_slope": 0.0, "cor_10": 0.776, "cor_slope": -0.0158,
    }  # fmt: skip
    with_impulse = model("two-mass").rebound(parameters, wang_impacts)
    inner = model("two-mass", normal="inner").rebound(parameters, wang_impacts)
    sliding = with_impulse.regime == int(Phase.SLIDE_FORWARD)
    assert sliding.any()
    # Sliding throughout, the loss of v_x is mu times all of the normal impulse, M v_y1 (1 + COR).
    cor = 0.776 - 0.0158 * (wang_impacts.v_y1 - 10.0)
    loss = (wang_impacts.v_x1 - with_impulse.v_x2)[sliding]
    np.testing.assert_allclose(loss, (0.56 * wang_impacts.v_y1 * (1.0 + cor))[sliding], rtol=1e-12)
    assert np.all((wang_impacts.v_x1 - inner.v_x2)[sliding] < 0.95 * loss)
