"""Laws that every rebound keeps, whatever solves it: a table of laws, each run on all models it
holds for.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import answers, bounces, taylor
from support.taylor import OUTPUTS

import fitball
from fitball.base.values import Ball, Impacts

BALL = Ball()
INERTIA = BALL.inertia_ratio * BALL.mass * BALL.radius**2
OFFSETS = ("eps_10", "eps_slope", "offset")
MIRRORED = str.maketrans("12", "21")


@dataclass(frozen=True)
class Case:
    """A model with random parameters (draws,), and impacts from a crawl to a smash, with and
    against the spin.
    """

    model: Any
    columns: dict
    at: Impacts

    @property
    def options(self):
        return dict(self.model.options)

    @property
    def timed(self):
        return self.model.timed

    def rebound(self, at=None, **changes):
        """Rebounds (draws, impacts), parameters changed where the model has them."""
        columns = {key: changes.get(key, old) + 0.0 * old for key, old in self.columns.items()}
        return self.model.evaluate([*columns], np.stack([*columns.values()], axis=1), at or self.at)

    def solved(self, **changes):
        """Rebounds, and which there are."""
        found = self.rebound(**changes)
        ok = found.status == 0
        assert ok.mean() > 0.5
        for name in OUTPUTS[: 7 if self.timed else 3]:
            assert np.array_equal(np.isfinite(getattr(found, name)), ok)
        return found, ok

    @property
    def size(self):
        """Speed that differences are compared with."""
        return np.hypot(self.at.v_x1, self.at.v_y1) + BALL.radius * np.abs(self.at.omega_1)

    def apart(self, v_x, omega, where):
        """The largest of differences of velocity and spin, over the size of the impact."""
        return float(
            np.max(((np.abs(v_x) + BALL.radius * np.abs(omega)) / self.size)[where], initial=0.0)
        )


def case_of(name, options):
    rng = np.random.default_rng(11)
    model = fitball.model(name if options is None else bounces.text_of(options))
    drawn = [bounces.random_bounce(rng, options or bounces.DEFAULT)[0] for _ in range(200)]
    for row in drawn:
        # e_x and offset of grip-slip and brody, which have no mass ratio to stay below.
        row |= {"e_x": rng.uniform(-0.3, 0.6), "offset": 3e-3 * rng.standard_normal()}
    columns = {spec.name: np.array([row[spec.name] for row in drawn]) for spec in model.parameters}
    along = rng.choice([-1.0, 1.0], 20) * 10.0 ** rng.uniform(-1.0, 1.6, 20)
    return Case(
        model,
        columns,
        Impacts(along, 10.0 ** rng.uniform(0.0, 1.5, 20), rng.uniform(-600.0, 600.0, 20)),
    )


CASES = [case_of("", options) for options in bounces.COMPOSITIONS]
CASES += [case_of(name, None) for name in ("grip-slip", "brody")]


def nothing_changes_along_the_court_without_friction(case):
    found, ok = case.solved(mu=0.0, **dict.fromkeys(OFFSETS, 0.0))
    assert case.apart(found.v_x2 - case.at.v_x1, found.omega_2 - case.at.omega_1, ok) < 2e-14
    if case.timed:
        # It goes on as it came, in place and in turn.
        for gap, rate in ((found.gap_path, case.at.v_x1), (found.gap_turn, case.at.omega_1)):
            assert_allclose(gap[ok], (rate * found.gap_time)[ok], rtol=1e-11, atol=1e-13)


def a_mirror_turns_speed_spin_and_offset(case):
    one, ok = case.solved()
    turned = {name: -case.columns[name] for name in OFFSETS if name in case.columns}
    other = case.rebound(Impacts(-case.at.v_x1, case.at.v_y1, -case.at.omega_1), **turned)
    assert case.apart(one.v_x2 + other.v_x2, one.omega_2 + other.omega_2, ok) < 1e-12
    seen = [{f"{code:o}" for code in np.unique(found.regime[ok])} for found in (one, other)]
    assert {code.translate(MIRRORED) for code in seen[0]} == seen[1]


def all_speeds_scale_together(case):
    one, ok = case.solved(cor_slope=0.0, eps_slope=0.0)
    for factor in (1e3, 1e-3):
        scaled = Impacts(
            *(factor * speed for speed in (case.at.v_x1, case.at.v_y1, case.at.omega_1))
        )
        two = case.rebound(scaled, cor_slope=0.0, eps_slope=0.0)
        assert (
            case.apart(one.v_x2 - two.v_x2 / factor, one.omega_2 - two.omega_2 / factor, ok) < 1e-12
        )
        assert np.array_equal(one.regime, two.regime)


def only_the_ratio_of_stiffnesses_reaches_the_rebound(case):
    one, ok = case.solved()
    two = case.rebound(**{name: 4.0 * case.columns[name] for name in ("k_y", "k_theta")})
    assert case.apart(one.v_x2 - two.v_x2, one.omega_2 - two.omega_2, ok) < 1e-12
    assert_allclose(two.contact_time[ok], one.contact_time[ok] / 2.0, rtol=1e-13)
    assert_allclose(two.gap_time[ok], one.gap_time[ok] / 2.0, rtol=1e-13)


def no_energy_comes_from_nowhere(case):
    """The spin is the mean: all motion left after the twist has died out; an offset is a torque of
    its own.
    """
    found, ok = case.solved(**dict.fromkeys(OFFSETS, 0.0))
    before, after = (
        BALL.mass * v_x**2 + INERTIA * omega**2
        for v_x, omega in ((case.at.v_x1, case.at.omega_1), (found.v_x2, found.omega_2))
    )
    assert np.all((after <= before * (1.0 + 1e-12))[ok])
    assert np.all((found.v_y2 < case.at.v_y1 * (1.0 + 1e-15))[ok])


def angular_momentum_about_the_contact_point_is_kept(case):
    """`M R (v_x1 - v_x2) - I (omega_2 - omega_1) = eps M (v_y1 + v_y2)`, and friction is at most mu
    times that.
    """
    grip = case.options.get("offset") == "grip"
    found, ok = case.solved(**(dict.fromkeys(OFFSETS, 0.0) if grip else {}))
    if case.timed:
        eps = 0.0
        if not grip:
            eps = case.columns["eps_10"][:, None] + case.columns["eps_slope"][:, None] * (
                case.at.v_y1 - 10.0
            )
    else:
        eps = case.columns.get("offset", 0.0 * case.columns["mu"])[:, None]
    normal = case.at.v_y1 + found.v_y2
    lost = case.at.v_x1 - found.v_x2
    turned = INERTIA / BALL.mass * (found.omega_2 - case.at.omega_1)
    assert case.apart(lost - (turned + eps * normal) / BALL.radius, 0.0, ok) < 3e-13
    assert np.all(
        (np.abs(lost) <= case.columns["mu"][:, None] * normal * (1.0 + 1e-12) + 1e-14)[ok]
    )


def a_stiff_joint_is_a_rigid_ball(case):
    """What is left of a joint falls with its compliance: `normal=total` goes over into `brody`."""
    brody = fitball.model("brody")
    names = [spec.name for spec in brody.parameters]
    limit = brody.evaluate(names, np.stack([case.columns[name] for name in names], axis=1), case.at)
    gaps = []
    for factor in (1.0, 1e3):
        found, ok = case.solved(k_theta=factor * case.columns["k_y"], **dict.fromkeys(OFFSETS, 0.0))
        gaps.append(case.apart(found.v_x2 - limit.v_x2, found.omega_2 - limit.omega_2, ok))
    assert gaps[1] < 1e-11
    assert gaps[1] < 0.1 * gaps[0]


def no_output_jumps_from_regime_to_regime(case):
    """March the incident angle through all regimes in small steps."""
    angle = np.linspace(0.15, 1.5, 20001)
    at = Impacts(17.0 * np.cos(angle), 17.0 * np.sin(angle), np.full(angle.size, 60.0))
    near = {
        "mass_ratio": 0.88,
        "k_y": 1.9e4,
        "k_theta": 18.0,
        "mu": 0.5,
        "eps_10": 1e-3,
        "eps_slope": 5e-5,
        "cor_10": 0.76,
        "cor_slope": -0.012,
        "zeta_theta": 0.3,
        "inertia_split": 0.5,
        "e_x": 0.1,
        "offset": 1e-3,
    }
    found = case.model.evaluate(
        [*case.columns],
        np.array([[near[name] for name in case.columns]]),
        at,
    )
    assert np.unique(found.regime).size >= 2
    scales = answers.scales((17.0, 0.0, 0.0), 5e-3, 5e-3)
    for name, scale in list(zip(OUTPUTS, scales, strict=True))[: 7 if case.timed else 3]:
        # A kink changes the slope, of order one a radian; a jump would show undiminished.
        assert np.max(np.abs(np.diff(getattr(found, name)[0], 2))) / scale < 20.0 * (
            angle[1] - angle[0]
        )


def restitution_follows_the_one_law(case):
    """Written out in the oracle; in (0, c), while the speed of rebound grows, from a crawl to
    beyond any serve.
    """
    speeds = np.geomspace(1e-3, 1e3, 25)
    found = case.rebound(Impacts(np.full(25, 3.0), speeds, np.zeros(25)))
    cor = found.v_y2 / speeds
    ok = found.status == 0
    assert ok.mean() > 0.5
    cap = (
        case.columns["mass_ratio"]
        if case.options.get("normal") == "momentum"
        else np.ones(len(cor))
    )
    for row, top, good, cor_10, slope in zip(
        cor,
        cap,
        ok,
        case.columns["cor_10"],
        case.columns["cor_slope"],
        strict=True,
    ):
        wanted = np.array([taylor.law(cor_10, slope, top, v, np.log) for v in speeds])
        assert_allclose(row[good], wanted[good], rtol=1e-12)
        assert np.all((row[good] > 0.0) & (row[good] <= top * (1.0 + 1e-15)))
        # What has saturated grows by less than rounding.
        grown = (row * speeds)[good]
        assert np.all(np.diff(grown) > -1e-14 * grown[1:])


def a_course_is_that_of_the_oracle(case):
    """Position, velocity, spins and twist at five times of two contacts."""
    for draw, place in ((3, 2), (8, 5)):
        values = {name: float(column[draw]) for name, column in case.columns.items()}
        state = [float(column[place]) for column in (case.at.v_x1, case.at.v_y1, case.at.omega_1)]
        end = float(case.model.rebound(values, fitball.impacts(*state)).contact_time[0])
        times = np.linspace(0.05, 1.0, 5) * end
        found = case.model.history(values, fitball.impacts(*state), times).courses
        for k, time in enumerate(times):
            y, v_y, v_x, core, shell, twist = taylor.solve(
                case.options,
                values,
                state,
                until=time,
            ).state[:6]
            speed = case.size[place]
            wanted = {
                "y": (y, speed * end),
                "v_y": (v_y, speed),
                "v_x": (v_x, speed),
                "twist": (twist, 1.0),
            }
            # With spin=mean a course ends with one spin.
            if k < 4:
                wanted |= {
                    "omega_core": (core, speed / BALL.radius),
                    "omega_shell": (shell, speed / BALL.radius),
                }
            for name, (exact, scale) in wanted.items():
                assert abs(found[name][k] - exact) < 1e-12 * scale, (name, k)


def _is(**wanted):
    return lambda case: case.timed and all(case.options[k] in v for k, v in wanted.items())


def _is_whole(case):
    """The normal impulse is that of the whole ball, its spin its own, no force before the release
    pulls.
    """
    o = case.options
    return not case.timed or (
        o["normal"] != "inner" and o["release"] == "zero_force" and o["spin"] == "mean"
    )


def always(case):
    return True


def is_timed(case):
    return case.timed


LAWS = {
    nothing_changes_along_the_court_without_friction: always,
    a_mirror_turns_speed_spin_and_offset: always,
    all_speeds_scale_together: always,
    only_the_ratio_of_stiffnesses_reaches_the_rebound: is_timed,
    no_energy_comes_from_nowhere: lambda case: case.options.get("spin") != "shell",
    angular_momentum_about_the_contact_point_is_kept: _is_whole,
    a_stiff_joint_is_a_rigid_ball: _is(normal=["total"], torsion=["matched"]),
    no_output_jumps_from_regime_to_regime: always,
    restitution_follows_the_one_law: always,
    a_course_is_that_of_the_oracle: _is(),
}


@pytest.mark.parametrize(
    ("law", "case"),
    [(law, case) for law, holds in LAWS.items() for case in CASES if holds(case)],
    ids=lambda one: one.model.text if isinstance(one, Case) else one.__name__,
)
def test_law(law, case):
    law(case)


def test_a_grip_that_holds_to_the_end_ends_with_the_contact():
    """The twist has died out long before release: friction and its limit vanish together, without a
    second slip.
    """
    values = {
        "mass_ratio": 0.3549999758539091,
        "k_y": 77663.08836292337,
        "k_theta": 15586.265293157781,
        "mu": 0.1010901235690645,
        "eps_10": 0.012340829370667807,
        "eps_slope": -0.0027860229277506445,
        "cor_10": 0.7772245597385539,
        "cor_slope": -0.016788361283666106,
    }
    rng = np.random.default_rng(2)
    states = fitball.impacts(
        rng.uniform(3.0, 17.0, 60),
        rng.uniform(4.0, 17.0, 60),
        rng.uniform(-200.0, 200.0, 60),
    )
    found = fitball.model("thesis-exact").rebound(values, states)
    assert np.all(np.isfinite(found.omega_2))
    assert np.all(np.isfinite(found.v_x2))
