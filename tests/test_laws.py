"""Laws that every solver keeps, with an offset towards positive v_x whichever way the ball flies: a
table of laws, each run on all models it holds for.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support import answers, bounces, taylor
from support.taylor import OUTPUTS
from support.travel import acting

import fitball
from fitball.base.values import Ball, Impacts

BALL = Ball(*taylor.BALL)
INERTIA = BALL.inertia_ratio * BALL.mass * BALL.radius**2
OFFSETS = ("eps_10", "eps_slope", "offset")
WITHOUT_OFFSET = dict.fromkeys(OFFSETS, 0.0)
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

    @property
    def outputs(self):
        return OUTPUTS[:7] if self.timed else OUTPUTS[:3]

    def rebound(self, at=None, **changes):
        """Rebounds (draws, impacts), parameters changed where the model has them."""
        columns = []
        for name, column in self.columns.items():
            value = changes.get(name, column)
            columns.append(np.broadcast_to(value, column.shape))
        values = np.stack(columns, axis=1)
        return self.model.solve(BALL, [*self.columns], values, at or self.at, None)

    def solved(self, **changes):
        """Rebounds, and which there are."""
        rebounds = self.rebound(**changes)
        ok = rebounds.status == 0
        assert ok.mean() > 0.5
        for name in self.outputs:
            assert np.array_equal(np.isfinite(getattr(rebounds, name)), ok)
        return rebounds, ok

    @property
    def size(self):
        """Speed that differences are compared with."""
        return np.hypot(self.at.v_x1, self.at.v_y1) + BALL.radius * np.abs(self.at.omega_1)

    def apart(self, v_x, omega, where):
        """The largest of differences of velocity and spin, over the size of the impact."""
        difference = np.abs(v_x) + BALL.radius * np.abs(omega)
        share = difference / self.size
        return float(np.max(share[where], initial=0.0))


def random_case(model, options):
    """200 draws of the parameters of a model, and 20 impacts."""
    rng = np.random.default_rng(11)
    drawn = [bounces.random_bounce(rng, options)[0] for _ in range(200)]
    for row in drawn:
        # e_x and offset of grip-slip and brody, which have no mass ratio to stay below.
        row["e_x"] = rng.uniform(-0.3, 0.6)
        row["offset"] = 3e-3 * rng.standard_normal()
    columns = {}
    for spec in model.parameters:
        columns[spec.name] = np.array([row[spec.name] for row in drawn])
    side = rng.choice([-1.0, 1.0], 20)
    v_x1 = side * 10.0 ** rng.uniform(-1.0, 1.6, 20)
    v_y1 = 10.0 ** rng.uniform(0.0, 1.5, 20)
    omega_1 = rng.uniform(-600.0, 600.0, 20)
    return Case(model, columns, Impacts(v_x1, v_y1, omega_1))


def composed_case(options):
    return random_case(fitball.model(bounces.text_of(options), ball=BALL), options)


RIGID_LAWS = ("power", "line", "root")
CASES = [
    *map(composed_case, bounces.COMPOSITIONS),
    random_case(fitball.model("grip-slip", ball=BALL), bounces.DEFAULT),
    random_case(fitball.model("brody", ball=BALL), bounces.DEFAULT),
    *(
        random_case(fitball.model("grip-slip", ball=BALL, cor=law), bounces.DEFAULT)
        for law in RIGID_LAWS
    ),
]


def nothing_changes_along_the_court_without_friction(case):
    rebounds, ok = case.solved(mu=0.0, **WITHOUT_OFFSET)
    change_of_v_x = rebounds.v_x2 - case.at.v_x1
    change_of_spin = rebounds.omega_2 - case.at.omega_1
    assert case.apart(change_of_v_x, change_of_spin, ok) < 2e-14
    if case.timed:
        # It goes on as it came, in place and in turn.
        path = case.at.v_x1 * rebounds.gap_time
        turn = case.at.omega_1 * rebounds.gap_time
        assert_allclose(rebounds.gap_path[ok], path[ok], rtol=1e-11, atol=1e-13)
        assert_allclose(rebounds.gap_turn[ok], turn[ok], rtol=1e-11, atol=1e-13)


def regimes_of(rebound, ok):
    """Digits of the phases, in base eight."""
    return {f"{code:o}" for code in np.unique(rebound.regime[ok])}


def a_mirror_turns_speed_spin_and_offset(case):
    plain, ok = case.solved()
    turned = {name: -case.columns[name] for name in OFFSETS if name in case.columns}
    mirrored = Impacts(-case.at.v_x1, case.at.v_y1, -case.at.omega_1)
    other = case.rebound(mirrored, **turned)
    assert case.apart(plain.v_x2 + other.v_x2, plain.omega_2 + other.omega_2, ok) < 1e-12
    translated = {code.translate(MIRRORED) for code in regimes_of(plain, ok)}
    assert translated == regimes_of(other, ok)


def all_speeds_scale_together(case):
    plain, ok = case.solved(cor_slope=0.0, eps_slope=0.0)
    for factor in (1e3, 1e-3):
        scaled = Impacts(
            factor * case.at.v_x1,
            factor * case.at.v_y1,
            factor * case.at.omega_1,
        )
        other = case.rebound(scaled, cor_slope=0.0, eps_slope=0.0)
        v_x = plain.v_x2 - other.v_x2 / factor
        omega = plain.omega_2 - other.omega_2 / factor
        assert case.apart(v_x, omega, ok) < 1e-12
        assert np.array_equal(plain.regime, other.regime)


def only_the_ratio_of_stiffnesses_reaches_the_rebound(case):
    soft, ok = case.solved()
    stiff = case.rebound(
        k_y=4.0 * case.columns["k_y"],
        k_theta=4.0 * case.columns["k_theta"],
    )
    assert case.apart(soft.v_x2 - stiff.v_x2, soft.omega_2 - stiff.omega_2, ok) < 1e-12
    assert_allclose(stiff.contact_time[ok], soft.contact_time[ok] / 2.0, rtol=1e-13)
    assert_allclose(stiff.gap_time[ok], soft.gap_time[ok] / 2.0, rtol=1e-13)


def no_energy_comes_from_nowhere(case):
    """The spin is the mean: all motion left after the twist has died out; an offset is a torque of
    its own.
    """
    rebounds, ok = case.solved(**WITHOUT_OFFSET)

    def energy(v_x, omega):
        return BALL.mass * v_x**2 + INERTIA * omega**2

    before = energy(case.at.v_x1, case.at.omega_1)
    after = energy(rebounds.v_x2, rebounds.omega_2)
    not_more = after <= before * (1.0 + 1e-12)
    not_faster = rebounds.v_y2 < case.at.v_y1 * (1.0 + 1e-15)
    assert np.all(not_more[ok])
    assert np.all(not_faster[ok])


def angular_momentum_about_the_contact_point_is_kept(case):
    """`M R (v_x1 - v_x2) - I (omega_2 - omega_1) = eps M (v_y1 + v_y2)`, and friction is at most mu
    times that.
    """
    columns = {name: column[:, None] for name, column in case.columns.items()}
    changes = {}
    if case.options.get("offset") == "grip":
        changes = WITHOUT_OFFSET
        eps = 0.0
    elif case.timed:
        eps = columns["eps_10"] + columns["eps_slope"] * (case.at.v_y1 - 10.0)
    else:
        eps = columns.get("offset", 0.0)
    rebounds, ok = case.solved(**changes)
    normal = case.at.v_y1 + rebounds.v_y2
    lost = case.at.v_x1 - rebounds.v_x2
    turned = INERTIA / BALL.mass * (rebounds.omega_2 - case.at.omega_1)
    balance = lost - (turned + eps * normal) / BALL.radius
    assert case.apart(balance, 0.0, ok) < 3e-13
    limit = columns["mu"] * normal * (1.0 + 1e-12) + 1e-14
    within = np.abs(lost) <= limit
    assert np.all(within[ok])


def a_stiff_joint_is_a_rigid_ball(case):
    """What is left of a joint falls with its compliance: `normal=total` goes over into `brody`."""
    brody = fitball.model("brody", ball=BALL)
    names = [spec.name for spec in brody.parameters]
    values = np.stack([case.columns[name] for name in names], axis=1)
    limit = brody.evaluate(names, values, case.at)

    def distance(factor):
        k_theta = factor * case.columns["k_y"]
        rebounds, ok = case.solved(k_theta=k_theta, **WITHOUT_OFFSET)
        return case.apart(rebounds.v_x2 - limit.v_x2, rebounds.omega_2 - limit.omega_2, ok)

    stiff = distance(1e3)
    assert stiff < 1e-11
    assert stiff < 0.1 * distance(1.0)


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
    row = [near[name] for name in case.columns]
    rebounds = case.model.evaluate([*case.columns], np.array([row]), at)
    # Laws without a ceiling have no answer for the slowest of these.
    first = int(np.argmax(rebounds.status[0] == 0))
    assert np.all(rebounds.status[0, first:] == 0)
    assert first == 0 or case.options["cor"] in ("power", "root")
    assert np.unique(rebounds.regime[0, first:]).size >= 2
    scales = answers.scales((17.0, 0.0, 0.0), 5e-3, 5e-3)
    scale_of = dict(zip(OUTPUTS, scales, strict=True))
    step = angle[1] - angle[0]
    for name in case.outputs:
        # A kink changes the slope, of order one a radian; a jump would show undiminished.
        bends = np.diff(getattr(rebounds, name)[0, first:], 2) / scale_of[name]
        assert np.max(np.abs(bends)) < 20.0 * step


def restitution_follows_its_law(case):
    """Written out in the oracle, from a crawl to beyond any serve: where the law is in (0, c], and
    nowhere else. The saturating law is everywhere, and the speed of rebound grows.
    """
    law = case.options["cor"]
    speeds = np.geomspace(1e-3, 1e3, 25)
    rebounds = case.rebound(Impacts(np.full(25, 3.0), speeds, np.zeros(25)))
    cor = rebounds.v_y2 / speeds
    ok = rebounds.status == 0
    assert ok.mean() > (0.5 if law == "saturating" else 0.2)
    caps = np.ones(len(cor))
    if case.options.get("normal") == "momentum":
        caps = case.columns["mass_ratio"]
    slopes = case.columns.get("cor_slope", np.zeros(len(cor)))
    for draw, solved in enumerate(ok):
        cap = caps[draw]
        cor_10 = case.columns["cor_10"][draw]
        wanted = [taylor.law(cor_10, slopes[draw], cap, v, np.log, law) for v in speeds]
        if law != "saturating":
            wanted = np.array(wanted)
            possible = (wanted > 0.0) & (wanted <= cap)
            assert not np.any(solved & ~possible)
            # Without a fit of the joint there is no answer at any speed.
            assert np.array_equal(solved, possible) or not solved.any()
        measured = cor[draw, solved]
        assert_allclose(measured, np.array(wanted)[solved], rtol=1e-12)
        assert np.all(measured > 0.0)
        assert np.all(measured <= cap * (1.0 + 1e-15))
        # What has saturated grows by less than rounding.
        speeds_after = measured * speeds[solved]
        grows = np.diff(speeds_after) > -1e-14 * speeds_after[1:]
        assert np.all(grows) or law == "line"


def a_course_is_that_of_the_oracle(case):
    """Position, velocity, spins and twist at five times of two contacts."""
    for draw, number in ((3, 2), (8, 5)):
        values = {name: float(column[draw]) for name, column in case.columns.items()}
        state = [
            float(case.at.v_x1[number]),
            float(case.at.v_y1[number]),
            float(case.at.omega_1[number]),
        ]
        acts = acting(*state[:2])
        ahead = {name: acts * values[name] for name in ("eps_10", "eps_slope")}
        impact = fitball.impacts(*state)
        end = float(case.model.rebound(values, impact).contact_time[0])
        times = np.linspace(0.05, 1.0, 5) * end
        courses = case.model.history(values, impact, times).courses
        speed = case.size[number]
        for k, time in enumerate(times):
            exact = taylor.solve(case.options, values | ahead, state, until=time)
            y, v_y, v_x, core, shell, twist = exact.state[:6]
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
                assert abs(courses[name][k] - exact) < 1e-12 * scale, (name, k)


def _is_balanced(case):
    """The normal impulse is that of the whole ball, its spin its own, no force before the release
    pulls.
    """
    if not case.timed:
        return True
    return (
        case.options["normal"] != "inner"
        and case.options["release"] == "zero_force"
        and case.options["spin"] == "mean"
    )


def _can_be_rigid(case):
    if not case.timed:
        return False
    return case.options["normal"] == "total" and case.options["torsion"] == "matched"


def _spin_is_the_mean(case):
    return case.options.get("spin") != "shell"


def _can_be_constant(case):
    return case.options["cor"] != "root"


def always(case):
    return True


def is_timed(case):
    return case.timed


LAWS = {
    nothing_changes_along_the_court_without_friction: always,
    a_mirror_turns_speed_spin_and_offset: always,
    all_speeds_scale_together: _can_be_constant,
    only_the_ratio_of_stiffnesses_reaches_the_rebound: is_timed,
    no_energy_comes_from_nowhere: _spin_is_the_mean,
    angular_momentum_about_the_contact_point_is_kept: _is_balanced,
    a_stiff_joint_is_a_rigid_ball: _can_be_rigid,
    no_output_jumps_from_regime_to_regime: always,
    restitution_follows_its_law: always,
    a_course_is_that_of_the_oracle: is_timed,
}
LAWS_AND_CASES = []
for _law, _holds in LAWS.items():
    LAWS_AND_CASES += [(_law, case) for case in CASES if _holds(case)]


def name_of(parameter):
    if isinstance(parameter, Case):
        return parameter.model.text
    return parameter.__name__


@pytest.mark.parametrize(("law", "case"), LAWS_AND_CASES, ids=name_of)
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
    rebounds = fitball.model("thesis-exact", ball=BALL).rebound(values, states)
    assert np.all(np.isfinite(rebounds.omega_2))
    assert np.all(np.isfinite(rebounds.v_x2))
