"""Central differences of the models' rebounds against differences of the oracle with 36 digits."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
from support import answers, bounces, taylor
from support.taylor import OUTPUTS

import fitball
from fitball.inference.differences import central
from fitball.models.specs import BALL_PARAMETERS, SPECS
from fitball.values import Impacts

KIND = taylor.FIFTY._replace(digits=36)
BASE = {
    "mass_ratio": 0.88, "k_y": 1.93e4, "k_theta": 18.0, "mu": 0.567, "eps_10": 2.4e-3, "eps_slope": 1e-4,
    "cor_10": 0.77, "cor_slope": -0.0157, "zeta_theta": 0.3, "inertia_split": 0.7,
}  # fmt: skip
BALL = dict(zip(BALL_PARAMETERS, taylor.BALL, strict=True))
INCIDENT = ("v_x1", "v_y1", "omega_1")
GRIP = {"offset": "grip"}
# Options, parameters, impact, and the phases there.
CASES = [
    ({}, {}, (16.0, 5.0, 0.0), "1"),
    ({}, {}, (14.0, 12.0, 100.0), "132"),
    ({"torsion": "free", "inertia": "table", "spin": "shell"}, {}, (14.0, 12.0, 100.0), "13"),
    ({"normal": "total", "release": "zero_displacement"}, {"mu": 0.9}, (3.0, 8.0, 250.0), "2"),
    ({**GRIP, "normal": "inner"}, {"eps_10": 1.2e-2, "mu": 0.3}, (6.0, 15.0, -50.0), "1"),
]


def differentiated(options, values, impact):
    """Names, and derivatives (names, outputs) by `central` of the model in steps of 6e-6 of a parameter's size."""
    model = fitball.model(bounces.text_of({**bounces.DEFAULT, **options}))
    given = {spec.name: values[spec.name] for spec in model.parameters} | BALL
    names, inside = [*given, *INCIDENT], len(given)
    at = np.array([[*given.values(), *impact]])
    size = [max(abs(x), abs(SPECS[name].typical or 0.0), 1e-3) for name, x in given.items()] + [10.0, 10.0, 300.0]
    low, high = np.full((2, len(names)), [[-np.inf], [np.inf]])
    for k, name in enumerate(given):
        low[k], high[k] = SPECS[name].lower, SPECS[name].upper

    def rebounds(rows):
        found = model.evaluate([*given], rows[:, :inside], Impacts(*rows[:, inside:].T[:, :, None]))
        return np.stack([getattr(found, name)[:, 0] for name in OUTPUTS], axis=1)

    _, slopes = central(rebounds, at, 6e-6 * np.array(size), low, high)
    return names, np.array(size), slopes[0]


def exact(options, values, impact, name, sides=(1, -1)):
    """Derivatives (outputs,) of the oracle by steps of 1e-12, to both sides or one."""
    inputs = {**values, **BALL, **dict(zip(INCIDENT, impact, strict=True))}
    made = []
    with localcontext(prec=KIND.digits):
        step = Decimal("1e-12") * max(abs(Decimal(inputs[name])), 1)
        for side in sides:
            # Not rounded to the digits of the context where nothing moves: it may be at a wall.
            moved = {**inputs, name: Decimal(inputs[name]) + side * step} if side else inputs
            ball, incident = ([moved[key] for key in keys] for keys in (BALL_PARAMETERS, INCIDENT))
            made.append(taylor.solve(options, moved, incident, ball=ball, kind=KIND))
        width = step * (sides[0] - sides[1])
        return np.array([float((getattr(made[0], key) - getattr(made[1], key)) / width) for key in OUTPUTS])


@pytest.mark.parametrize(("options", "changes", "impact", "phases"), CASES, ids=[case[-1] for case in CASES])
def test_derivatives_by_all_parameters_and_by_the_state(options, changes, impact, phases):
    values = BASE | changes
    answer = taylor.solve(options, values, impact)
    assert f"{answer.regime():o}"[::-1].startswith(phases)
    names, sizes, slopes = differentiated(options, values, impact)
    scales = np.array(answers.scales(impact, answer.contact_time, answer.gap_time))
    assert len(names) >= 14
    for name, size, slope in zip(names, sizes, slopes, strict=True):
        # As shares of the outputs' scales for a change by the parameter's own size.
        off = (slope - exact(options, values, impact, name)) * size / scales
        assert np.abs(off).max() < 2e-8, name
    assert np.all(np.abs(slopes).max(axis=0) > 0.0)


def test_the_differences_notice_a_wrong_slope():
    """Against the derivative at an impact one per cent faster they fail: the bound is no formality."""
    options, changes, impact, _ = CASES[1]
    names, sizes, slopes = differentiated(options, BASE | changes, impact)
    k = names.index("mu")
    other = exact(options, BASE | changes, (impact[0] * 1.01, *impact[1:]), "mu")
    assert np.abs((slopes[k] - other) * sizes[k]).max() > 1e-4


def test_across_a_boundary_of_regimes_a_difference_lies_between_the_slopes_of_both_sides():
    """Friction that just uses up the slip at the end of the contact: with less it slides, with more it grips."""
    impact, low, high = (16.0, 5.0, 0.0), 0.6, 0.9

    def slides(mu):
        return f"{taylor.solve({}, BASE | {'mu': mu}, impact).regime():o}" == "1"

    assert slides(low) and not slides(high)
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if slides(middle) else (low, middle)
    names, _, slopes = differentiated({}, BASE | {"mu": high}, impact)
    below, above = (exact({}, BASE | {"mu": high + 1e-7 * side}, impact, "mu") for side in (-1, 1))
    spin = OUTPUTS.index("omega_2")
    middle = slopes[names.index("mu"), spin]
    assert abs(below[spin] - above[spin]) > 0.1 * abs(below[spin])
    assert min(below[spin], above[spin]) <= middle <= max(below[spin], above[spin])


def test_at_the_wall_the_side_that_has_an_answer():
    """mass_ratio = COR: there is no smaller mass ratio, and no larger restitution."""
    values, impact = BASE | {"mass_ratio": 0.77, "cor_slope": 0.0}, (14.0, 12.0, 100.0)
    assert taylor.solve({}, values | {"mass_ratio": 0.7699}, impact).status == "COR_EXCEEDS_MASS_RATIO"
    names, sizes, slopes = differentiated({}, values, impact)
    scales = np.array(answers.scales(impact, 5e-3, 5e-3))
    for name, sides in (("mass_ratio", (1, 0)), ("cor_10", (0, -1)), ("mu", (1, -1))):
        k = names.index(name)
        off = (slopes[k] - exact({}, values, impact, name, sides)) * sizes[k] / scales
        # A one-sided difference is off by half a step times the second derivative.
        assert np.abs(off).max() < (2e-8 if name == "mu" else 5e-5)
        assert np.abs(slopes[k]).max() > 0.0
