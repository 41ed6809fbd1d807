"""Laws that every rebound keeps, whatever solves it: each stands once and runs on every model and on the oracle."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import pytest
from samples import COMPOSITIONS

from fitball.models.oracle import oracle_rebound
from fitball.models.registry import model
from fitball.models.types import Phase, Rebound, unpack_regime
from fitball.values import Ball, FloatArray, Impacts, impacts

# Not those that are told or bend the restitution: there the speeds do not scale together.
TWO_MASS = [
    (name, closures) for name, closures in COMPOSITIONS if closures.get("cor") not in ("measured", "saturating")
]
SOLVERS = [(*one, False) for one in [*TWO_MASS, ("grip-slip", {}), ("brody", {})]]
SOLVERS += [(*one, True) for one in TWO_MASS[:6]]
OFFSETS = ("eps_10", "eps_slope", "offset")
BALL = Ball()
# Near Wang's balls; what a model does not know of these it is not given.
NEAR = {
    "mass_ratio": 0.88, "k_y": 1.9e4, "k_theta": 18.0, "mu": 0.5, "eps_10": 1e-3, "eps_slope": 5e-5, "cor_10": 0.76,
    "cor_slope": -0.012, "zeta_theta": 0.3, "inertia_split": 0.5, "e_x": 0.1, "offset": 1e-3,
}  # fmt: skip
MIRRORED = {Phase.SLIDE_FORWARD: Phase.SLIDE_BACKWARD, Phase.SLIDE_BACKWARD: Phase.SLIDE_FORWARD}


def near(chosen, **changes):
    return {name: {**NEAR, **changes}[name] for name in chosen.parameter_names}


@dataclass(frozen=True)
class Case:
    """A model, or its oracle, with draws of its priors, and impacts from a crawl to a smash, with and against the
    spin.
    """

    model: Any
    oracle: bool
    columns: dict[str, FloatArray]
    at: Impacts

    def rebound(self, at: Impacts | None = None, **changes: Any) -> Rebound:
        """Rebounds (draws, impacts), parameters changed where the model has them."""
        known = {
            name: np.broadcast_to(changes[name], old.shape) for name, old in self.columns.items() if name in changes
        }
        columns, at = {**self.columns, **known}, at or self.at
        if not self.oracle:
            return self.model.rebound(columns, at)
        rows = [dict(zip(columns, row, strict=True)) for row in np.stack([*columns.values()], axis=1)]
        found = [oracle_rebound(self.model.closures, BALL, row, at) for row in rows]
        return Rebound(*(np.stack([getattr(one, field.name) for one in found]) for field in fields(Rebound)))

    def solved(self, **changes: Any) -> tuple[Rebound, Any]:
        """Rebounds, and which there are."""
        found = self.rebound(**changes)
        assert (found.status == 0).mean() > 0.05
        for output in (found.v_x2, found.v_y2, found.omega_2, *([found.contact_time] if self.model.has_time else [])):
            assert np.array_equal(np.isfinite(output), found.status == 0)
        return found, found.status == 0

    @property
    def size(self) -> FloatArray:
        """Speed that differences are compared with."""
        return np.abs(self.at.v_x1) + self.at.v_y1 + BALL.radius * np.abs(self.at.omega_1)

    def apart(self, v_x: FloatArray, omega: FloatArray, where: Any) -> float:
        """The largest of differences of velocity and spin, over the size of the impact."""
        return float(np.max(((np.abs(v_x) + BALL.radius * np.abs(omega)) / self.size)[where], initial=0.0))


def name_of(solver):
    name, closures, oracle = solver
    return " ".join([*(["oracle of"] if oracle else []), name, *map(str, closures.values())])


@pytest.fixture(scope="module", params=SOLVERS, ids=name_of)
def case(request, draw_priors):
    name, closures, oracle = request.param
    chosen, rng = model(name, **closures), np.random.default_rng(1)
    values, count = draw_priors(chosen, rng, 6 if oracle else 300), 4 if oracle else 25
    columns = dict(zip(chosen.parameter_names, values.T, strict=True))
    if oracle and "k_theta" in columns:
        # Stiffer joints make the integration slow.
        columns["k_theta"] = np.minimum(columns["k_theta"], 150.0)
    at = Impacts(
        rng.choice([-1.0, 1.0], count) * 10.0 ** rng.uniform(-1.0, 1.6, count), 10.0 ** rng.uniform(0.0, 1.5, count),
        rng.uniform(-600.0, 600.0, count),
    )  # fmt: skip
    return Case(chosen, oracle, columns, at)


def test_without_friction_nothing_changes_along_the_court(case):
    found, ok = case.solved(mu=0.0, **dict.fromkeys(OFFSETS, 0.0))
    assert case.apart(found.v_x2 - case.at.v_x1, found.omega_2 - case.at.omega_1, ok) < 1e-13


def test_mirror(case):
    one, ok = case.solved()
    turned = {name: -case.columns[name] for name in OFFSETS if name in case.columns}
    other = case.rebound(Impacts(-case.at.v_x1, case.at.v_y1, -case.at.omega_1), **turned)
    assert case.apart(one.v_x2 + other.v_x2, one.omega_2 + other.omega_2, ok) < 1e-11
    here, there = (np.unique(found.regime[ok]) for found in (one, other))
    assert {tuple(MIRRORED.get(phase, phase) for phase in unpack_regime(int(code))) for code in here} == {
        unpack_regime(int(code)) for code in there
    }


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_all_speeds_scale_together(case, factor):
    one, ok = case.solved(cor_slope=0.0, eps_slope=0.0)
    scaled = Impacts(*(factor * speed for speed in (case.at.v_x1, case.at.v_y1, case.at.omega_1)))
    two = case.rebound(scaled, cor_slope=0.0, eps_slope=0.0)
    assert case.apart(one.v_x2 - two.v_x2 / factor, one.omega_2 - two.omega_2 / factor, ok) < 1e-11
    assert np.array_equal(one.regime, two.regime)


def test_only_the_ratio_of_stiffnesses_reaches_the_rebound(case):
    if "k_y" not in case.columns:
        pytest.skip("without springs")
    one, ok = case.solved()
    stiffer = {name: 4.0 * case.columns[name] for name in ("k_y", "k_theta") if name in case.columns}
    two = case.rebound(**stiffer)
    assert case.apart(one.v_x2 - two.v_x2, one.omega_2 - two.omega_2, ok) < 1e-11
    np.testing.assert_allclose(two.contact_time[ok], one.contact_time[ok] / 2.0, rtol=1e-13)


def test_no_energy_comes_from_nowhere(case):
    """The spin is the mean: all motion left after the twist has died out; an offset is a torque of its own."""
    if case.model.options.get("spin") == "shell":
        pytest.skip("the spin is not that of the whole ball")
    found, ok = case.solved(**dict.fromkeys(OFFSETS, 0.0))
    before, after = (
        BALL.mass * v_x**2 + BALL.inertia * omega**2
        for v_x, omega in ((case.at.v_x1, case.at.omega_1), (found.v_x2, found.omega_2))
    )
    assert np.all((after <= before * (1.0 + 1e-12))[ok])
    assert np.all((found.v_y2 <= case.at.v_y1 * (1.0 + 1e-15))[ok])


def test_friction_cone_and_balance_about_the_contact_point(case):
    """`M R (v_x1 - v_x2) - I (omega_2 - omega_1) = eps M (v_y1 + v_y2)`, and friction is at most mu times that."""
    options = case.model.options
    inner, flies = options.get("normal") == "inner", options.get("release") == "zero_displacement"
    if "offset" not in case.columns and (inner or flies or options.get("spin") == "shell"):
        pytest.skip("the normal impulse is not that of the whole ball, or the spin not its own")
    found, ok = case.solved(**(dict.fromkeys(OFFSETS, 0.0) if options.get("offset") == "grip" else {}))
    eps = case.columns.get("offset", 0.0 * case.columns["mu"])[:, None]
    if "eps_10" in case.columns and options["offset"] == "contact":
        eps = case.columns["eps_10"][:, None] + case.columns["eps_slope"][:, None] * (case.at.v_y1 - 10.0)
    normal, lost = case.at.v_y1 + found.v_y2, case.at.v_x1 - found.v_x2
    turned = BALL.inertia / BALL.mass * (found.omega_2 - case.at.omega_1)
    assert case.apart(lost - (turned + eps * normal) / BALL.radius, 0.0, ok) < 1e-11
    assert np.all((np.abs(lost) <= case.columns["mu"][:, None] * normal * (1.0 + 1e-11) + 1e-14)[ok])


def test_a_stiff_joint_is_a_rigid_ball(case):
    """What is left of a joint falls at least with the square root of its compliance: it relaxes as if critical."""
    if "k_theta" not in case.columns or case.model.options["normal"] == "momentum":
        pytest.skip("no joint, or a landing impulse that the shell takes alone")
    rigid = model(case.model.name, **{**case.model.options, "torsion": "rigid"})
    values = {name: case.columns[name][:3] for name in case.columns}
    few = replace(case, columns=values, at=case.at.take(np.arange(3)))
    limit = rigid.rebound({name: values[name] for name in rigid.parameter_names}, few.at)
    ok = limit.status == 0
    gaps = []
    for k_theta in (1e4, 1e6):
        found = few.rebound(k_theta=k_theta)
        gaps.append(few.apart(found.v_x2 - limit.v_x2, found.omega_2 - limit.omega_2, ok & (found.status == 0)))
    assert gaps[1] < 0.15 * gaps[0] or gaps[1] < 1e-9


@pytest.mark.parametrize(("name", "closures"), [*TWO_MASS, ("grip-slip", {})])
def test_no_output_jumps_from_regime_to_regime(name, closures):
    """March the incident angle through all regimes in small steps."""
    chosen = model(name, **closures)
    angle = np.linspace(0.15, 1.5, 20001)
    found = chosen.rebound(near(chosen), impacts(17.0 * np.cos(angle), 17.0 * np.sin(angle), 60.0))
    assert np.unique(found.regime).size >= 2
    for output, scale in ((found.v_x2, 17.0), (found.omega_2, 17.0 / 0.033), (found.v_y2, 17.0)):
        second = np.abs(np.diff(output, 2)) / scale
        # A kink changes the slope, of order one per radian; a jump would show undiminished.
        assert second.max() < 20.0 * (angle[1] - angle[0])


def test_total_mass_and_rigid_torsion_is_brody(wang_impacts):
    rigid, brody = model("two-mass", torsion="rigid", normal="total"), model("brody")
    one = rigid.rebound(near(rigid, eps_10=0.0, eps_slope=0.0), wang_impacts)
    other = brody.rebound(near(brody), wang_impacts)
    np.testing.assert_allclose(one.v_x2, other.v_x2, rtol=1e-13)
    np.testing.assert_allclose(one.v_y2, other.v_y2, rtol=1e-15)
    np.testing.assert_allclose(one.omega_2, other.omega_2, rtol=1e-12, atol=1e-10)


def test_landing_on_a_massless_shell_has_no_impulse(wang_impacts):
    """As the shell's mass vanishes, the momentum closure goes over into the total one."""
    one, other = (
        model("two-mass", normal=normal).rebound(near(model("two-mass"), mass_ratio=1.0 - 1e-7), wang_impacts)
        for normal in ("momentum", "total")
    )
    np.testing.assert_allclose(one.v_x2, other.v_x2, atol=1e-4)
    np.testing.assert_allclose(one.omega_2, other.omega_2, atol=1e-2)


def test_spin_of_a_drop_comes_from_the_offset_alone():
    """A ball dropped without spin that grips at once: the offset turns it as angular momentum demands."""
    chosen = model("grip-slip")
    found = chosen.rebound(near(chosen, e_x=0.0, offset=2e-3, cor_slope=0.0), impacts(0.0, 10.0, 0.0))
    assert unpack_regime(int(found.regime[0])) == (Phase.GRIP,)
    expected = -2e-3 * BALL.mass * 1.76 * 10.0 / (BALL.inertia + BALL.mass * BALL.radius**2)
    np.testing.assert_allclose(found.omega_2, expected, rtol=1e-13)
    np.testing.assert_allclose(found.v_x2, BALL.radius * expected, rtol=1e-13)


def test_a_grip_that_holds_to_the_end_ends_with_the_contact(wang_impacts):
    """The twist has died out long before release: friction and its limit vanish together, without a second slip."""
    parameters = {
        "mass_ratio": 0.3549999758539091, "k_y": 77663.08836292337, "k_theta": 15586.265293157781,
        "mu": 0.1010901235690645, "eps_10": 0.012340829370667807, "eps_slope": -0.0027860229277506445,
        "cor_10": 0.7772245597385539, "cor_slope": -0.016788361283666106,
    }  # fmt: skip
    found = model("thesis-exact").rebound(parameters, wang_impacts)
    assert np.all(np.isfinite(found.omega_2)) and np.all(np.isfinite(found.v_x2))
