"""Effective draws a CPU second: fitball's sampling beside samplers people would take instead, on our own log
posterior and on tables of different kinds.

Each has the same CPU seconds, coordinates, starting points and density, and its burn-in is dropped: only samplers are
compared. Those that are not installed are named.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
import pandas as pd
from arviz_stats.base.array import array_stats
from matplotlib.figure import Figure

from fitball.bench.errors import OURS, SCRIPT
from fitball.bench.measure import MARKS
from fitball.bench.problems import problems
from fitball.inference.effort import Effort
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.point.point_fit import point_fit
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.convergence import TAILS
from fitball.inference.sampling.ensembles import default_walkers, sample, starting_positions
from fitball.report.figures.canvas import new_figure, own_style
from fitball.report.form.palette import GUIDE, SERIES
from fitball.values import FloatArray
from fitball.version import __version__

# Share of a chain that is burn-in, chains of samplers without walkers, draws between looks at the clock.
BURN_IN, CHAINS, BLOCK = 0.33, 4, 50
# Starts that tell PINTS a scale, and its draws before it adapts.
SPREAD, UNADAPTED = 200, 200
# Draws with which NUTS learns its step and metric, and those that each chain makes however long they take.
NUTS_WARM_UP, FEWEST = 150, 12
# Live points of nested sampling a parameter, and the evidence that may be left.
LIVE, LEFT = 5, 0.5
# Step of central differences, in widths of the priors.
DIFFERENCE = 1e-5
# Effective draws below which nothing is said: the chains have not met.
LEAST = 20.0
NAIVE = "emcee, stretch move, on solve_ivp"


@dataclass
class Budget:
    """CPU seconds of this process, counted from when it is made; `start` counts anew."""

    seconds: float
    begun: float = field(default_factory=time.process_time)

    def start(self) -> None:
        """Count from now."""
        self.begun = time.process_time()

    @property
    def spent(self) -> float:
        """CPU seconds so far."""
        return time.process_time() - self.begun

    @property
    def left(self) -> bool:
        """Whether there is time left."""
        return self.spent < self.seconds


class Target:
    """The log posterior of a problem with the number of its `evaluations`, and starts for any number of walkers."""

    def __init__(self, problem: Problem, optima: FloatArray, seed: int = 1) -> None:
        self.problem, self.optima, self.seed = problem, optima, seed
        self.dimension = problem.dimension
        self.evaluations = 0

    def many(self, coordinates: FloatArray) -> FloatArray:
        """Log posterior (draws,) of coordinates (draws, free)."""
        self.evaluations += len(coordinates)
        return log_posterior(self.problem, coordinates)

    def one(self, coordinates: FloatArray) -> float:
        """Log posterior of coordinates (free,), low instead of minus infinity."""
        return max(float(self.many(coordinates[None])[0]), -1e300)

    def with_gradient(self, coordinates: FloatArray) -> tuple[float, FloatArray]:
        """Log posterior of coordinates (free,) and its slopes (free,), by central differences in one batch."""
        steps = np.diag(DIFFERENCE * self.problem.prior.width)
        found = self.many(np.concatenate([coordinates[None], coordinates + steps, coordinates - steps]))
        ahead, behind = found[1 : self.dimension + 1], found[self.dimension + 1 :]
        with np.errstate(invalid="ignore"):
            slopes = (ahead - behind) / (2.0 * np.diag(steps))
        return float(found[0]), np.where(np.isfinite(slopes), slopes, 0.0)

    def starts(self, count: int) -> FloatArray:
        """Coordinates (count, free), as those of our ensembles."""
        return starting_positions(self.problem, self.optima, 0, count, np.random.default_rng(self.seed))


@dataclass(frozen=True)
class Sampler:
    """A rival: the `package` that it comes from, and `run`, which returns effective draws."""

    name: str
    package: str
    run: Callable[[Target, Budget], float]

    @property
    def version(self) -> str | None:
        """Of the package; None where it is not installed."""
        try:
            return version(self.package)
        except PackageNotFoundError:
            return None


def effective(chain: FloatArray) -> float:
    """The least effective number of draws, bulk or tail, over the parameters of a chain (steps, walkers, free).

    No more than there are draws: of short chains the estimates are above that.
    """
    kept = chain[int(BURN_IN * len(chain)) :].transpose(2, 1, 0)
    sizes = [
        [array_stats.ess(column, chain_axis=0, draw_axis=1, method="bulk"),
         array_stats.ess(column, chain_axis=0, draw_axis=1, method="tail", prob=TAILS)]
        for column in kept
    ]  # fmt: skip
    return float(min(np.min(sizes), kept[0].size))


def emcee_stretch(target: Target, budget: Budget) -> float:
    """As emcee comes: one ensemble, the stretch move."""
    import emcee

    walkers = default_walkers(target.dimension)
    sampler = emcee.EnsembleSampler(walkers, target.dimension, target.many, vectorize=True)
    state = emcee.State(target.starts(walkers))
    while budget.left:
        state = sampler.run_mcmc(state, BLOCK)
    return effective(sampler.get_chain())


def zeus_slice(target: Target, budget: Budget) -> float:
    """As zeus comes: ensemble slice sampling."""
    import zeus

    walkers = default_walkers(target.dimension)
    sampler = zeus.EnsembleSampler(walkers, target.dimension, target.many, vectorize=True, verbose=False)
    start: Any = target.starts(walkers)
    np.random.seed(target.seed)  # noqa: NPY002 - zeus knows no other generator
    parts = []
    while budget.left:
        sampler.run_mcmc(start, BLOCK, progress=False)
        parts.append(sampler.get_chain())
        start = sampler.get_last_sample()
        sampler.reset()
    return effective(np.concatenate(parts))


def pints_adaptive(target: Target, budget: Budget) -> float:
    """The default of PINTS: adaptive Metropolis by Haario and Bardenet, some chains."""
    import pints

    np.random.seed(target.seed)  # noqa: NPY002 - PINTS knows no other generator
    reach = np.cov(target.starts(SPREAD), rowvar=False)
    chains = [pints.HaarioBardenetACMC(start, reach) for start in target.starts(CHAINS)]
    draws: list[list[FloatArray]] = [[] for _ in chains]
    while budget.left:
        for chain, mine in zip(chains, draws, strict=True):
            for _ in range(BLOCK):
                told = None
                while told is None:
                    told = chain.tell(target.one(chain.ask()))
                mine.append(np.array(told[0]))
            chain.set_initial_phase(len(mine) < UNADAPTED)
    return effective(np.array(draws).transpose(1, 0, 2))


def dynesty_nested(target: Target, _budget: Budget) -> float:
    """As dynesty comes: nested sampling until little evidence is left, however long that takes."""
    import dynesty

    priors = target.problem.prior.priors
    likelihood_of = target.problem.prior.log_density

    def coordinates(cube: FloatArray) -> FloatArray:
        values = [prior.quantile(np.asarray(share)) for prior, share in zip(priors, cube, strict=True)]
        return np.asarray(target.problem.to_coordinates(np.array(values, dtype=np.float64)[None])[0])

    def likelihood(at: FloatArray) -> float:
        return target.one(at) - float(likelihood_of(at[None])[0])

    sampler = dynesty.NestedSampler(
        likelihood, coordinates, target.dimension, nlive=LIVE * target.dimension,
        rstate=np.random.default_rng(target.seed),
    )  # fmt: skip
    sampler.run_nested(dlogz=LEFT, print_progress=False)
    weights = np.exp(sampler.results.logwt - sampler.results.logz[-1])
    return float(weights.sum() ** 2 / np.sum(weights**2))


def numpyro_nuts(target: Target, budget: Budget) -> float:
    """NUTS of numpyro with a dense metric, slopes by differences of our density; compiling is not counted."""
    import jax
    from numpyro.infer.hmc import hmc

    jax.config.update("jax_enable_x64", True)
    shapes = (jax.ShapeDtypeStruct((), np.float64), jax.ShapeDtypeStruct((target.dimension,), np.float64))

    def asked(at: Any) -> Any:
        return jax.pure_callback(lambda x: target.with_gradient(np.asarray(x)), shapes, at)

    potential = jax.custom_vjp(lambda at: -asked(at)[0])
    potential.defvjp(lambda at: (-asked(at)[0], asked(at)[1]), lambda slopes, passed: (-passed * slopes,))
    begin, advance = hmc(potential, algo="NUTS")
    go_on = jax.jit(advance)
    draws: list[list[FloatArray]] = []
    for k, start in enumerate(target.starts(CHAINS)):
        state = begin(start, NUTS_WARM_UP, dense_mass=True, rng_key=jax.random.key(target.seed + k))
        if not k:
            go_on(state)
            budget.start()
        draws.append([])
        while len(draws[k]) < FEWEST or budget.spent < budget.seconds * (k + 1) / CHAINS:
            state = go_on(state)
            draws[k].append(np.asarray(state.z))
    least = min(map(len, draws))
    return effective(np.array([mine[:least] for mine in draws]).transpose(1, 0, 2))


STRETCH = "emcee, stretch move"
RIVALS = (
    Sampler(STRETCH, "emcee", emcee_stretch),
    Sampler("zeus", "zeus-mcmc", zeus_slice),
    Sampler("PINTS, adaptive Metropolis", "pints", pints_adaptive),
    Sampler("dynesty, nested", "dynesty", dynesty_nested),
    Sampler("numpyro, NUTS", "numpyro", numpyro_nuts),
)


def missing() -> list[str]:
    """Packages of rivals that are not installed."""
    return [rival.package for rival in RIVALS if rival.version is None]


def sampling_costs(seconds: float, densities: pd.DataFrame, report: Callable[[str], None]) -> pd.DataFrame:
    """One row a table and sampler: CPU seconds (of rivals about `seconds`), densities, effective draws, densities a
    draw and draws a second.

    A script on `solve_ivp` asks for as many densities as the same sampler does on ours; `densities` say what each
    costs it.
    """
    scripts = densities[densities["log posterior"] == SCRIPT].set_index("table")["microseconds"]
    rows = []
    for name, problem in problems():
        report(f"effective draws of {name}")
        _, point = point_fit(problem, np.random.default_rng(1))
        chosen = [[optimum[free] for free in problem.free_names] for optimum in point.optima]
        optima = problem.to_coordinates(np.array(chosen))
        for sampler, number, spent, asked, draws in (_ours(problem, optima), *_theirs(problem, optima, seconds)):
            rows.append(_row(name, sampler, number, spent, asked, draws))
            if sampler == STRETCH:
                rows.append(_row(name, NAIVE, number, 1e-6 * asked * scripts[name], asked, draws))
    return pd.DataFrame(rows)


Found = tuple[str, str, float, int, float]


def _ours(problem: Problem, optima: FloatArray) -> Found:
    settings = Effort(cores=1).settings(problem)
    budget = Budget(math.inf)
    sampled = sample(problem, optima, settings, None, False, lambda _progress: None)
    asked = sampled.steps * settings.walkers * settings.ensembles
    return OURS, __version__, budget.spent, asked, sampled.convergence.min_ess


def _theirs(problem: Problem, optima: FloatArray, seconds: float) -> Iterator[Found]:
    for rival in RIVALS:
        if rival.version is not None:
            target, budget = Target(problem, optima), Budget(seconds)
            draws = rival.run(target, budget)
            yield rival.name, rival.version, budget.spent, target.evaluations, draws


def _row(table: str, sampler: str, version: str, seconds: float, asked: int, draws: float) -> dict[str, object]:
    known = draws if draws >= LEAST else math.nan
    return {
        "table": table, "sampler": sampler, "version": version, "CPU seconds": seconds, "densities": asked,
        "effective draws": draws, "densities a draw": asked / known, "draws a CPU second": known / seconds,
    }  # fmt: skip


@own_style()
def figure(frame: pd.DataFrame) -> Figure:
    """Effective draws a CPU second by sampler, one mark a table."""
    samplers = list(dict.fromkeys(frame["sampler"]))[::-1]
    made = new_figure(8.5, 1.4 + 0.42 * len(samplers))
    panel = made.subplots()
    for k, (table, mine) in enumerate(frame.groupby("table", sort=False)):
        panel.semilogx(
            mine["draws a CPU second"], [samplers.index(name) for name in mine["sampler"]], MARKS[k % len(MARKS)],
            color=SERIES[k % len(SERIES)], label=str(table), alpha=0.85,
        )  # fmt: skip
    panel.set_yticks(range(len(samplers)), samplers)
    panel.set_ylim(-0.5, len(samplers) - 0.5)
    panel.hlines(range(len(samplers)), *panel.get_xlim(), color=GUIDE, linewidth=0.5, alpha=0.5)
    panel.set_xlabel("effective draws a CPU second")
    panel.grid(alpha=0.3, axis="x")
    panel.legend(fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return made
