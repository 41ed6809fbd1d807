"""Derivatives of the bounce against differences of independent solutions, and against what conservation demands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from samples import COMPOSITIONS

import fitball
from fitball.bench.problems import BASE, FAST, SHALLOW, STEEP, HardCase, hard_cases
from fitball.models.oracle import oracle_rebound
from fitball.models.types import OUTPUTS, Status, regime_name
from fitball.observables import OBSERVABLES
from fitball.values import Ball

# Steps are counted in these: the size over which a rebound may change by as much as itself.
SCALE = {
    "v_x1": 10.0, "v_y1": 10.0, "omega_1": 300.0, "cor": 1.0, "mass_ratio": 0.1, "k_y": 2e4, "k_theta": 20.0,
    "mu": 0.5, "eps_10": 0.03, "eps_slope": 3e-3, "cor_10": 1.0, "cor_slope": 0.1, "zeta_theta": 1.0,
    "inertia_split": 0.3, "c_y": 3.0, "e_x": 1.0, "offset": 0.03, "ball_mass": 0.06, "ball_radius": 0.03,
    "inertia_ratio": 0.5,
}  # fmt: skip
INCIDENT = ("v_x1", "v_y1", "omega_1")
OUTPUT_SIZE = np.array([10.0, 10.0, 300.0, 5e-3, 5e-3, 0.05, 10.0])
LINES = {"eps_slope": 1e-4, "cor_slope": -0.0145}

OTHERS = [
    ("grip-slip", {}), ("brody", {}), ("grip-slip", {"cor": "saturating"}), ("thesis", {}),
    ("thesis", {"cor": "measured", "inertia": "table"}),
    ("thesis", {"damping": "given"}), ("two-mass", {"tangential": False}),
]  # fmt: skip


def every_derivative(chosen, names, values, impacts):
    """Columns in the order of `variables`, (draws, impacts, outputs, variables), and the rebound."""
    found = chosen.jacobian(names, values, impacts)
    blocks = [found.inputs, *([found.cor[..., None]] if found.cor is not None else []), found.parameters]
    return np.concatenate(blocks, axis=-1), found.rebound


def variables(chosen, names):
    return (*INCIDENT, *(["cor"] if chosen.needs_cor else []), *names)


def stacked(rebound):
    return np.stack([getattr(rebound, name) for name in OUTPUTS], axis=-1)


def shifted(names, values, impacts, variable, step):
    """Parameters and impacts with one variable moved by `step`."""
    if variable in names:
        moved = values.copy()
        moved[:, list(names).index(variable)] += step
        return moved, impacts
    return values, replace(impacts, **{variable: getattr(impacts, variable) + step})


def difference(solve, names, values, impacts, variable, size):
    """Richardson's extrapolation of central differences, a bound of its error, and where one regime holds.

    Its truncation is far below its distance to the finer difference; its rounding is that of the outputs.
    """
    slopes, regimes, statuses = [], [], []
    for step in (size, 0.5 * size):
        ends = [solve(*shifted(names, values, impacts, variable, sign * step)) for sign in (1.0, -1.0)]
        slopes.append((stacked(ends[0]) - stacked(ends[1])) / (2.0 * step))
        regimes += [end.regime for end in ends]
        statuses += [end.status for end in ends]
    best = (4.0 * slopes[1] - slopes[0]) / 3.0
    alike = np.all([regime == regimes[0] for regime in regimes], axis=0) & ~np.any(statuses, axis=0)
    return best, np.abs(best - slopes[1]), alike


def compare(solve, chosen, names, values, impacts, step, rounding):
    """Largest disagreement beyond the allowance of the differences, and how many entries were compared."""
    exact, rebound = every_derivative(chosen, names, values, impacts)
    compared, worst = 0, 0.0
    for k, variable in enumerate(variables(chosen, names)):
        size = step * SCALE[variable]
        best, error, alike = difference(solve, names, values, impacts, variable, size)
        alike = alike & (rebound.status == 0)
        absent = [place for place, name in enumerate(OUTPUTS) if not chosen.gives(OBSERVABLES[name])]
        best[..., absent], error[..., absent], exact[..., absent, k] = 0.0, 0.0, 0.0
        allowed = error + rounding * (np.abs(stacked(rebound)) + OUTPUT_SIZE) / size
        allowed[..., absent] = 1.0
        misfit = (np.abs(exact[..., k] - best) / allowed)[alike]
        compared += misfit.size
        worst = max(worst, float(np.max(misfit, initial=0.0)))
    return worst, compared


def test_random_draws_of_every_composition(wang_impacts, draw_priors):
    """At most the error of the differences, wherever one regime spans them; over all closures and models."""
    impacts = replace(wang_impacts, cor=np.linspace(0.6, 0.7, len(wang_impacts)))
    for name, closures in COMPOSITIONS + OTHERS:
        chosen = fitball.model(name, **closures)
        names = (*chosen.parameter_names, "ball_mass", "ball_radius", "inertia_ratio")
        ball = np.broadcast_to([0.0576, 0.033, 0.56], (60, 3))
        values = np.concatenate([draw_priors(chosen, np.random.default_rng(8), 60), ball], axis=1)

        def solve(values, impacts, chosen=chosen, names=names):
            return chosen.evaluate(names, values, impacts)

        # A few roundings of the outputs; the thesis's own formulas cancel where its joint is barely stiff enough.
        rounding = 3e-13 if name == "thesis" else 1e-14
        worst, compared = compare(solve, chosen, names, values, impacts, 1e-5, rounding)
        assert worst < 1.0, (name, closures)
        assert compared > 6000, (name, closures)


@pytest.mark.parametrize(("name", "closures"), COMPOSITIONS)
def test_closures_against_the_oracle(name, closures):
    """The independent integration in double precision, one variable after the other, over regimes."""
    chosen = fitball.model(name, **closures)
    names = chosen.parameter_names
    values = np.array([[{**BASE, **LINES}[key] for key in names]])

    def solve(values, impacts):
        found = oracle_rebound(chosen.closures, chosen.ball, dict(zip(names, values[0], strict=True)), impacts)
        return replace(found, **{key: getattr(found, key)[None, :] for key in vars(found)})

    impacts = fitball.impacts(*zip(FAST, SHALLOW, STEEP, strict=True), cor=0.7)
    # The oracle's own rounding, 1e-13, over steps of a thousandth: 1e-10 of the outputs per scale of a variable.
    worst, compared = compare(solve, chosen, names, values, impacts, 1e-3, 1e-12)
    assert worst < 1.0
    assert compared >= 0.9 * 3 * 4 * len(variables(chosen, names))


FIFTY_DIGITS = {
    "slide-grip-slide back": HardCase("", FAST, LINES),
    "slide-grip-slide": HardCase("", (8.0, 10.0, 0.0), {**LINES, "k_theta": 80.0}, {"torsion": "free"}),
    "slide-hold-grip-slide back": HardCase("", STEEP, {**LINES, "eps_10": 1.2e-2, "mu": 0.22}, {"offset": "grip"}),
    "slide-free": HardCase("", SHALLOW, LINES, {"normal": "total", "release": "zero_displacement", "spin": "shell"}),
}


@pytest.mark.parametrize("regime", FIFTY_DIGITS)
def test_fifty_digits(regime):
    """One direction in which every variable moves, through every kind of phase: agreement to 1e-9 and better."""
    case = FIFTY_DIGITS[regime]
    chosen, names = case.model, case.model.parameter_names
    values = np.array([[case.parameters[key] for key in names]])
    exact, rebound = every_derivative(chosen, names, values, case.impacts)
    assert regime_name(int(rebound.regime[0, 0])) == regime
    rng = np.random.default_rng(3)
    moves = {key: SCALE[key] * rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.0) for key in variables(chosen, names)}

    def at(step):
        impact = [start + step * moves[key] for start, key in zip(case.impact, INCIDENT, strict=True)]
        moved = {key: case.parameters[key] + step * moves[key] for key in names}
        found = oracle_rebound(chosen.closures, chosen.ball, moved, fitball.impacts(*impact), digits=50)
        assert regime_name(int(found.regime[0])) == regime
        return stacked(found)[0]

    coarse, fine = ((at(step) - at(-step)) / (2.0 * step) for step in (2e-4, 1e-4))
    expected = (4.0 * fine - coarse) / 3.0
    along = exact[0, 0] @ np.array(list(moves.values()))
    assert np.max(np.abs(along - expected) / OUTPUT_SIZE) < 1e-9


# Speed and spin that just match, and an offset that overcomes friction: the slope changes with the sign of the slip.
KINK = "grip broken at once"


def test_hard_cases():
    """Poles that meet, joints stiff and soft, critical damping, many phases: wherever one regime spans the step."""
    compared = 0
    for case in hard_cases():
        if case.name == KINK:
            continue
        chosen, names = case.model, case.model.parameter_names
        values = np.array([[case.parameters[key] for key in names]])
        exact, rebound = every_derivative(chosen, names, values, case.impacts)
        assert rebound.status[0, 0] == Status.OK
        for k, variable in enumerate(variables(chosen, names)):
            start = case.parameters[variable] if variable in names else getattr(case.impacts, variable)[0]
            left = min(abs(start), 1.0 - start) if variable in ("mass_ratio", "inertia_split") else abs(start)
            # Of the variable itself, where that is small beside its scale; of what is left of core or shell.
            size = 1e-5 * (min(left, SCALE[variable]) if left > 0.0 else SCALE[variable])

            def solve(values, impacts, chosen=chosen, names=names):
                return chosen.evaluate(names, values, impacts)

            if variable == "mass_ratio" and left <= 0.0:
                continue  # the end of its range: there is only one side
            best, error, alike = difference(solve, names, values, case.impacts, variable, size)
            if alike[0, 0]:
                allowed = 2.0 * error + 1e-12 * (np.abs(stacked(rebound)) + 1e-3 * OUTPUT_SIZE) / size
                assert np.all(np.abs(exact[..., k] - best) <= allowed), (case.name, variable)
                compared += 1
    assert compared > 600


def test_rebound_status_and_choice(wang_impacts, draw_priors):
    """The rebound is that of `evaluate` to the bit; what fails is NaN; fewer parameters are fewer columns."""
    for name, closures in COMPOSITIONS + OTHERS:
        chosen = fitball.model(name, **closures)
        names = chosen.parameter_names
        impacts = replace(wang_impacts, cor=np.full(len(wang_impacts), 0.7))
        values = draw_priors(chosen, np.random.default_rng(9), 40)
        found = chosen.jacobian(names, values, impacts)
        plain = chosen.evaluate(names, values, impacts)
        for key, column in vars(plain).items():
            assert column.tobytes() == getattr(found.rebound, key).tobytes()
        failed = plain.status != 0
        assert np.isnan(found.inputs[failed]).all()
        assert np.isnan(found.parameters[failed]).all()
        last = 4 if chosen.has_time else 3
        assert np.isfinite(found.inputs[~failed][:, :last]).all()
        assert np.isfinite(found.parameters[~failed][:, :last]).all()
        assert (found.cor is None) == (not chosen.needs_cor)
        some = chosen.jacobian(names, values, impacts, names[1::-1])
        assert some.names == names[1::-1]
        np.testing.assert_array_equal(some.parameters, found.parameters[..., 1::-1])
        assert chosen.jacobian(names, values, impacts, ()).parameters.shape[-1] == 0


def test_no_slip_at_landing():
    """Speed and spin that just match: the rebound is smooth there, from either side, and so is the derivative."""
    radius = Ball().radius
    for closures in ({}, {"normal": "total"}, {"torsion": "rigid"}):
        chosen = fitball.model("two-mass", **closures)
        values = np.array([[{**BASE, **LINES}[key] for key in chosen.parameter_names]])
        impact = fitball.impacts([radius * 300.0, radius * 300.0 + 1e-9, radius * 300.0 - 1e-9], 10.0, 300.0)
        found = chosen.jacobian(chosen.parameter_names, values, impact, ()).inputs[0]
        np.testing.assert_allclose(found[1], found[0], rtol=1e-6, atol=1e-9)
        np.testing.assert_allclose(found[2], found[0], rtol=1e-6, atol=1e-9)
