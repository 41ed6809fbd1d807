"""A fit without fitting, for pages and figures: a real problem, draws about a point, results by hand, real frames."""

from functools import cached_property

import numpy as np

import fitball
from fitball.data.read import load_data
from fitball.data.scene import Scene
from fitball.errors import Note
from fitball.inference import frames, results
from fitball.inference.curves import curves
from fitball.inference.derived import Quantity
from fitball.inference.effort import Effort
from fitball.inference.fit import Fit, Run
from fitball.inference.forward import Draws
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.summary import summarise
from fitball.priors import ParameterSpec

ENSEMBLES, STEPS, WALKERS = 2, 25, 8
PACE = ParameterSpec("court_pace", "", 0.0, 100.0, "", "ITF court pace rating, at 30 m/s and 16 degrees", "")
BALL = ParameterSpec("ball_radius", "m", 0.0, 1.0, "", "outer radius of the ball", "$R$")
VERDICTS = ("given", "identified", "prior-dominated", "one-sided", "conditional")


class MadeFit(Fit):
    """The fields of a fit, and in `made` what is computed from them."""

    problem = property(lambda self: self.made.problem)
    draws = property(lambda self: self.made.draws)
    summary = cached_property(lambda self: frames.summary(
        [*self.parameters.values(), *self.derived.values()], self.profiles, self.diagnostics, self.variants
    ))  # fmt: skip
    variants = cached_property(lambda self: frames.variants(
        [*self.parameters.values(), *self.derived.values()], self.alternatives, self.constants))  # fmt: skip
    predictions = cached_property(lambda self: frames.predictions(self.problem, self.draws, np.random.default_rng(2)))
    curves = cached_property(lambda self: curves(self.problem, self.draws))

    def quantity(self, name):
        specs = {one.spec.name: one.spec for one in self.problem.parameters} | {"ball_radius": BALL}
        return Quantity(
            specs.get(name, PACE),
            lambda values: 44.0 + next(iter(values.values())) if name == PACE.name else values[name],
        )


class _Made:
    """Problem and draws: a point within the bounds, and normal numbers about it, 3 % of the prior's middle half."""

    def __init__(self, table, scene, choices, sampled):
        self.problem = build_problem(table, scene, choices)
        rng, values, point = np.random.default_rng(1), {}, {}
        for k, one in enumerate(self.problem.parameters):
            spec, (low, centre, high) = one.spec, one.prior.quantile(np.array([0.25, 0.5, 0.75]))
            best = spec.typical if spec.typical is not None else centre
            best *= 0.995**k if "[" in spec.name else 1.0
            drawn = best + 0.03 * (high - low) * rng.standard_normal(ENSEMBLES * STEPS * WALKERS)
            point[spec.name] = best if one.fixed is None else one.fixed
            values[spec.name] = (
                np.clip(drawn, spec.lower, spec.upper) if one.fixed is None else 0.0 * drawn + one.fixed
            )
        draws = values if sampled else {name: one[:0] for name, one in values.items()}
        self.draws = Draws(point, draws, {name: np.array([one]) for name, one in point.items()})


def table_of(count=24, surfaces=("",), noise=0.3, seed=3, ids=None, drop=False):
    """A frame of what grip-slip says, with noise: impacts on surfaces in turn, or dropped."""
    import pandas as pd

    rng = np.random.default_rng(seed)
    speed, angle = rng.uniform(15.0, 25.0, count), rng.uniform(0.25, 1.2, count)
    truth = {"mu": 0.6, "e_x": 0.12, "offset": 0.002, "cor_10": 0.76, "cor_slope": -0.015}
    along = 0.0 if drop else speed * np.cos(angle)
    states = fitball.impacts(
        along, speed * np.sin(angle) / (3.0 if drop else 1.0), 0.0 if drop else rng.uniform(-200, 200, count)
    )
    made = fitball.model("grip-slip").rebound(truth, states)
    table = {"id": ids or [str(k + 1) for k in range(count)]}
    names = ("v_y1", "v_y2") if drop else ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")
    for name in names:
        exact = getattr(states, name, None) if name.endswith("1") else getattr(made, name)
        size = 0.0 if name.endswith("1") else noise * (20.0 if "omega" in name else 0.1 if drop else 1.0)
        table[name if "omega" not in name else f"{name} [rad/s]"] = exact + size * rng.standard_normal(count)
    if len(surfaces) > 1:
        table["surface"] = [surfaces[k % len(surfaces)] for k in range(count)]
    return pd.DataFrame(table)


def made_fit(
    frame=None, *, model="grip-slip", scene=None, sampled=True, name="", notes=(), answer="describes", **choices
):
    """The fit of a frame (default: `table_of()`); a variant moves every value by 1.3 sd, the first by 2.6, and a held
    radius by 0.5; verdicts in turn.
    """
    from dataclasses import replace

    table, scene = load_data([table_of() if frame is None else frame], scene or Scene(), True)
    table = replace(table, name=name or "balls")
    made = _Made(table, scene, Choices(model, **choices), sampled)
    problem, draws = made.problem, made.draws
    values = dict(draws.values)
    kinds = {**{one.noise: "noise" for one in problem.observables}, "ball_radius": "ball"}
    estimates, derived = {}, {}
    for k, one in enumerate(problem.parameters):
        name, known = one.spec.name, summarise(values[one.spec.name], draws.point[one.spec.name])
        verdict = "fixed" if one.fixed is not None else VERDICTS[k % len(VERDICTS)]
        given = ("offset=contact", "ball_radius") if verdict == "given" else ()
        estimates[name] = results.Estimate(
            **{field: getattr(known, field) for field in known.__struct_fields__}, name=name,
            kind=kinds.get(name, "level" if "[" in name else "model"), unit=one.spec.unit, meaning=one.spec.meaning,
            prior=one.prior.text, prior_source="", contraction=0.9, verdict=verdict, rule="toy",
            reason=f"reason of {name}", given=given,
        )  # fmt: skip
    if problem.forward.model.tangential:
        pace = summarise(44.0 + next(iter(values.values())), 44.0)
        derived["court_pace"] = results.Estimate(
            **{field: getattr(pace, field) for field in pace.__struct_fields__}, name="court_pace", kind="derived",
            unit="", meaning=PACE.meaning, prior="", prior_source="", contraction=np.nan, verdict="extrapolated",
            rule="toy", reason="the test impact is 6 m/s beyond the data", given=(),
        )  # fmt: skip
    main = [one for one in estimates.values() if one.kind in ("model", "level") and one.sd > 0.0]
    moved = {one.name: _moved(one, 2.6 if k == 0 else 1.3) for k, one in enumerate(main)}
    alternatives = (
        results.Alternative("offset=grip", "offset=contact", "toy", {}, moved, 0.4, 0.2, True),
        results.Alternative("noise=student-t", "noise=normal", "toy", {}, moved, -9.0, 1.0, False),
        results.Alternative("spin=shell", "spin=mean", "toy", {}, {}, None, np.nan, False, "no answer for impact 3"),
    )
    constants = (results.Constant("ball_radius", 0.0327, 0.0343, {one.name: 0.5 for one in main}),)
    return _filled(made, table, scene, sampled, estimates, derived, alternatives, constants, notes, answer)


def _moved(one, sds):
    shift = sds * one.sd
    return results.Summary(
        one.point + shift,
        one.median + shift,
        one.sd,
        one.q025 + shift,
        one.q16 + shift,
        one.q84 + shift,
        one.q975 + shift,
    )


def _filled(made, table, scene, sampled, estimates, derived, alternatives, constants, notes, answer):
    problem, values = made.problem, made.draws.values
    free = list(problem.free)
    chains = np.stack([values[name] for name in free], axis=1) if sampled else np.empty((0, len(free)))
    posterior = (
        results.Posterior(
            tuple(free), chains.reshape(ENSEMBLES, STEPS, WALKERS, -1), np.zeros((ENSEMBLES, STEPS, WALKERS))
        )
        if sampled
        else None
    )
    ess = dict.fromkeys(free, 900.0)
    diagnostics = (
        results.Diagnostics(100, STEPS, (0.4, 0.42), ess, ess, dict.fromkeys(free, 1.004), None, True, ())
        if sampled
        else None
    )
    profiles = {}
    for one in estimates.values():
        if one.kind in ("model", "level") and one.verdict != "fixed":
            wide = one.sd if sampled else 0.05 * (abs(one.point) + 0.01)
            at = one.point + wide * np.linspace(-2.5, 2.5, 11)
            profiles[one.name] = results.Profile(
                at,
                0.5 * np.linspace(-2.5, 2.5, 11) ** 2,
                (None, None),
                (None if one.verdict == "one-sided" else at[1], at[-2]),
            )
    columns = [one.column.name for one in problem.observables]
    tests = tuple(
        results.ResidualTest(
            "trend",
            column,
            f"{column}: trend with omega_1",
            0.004 if k == 0 else 0.4,
            0.38,
            k == 0 and answer != "describes",
        )
        for k, column in enumerate(columns)
    )
    noise = tuple(results.NoiseCheck(column, 0.5, 0.25, False, False) for column in columns)
    adequacy = results.Adequacy(
        answer,
        "The model describes the data: no residual test finds a pattern.",
        tests,
        noise,
        {},
        dict.fromkeys(columns, 0.49),
    )
    squares = results.LeastSquares(
        dict(made.draws.point),
        {name: (None if k == 0 else 0.1) for k, name in enumerate(free)},
        {free[0]: "at its bound"},
        53.6,
        67,
        1.0,
        2.0,
    )
    point = results.PointFit((dict(made.draws.point),), (-50.0,), -45.0, dict.fromkeys(columns, 0.3))
    run = Run(table, scene, problem.choices, Effort(point_only=not sampled), problem.known, "", "3.0.0", "0" * 64)
    fit = MadeFit(
        run,
        "converged" if sampled else "point only",
        "balls",
        (*table.notices, *problem.notes, *(Note("toy", note) for note in notes)),
        estimates,
        derived,
        point,
        squares,
        posterior,
        diagnostics,
        profiles,
        adequacy,
        alternatives,
        constants,
        {},
    )
    fit.__dict__["made"] = made
    return fit
