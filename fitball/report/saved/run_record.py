"""`run.toml` read back: the run it describes, ready to be made again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path

import msgspec

from fitball.data.bundled import bundled_folder, split_sheet
from fitball.data.force_file import load_force
from fitball.data.join import load_tables
from fitball.data.scene import Scene
from fitball.data.table import FrozenMapping, ImpactTable
from fitball.errors import ResultFolderError
from fitball.inference.effort import Effort
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.problem.force_records import ForceRecords, build_records
from fitball.inference.problem.problem import Problem
from fitball.report.saved.run_file import (
    RUN_KIND,
    RUN_NAME,
    RUN_SCHEMA,
    MadePart,
    NamedTable,
    RunFile,
    SamplerPart,
)
from fitball.report.saved.saved_fit import FIT_NAME
from fitball.report.saved.structure import damaged, place_of, read_toml, refuse_foreign, structured
from fitball.wording import option


@dataclass(frozen=True)
class RunRecord:
    """A run: `place` is the file that describes it. `scene` and `choices` together define the problem; `reasons` say
    why parameters are fixed, `sources` where priors were published, `notes` are those of the problem; `force` are the
    force records, if there were any, `flipped` the columns counted the other way round, `columns` names in the tables
    that are not ours, by our name.
    """

    place: Path
    tables: tuple[NamedTable, ...]
    force: NamedTable | None
    scene: Scene
    choices: Choices
    reasons: Mapping[str, str]
    notes: tuple[str, ...]
    effort: Effort
    flipped: tuple[str, ...] = ()
    sources: Mapping[str, str] = field(default_factory=dict)
    columns: Mapping[str, str] = field(default_factory=FrozenMapping)

    @property
    def folder(self) -> Path:
        """The result folder."""
        return self.place.parent

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
        made = build_problem(table, self.scene, self.choices, force)
        parameters = tuple(
            replace(
                item,
                fixed_because=self.reasons.get(item.name, item.fixed_because),
                prior_source=self.sources.get(item.name, ""),
            )
            for item in made.parameters
        )
        return replace(made, parameters=parameters, notes=self.notes)


def read_run(path: Path) -> RunRecord:
    """Read a `run.toml`: the one in a folder, the one beside a `fit.json`, or a TOML file itself.

    Raises ResultFolderError for a file that is missing, damaged, foreign, or of another schema version.
    """
    place = path.with_name(RUN_NAME) if path.name == FIT_NAME else place_of(path, RUN_NAME)
    content = read_toml(place)
    if "schema_version" not in content and "fitball" in content:
        raise ResultFolderError(
            f"{place}: made by a fitball that did not keep all it takes to repeat a run; run calibrate again"
        )
    refuse_foreign(place, content, RUN_KIND, RUN_SCHEMA)
    return _record(place, structured(place, content, RunFile))


def _record(place: Path, file: RunFile) -> RunRecord:
    time = file.contact_time
    known = {name: value for name, value in msgspec.structs.asdict(file.scene).items() if value is not None}
    ball_sd = FrozenMapping(known.pop("ball_sd"))
    contact_time = None if time is None else (time.value, time.sd)
    choices = Choices(
        model=file.model.name,
        closures=file.model.closures,
        priors=file.priors,
        fix=file.fix,
        noise=file.measurement.distribution,
        pool=file.pool,
        offsets=file.measurement.offsets,
        incident_errors=file.measurement.incident_errors,
    )
    return RunRecord(
        place=place,
        tables=file.table.files,
        force=file.force,
        scene=Scene(ball=file.ball.ball(), ball_sd=ball_sd, contact_time=contact_time, **known),
        choices=choices,
        reasons=file.fixed_because,
        notes=file.notes,
        effort=_effort(file.fitball, file.sampler),
        flipped=file.table.flipped,
        sources=file.prior_sources,
        columns=file.table.columns,
    )


def _effort(made: MadePart, sampler: SamplerPart | None) -> Effort:
    effort = Effort(seed=made.seed, point_only=made.point_only)
    if sampler is None:
        return effort
    return replace(
        effort,
        # One walker is no ensemble: draws were weighed, as they would be again.
        walkers=None if sampler.walkers == 1 else sampler.walkers,
        ensembles=sampler.ensembles,
        max_steps=sampler.max_steps,
        ess=sampler.target_ess,
    )


def find_tables(record: RunRecord, given: Sequence[str] = ()) -> tuple[Path, ...]:
    """The files a run was made from: those `given`, or where `run.toml` says; each checked against its digest.

    Raises ResultFolderError when one is gone or has changed, naming both digests.
    """
    if not record.tables:
        raise ResultFolderError(
            f"{record.place}: names no file: the table was made in Python; fit it there again to repeat the run"
        )
    if given and len(given) != len(record.tables):
        count = len(record.tables)
        raise ResultFolderError(
            f"{record.place}: made from {count} table{'s' if count > 1 else ''}, but {len(given)} named; "
            "name each of them, in the order of the fit"
        )
    return tuple(
        _found(Path(given[k]) if given else record.place_of(named), named, "the table", "data")
        for k, named in enumerate(record.tables)
    )


def find_records(record: RunRecord, given: str | None = None) -> Path | None:
    """The file of the run's force records, None where it had none; as `find_tables`."""
    if record.force is None:
        if given is not None:
            raise ResultFolderError(f"{record.place}: made without force records, but {given} named")
        return None
    return _found(Path(given) if given else record.place_of(record.force), record.force, "the force record", "force")


def _found(place: Path, named: NamedTable, what: str, name: str) -> Path:
    """`place`, where it holds what `named` says; ResultFolderError otherwise."""
    file = Path(split_sheet(place)[0])
    try:
        there = file.is_file()
    except OSError as error:
        raise ResultFolderError(f"{str(place)[:200]}: cannot be opened: {error.strerror}") from None
    if not there:
        raise ResultFolderError(
            f"{place}: {what} of this fit is not there; put it back, or say with {option(name, 'FILE')} where it is "
            f"(SHA-256 {named.sha256})"
        )
    digest = sha256(file.read_bytes()).hexdigest()
    if digest != named.sha256:
        raise ResultFolderError(
            f"{place}: changed since the fit: its SHA-256 is {digest}, the fit was made from {named.sha256}; "
            f"put the old file back, name it with {option(name, 'FILE')}, or calibrate anew"
        )
    return place


def record_problem(record: RunRecord, tables: Sequence[Path], records: Path | None = None) -> Problem:
    """The problem of a run, from the files that `find_tables` and `find_records` found.

    Raises as reading and `build_problem` do.
    """
    table = load_tables(tables, record.scene, record.flipped, record.columns)
    force = None if records is None else build_records(load_force(records, table), record.scene.force_start_sd)
    return record.problem(table, force)
