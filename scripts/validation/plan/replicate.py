"""One simulated table at chosen impacts, fitted together with the table that the plan was made from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitball.api.calibrating import calibrate
from fitball.errors import FitError
from fitball.inference.design.knowledge import Knowledge, knowledge, solved
from fitball.inference.design.make_plan import make_plan
from fitball.inference.design.results import Plan
from fitball.inference.design.sensor import Sensor, as_before, parse_sensor
from fitball.inference.design.target import Target, parse_target
from fitball.inference.identifiability.fisher import about
from fitball.inference.problem.observables import Observable
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Fit
from fitball.inference.sampling.importance import importance_posterior
from fitball.inference.sampling.moves import StudentProposal
from fitball.values import FloatArray, Impacts
from validation.plan.cases import CASES, Case

PLANNED, AGAIN = "planned", "table again"
# Independent draws that a refit is worth: an sd is then known within 1.8 %.
EFFECTIVE = 1500.0


@dataclass(frozen=True)
class Design:
    """Impacts to simulate, the sensor that reads them, and what the plan promises: `gain` in nats, `sds` (parts,)."""

    impacts: Impacts
    like: NDArray[np.int64]
    sensor: Sensor
    gain: float
    sds: FloatArray


@dataclass(frozen=True)
class Ready:
    """A case with its fit, plan and designs by name."""

    case: Case
    known: Knowledge
    target: Target
    plan: Plan
    designs: Mapping[str, Design]
    proposal: StudentProposal


@dataclass(frozen=True)
class Narrowed:
    """What one simulated table did: nats by which a normal target narrowed, sds (parts,) after it, and how many draws
    the refit is worth.
    """

    nats: float
    sds: FloatArray
    effective: float


def prepared(name: str, seed: int) -> Ready:
    """Fit the table of the case called `name`, and plan."""
    case = CASES[name]
    return planned_from(case, calibrate(case.table, case.model, seed=seed, cores=1).result, seed)


def planned_from(case: Case, fit: Fit, seed: int) -> Ready:
    """Plan from a fit, with what plan and table promise. Raises FitError for a fit whose table cannot be extended."""
    problem, asked = fit.problem, case.asked(seed)
    known = knowledge(problem, fit.posterior, np.random.default_rng(seed))
    if known.problem is not problem or problem.pooling or problem.incident is not None or problem.force is not None:
        raise FitError(f"{case.words}: the study extends tables without groups, levels and uncertain incidence only")
    plan = make_plan(problem, fit.posterior, asked)
    sensor = as_before(problem) if case.sensor is None else parse_sensor(problem, case.sensor)
    states = [one.setting for one in plan.chosen]
    speed, angle, spin = (np.array([getattr(state, part) for state in states]) for part in ("speed", "angle", "spin"))
    chosen = Impacts(speed * np.cos(angle), speed * np.sin(angle), spin)
    # Evenly over the table by angle, as it was made.
    order = np.argsort(np.arctan2(problem.impacts.v_y1, problem.impacts.v_x1), kind="stable")
    rows = order[((np.arange(case.impacts) + 0.5) * len(order) / case.impacts).astype(np.int64)]
    designs = {
        PLANNED: Design(chosen, np.zeros(case.impacts, dtype=np.int64), sensor, plan.gain, plan.chosen[-1].sds),
        AGAIN: Design(problem.impacts.take(rows), rows, as_before(problem), plan.again, plan.again_sds),
    }
    weights = np.full(len(known.coordinates), 1.0 / len(known.coordinates))
    proposal = StudentProposal.fit(known.coordinates, weights)
    if proposal is None:
        raise FitError(f"{case.words}: the draws of the posterior do not span its space")
    return Ready(case, known, parse_target(case.target, known), plan, designs, proposal)


def replicate(ready: Ready, seed: int, number: int) -> Mapping[str, Narrowed | None]:
    """A truth from the posterior, a table at each design, the fit of both tables; None where there is none."""
    rng = np.random.default_rng([seed, number])
    row = rng.integers(len(ready.known.coordinates), size=1)
    return {name: _narrowed(ready, design, row, rng) for name, design in ready.designs.items()}


def _narrowed(ready: Ready, design: Design, row: NDArray[np.int64], rng: np.random.Generator) -> Narrowed | None:
    known, truth = ready.known, ready.known.coordinates[row]
    y = _simulated(known.at(design.impacts, design.like), design.sensor, truth, rng)
    if y is None:
        return None
    problem = extended(known.problem, design.impacts, design.sensor, y)
    drawn = importance_posterior(problem, [ready.proposal, about(problem, truth[0])], rng, EFFECTIVE)
    if not drawn.settled:
        return None
    weights = np.exp(drawn.log_weights)
    after = _covariance(ready.target.values(problem.to_coordinates(drawn.values)), weights)
    before = _covariance(ready.target.values(known.coordinates), np.full(len(known.coordinates), 1.0))
    nats = 0.5 * float(np.linalg.slogdet(before)[1] - np.linalg.slogdet(after)[1])
    return Narrowed(nats, np.sqrt(np.diag(after)), drawn.effective)


def _simulated(problem: Problem, sensor: Sensor, truth: FloatArray, rng: np.random.Generator) -> FloatArray | None:
    """What a sensor reads (impacts, columns) at one draw `truth` (1, free); None where that cannot be evaluated."""
    values = problem.to_values(truth)
    columns, rebound = problem.all_values(values), problem.rebound(values)
    if not np.all(solved(rebound)):
        return None
    means = np.stack([column.predict(rebound)[0] for column in sensor.columns], axis=1)
    sds = np.stack([column.sds(columns, rebound)[0] for column in sensor.columns], axis=1)
    return np.asarray(means + sds * problem.noise.draw(rng, (1, *means.shape), columns)[0])


def _covariance(quantities: FloatArray, weights: FloatArray) -> FloatArray:
    told = np.isfinite(quantities).all(axis=1)
    return np.atleast_2d(np.cov(quantities[told], rowvar=False, aweights=weights[told]))


def extended(problem: Problem, impacts: Impacts, sensor: Sensor, y: FloatArray) -> Problem:
    """The problem of a table with further impacts, read by a sensor as `y` (impacts, columns). Raises FitError for a
    sensor that reads a column of the table with another noise.
    """
    first = len(problem.impacts)
    joined = Impacts(
        np.concatenate([problem.impacts.v_x1, impacts.v_x1]),
        np.concatenate([problem.impacts.v_y1, impacts.v_y1]),
        np.concatenate([problem.impacts.omega_1, impacts.omega_1]),
    )
    before = {column.name: column for column in as_before(problem).columns}
    if any(before.get(column.name, column) != column for column in sensor.columns):
        raise FitError(f"sensor {sensor.name}: columns that the table has can only be read as the table was")
    measured = {column.name: y[:, k] for k, column in enumerate(sensor.columns)}
    observables = [
        replace(
            item.everywhere(first),
            observed=np.concatenate([item.everywhere(first).observed, measured.pop(item.name)]),
        )
        for item in problem.observables
    ]
    rows = np.arange(first, first + len(impacts))
    sds = {column.name: column.sd for column in sensor.columns}
    for name, values in measured.items():
        observables.append(Observable(name, values, np.full(len(values), sds[name]), None, rows))
    return replace(problem, impacts=joined, observables=tuple(observables))
