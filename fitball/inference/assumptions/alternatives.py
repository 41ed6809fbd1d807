"""The problems that differ from one in a single choice: another option of a closure, or another kind of noise."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from fitball.errors import FitballError
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.problem.build import build_problem, reduction
from fitball.inference.problem.noise import KINDS
from fitball.inference.problem.problem import Choices, Problem
from fitball.models.model import Model
from fitball.models.registry import closure_options, model
from fitball.values import FloatArray

Value = TypeVar("Value")


@dataclass(frozen=True)
class Change:
    """A `problem` in which the choice `name` (such as `offset=grip`) stands `instead_of` another; None with the
    reason why where it cannot be posed.
    """

    name: str
    instead_of: str
    problem: Problem | None
    reason: str = ""


def alternatives(problem: Problem, probes: FloatArray) -> tuple[Change, ...]:
    """All single changes that make a difference at `probes` (draws, free), coordinates of the problem.

    A closure that the table does not show (see `registry.Reduced`) stays as it is, and so does whether the model is
    told each measured restitution: a model that is told a column cannot be scored by it. Models that take no part in
    comparisons keep their closures.
    """
    found = []
    for name, instead_of, changed in _changes(problem):
        given = problem.model
        try:
            there = model(given.name, ball=given.ball, tangential=given.tangential, **changed.closures)
            if there.needs_cor != given.needs_cor:
                continue
            posed = _posed(problem, changed, there)
        except FitballError as error:
            found.append(Change(name, instead_of, None, str(error)))
            continue
        if not _same(problem, posed, probes):
            found.append(Change(name, instead_of, posed))
    return tuple(found)


def _changes(problem: Problem) -> Iterator[tuple[str, str, Choices]]:
    """Name, what it replaces, and the choices of each single change."""
    chosen = replace(
        problem.choices, model=problem.model.name, closures=dict(problem.model.options), noise=problem.noise.name
    )
    reduced = reduction(problem.table, problem.model.name)
    kept = set() if reduced is None else reduced.closures.keys()
    options = {} if problem.model.unranked else closure_options(problem.model.name)
    for closure, known in options.items():
        now = problem.model.options[closure]
        for option in known if closure not in kept else ():
            if option != now:
                closures = {**chosen.closures, closure: option}
                yield f"{closure}={option}", f"{closure}={now}", replace(chosen, closures=closures)
    for kind in KINDS:
        if kind != problem.noise.name:
            yield f"noise={kind}", f"noise={problem.noise.name}", replace(chosen, noise=kind)


def _posed(problem: Problem, choices: Choices, there: Model) -> Problem:
    """The problem of other choices, that is, of the model `there`; what is known of parameters that only the given
    problem has is left out.
    """
    gone = set(problem.model.parameter_names) - set(there.parameter_names)
    if choices.noise != problem.noise.name:
        gone |= {spec.name for spec in problem.noise.parameters}
    stated = {**problem.scene.priors, **choices.priors}
    silent = set(gone)
    # Of a ball that turns as one k_y may act nowhere, and is held unless a prior is stated: a repetition states all
    # those of the given model, defaults too.
    if "k_theta" in gone and "k_y" in stated and stated["k_y"] == there.specs["k_y"].prior:
        silent.add("k_y")
    scene = replace(
        problem.scene, priors=_without(problem.scene.priors, silent), fix=_without(problem.scene.fix, gone)
    )
    left = replace(choices, priors=_without(choices.priors, silent), fix=_without(choices.fix, gone))
    return replace(build_problem(problem.table, scene, left, problem.force), threads=problem.threads)


def _without(named: Mapping[str, Value], gone: Collection[str]) -> dict[str, Value]:
    return {name: value for name, value in named.items() if name not in gone}


def _same(one: Problem, other: Problem, probes: FloatArray) -> bool:
    """Whether a choice acts nowhere here: the same parameters are as probable to the last bit."""
    return one.free_names == other.free_names and np.array_equal(
        log_posterior(one, probes), log_posterior(other, probes)
    )
