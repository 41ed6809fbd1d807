"""The oracle against itself at fifty digits; the laws that it keeps stand in `test_laws.py`."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from oracle_case import AS_THE_THESIS, BALL, DEFAULT, PARAMETERS, distance

from fitball.models.oracle import oracle_rebound
from fitball.models.types import Closures, Phase, Status, unpack_regime
from fitball.values import Impacts, impacts

Case = tuple[Closures, dict[str, float], Impacts]


def random_case(rng: np.random.Generator, **fixed: str) -> Case:
    """Closures, parameters and one impact, wide enough to reach every regime; `fixed` pins closures."""
    options = {
        "release": ["zero_displacement", "zero_force"],
        "normal": ["inner", "momentum", "total"],
        "offset": ["grip", "contact"],
        "spin": ["shell", "mean"],
        "inertia": ["tied", "table"],
        "torsion": ["matched", "free", "rigid"],
        "cor": ["line", "mean", "saturating"],
    }
    chosen: dict[str, Any] = {name: str(rng.choice(values)) for name, values in options.items()} | fixed
    closures = Closures(**chosen)
    mass_ratio = rng.uniform(0.4, 0.95)
    parameters = {
        "mass_ratio": mass_ratio,
        "k_y": 10 ** rng.uniform(4.0, 4.7),
        "k_theta": 10 ** rng.uniform(1.2, 2.5),
        "mu": float(rng.choice([0.1, 0.3, 0.55, 1.0])),
        "eps_10": 3e-3 * rng.normal(),
        "eps_slope": 1e-4 * rng.normal(),
        "cor_10": rng.uniform(0.4, 0.9) * (mass_ratio if closures.normal == "momentum" else 1.0),
        "cor_slope": 1e-3 * rng.normal(),
        "zeta_theta": 10 ** rng.uniform(-2.0, 0.3),
        "inertia_split": rng.uniform(0.2, 0.8),
    }
    v_x1 = rng.uniform(-30.0, 30.0) * rng.choice([1.0, 0.1])
    return closures, parameters, impacts(v_x1, rng.uniform(5.0, 25.0), rng.uniform(-500.0, 500.0))


def random_cases(seed: int, count: int, **fixed: str) -> list[Case]:
    """Cases that have a solution."""
    rng, cases = np.random.default_rng(seed), list[Case]()
    for _ in range(4 * count + 4):
        case = random_case(rng, **fixed)
        if oracle_rebound(case[0], BALL, case[1], case[2]).status[0] == Status.OK:
            cases.append(case)
    assert len(cases) >= count
    return cases[:count]


@pytest.mark.parametrize("seed", range(100, 108))
def test_agrees_with_fifty_digits(seed: int) -> None:
    [(closures, parameters, at)] = random_cases(seed, 1)
    double, exact = (oracle_rebound(closures, BALL, parameters, at, digits) for digits in (None, 50))
    assert double.regime[0] == exact.regime[0]
    assert distance(double, exact, at) < 1e-13
    assert double.contact_time[0] == pytest.approx(exact.contact_time[0], rel=1e-14, abs=0)


@pytest.mark.parametrize("zeta_theta", [1.0, 1.0 - 1e-9, 1.0 + 1e-9])
def test_critical_torsion_is_no_special_case(zeta_theta: float) -> None:
    closures, at = replace(DEFAULT, torsion="free"), impacts(15.0, 10.0, 100.0)
    parameters = PARAMETERS | {"zeta_theta": zeta_theta}
    double, exact = (oracle_rebound(closures, BALL, parameters, at, digits) for digits in (None, 50))
    assert distance(double, exact, at) < 1e-13


def test_grazing_the_friction_cone_is_seen() -> None:
    # Just beyond v_x1 = 6.525961083 m/s the grip leaves its cone for a thousandth of the contact and so
    # turns into a hold; whoever samples past that dip is wrong by three radians a second.
    closures = replace(AS_THE_THESIS, torsion="free")
    parameters, at = PARAMETERS | {"eps_10": 5e-3, "mu": 0.3}, impacts([6.52596, 6.525963], 12.0, 80.0)
    double, exact = (oracle_rebound(closures, BALL, parameters, at, digits) for digits in (None, 50))
    assert Phase.HOLD not in unpack_regime(int(exact.regime[0]))
    assert Phase.HOLD in unpack_regime(int(exact.regime[1]))
    assert double.regime.tolist() == exact.regime.tolist()
    # The square root at the grazing takes half the digits from the instant at which the grip ends.
    assert distance(double, exact, at) < 1e-11


def test_digits_beyond_double_change_nothing() -> None:
    at = impacts([15.0, 1.0], [10.0, 15.0], [100.0, 300.0])
    few = oracle_rebound(DEFAULT, BALL, PARAMETERS, at, digits=30)
    many = oracle_rebound(DEFAULT, BALL, PARAMETERS, at, digits=70)
    np.testing.assert_array_equal(few.v_x2, many.v_x2)
    np.testing.assert_array_equal(few.omega_2, many.omega_2)
