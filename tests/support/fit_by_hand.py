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
from fitball.data.load import load_data
from fitball.data.scene import Scene
from fitball.inference import frames, schema
from fitball.inference.curves import curves_frame
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


class FitByHand(Fit):
    """A fit with the fields of a real one; `built` has its problem and draws."""

    problem = property(lambda self: self.built.problem)
    draws = property(lambda self: self.built.draws)
    rivals = ()
    all = property(lambda self: [*self.parameters.values(), *self.derived.values()])
    variants = cached_property(
        lambda self: frames.variants_frame(self.all, self.alternatives, self.constants)
    )
    summary = cached_property(
        lambda self: frames.summary_frame(self.all, self.profiles, self.diagnostics, self.variants)
    )
    predictions = cached_property(
        lambda self: frames.predictions_frame(self.problem, self.draws, np.random.default_rng(2))
    )
    curves = cached_property(lambda self: curves_frame(self.problem, self.draws))
    frames = property(
        lambda self: {name: getattr(self, name) for name in ("summary", "predictions", "variants")}
    )

    def quantity(self, name):
        if name == PACE.name:
            return Quantity(PACE, lambda values: 44.0 + next(iter(values.values())))
        specs = {parameter.spec.name: parameter.spec for parameter in self.problem.parameters}
        return Quantity(specs[name], lambda values: values[name])


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
    rebound = fitball.model("grip-slip").rebound(TRUTH, states)
    table = {"id": ids or [str(k + 1) for k in range(count)], "v_y1": states.v_y1}
    table |= {} if drop else {"v_x1": states.v_x1, "omega_1": states.omega_1}
    for name, noise in (("v_y2", 0.3), *(() if drop else (("v_x2", 0.3), ("omega_2", 6.0)))):
        table[name] = getattr(rebound, name) + scatter * noise * rng.standard_normal(count)
    surface = {"surface": [surfaces[k % len(surfaces)] for k in range(count)]} if surfaces else {}
    return pd.DataFrame(table | surface)


def drawn_values(problem, sampled):
    """Draws about a point by name, empty where nothing is sampled, and the point."""
    rng = np.random.default_rng(1)
    values = {}
    point = {}
    for k, parameter in enumerate(problem.parameters):
        spec = parameter.spec
        low, middle, high = parameter.prior.quantile(np.array([0.25, 0.5, 0.75]))
        best = middle if spec.typical is None else spec.typical
        if "[" in spec.name:
            best = best * 0.995**k
        draws = best + 0.03 * (high - low) * rng.standard_normal(SHAPE).ravel()
        point[spec.name] = best
        if parameter.fixed is not None:
            point[spec.name] = parameter.fixed
            draws = np.full(draws.size, parameter.fixed)
        count = len(draws) if sampled else 0
        values[spec.name] = np.clip(draws, spec.lower, spec.upper)[:count]
    return values, point


def estimates_of(problem, values, point):
    """Estimates of parameters, with verdicts in turn."""
    noises = {observable.noise for observable in problem.observables}
    estimates = {}
    for k, parameter in enumerate(problem.parameters):
        spec = parameter.spec
        kind = "level" if "[" in spec.name else "model"
        if spec.name in noises:
            kind = "noise"
        verdict = VERDICTS[k % len(VERDICTS)] if parameter.fixed is None else "fixed"
        rests = ("offset=contact", "ball_radius") if verdict == "given" else ()
        summary = summarise(values[spec.name], point[spec.name])
        estimates[spec.name] = _estimate(spec, summary, kind, parameter.prior.text, verdict, rests)
    return estimates


def derived_of(problem, values):
    """The court pace of models with a tangential direction."""
    if not problem.forward.model.tangential:
        return {}
    pace = summarise(44.0 + next(iter(values.values())), 44.0)
    return {PACE.name: _estimate(PACE, pace, "derived", "", "extrapolated")}


def least_squares_of(point, free):
    """A search that ended at a bound."""
    errors = {name: k * 0.1 or None for k, name in enumerate(free)}
    return schema.LeastSquares(point, errors, {free[0]: "at a bound"}, 53.6, 67, 1.0, 2.0)


def sampling_of(values, free):
    """The posterior of the draws, and diagnostics without a fault."""
    chains = np.stack([values[name] for name in free], axis=-1)
    posterior = schema.Posterior(free, chains.reshape(*SHAPE, -1), np.zeros(SHAPE))
    ess = dict.fromkeys(free, 900.0)
    rhat = dict.fromkeys(free, 1.004)
    return posterior, schema.Diagnostics(100, 25, (0.4,), ess, ess, rhat, None, True, ())


def profile_of(estimate, sd):
    """A parabola of this sd about the point; a one-sided one has no lower end."""
    across = np.linspace(-2.5, 2.5, 11)
    lower = None if estimate.verdict == "one-sided" else estimate.point - 2.0 * sd
    return schema.Profile(
        estimate.point + sd * across,
        0.5 * across**2,
        (None, None),
        (lower, estimate.point + 2.0 * sd),
    )


def adequacy_of(answer, columns):
    """The answer, with a residual test a column: the first sees something unless the model
    describes the table.
    """
    doubted = answer != "describes"
    tests = []
    for k, name in enumerate(columns):
        p = 0.4 - 0.39 * (k == 0)
        words = f"{name}: trend"
        tests.append(schema.ResidualTest("trend", name, words, p, 0.38, doubted and k == 0))
    noise = [schema.NoiseCheck(name, 0.5, 0.25, False, False) for name in columns]
    words = "Words of the answer."
    return schema.Adequacy(answer, words, tuple(tests), tuple(noise), {}, {columns[0]: 0.49})


def alternatives_of(main):
    """Variants: another offset and noise, which move every value by 1.3 sd, the first by 2.6, and
    one without an answer.
    """
    moved = {}
    for k, estimate in enumerate(main):
        moved[estimate.name] = _shifted(estimate, 2.6 if k == 0 else 1.3)
    offset = ("offset=grip", "offset=contact", "toy")
    noise = ("noise=student-t", "noise=normal", "toy")
    spin = ("spin=shell", "spin=mean", "toy")
    return (
        schema.Alternative(*offset, {}, moved, 0.4, 0.2, True),
        schema.Alternative(*noise, {}, moved, -9.0, 1.0, False),
        schema.Alternative(*spin, {}, {}, None, np.nan, False, "no answer"),
    )


def fit_by_hand(
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
    values, point = drawn_values(problem, sampled)
    estimates = estimates_of(problem, values, point)
    main = [
        estimate
        for estimate in estimates.values()
        if estimate.kind != "noise" and estimate.verdict != "fixed"
    ]
    columns = [observable.column.name for observable in problem.observables]
    posterior = None
    diagnostics = None
    if sampled:
        posterior, diagnostics = sampling_of(values, problem.free)
    profiles = {}
    for estimate in main:
        sd = estimate.sd if sampled else 0.05 * (abs(estimate.point) + 0.01)
        profiles[estimate.name] = profile_of(estimate, sd)
    effort = Effort(point_only=not sampled)
    fit = FitByHand(
        Run(problem.table, scene, problem.choices, effort, problem.prior_texts, "", "3.0", "0"),
        "converged" if sampled else "point only",
        name,
        (*problem.table.notices, *problem.notes),
        estimates,
        derived_of(problem, values),
        schema.PointFit((point,), (-50.0,), -45.0, dict.fromkeys(columns, 0.3)),
        least_squares_of(point, problem.free),
        posterior,
        diagnostics,
        profiles,
        adequacy_of(answer, columns),
        alternatives_of(main),
        (
            schema.Constant(
                "ball_radius",
                0.0327,
                0.0343,
                dict.fromkeys((estimate.name for estimate in main), 0.5),
            ),
        ),
        {},
    )
    best = {name: np.array([number]) for name, number in point.items()}
    fit.__dict__["built"] = SimpleNamespace(problem=problem, draws=Draws(point, values, best))
    return fit


def _estimate(spec, summary, kind, prior, verdict, rests=()):
    """An estimate with the numbers of a summary."""
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
    return schema.Estimate(**asdict(summary), **about, reason=f"reason of {spec.name}")


def _shifted(estimate, sds):
    """The summary of an estimate moved by so many of its sds."""
    names = ("point", "median", "q025", "q16", "q84", "q975")
    moved = {name: getattr(estimate, name) + sds * estimate.half for name in names}
    return schema.Summary(**moved, sd=sds * estimate.half)
