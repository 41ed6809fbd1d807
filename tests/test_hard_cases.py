"""The catalogue of hard impacts against fifty digits, marches over regime boundaries, and the ends of all ranges."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

import fitball
from fitball.bench.problems import BASE, FAST, HardCase, hard_cases
from fitball.errors import ParameterError
from fitball.models.oracle import oracle_rebound
from fitball.models.specs import SPECS
from fitball.models.types import STATUS_REASON, Phase, Status, unpack_regime

CASES = {case.name: case for case in hard_cases()}
ANSWERS = {
    row["name"]: row
    for row in csv.DictReader(
        (Path(__file__).parent / "data" / "hard_cases.csv").read_text(encoding="utf-8").splitlines()
    )
}
# Of the incident speed at the ball's surface, for cases known to fifty digits: docs/speed.md says so. The worst is
# off by 5.2e-16, alike on processors with and without fused multiply-add.
TOLERANCE = 1e-15
# Where the answer is known in double precision only, its own error counts: a joint that turns or decays by thousands
# of radians in one contact costs the matrix exponential that many roundings.
DOUBLE = 1e-14
WORSE = {"mass_ratio 1 less 1e-6": 2e-10, "share of inertia 0.9999": 2e-13}
# Phases shorter than rounding: the sequence may name them or not.
FLEETING = {"k_theta = 1e7, matched", "k_theta = 1e8, matched", "restitution 1 less 1e-15 of the whole mass"}
RADIUS = fitball.Ball().radius


def solve(case):
    """Raw arrays of the kernel, (1, 1), without the checks of a direct call."""
    names = case.model.parameter_names
    return case.model.evaluate(names, np.array([[case.parameters[name] for name in names]]), case.impacts)


def size_of(case):
    v_x, v_y, omega = case.impact
    return float(np.hypot(v_x, v_y) + RADIUS * abs(omega))


@pytest.mark.parametrize("name", CASES)
def test_hard_case(name):
    case, answer = CASES[name], ANSWERS[name]
    found = solve(case)
    assert Status(int(found.status[0, 0])).name == answer["status"]
    size = size_of(case)
    tolerance = WORSE.get(name, TOLERANCE if answer["digits"] == "50" else DOUBLE) * size
    assert found.v_x2[0, 0] == pytest.approx(float(answer["v_x2"]), rel=0, abs=tolerance)
    assert RADIUS * found.omega_2[0, 0] == pytest.approx(RADIUS * float(answer["omega_2"]), rel=0, abs=tolerance)
    assert found.v_y2[0, 0] == pytest.approx(float(answer["v_y2"]), rel=TOLERANCE, abs=0)
    assert found.contact_time[0, 0] == pytest.approx(float(answer["contact_time"]), rel=TOLERANCE, abs=0)
    if name not in FLEETING:
        assert unpack_regime(int(found.regime[0, 0])) == unpack_regime(int(answer["regime"]))


def test_the_documentation_says_what_is_held():
    page = (Path(__file__).parent.parent / "docs" / "speed.md").read_text(encoding="utf-8").replace("\n", " ")
    assert f"A catalogue of {len(CASES)} hard impacts" in page
    assert f"stays below {TOLERANCE:.0e} wherever fifty digits are known" in page
    assert {ANSWERS[name]["digits"] for name in WORSE} == {"16"}


def test_answers_are_those_of_the_catalogue():
    assert list(ANSWERS) == list(CASES)
    assert sum(row["digits"] == "50" for row in ANSWERS.values()) > 75
    for name in ("torsional pole on the vertical one exactly", "grip broken at once", "negative offset"):
        case = CASES[name]
        found = oracle_rebound(case.model.closures, case.model.ball, case.parameters, case.impacts, digits=50)
        assert repr(float(found.omega_2[0])) == ANSWERS[name]["omega_2"]


def test_the_catalogue_is_hard():
    """It holds reversals, broken and renewed grips, holds, and contacts of many phases."""
    sequences = [unpack_regime(int(row["regime"])) for row in ANSWERS.values()]
    assert any(Phase.SLIDE_BACKWARD in item and Phase.SLIDE_FORWARD in item for item in sequences)
    assert any(Phase.HOLD in item for item in sequences)
    assert any(item[:1] == (Phase.GRIP,) for item in sequences)
    assert max(map(len, sequences)) >= 10


@pytest.mark.parametrize("name", [name for name in CASES if name.endswith("1e-9 before")])
def test_marching_over_a_boundary(name):
    """At steps of 1e-12 in friction the rebound moves by no more than that, times its steepness."""
    case = CASES[name]
    edge = case.parameters["mu"] / (1.0 - 1e-9)
    steps = np.linspace(-2e-9, 2e-9, 4001)
    names = case.model.parameter_names
    values = np.array([[case.parameters[key] for key in names]] * steps.size)
    values[:, names.index("mu")] = edge + edge * steps
    found = case.model.evaluate(names, values, case.impacts)
    assert len(set(found.regime[:, 0].tolist())) > 1
    for output in (found.v_x2[:, 0], RADIUS * found.omega_2[:, 0]):
        # A grip that sets in or breaks does so with the square root of the distance at worst.
        assert np.max(np.abs(np.diff(output))) < 1e-9 * size_of(case)


def test_a_shell_without_inertia_is_named():
    case = HardCase("", changes={"mass_ratio": 1.0})
    assert solve(case).status[0, 0] == Status.NO_INERTIA
    with pytest.raises(ParameterError, match="has no inertia"):
        case.model.rebound(case.parameters, case.impacts)


def test_every_failure_has_a_reason_and_nothing_else_is_nan():
    assert set(STATUS_REASON) == set(Status)
    rng = np.random.default_rng(12)
    names = fitball.model("two-mass").parameter_names
    values = np.array([[BASE[name] for name in names]] * 3000)
    for column, name in enumerate(names):
        if name in ("mass_ratio", "cor_10"):
            values[:, column] = rng.uniform(0.05, 1.0, 3000)
        elif name in ("k_y", "k_theta"):
            values[:, column] *= np.exp(3.0 * rng.standard_normal(3000))
    found = fitball.model("two-mass").evaluate(
        names, values, fitball.impacts([14.0, 2.0], [12.0, 20.0], [100.0, 0.0])
    )
    failed = found.status != Status.OK
    assert failed.any()
    assert (~failed).any()
    for output in (found.v_x2, found.v_y2, found.omega_2, found.contact_time):
        assert (np.isnan(output) == failed).all()


def test_a_shell_almost_without_mass_is_followed():
    """Poles of 2e7/s beside 350/s: time and digits stay bounded, and the rebound settles as the shell vanishes."""
    names = fitball.model("two-mass").parameter_names
    left = 10.0 ** -np.arange(2.0, 16.0)
    values = np.array([[BASE[name] for name in names]] * left.size)
    values[:, names.index("mass_ratio")] = 1.0 - left
    values[:, names.index("k_theta")] = 408.0
    found = fitball.model("two-mass").evaluate(names, values, fitball.impacts(*FAST))
    assert (found.status == Status.OK).all()
    steps = np.abs(np.diff(found.v_x2[:, 0]))
    assert (steps[2:] < 0.5 * steps[1:-1]).all()


def test_a_joint_too_rapid_to_follow_is_refused():
    chosen = fitball.model("two-mass", torsion="free")
    parameters = {**BASE, "mass_ratio": 1.0 - 5.4e-9, "k_theta": 1e8, "zeta_theta": 1e-8}
    names = chosen.parameter_names
    values = np.array([[parameters[name] for name in names]])
    impact = fitball.impacts(*FAST)
    assert chosen.evaluate(names, values, impact).status[0, 0] == Status.TOO_RAPID
    with pytest.raises(ParameterError, match="too fast"):
        chosen.rebound({name: parameters[name] for name in names}, impact)


@pytest.mark.parametrize("closures", [{}, {"torsion": "free"}, {"offset": "grip"}, {"inertia": "table"}], ids=str)
def test_anything_within_bounds_is_solved_or_refused(closures):
    """Over the whole range of every parameter, its edges included."""
    chosen = fitball.model("two-mass", **closures)
    rng = np.random.default_rng(5)
    columns = []
    for name in chosen.parameter_names:
        spec = SPECS[name]
        if spec.lower > 0.0 and spec.upper > 50.0 * spec.lower:
            columns.append(np.exp(rng.uniform(np.log(spec.lower), np.log(spec.upper), 1500)))
        else:
            near = (spec.upper - spec.lower) * 10.0 ** rng.uniform(-16.0, 0.0, 1500)
            columns.append(np.where(rng.random(1500) < 0.5, spec.upper - near, spec.lower + near))
    sign = rng.choice([-1.0, 1.0], (2, 4))
    speeds = fitball.impacts(
        sign[0] * 10.0 ** rng.uniform(-6.0, 2.0, 4), 10.0 ** rng.uniform(-2.0, 2.0, 4),
        sign[1] * 10.0 ** rng.uniform(-3.0, 4.0, 4),
    )  # fmt: skip
    found = chosen.evaluate(chosen.parameter_names, np.stack(columns, axis=1), speeds)
    solved = found.status == Status.OK
    assert 0.05 < solved.mean() < 0.95
    for output in (found.v_x2, found.v_y2, found.omega_2, found.contact_time):
        assert (np.isfinite(output) == solved).all()
