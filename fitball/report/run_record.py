"""`run.toml` read back: the run it describes, ready to be made again."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from fitball.data.bundled import bundled_folder
from fitball.data.force_file import load_force
from fitball.data.frozen import FrozenMapping
from fitball.data.join import load_tables
from fitball.data.scene import Scene
from fitball.errors import ParameterError, ResultFolderError
from fitball.inference.calibrate import Effort
from fitball.inference.posterior import Problem
from fitball.inference.problem import Choices, build_problem
from fitball.report.export import FIT_NAME
from fitball.report.run_file import RUN_NAME, RUN_SCHEMA, SCENE_NUMBERS, SCENE_TEXTS
from fitball.values import Ball


@dataclass(frozen=True)
class NamedTable:
    """A table, or its force records, as `run.toml` names it: `file` relative to the result folder, or the name of a
    bundled one.
    """

    file: str
    bundled: bool
    digest: str


@dataclass(frozen=True)
class RunRecord:
    """A run: `place` is the file that describes it. `scene` and `choices` together define the problem; `reasons` say
    why parameters are fixed, `notes` are those of the problem; `force` are the force records, if there were any.
    """

    place: Path
    tables: tuple[NamedTable, ...]
    force: NamedTable | None
    scene: Scene
    choices: Choices
    reasons: Mapping[str, str]
    notes: tuple[str, ...]
    effort: Effort

    @property
    def folder(self) -> Path:
        """The result folder."""
        return self.place.parent


def read_run(path: Path) -> RunRecord:
    """Read a `run.toml`: the one in a folder, the one beside a `fit.json`, or a TOML file itself.

    Raises ResultFolderError for a file that is missing, damaged, foreign, or of another schema version.
    """
    place = path / RUN_NAME if path.is_dir() else path.with_name(RUN_NAME) if path.name == FIT_NAME else path
    try:
        content = tomllib.loads(place.read_bytes().decode("utf-8"))
    except FileNotFoundError:
        raise ResultFolderError(
            f"{place}: there is no such file; expected a result folder of fitball calibrate, with {RUN_NAME} in it"
        ) from None
    except (OSError, ValueError) as error:
        raise ResultFolderError(f"{place}: not a readable {RUN_NAME}: {error}") from None
    if "schema_version" not in content and "fitball" in content:
        raise ResultFolderError(
            f"{place}: made by a fitball that did not keep all it takes to repeat a run; run calibrate again"
        )
    if content.get("kind") != "fitball run":
        raise ResultFolderError(f"{place}: valid TOML, but not a {RUN_NAME} of fitball")
    if content["schema_version"] != RUN_SCHEMA:
        raise ResultFolderError(
            f"{place}: schema_version {content['schema_version']!r}; this fitball reads version {RUN_SCHEMA}"
        )
    try:
        return _record(place, content)
    except (KeyError, TypeError, ValueError, AttributeError, ParameterError) as error:
        raise ResultFolderError(f"{place}: damaged: {type(error).__name__}: {error}") from None


def _record(place: Path, content: Mapping[str, Any]) -> RunRecord:
    run, measurement, known = content["fitball"], content["measurement"], content["scene"]
    time = content.get("contact_time")
    found = {name: known[name] for name in (*SCENE_TEXTS, *SCENE_NUMBERS) if name in known}
    scene = Scene(
        ball=Ball(**content["ball"]),
        ball_sd=FrozenMapping(known["ball_sd"]),
        contact_time=None if time is None else (time["value"], time["sd"]),
        **found,
    )
    choices = Choices(
        model=content["model"]["name"],
        closures=content["model"]["closures"],
        priors=content["priors"],
        fix={name: float(value) for name, value in content["fix"].items()},
        noise=measurement["distribution"],
        pool=content["pool"],
        offsets=measurement.get("offsets"),
        incident_errors=measurement["incident_errors"],
    )
    files = tuple(map(_named, content["table"].get("files", ())))
    force = _named(content["force"]) if "force" in content else None
    return RunRecord(
        place, files, force, scene, choices, content["fixed_because"], tuple(content["notes"]),
        _effort(run, content.get("sampler")),
    )  # fmt: skip


def _named(item: Mapping[str, Any]) -> NamedTable:
    return NamedTable(item["file"], item["bundled"], item["sha256"])


def _effort(run: Mapping[str, Any], sampler: Mapping[str, Any] | None) -> Effort:
    effort = Effort(seed=_whole(run, "seed"), point_only=bool(run["point_only"]))
    if sampler is None:
        return effort
    return replace(
        effort,
        walkers=_whole(sampler, "walkers"),
        ensembles=_whole(sampler, "ensembles"),
        max_steps=_whole(sampler, "max_steps"),
        ess=float(sampler["target_ess"]),
    )


def _whole(section: Mapping[str, Any], name: str) -> int:
    value = section[name]
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(f"{name} = {value!r}, expected a whole number")
    return value


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
            f"{record.place}: made from {count} table{'s' if count > 1 else ''}, --data names {len(given)}; "
            "name each of them, in the order of the fit"
        )
    return tuple(
        _found(Path(given[k]) if given else _place(record, item), item, "the table", "--data")
        for k, item in enumerate(record.tables)
    )


def find_records(record: RunRecord, given: str | None = None) -> Path | None:
    """The file of the run's force records, None where it had none; as `find_tables`."""
    if record.force is None:
        if given is not None:
            raise ResultFolderError(f"{record.place}: made without force records, --force names {given}")
        return None
    return _found(Path(given) if given else _place(record, record.force), record.force, "the force record", "--force")


def _found(place: Path, item: NamedTable, what: str, option: str) -> Path:
    """`place`, where it holds what `item` says; ResultFolderError otherwise."""
    if not place.is_file():
        raise ResultFolderError(
            f"{place}: {what} of this fit is not there; put it back, or say with {option} where it is "
            f"(SHA-256 {item.digest})"
        )
    found = sha256(place.read_bytes()).hexdigest()
    if found != item.digest:
        raise ResultFolderError(
            f"{place}: changed since the fit: its SHA-256 is {found}, the fit was made from {item.digest}; "
            f"put the old file back, name it with {option}, or calibrate anew"
        )
    return place


def _place(record: RunRecord, item: NamedTable) -> Path:
    return bundled_folder() / item.file if item.bundled else (record.folder / item.file).resolve()


def record_problem(record: RunRecord, tables: Sequence[Path], records: Path | None = None) -> Problem:
    """The problem of a run, from the files that `find_tables` and `find_records` found.

    Raises as reading and `build_problem` do.
    """
    table = load_tables(tables, record.scene)
    force = None if records is None else load_force(records, table)
    problem = build_problem(table, record.scene, record.choices, force)
    parameters = tuple(
        replace(item, fixed_because=record.reasons.get(item.name, item.fixed_because)) for item in problem.parameters
    )
    return replace(problem, parameters=parameters, notes=record.notes)
