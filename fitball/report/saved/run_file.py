"""`run.toml`: all that is needed to repeat a run, as structures that are written and read, and the run read back."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Literal

import msgspec
import tomli_w

from fitball.data.bundled import bundled_folder, split_sheet
from fitball.data.covariance_entries import LEFT_OUT
from fitball.data.force import load_force
from fitball.data.scene import Camera, Quantity, Scene
from fitball.data.table import FrozenMapping, ImpactTable
from fitball.data.tables import load_tables
from fitball.errors import ResultFolderError
from fitball.inference.effort import Effort
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.force_records import ForceRecords, build_records
from fitball.inference.problem.parameters import SD_SPECS
from fitball.inference.problem.pooling import NOT_POOLED
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Fit
from fitball.inference.results.source import Counted, Digest, Positive, Whole
from fitball.report.saved.structure import (
    FIT_NAME,
    Part,
    damaged,
    part,
    place_of,
    plain,
    read_toml,
    refuse_foreign,
    structured,
)
from fitball.values import Ball
from fitball.version import __version__
from fitball.wording import option

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
SCENE_TEXTS = (
    "model", "surface", "court", "laboratory", "operator", "instrument", "date", "ball_type", "description",
    "citation",
)  # fmt: skip
HEAD = """\
# Everything this result depends on; SI units. `fitball repeat` runs it again.
# The priors are those of all parameters; the prior of a fixed parameter is not used.

"""


class ModelPart(Part, frozen=True):
    """The model and the closures it is composed of."""

    name: str
    closures: Mapping[str, str]


class NamedTable(Part, frozen=True, omit_defaults=True):
    """A table, its force records, or its covariances, as `run.toml` names it: `file` relative to the result folder,
    the name of a bundled one, or "" for what was given in Python.
    """

    file: str
    bundled: bool
    sha256: Digest
    covariance: NamedTable | None = None


class TablesPart(Part, frozen=True, omit_defaults=True):
    """The table of a fit and the files it was joined from; none for a table made in Python. `flipped` are columns
    that were counted the other way round, `ignored` those that were left out, `columns` names in the files that are
    not fitball's, by fitball's name.
    """

    name: str
    sha256: Digest
    files: tuple[NamedTable, ...] = ()
    flipped: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()
    columns: Mapping[str, str] = {}


class MadePart(Part, frozen=True):
    """By whom and from which seed."""

    version: str
    seed: Whole
    point_only: bool


class TimePart(Part, frozen=True):
    """What the scene knows of the contact time [s]."""

    value: Positive
    sd: Positive


class MeasurementPart(Part, frozen=True, omit_defaults=True):
    """What is taken of the measurement's errors. `velocity_noise` is written where stated errors are all of the
    noise: which columns share one follows from the parameters.
    """

    distribution: str
    incident_errors: bool
    offsets: str | None = None
    velocity_noise: Literal["stated"] | None = None


class SamplerPart(Part, frozen=True):
    """How the posterior was sampled."""

    ensembles: Counted
    walkers: Counted
    steps: Counted
    max_steps: Counted
    target_ess: Positive


class SpreadPart(Part, frozen=True, omit_defaults=True):
    """A number with its standard deviation, when one was stated."""

    value: float
    sd: Positive | None = None


class CameraPart(Part, frozen=True, omit_defaults=True):
    """What a session of filming shares, see `data.scene.Camera`."""

    scale: SpreadPart | None = None
    clock: SpreadPart | None = None
    tilt: SpreadPart | None = None
    court_height: SpreadPart | None = None
    fps: Positive | None = None
    mm_per_px: Positive | None = None
    row_time: Positive | None = None
    court: float | None = None


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
    ball: Ball
    priors: Mapping[str, str]
    fix: Mapping[str, float]
    fixed_because: Mapping[str, str]
    pool: Mapping[str, str]
    measurement: MeasurementPart
    scene: ScenePart  # type: ignore[valid-type]
    contact_time: TimePart | None = None
    camera: CameraPart | None = None
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
            tuple(_named_table(table, *file, folder) for file in table.files),
            table.flipped,
            table.ignored,
            dict(table.columns),
        ),
        model=ModelPart(problem.model.name, problem.model.options),
        ball=problem.model.ball,
        priors={
            **{spec.name: spec.prior.text for spec in problem.parameters},
            **{name: prior.text for name, prior in problem.spreads.items()},
        },
        prior_sources={spec.name: spec.prior_source for spec in problem.parameters if spec.prior_source},
        fix={spec.name: spec.fixed for spec in problem.parameters if spec.fixed is not None},
        fixed_because={spec.name: spec.fixed_because for spec in problem.parameters if spec.fixed is not None},
        pool={
            **{name: column for name, column in problem.choices.pool.items() if column == NOT_POOLED},
            **{level.parameter: level.column for level in problem.pooling},
        },
        measurement=MeasurementPart(
            distribution=problem.noise.name,
            incident_errors=problem.uncertain,
            offsets=None if problem.group_bias is None else problem.group_bias.column,
            velocity_noise="stated"
            if any(item.sd is not None and not item.scatters for item in problem.observables)
            else None,
        ),
        scene=part(ScenePart, problem.scene),
        contact_time=None if problem.contact_time is None else TimePart(*problem.contact_time),
        camera=None if problem.scene.camera is None else camera_part(problem.scene.camera),
        force=None if force is None else _named(force.source, force.digest, folder),
        sampler=None if fit.diagnostics is None else part(SamplerPart, fit.diagnostics),
    )
    # A name that is no Unicode is written as the numbers that stand for its bytes.
    return (HEAD + tomli_w.dumps(plain(run))).encode("utf-8", "backslashreplace").decode()


def camera_part(camera: Camera) -> CameraPart:
    """What a session of filming shares, as `run.toml` has it."""
    known: dict[str, Any] = {
        name: SpreadPart(it.value, it.sd) if isinstance(it, Quantity) else it for name, it in vars(camera).items()
    }
    return CameraPart(**known)


def _camera(part: CameraPart) -> Camera:
    known: dict[str, Any] = {
        name: Quantity(it.value, it.sd) if isinstance(it, SpreadPart) else it
        for name, it in msgspec.structs.asdict(part).items()
    }
    return Camera(**known)


def _named_table(table: ImpactTable, source: str, digest: str, folder: Path) -> NamedTable:
    """A table with its covariances."""
    named, errors = _named(source, digest, folder), table.covariance_files.get(source)
    if errors is None:
        return named
    place, own = errors
    return msgspec.structs.replace(
        named, covariance=_named(place, own, folder) if place else NamedTable("", False, own)
    )


def _named(source: str, digest: str, folder: Path) -> NamedTable:
    """How a table is named: bundled ones by name, others by the way from the result folder to them."""
    place = Path(source)
    if place.parent == bundled_folder().resolve():
        return NamedTable(place.name, True, digest)
    return NamedTable(Path(os.path.relpath(place, folder.resolve())).as_posix(), False, digest)


@dataclass(frozen=True)
class RunRecord:
    """A run: `file` is what the `run.toml` at `place` says. `scene` and `choices` together define the problem."""

    place: Path
    file: RunFile

    @property
    def folder(self) -> Path:
        """The result folder."""
        return self.place.parent

    @property
    def scene(self) -> Scene:
        """What the scene knew."""
        known = {name: value for name, value in msgspec.structs.asdict(self.file.scene).items() if value is not None}
        time = self.file.contact_time
        known["contact_time"] = None if time is None else (time.value, time.sd)
        camera = self.file.camera
        known["camera"] = None if camera is None else _camera(camera)
        return Scene(ball=self.file.ball, ball_sd=FrozenMapping(known.pop("ball_sd")), **known)

    @property
    def choices(self) -> Choices:
        """What was chosen."""
        file = self.file
        return Choices(
            model=file.model.name,
            closures=file.model.closures,
            priors=file.priors,
            fix=file.fix,
            noise=file.measurement.distribution,
            pool=file.pool,
            offsets=file.measurement.offsets,
            incident_errors=file.measurement.incident_errors,
            velocity_noise=file.measurement.velocity_noise,
        )

    @property
    def effort(self) -> Effort:
        """How it was sampled."""
        sampler, made = self.file.sampler, self.file.fitball
        effort = Effort(seed=made.seed, point_only=made.point_only)
        if sampler is None:
            return effort
        # One walker is no ensemble: draws were weighed, as they would be again.
        walkers = None if sampler.walkers == 1 else sampler.walkers
        steps, ess = sampler.max_steps, sampler.target_ess
        return replace(effort, walkers=walkers, ensembles=sampler.ensembles, max_steps=steps, ess=ess)

    def place_of(self, named: NamedTable) -> Path:
        """Where a file lay that the run was made from. Raises ResultFolderError."""
        if named.bundled:
            return bundled_folder().resolve() / named.file
        try:
            return (self.folder / named.file).resolve()
        except (OSError, ValueError, RuntimeError) as error:
            raise damaged(self.place, f"table.files: {named.file[:200]!r} names no file: {error}") from None

    def problem(self, table: ImpactTable, force: ForceRecords | None) -> Problem:
        """The problem of the run, from the table it was made from and its force records.

        Raises as `build_problem` does.
        """
        made, file = build_problem(table, self.scene, self.choices, force), self.file
        parameters = tuple(
            replace(
                item,
                fixed_because=file.fixed_because.get(item.name, item.fixed_because),
                prior_source=file.prior_sources.get(item.name, ""),
            )
            for item in made.parameters
        )
        return replace(made, parameters=parameters, notes=file.notes)


def read_run(path: Path) -> RunRecord:
    """Read a `run.toml`: the one in a folder, the one beside a `fit.json`, or a TOML file itself.

    Raises ResultFolderError for a file that is missing, damaged, foreign, or of another schema version.
    """
    place = path.with_name(RUN_NAME) if path.name == FIT_NAME else place_of(path, RUN_NAME)
    content = read_toml(place)
    if "schema_version" not in content and "fitball" in content:
        raise ResultFolderError(
            f"{place}: written by an old fitball, without all that a repetition needs; run calibrate again"
        )
    refuse_foreign(place, content, RUN_KIND, RUN_SCHEMA)
    return RunRecord(place, structured(place, content, RunFile))


def find_tables(record: RunRecord, given: Sequence[str] = ()) -> tuple[Path, ...]:
    """The files a run was made from: those `given`, or where `run.toml` says; each checked against its digest.

    Raises ResultFolderError when one is gone or has changed, naming both digests.
    """
    tables = record.file.table.files
    if not tables:
        raise ResultFolderError(
            f"{record.place}: has no file of the table, which was made in Python; fit it there again"
        )
    if given and len(given) != len(tables):
        raise ResultFolderError(
            f"{record.place}: made from {len(tables)} table{'s' if len(tables) > 1 else ''}, but {len(given)} given; "
            "give each of them, in the order of the fit"
        )
    places = map(Path, given) if given else map(record.place_of, tables)
    return tuple(_found(place, named, "the table", "data") for place, named in zip(places, tables, strict=True))


def find_records(record: RunRecord, given: str | None = None) -> Path | None:
    """The file of the run's force records, None where it had none; as `find_tables`."""
    force = record.file.force
    if force is None:
        if given is not None:
            raise ResultFolderError(f"{record.place}: made without force records, but {given} is given")
        return None
    return _found(Path(given) if given else record.place_of(force), force, "the force record", "force")


def find_covariances(record: RunRecord, given: Sequence[str] = ()) -> tuple[Path | str, ...]:
    """The files of covariances of a run's tables, "none" for a table without; as `find_tables`. Those `given` are
    of the tables that have one.
    """
    named = [table.covariance for table in record.file.table.files]
    having = [item for item in named if item is not None]
    if given and len(given) != len(having):
        raise ResultFolderError(
            f"{record.place}: made with covariances of {len(having)} table{'s' if len(having) != 1 else ''}, but "
            f"{len(given)} given; give one for each, in the order of the fit"
        )
    if any(not item.file for item in having):
        raise ResultFolderError(
            f"{record.place}: has no file of the covariances, which were given in Python; fit it there again"
        )
    places = iter(map(Path, given) if given else map(record.place_of, having))
    what, name = "the covariance", "covariance"
    return tuple(LEFT_OUT if item is None else _found(next(places), item, what, name) for item in named)


def _found(place: Path, named: NamedTable, what: str, name: str) -> Path:
    """`place`, where it holds what `named` says; ResultFolderError otherwise."""
    file = Path(split_sheet(place)[0])
    try:
        there = file.is_file()
    except OSError as error:
        raise ResultFolderError(f"{str(place)[:200]}: cannot be opened: {error.strerror}") from None
    if not there:
        raise ResultFolderError(
            f"{place}: {what} of this fit is missing; put it back, or give its place with {option(name, 'FILE')} "
            f"(SHA-256 {named.sha256})"
        )
    digest = sha256(file.read_bytes()).hexdigest()
    if digest != named.sha256:
        raise ResultFolderError(
            f"{place}: changed since the fit: its SHA-256 is {digest}, the fit was made from {named.sha256}; "
            f"put the old file back, give it with {option(name, 'FILE')}, or run calibrate again"
        )
    return place


def record_problem(
    record: RunRecord, tables: Sequence[Path], records: Path | None = None, covariances: Sequence[Path | str] = ()
) -> Problem:
    """The problem of a run, from the files that `find_tables`, `find_records` and `find_covariances` found.

    Raises as reading and `build_problem` do.
    """
    named, scene = record.file.table, record.scene
    table = load_tables(tables, scene, named.flipped, named.columns, named.ignored, covariances or None)
    force = None if records is None else build_records(load_force(records, table), scene.force_start_sd)
    return record.problem(table, force)
