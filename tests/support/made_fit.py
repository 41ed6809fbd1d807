"""A fit without fitting, for pages and figures: a real problem, draws about a point, results by
hand, real frames.
"""

from dataclasses import replace
from functools import cached_property
from types import SimpleNamespace

import numpy as np
import pandas as pd
from msgspec.structs import asdict

import fitball
from fitball.base.priors import ParameterSpec
from fitball.data.read import load_data
from fitball.data.scene import Scene
from fitball.inference import frames, schema
from fitball.inference.curves import curves
from fitball.inference.derived import Quantity
from fitball.inference.effort import Effort
from fitball.inference.fitted import Run
from fitball.inference.forward import Draws
from fitball.inference.problem.build import build_problem
from fitball.inference.problem.problem import Choices
from fitball.inference.summary import summarise
from fitball.results.fit import Fit

SHAPE = (2, 25, 8)
PACE = ParameterSpec("court_pace", "", 0.0, 100.0, "", "ITF court pace rating, at 30 m/s", "")
VERDICTS = ("given", "identified", "prior-dominated", "one-sided", "conditional")


class MadeFit(Fit):
    """The fields of a fit; `made` has problem and draws."""

    problem = property(lambda self: self.made.problem)
    draws = property(lambda self: self.made.draws)
    all = property(lambda self: [*self.parameters.values(), *self.derived.values()])
    variants = cached_property(
        lambda self: frames.variants(self.all, self.alternatives, self.constants)
    )
    summary = cached_property(
        lambda self: frames.summary(self.all, self.profiles, self.diagnostics, self.variants)
    )
    predictions = cached_property(
        lambda self: frames.predictions(self.problem, self.draws, np.random.default_rng(2))
    )
    curves = cached_property(lambda self: curves(self.problem, self.draws))
    frames = property(
        lambda self: {name: getattr(self, name) for name in ("summary", "predictions", "variants")}
    )

    def quantity(self, name):
        if name == PACE.name:
            return Quantity(PACE, lambda values: 44.0 + next(iter(values.values())))
        known = {one.spec.name: one.spec for one in self.problem.parameters}
        return Quantity(known[name], lambda values: values[name])


TRUTH = {
    "mu": 0.6,
    "e_x": 0.12,
    "offset": 0.002,
    "cor_10": 0.76,
    "cor_slope": -0.015,
}


def table_of(count=24, surfaces=(), ids=None, drop=False, scatter=1.0):
    """A frame of what grip-slip says, with noise: impacts on surfaces in turn, or drops."""
    rng = np.random.default_rng(3)
    speed = rng.uniform(15.0, 25.0, count)
    angle = rng.uniform(0.25, 1.2, count)
    spin = rng.uniform(-200.0, 200.0, count)
    still = 0.0 if drop else 1.0
    states = fitball.impacts(still * speed * np.cos(angle), speed * np.sin(angle), still * spin)
    made = fitball.model("grip-slip").rebound(TRUTH, states)
    table = {"id": ids or [str(k + 1) for k in range(count)], "v_y1": states.v_y1}
    table |= {} if drop else {"v_x1": states.v_x1, "omega_1": states.omega_1}
    for name, noise in (("v_y2", 0.3), *(() if drop else (("v_x2", 0.3), ("omega_2", 6.0)))):
        table[name] = getattr(made, name) + scatter * noise * rng.standard_normal(count)
    surface = {"surface": [surfaces[k % len(surfaces)] for k in range(count)]} if surfaces else {}
    return pd.DataFrame(table | surface)


def made_fit(
    frame=None,
    *,
    scene=None,
    sampled=True,
    name="balls",
    answer="describes",
    model="grip-slip",
    **choices,
):
    """The fit of a frame (default: `table_of()`): a variant moves every value by 1.3 sd, the first
    by 2.6, a held radius by 0.5; verdicts go in turn; with another answer the first of the residual
    tests found something.
    """
    table, scene = load_data([table_of() if frame is None else frame], scene or Scene(), True)
    problem = build_problem(replace(table, name=name), scene, Choices(model, **choices))
    rng = np.random.default_rng(1)
    values = {}
    point = {}
    for k, one in enumerate(problem.parameters):
        low, best, high = one.prior.quantile(np.array([0.25, 0.5, 0.75]))
        best = (best if one.spec.typical is None else one.spec.typical) * (
            0.995**k if "[" in one.spec.name else 1.0
        )
        free = best + 0.03 * (high - low) * rng.standard_normal(SHAPE).ravel()
        point[one.spec.name] = best if one.fixed is None else one.fixed
        drawn = free if one.fixed is None else np.full(free.size, one.fixed)
        values[one.spec.name] = np.clip(drawn, one.spec.lower, one.spec.upper)[
            : len(free) * sampled
        ]
    estimates = {}
    noises = {one.noise for one in problem.observables}
    for k, one in enumerate(problem.parameters):
        kind = "level" if "[" in one.spec.name else "model"
        if one.spec.name in noises:
            kind = "noise"
        verdict = VERDICTS[k % len(VERDICTS)] if one.fixed is None else "fixed"
        rests = ("offset=contact", "ball_radius") if verdict == "given" else ()
        known = summarise(values[one.spec.name], point[one.spec.name])
        estimates[one.spec.name] = _estimate(one.spec, known, kind, one.prior.text, verdict, rests)
    pace = summarise(44.0 + next(iter(values.values())), 44.0)
    derived = (
        {PACE.name: _estimate(PACE, pace, "derived", "", "extrapolated")}
        if problem.forward.model.tangential
        else {}
    )
    main = [one for one in estimates.values() if one.kind != "noise" and one.verdict != "fixed"]
    moved = {one.name: _shifted(one, 2.6 if k == 0 else 1.3) for k, one in enumerate(main)}
    found = answer != "describes"
    free = problem.free
    columns = [one.column.name for one in problem.observables]
    ess = dict.fromkeys(free, 900.0)
    across = np.linspace(-2.5, 2.5, 11)
    chains = np.stack([values[name] for name in free], axis=-1)
    wide = {one.name: one.sd if sampled else 0.05 * (abs(one.point) + 0.01) for one in main}
    fit = MadeFit(
        Run(
            problem.table,
            scene,
            problem.choices,
            Effort(point_only=not sampled),
            problem.known,
            "",
            "3.0",
            "0",
        ),
        "converged" if sampled else "point only",
        name,
        (*problem.table.notices, *problem.notes),
        estimates,
        derived,
        schema.PointFit((point,), (-50.0,), -45.0, dict.fromkeys(columns, 0.3)),
        schema.LeastSquares(
            point,
            {name: k * 0.1 or None for k, name in enumerate(free)},
            {free[0]: "at a bound"},
            53.6,
            67,
            1.0,
            2.0,
        ),
        schema.Posterior(free, chains.reshape(*SHAPE, -1), np.zeros(SHAPE)) if sampled else None,
        schema.Diagnostics(100, 25, (0.4,), ess, ess, dict.fromkeys(free, 1.004), None, True, ())
        if sampled
        else None,
        {
            one.name: schema.Profile(
                one.point + wide[one.name] * across,
                0.5 * across**2,
                (None, None),
                (
                    None if one.verdict == "one-sided" else one.point - 2.0 * wide[one.name],
                    one.point + 2.0 * wide[one.name],
                ),
            )
            for one in main
        },
        schema.Adequacy(
            answer,
            "Words of the answer.",
            tuple(
                schema.ResidualTest(
                    "trend",
                    one,
                    f"{one}: trend",
                    0.4 - 0.39 * (k == 0),
                    0.38,
                    found and k == 0,
                )
                for k, one in enumerate(columns)
            ),
            tuple(schema.NoiseCheck(one, 0.5, 0.25, False, False) for one in columns),
            {},
            {columns[0]: 0.49},
        ),
        (
            schema.Alternative("offset=grip", "offset=contact", "toy", {}, moved, 0.4, 0.2, True),
            schema.Alternative(
                "noise=student-t",
                "noise=normal",
                "toy",
                {},
                moved,
                -9.0,
                1.0,
                False,
            ),
            schema.Alternative(
                "spin=shell",
                "spin=mean",
                "toy",
                {},
                {},
                None,
                np.nan,
                False,
                "no answer",
            ),
        ),
        (schema.Constant("ball_radius", 0.0327, 0.0343, {one.name: 0.5 for one in main}),),
        {},
    )
    best = {name: np.array([one]) for name, one in point.items()}
    fit.__dict__["made"] = SimpleNamespace(problem=problem, draws=Draws(point, values, best))
    return fit


def _estimate(spec, known, kind, prior, verdict, rests=()):
    about = {
        "name": spec.name,
        "kind": kind,
        "unit": spec.unit,
        "meaning": spec.meaning,
        "prior": prior,
    }
    about |= {
        "prior_source": "",
        "contraction": 0.9,
        "verdict": verdict,
        "rule": "toy",
        "given": rests,
    }
    return schema.Estimate(**asdict(known), **about, reason=f"reason of {spec.name}")


def _shifted(one, sds):
    ends = (one.point, one.median, 0.0, one.q025, one.q16, one.q84, one.q975)
    return schema.Summary(*(end + sds * one.half for end in ends))
