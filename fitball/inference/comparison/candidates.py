"""Which models stand side by side in a comparison: names, what makes sense on a table, and the columns they share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.errors import FitError, ModelError
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.problem import Problem
from fitball.models.registry import MODELS, Entry, Reduced, model
from fitball.models.specs import DEFAULT_MODEL


@dataclass(frozen=True)
class Candidate:
    """A model of the comparison, under the `name` it was asked for, with its `problem`."""

    name: str
    problem: Problem

    @property
    def given_columns(self) -> tuple[str, ...]:
        """Measured columns that this model takes as input."""
        return ("v_y2",) if self.problem.model.needs_cor else ()


@dataclass(frozen=True)
class Candidates:
    """Models to compare on one table; `columns` are the measured ones that all of them predict, `notes` are sentences
    on what was left out, and why.
    """

    candidates: tuple[Candidate, ...]
    columns: tuple[str, ...]
    notes: tuple[str, ...]


def parse_name(text: str) -> tuple[str, dict[str, str]]:
    """Model and closures of `two-mass+torsion=free+cor=mean`. Raises ModelError for a malformed part."""
    name, *parts = (part.strip() for part in text.split("+"))
    closures: dict[str, str] = {}
    for part in parts:
        closure, equals, option = part.partition("=")
        if not (closure and equals and option):
            raise ModelError(f"model '{text}': read '{part}', expected CLOSURE=OPTION, as in two-mass+torsion=free")
        if closure in closures:
            raise ModelError(f"model '{text}': closure {closure} is given twice")
        closures[closure] = option
    return name, closures


def default_names(table: ImpactTable, quick: bool = False) -> tuple[tuple[str, ...], list[str]]:
    """Models that can differ on this table, and a sentence for those left out."""
    if not table.has_tangential:
        return _tried(lambda entry: entry.vertical), [
            "without motion along the court all models predict COR(v_y1) v_y1: brody, grip-slip, thesis-exact "
            "and the "
            "other model variants are left out"
        ]
    if not table.has_spin:
        return _tried(lambda entry: entry.spinless), [
            "without spin the two-mass ball is rigid and equals brody: two-mass, thesis-exact and all model "
            "variants but those of cor are left out"
        ]
    core = _tried(lambda entry: entry)
    if quick:
        return core, [f"quick: the variants of {DEFAULT_MODEL} are left out"]
    return (*core, *(name for entry in MODELS.values() for name in entry.variants)), []


def _tried(kind: Callable[[Entry], Entry | Reduced | None]) -> tuple[str, ...]:
    """Candidates of all models on one kind of table, the simplest model first."""
    of_kind = [kind(entry) for entry in reversed(MODELS.values())]
    return tuple(name for entry in of_kind if entry is not None for name in entry.candidates)


def build_candidates(table: ImpactTable, scene: Scene, names: Sequence[str]) -> Candidates:
    """Problems for the models called `names`; one that equals an earlier one on this table is left out.

    Raises ModelError and FitError as `build_problem` does, for the model `thesis`, for fewer than two models, and
    when no column is predicted by all of them.
    """
    candidates: list[Candidate] = []
    notes: list[str] = []
    for text in names:
        name, closures = parse_name(text)
        if reason := model(name).unranked:
            raise ModelError(reason)
        if text in (candidate.name for candidate in candidates):
            raise ModelError(f"model {text} is named twice")
        problem = build_problem(table, scene, Choices(model=name, closures=closures))
        twin = next((candidate for candidate in candidates if _same(candidate.problem, problem)), None)
        if twin is None:
            candidates.append(Candidate(text, problem))
        else:
            notes.append(f"{text} is {twin.name} on this table and is not fitted again")
    if len(candidates) < 2:
        raise FitError(
            f"a comparison needs at least two different models, read {len(candidates)}: name more (models)"
        )
    columns, said = _common_columns(candidates)
    if not columns:
        raise FitError(
            f"{table.source}: no measured column is predicted by all of "
            f"{', '.join(candidate.name for candidate in candidates)}: compare fewer models"
        )
    return Candidates(tuple(candidates), columns, tuple(notes + said))


def _same(one: Problem, other: Problem) -> bool:
    """Whether two problems are one: the model, its closures and its free parameters agree."""
    return (one.model.name, dict(one.model.options), one.free_names) == (
        other.model.name,
        dict(other.model.options),
        other.free_names,
    )


def _common_columns(candidates: Sequence[Candidate]) -> tuple[tuple[str, ...], list[str]]:
    predicted: Mapping[str, tuple[str, ...]] = {
        candidate.name: tuple(observable.name for observable in candidate.problem.observables)
        for candidate in candidates
    }
    everything = tuple(dict.fromkeys(name for names in predicted.values() for name in names))
    common = tuple(name for name in everything if all(name in names for names in predicted.values()))
    notes = []
    for name in everything:
        without = [model for model, names in predicted.items() if name not in names]
        if without:
            verb = "does" if len(without) == 1 else "do"
            notes.append(
                f"{name} is left out of all scores, because {', '.join(without)} {verb} not predict it; "
                "the other models are still fitted to it"
            )
    informed = [candidate for candidate in candidates if candidate.given_columns]
    notes += [
        f"{candidate.name} takes as an input each measured {', '.join(candidate.given_columns)}, also of "
        "left-out impacts"
        for candidate in informed
    ]
    return common, notes
