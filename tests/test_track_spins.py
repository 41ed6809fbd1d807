"""Spins from marks: aliases, what a bounce can do, and how often what is called sure is right."""

import numpy as np
import pytest
from simulated_films import errors, estimated, film

from fitball.tracks.spins import SURE, Bounce, Candidate, candidates, pairs_of, plausible
from fitball.values import Ball

BALL = Ball()
# A bounce of fitball's ball at 17 m/s.
BOUNCE = Bounce(13.6, 9.4, 9.9, 7.2, 4.9e-3, 0.03, 5e-5)


def angles(omega: float, d: np.ndarray, fold: int, seed: int = 1, sd: float = 0.035) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.mod(0.7 + omega * d + sd * rng.standard_normal(d.size), 2 * np.pi / fold)


@pytest.mark.parametrize(("fps", "fold"), [(240, 1), (240, 2), (120, 1), (1000, 2)])
def test_candidates_are_all_spins_that_frames_cannot_tell_apart(fps, fold):
    omega, d = 210.0, np.arange(1, 16) / fps
    found = candidates(d, angles(omega, d, fold), fold, 0.035, 0.05)
    spacing = 2 * np.pi * fps / fold
    expected = [omega + n * spacing for n in range(-20, 21) if abs(omega + n * spacing) < 890]
    assert len(found) == len(expected)
    sd = np.sqrt(found[0].covariance[1, 1])
    assert np.allclose(sorted(one.omega for one in found), expected, atol=5 * sd)
    # Of a straight line: Fisher's information.
    assert np.isclose(sd, 0.035 * fps * np.sqrt(12 / (d.size * (d.size**2 - 1))), rtol=0.05)
    line = min(found, key=lambda one: abs(one.omega - omega))
    turn = 2 * np.pi / fold
    off = line.phi - 0.7
    assert abs(off - turn * np.round(off / turn)) < 5 * np.sqrt(line.covariance[0, 0])


def test_outliers_of_angles_do_not_move_a_line():
    d = np.arange(1, 30) * 1e-3
    phi = angles(-340.0, d, 1)
    plain = candidates(d, phi, 1, 0.035, 0.05)[0]
    phi[[3, 11, 20]] += [1.1, 2.0, -1.4]
    found = candidates(d, phi, 1, 0.035, 0.05)[0]
    assert abs(found.omega - plain.omega) < 2.0 and abs(found.omega + 340.0) < 5.0
    assert found.covariance[1, 1] > plain.covariance[1, 1]


def test_too_few_angles_have_no_candidate():
    assert candidates(np.array([1e-3, 2e-3]), np.array([0.1, 0.2]), 1, 0.035, 0.05) == []


def test_errors_of_a_line_cover_its_truth():
    d, z = np.arange(2, 25) * 1e-3, []
    for seed in range(200):
        one = candidates(d, angles(150.0, d, 1, seed), 1, 0.035, 0.05)[0]
        error = np.array([np.angle(np.exp(1j * (one.phi - 0.7))), one.omega - 150.0])
        z.append(np.linalg.solve(np.linalg.cholesky(one.covariance), error))
    assert np.allclose(np.std(z, axis=0), 1.0, atol=0.13) and np.all(np.abs(np.mean(z, axis=0)) < 0.25)


def likely(omega_1: float, omega_2: float, turn: float | None = None, bounce: Bounce = BOUNCE) -> float:
    between = bounce.time * (omega_1 + 0.6 * (omega_2 - omega_1))
    return plausible(bounce, omega_1, omega_2, between if turn is None else turn, 0.02, BALL)


def test_a_bounce_weighs_spins_by_each_of_its_laws():
    radius, inertia = BALL.radius, BALL.inertia_ratio * BALL.radius**2
    pressed, lost = BOUNCE.v_y1 + BOUNCE.v_y2, BOUNCE.v_x1 - BOUNCE.v_x2

    def after(omega_1: float, offset: float) -> float:
        return omega_1 + (radius * lost - offset * pressed) / inertia

    best = likely(100.0, after(100.0, 1.5e-3))
    # The offset of the normal force: two sds on either side.
    for offset in (1.5e-3 - 6e-3, 1.5e-3 + 6e-3):
        assert np.isclose(best - likely(100.0, after(100.0, offset)), 2.0, atol=0.15)
    # The turn over the contact, two sds and half of one fold.
    turn = BOUNCE.time * (100.0 + 0.6 * (after(100.0, 1.5e-3) - 100.0))
    assert np.isclose(best - likely(100.0, after(100.0, 1.5e-3), turn + 0.5), 2.0, atol=0.05)
    # Friction slows what slides: with a spin above rolling it would have to drive the ball backwards.
    fast = BOUNCE.v_x1 / radius + 150.0
    assert best - likely(fast, after(fast, 1.5e-3)) > 5.0
    # The slip does not turn round at more than half its speed.
    slow = BOUNCE.v_x1 / radius - 100.0
    assert best - likely(slow, after(slow, 1.5e-3)) > 5.0


def test_pairs_weigh_marks_bounce_and_spread_of_spins():
    before = [Candidate(0.3, 100.0, np.diag([1e-4, 1.0]), -1.0), Candidate(0.3, 854.0, np.diag([1e-4, 1.0]), -1.0)]
    after = [Candidate(2.0, 330.0, np.diag([1e-4, 1.0]), -2.0), Candidate(2.0, -424.0, np.diag([1e-4, 1.0]), -2.0)]
    pairs = pairs_of(before, after, BOUNCE, 2, BALL, 250.0)
    assert np.isclose(sum(pair.probability for pair in pairs), 1.0, atol=1e-4)
    assert (pairs[0].omega_1, pairs[0].omega_2) == (100.0, 330.0)
    assert pairs[0].phi_1 == 0.3
    for pair in pairs:
        assert np.isclose(np.mod(pair.turn - 1.7, np.pi) % np.pi, 0.0, atol=1e-9) or np.isclose(
            np.mod(pair.turn - 1.7, np.pi), np.pi, atol=1e-9
        )
    assert np.all(np.linalg.eigvalsh(pairs[0].covariance) > -1e-12)
    # A whole turn between frames on both sides: only the spread of incident spins and the turn speak against it.
    before[1] = Candidate(0.3, -654.0, np.diag([1e-4, 1.0]), -1.0)
    ratio = []
    for spread in (250.0, 400.0):
        weights = {(p.omega_1, p.omega_2): p.probability for p in pairs_of(before, after, BOUNCE, 2, BALL, spread)}
        ratio.append(np.log(weights[(-654.0, -424.0)] / weights[(100.0, 330.0)]))
    assert np.isclose(ratio[0] - ratio[1], -0.5 * (654**2 - 100**2) * (250**-2 - 400**-2), rtol=1e-3)
    assert pairs_of([], after, BOUNCE, 2, BALL, 250.0) == ()


def test_angles_that_say_nothing_are_not_sure():
    """Random angles, of which any few fit some line, beside a side that is read well."""
    d = np.arange(1, 30) / 240
    after = candidates(d, angles(330.0, d, 1), 1, 0.035, 0.05)
    sure = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        first = -np.arange(1, 4 + seed % 6) / 240
        before = candidates(first, rng.uniform(0, 2 * np.pi, first.size), 1, 0.035, 0.05)
        pairs = pairs_of(before, after, BOUNCE, 1, BALL, 250.0)
        assert sum(pair.probability for pair in pairs) <= 1.0 + 1e-9
        sure.append(bool(pairs) and pairs[0].probability > SURE)
    assert sum(sure) <= 1
    read = candidates(-d, angles(100.0, -d, 1), 1, 0.035, 0.05)
    assert pairs_of(read, after, BOUNCE, 1, BALL, 250.0)[0].probability > SURE


def test_covariance_of_a_pair_is_that_of_its_lines():
    """By draws of both lines: turn = phi_2 - phi_1."""
    one = Candidate(0.3, 100.0, np.array([[4e-4, 0.012], [0.012, 1.0]]), 0.0)
    two = Candidate(2.0, 330.0, np.array([[9e-4, -0.02], [-0.02, 1.5]]), 0.0)
    rng = np.random.default_rng(3)
    first, last = (rng.multivariate_normal([side.phi, side.omega], side.covariance, 200_000) for side in (one, two))
    drawn = np.cov(np.stack([first[:, 1], last[:, 1], last[:, 0] - first[:, 0]]))
    found = pairs_of([one], [two], BOUNCE, 1, BALL, 250.0)[0].covariance
    sds = np.sqrt(np.diagonal(drawn))
    assert np.allclose(found / np.outer(sds, sds), drawn / np.outer(sds, sds), atol=0.015)


def wrong(true: np.ndarray, made: object) -> bool:
    """Whether spins are off by more than four sds, which is another alias."""
    off = np.abs(made.values - true[int(made.id) - 1])[[2, 5, 8]]
    return bool(np.any(off > 5.0 * np.array([made.sd(name) for name in ("omega_1", "omega_2", "gap_turn")])))


def test_of_dots_at_a_thousand_frames_nine_in_ten_are_sure_and_right():
    true, found = estimated(150, film(1000))
    sure = [made for made in found.impacts if made.sure]
    assert len(sure) >= 0.9 * 150
    assert sum(wrong(true, made) for made in sure) <= 1


def test_what_is_called_sure_is_right_and_what_is_not_is_left_empty():
    """Stripes at 240 frames/s: spins are known modulo 754 rad/s."""
    true, found = estimated(150, film(240, fold=2))
    sure = [made for made in found.impacts if made.sure]
    unsure = [made for made in found.impacts if not made.sure]
    assert len(sure) >= 10 and len(unsure) >= 30
    assert sum(wrong(true, made) for made in sure) <= 1
    kept, expected, right = 0, 0.0, 0
    for made in unsure:
        assert np.isnan(made.values[[2, 5, 8]]).all()
        assert not made.covariance[[2, 5, 8]].any() and not made.covariance[:, [2, 5, 8]].any()
        assert np.isnan(made.before.omega) and np.isnan(made.angle_residual).all()
        assert made.pairs[0].probability <= SURE
        assert any("ambiguous" in words for words in made.notes)
        place = true[int(made.id) - 1]
        near = [abs(p.omega_1 - place[2]) + abs(p.omega_2 - place[5]) < 40 for p in made.pairs]
        kept += any(near)
        expected += made.pairs[0].probability
        right += near[0]
    # The truth is among the candidates, and the first is right as often as its probability says.
    assert kept >= len(unsure) - 2
    assert right >= expected - 3.0 * np.sqrt(len(unsure) * 0.25)
    # Balls leave the court with topspin, whose lift is expected.
    empty = [made.id for made in unsure]
    z = errors(true, found)[[made.id in empty for made in found.impacts]][:, [3, 4]]
    assert np.all(np.abs(z.mean(axis=0)) < 0.5)
    assert any("Spins are ambiguous" in words for words in found.notes)


def test_without_marks_spins_are_empty():
    true, found = estimated(40, film(240, fold=None))
    assert all(np.isnan(made.values[[2, 5, 8]]).all() and not made.pairs for made in found.impacts)
    z = errors(true, found)[:, [0, 1, 3, 4]]
    assert 0.8 < np.sqrt(np.mean(z**2)) < 1.25
    # Balls leave the court with topspin, whose lift is expected.
    assert np.all(np.abs(z.mean(axis=0)) < 0.6)
    marked = estimated(40, film(240))[1]
    sds = [np.median([made.sd("v_y1") for made in one.impacts]) for one in (marked, found)]
    assert sds[0] < sds[1]
