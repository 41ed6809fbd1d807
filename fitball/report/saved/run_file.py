"""`run.toml`: all that is needed to repeat a run, as structures that are written and read; see `run_record`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import tomli_w

from fitball.data.bundled import bundled_folder
from fitball.inference.problem.build import NOT_POOLED
from fitball.inference.problem.parameters import SD_SPECS
from fitball.inference.results.results import Fit
from fitball.report.saved.fit_file import BallPart, ModelPart
from fitball.report.saved.structure import Counted, Digest, Part, Positive, part, plain
from fitball.version import __version__

RUN_NAME = "run.toml"
RUN_KIND = "fitball run"
# Version 1, which had no number, named neither the files nor the scene's numbers.
RUN_SCHEMA = 2
SCENE_NUMBERS = (
    *SD_SPECS,
    "nominal_velocity_sd",
    "nominal_spin_sd",
    "force_sd",
    "force_start_sd",
    "ball_temperature_sd",
)
SCENE_TEXTS = ("model", "surface", "ball_type", "description", "citation")
HEAD = """\
# Everything this result depends on; SI units. `fitball repeat` runs it again.
# The priors are those of all parameters; the prior of one that is fixed takes no part.

"""


class NamedTable(Part, frozen=True):
    """A table, or its force records, as `run.toml` names it: `file` relative to the result folder, or the name of a
    bundled one.
    """

    file: str
    bundled: bool
    sha256: Digest


class TablesPart(Part, frozen=True, omit_defaults=True):
    """The table of a fit and the files it was joined from; none for a table made in Python. `flipped` are columns
    that were counted the other way round, `columns` names in the files that are not fitball's, by fitball's name.
    """

    name: str
    sha256: Digest
    files: tuple[NamedTable, ...] = ()
    flipped: tuple[str, ...] = ()
    columns: Mapping[str, str] = {}


class MadePart(Part, frozen=True):
    """By whom and from which seed."""

    version: str
    seed: Annotated[int, msgspec.Meta(ge=0)]
    point_only: bool


class TimePart(Part, frozen=True):
    """What the scene knows of the contact time [s]."""

    value: Positive
    sd: Positive


class MeasurementPart(Part, frozen=True, omit_defaults=True):
    """What is taken of the measurement's errors."""

    distribution: str
    incident_errors: bool
    offsets: str | None = None


class SamplerPart(Part, frozen=True):
    """How the posterior was sampled."""

    ensembles: Counted
    walkers: Counted
    steps: Counted
    max_steps: Counted
    target_ess: Positive


# What the scene knew besides that which stands in the other sections.
ScenePart = msgspec.defstruct(
    "ScenePart",
    [
        ("ball_sd", Mapping[Literal["mass", "radius", "inertia_ratio"], Positive]),
        # In degrees Celsius.
        ("ball_temperature", float | None, None),
        *((name, str | None, None) for name in SCENE_TEXTS),
        *((name, Positive | None, None) for name in SCENE_NUMBERS),
    ],
    bases=(Part,),
    frozen=True,
    omit_defaults=True,
)


class RunFile(Part, frozen=True, omit_defaults=True):
    """The structure of `run.toml`."""

    kind: str
    schema_version: int
    notes: tuple[str, ...]
    fitball: MadePart
    table: TablesPart
    model: ModelPart
    ball: BallPart
    priors: Mapping[str, str]
    fix: Mapping[str, float]
    fixed_because: Mapping[str, str]
    pool: Mapping[str, str]
    measurement: MeasurementPart
    scene: ScenePart  # type: ignore[valid-type]
    contact_time: TimePart | None = None
    force: NamedTable | None = None
    prior_sources: Mapping[str, str] = {}
    sampler: SamplerPart | None = None


def run_text(fit: Fit, folder: Path) -> str:
    """The run as TOML: tables with digests, model, closures, every prior and fixed value, scene, sampler, seed.

    Tables are named relative to the `folder` that the text is written to.
    """
    problem = fit.problem
    table, force = problem.table, problem.force
    run = RunFile(
        kind=RUN_KIND,
        schema_version=RUN_SCHEMA,
        notes=problem.notes,
        fitball=MadePart(__version__, fit.seed, fit.diagnostics is None),
        table=TablesPart(
            table.name,
            table.digest,
            tuple(_named(*file, folder) for file in table.files),
            table.flipped,
            dict(table.columns),
        ),
        model=ModelPart(problem.model.name, problem.model.options),
        ball=part(BallPart, problem.model.ball),
        priors={spec.name: spec.prior.text for spec in problem.parameters},
        prior_sources={spec.name: spec.prior_source for spec in problem.parameters if spec.prior_source},
        fix={spec.name: spec.fixed for spec in problem.parameters if spec.fixed is not None},
        fixed_because={spec.name: spec.fixed_because for spec in problem.parameters if spec.fixed is not None},
        pool={
            **{name: column for name, column in problem.choices.pool.items() if column == NOT_POOLED},
            **{level.parameter: level.column for level in problem.pooling},
        },
        measurement=MeasurementPart(
            distribution=problem.noise.name,
            incident_errors=problem.incident is not None,
            offsets=None if problem.group_bias is None else problem.group_bias.column,
        ),
        scene=part(ScenePart, problem.scene),
        contact_time=None if problem.contact_time is None else TimePart(*problem.contact_time),
        force=None if force is None else _named(force.source, force.digest, folder),
        sampler=None if fit.diagnostics is None else part(SamplerPart, fit.diagnostics),
    )
    # A name that is no Unicode is written as the numbers that stand for its bytes.
    return (HEAD + tomli_w.dumps(plain(run))).encode("utf-8", "backslashreplace").decode()


def _named(source: str, digest: str, folder: Path) -> NamedTable:
    """How a table is named: bundled ones by name, others by the way from the result folder to them."""
    place = Path(source)
    if place.parent == bundled_folder().resolve():
        return NamedTable(place.name, True, digest)
    return NamedTable(Path(os.path.relpath(place, folder.resolve())).as_posix(), False, digest)
