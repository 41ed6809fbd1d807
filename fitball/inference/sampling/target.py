"""What is sampled: a posterior, or one in which scatter is integrated out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np

from fitball.base.prior_families import LogNormal
from fitball.base.values import FloatArray, IntArray
from fitball.inference.density import (
    cell_log_density,
    cells,
    log_posterior,
    measured_blocks,
    scene_density,
)
from fitball.inference.problem.joint_prior import joint_prior
from fitball.inference.problem.problem import Problem
from fitball.inference.sampling.importance import AdaptiveDraws, Student, adaptive_draws
from fitball.inference.scatter import ScatterIntegral

# Draws whose scatter is drawn at once.
COMPLETED_AT_ONCE = 4_000
# Integrals that are kept with their tables, at most some MB each.
KEPT_INTEGRALS = 16


@dataclass(frozen=True)
class Target:
    """The log posterior of a problem, as samplers take it: `names` are those of its coordinates."""

    problem: Problem

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that are sampled."""
        return self.problem.free

    @property
    def numbers(self) -> int:
        """How many numbers `evaluate` gives for a draw."""
        return 1

    def evaluate(
        self, q: Annotated[FloatArray, "draws coordinates"]
    ) -> Annotated[FloatArray, "draws numbers"]:
        """The log density at coordinates, followed by what `complete` needs."""
        return log_posterior(self.problem, q)[:, None]

    def begin(self, proposals: Sequence[Student]) -> list[Student]:
        """Proposals for the coordinates of the problem, in those that are sampled."""
        return [*proposals]

    def sampled(
        self, q: Annotated[FloatArray, "draws free"]
    ) -> Annotated[FloatArray, "draws coordinates"]:
        """Those of the coordinates of the problem that are sampled."""
        return q

    def complete(
        self,
        q: Annotated[FloatArray, "draws coordinates"],
        evaluated: Annotated[FloatArray, "draws numbers"],
        rng: np.random.Generator,
    ) -> tuple[Annotated[FloatArray, "draws free"], Annotated[FloatArray, "draws"]]:
        """All coordinates of the problem for sampled ones, and their log posterior."""
        del rng
        return q, evaluated[:, 0]


class _Scatter(NamedTuple):
    """A noise that is integrated out: its `place` among the free parameters, the numbers of the
    `columns` that have it, and its integral.
    """

    place: int
    columns: IntArray
    integral: ScatterIntegral


@dataclass(frozen=True)
class Integrated(Target):
    """A posterior without its `scatters`: they are integrated out, and drawn again afterwards.
    `reduced` is the problem with all of them held at one, whose residuals are in SI; `kept` are the
    indices of its free parameters among those of the problem.
    """

    reduced: Problem
    scatters: tuple[_Scatter, ...]
    kept: IntArray

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters that are sampled."""
        return self.reduced.free

    @property
    def numbers(self) -> int:
        """How many numbers `evaluate` gives for a draw."""
        return 1 + len(self.scatters)

    def evaluate(self, q: FloatArray) -> FloatArray:
        """The log density at coordinates, and the log sum of squares of each scatter."""
        problem = self.reduced
        evaluated = np.zeros((len(q), self.numbers))
        prior = problem.prior.log_density(q)
        evaluated[:, 0] = prior
        inside = np.flatnonzero(np.isfinite(prior))
        if inside.size:
            evaluated[inside] += self._likelihood(q[inside])
        return evaluated

    def _likelihood(self, q: FloatArray) -> FloatArray:
        """The log likelihood, -inf where the model has no answer, and log sums of squares."""
        problem = self.reduced
        values = problem.values(q)
        count = len(problem.rows.y)
        squares = np.zeros((len(q), len(self.scatters)))
        total = np.zeros(len(q))
        time = np.zeros(len(q))
        possible = np.ones(len(q), dtype=np.bool_)
        others = np.ones(len(problem.observables), dtype=np.bool_)
        for scatter in self.scatters:
            others[scatter.columns] = False
        for block, mask in measured_blocks(problem, len(q)):
            residuals = cells(block, q)
            for k, scatter in enumerate(self.scatters):
                z = residuals.z[:, :, scatter.columns]
                squares[:, k] += np.einsum("dic,dic->d", z, z)
            if others.any():
                density = cell_log_density(block, residuals, values, mask & others)
                total += density.sum(axis=(1, 2))
            time += residuals.time * (len(block.rows.y) / count)
            possible &= residuals.possible
        time = np.where(possible, time, 0.0)
        # Where the model has no answer residuals may be no numbers.
        squares = np.where(possible[:, None], squares, 1.0)
        with np.errstate(divide="ignore"):
            log_squares = np.log(squares)
        for k, scatter in enumerate(self.scatters):
            total += scatter.integral.log_marginal(log_squares[:, k])
        total = np.where(possible, total + scene_density(problem, time), -np.inf)
        return np.column_stack([total, log_squares])

    def begin(self, proposals: Sequence[Student]) -> list[Student]:
        """Proposals without the scatters: their margins."""
        margins = []
        for student in proposals:
            rows = student.factor[self.kept]
            # The triangle of the rows left, without squaring them.
            upper = np.linalg.qr(rows.T, mode="r")
            sign = np.where(np.diagonal(upper) < 0.0, -1.0, 1.0)
            factor = np.asarray((sign[:, None] * upper).T)
            margins.append(Student(student.centre[self.kept], factor, student.freedom))
        return margins

    def sampled(self, q: FloatArray) -> FloatArray:
        """The coordinates without the scatters."""
        return q[:, self.kept]

    def complete(
        self,
        q: FloatArray,
        evaluated: FloatArray,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """All coordinates of the problem, scatters drawn given the others, and their log
        posterior.
        """
        whole = np.empty((len(q), len(self.problem.free)))
        whole[:, self.kept] = q
        score = evaluated[:, 0].copy()
        for first in range(0, len(q), COMPLETED_AT_ONCE):
            some = slice(first, first + COMPLETED_AT_ONCE)
            for k, scatter in enumerate(self.scatters, 1):
                log_squares = evaluated[some, k]
                drawn = scatter.integral.draw(log_squares, rng)
                whole[some, scatter.place] = drawn
                joint = scatter.integral.joint(drawn[:, None], log_squares)[:, 0]
                score[some] += joint - scatter.integral.log_marginal(log_squares)
        return whole, score


@lru_cache(maxsize=KEPT_INTEGRALS)
def _integral_of(prior: LogNormal, count: int) -> ScatterIntegral:
    """The integral of a scatter, with its table: variants of a fit have the same scatters."""
    return ScatterIntegral(prior, count)


def target_of(problem: Problem) -> Target:
    """What is sampled of a problem. Scatter is integrated out where the likelihood is normal, rows
    have no errors of their own, no parameter has levels, and the prior of the scatter is lognormal.
    """
    plain = Target(problem)
    noise = problem.forward.noise
    if noise.name != "normal" or problem.rows.errors is not None or problem.prior.level_priors:
        return plain
    scatters = []
    for name in dict.fromkeys(observable.noise for observable in problem.observables):
        own = [k for k, observable in enumerate(problem.observables) if observable.noise == name]
        count = int(np.isfinite(problem.rows.y[:, own]).sum())
        if name not in problem.free or not count or np.any(problem.rows.sd[:, own] > 0.0):
            continue
        place = problem.free.index(name)
        prior = problem.prior.parameters[place].prior
        if isinstance(prior, LogNormal):
            columns = np.array(own, dtype=np.int64)
            scatters.append(_Scatter(place, columns, _integral_of(prior, count)))
    if not scatters or len(scatters) == len(problem.free):
        return plain
    gone = {problem.free[scatter.place] for scatter in scatters}
    kept = np.flatnonzero([name not in gone for name in problem.free])
    parameters = tuple(
        parameter._replace(fixed=1.0) if parameter.spec.name in gone else parameter
        for parameter in problem.parameters
    )
    reduced = replace(
        problem,
        parameters=parameters,
        free=tuple(problem.free[k] for k in kept),
        prior=joint_prior([problem.prior.parameters[k] for k in kept], []),
    )
    return Integrated(problem, reduced, tuple(scatters), kept)


def adapted(
    target: Target,
    proposals: Sequence[Student],
    rng: np.random.Generator,
    enough: float,
    good_k: float = np.inf,
    progress: Callable[[int], None] = lambda _tried: None,
) -> tuple[AdaptiveDraws, Annotated[FloatArray, "draws numbers"]]:
    """Draws of a target, as by `adaptive_draws` from proposals in its coordinates, and what it
    evaluated at them. `progress` is given how many draws were tried.
    """
    evaluations = list[FloatArray]()

    def density(x: FloatArray) -> FloatArray:
        evaluations.append(target.evaluate(x))
        progress(sum(map(len, evaluations)))
        return evaluations[-1][:, 0]

    drawn = adaptive_draws(density, proposals, rng, enough, good_k)
    # The last evaluations are of the proposals' centres.
    evaluated = np.concatenate(evaluations)[: drawn.tried]
    return drawn, evaluated[np.isfinite(evaluated[:, 0])]
