"""Tables of a batch fitted together, parameters pooled over them: where weights do not carry from each to all."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from fitball.api import begin, load_fit, pose
from fitball.api.progress import Report, silent
from fitball.batch.names import JOINT
from fitball.data.join import ORIGIN, joined
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.errors import ParameterError, ResultFolderError, TableError
from fitball.inference.calibrate import fingerprint
from fitball.inference.effort import Effort
from fitball.inference.population.draws import drawn_new
from fitball.inference.population.hyper import Known
from fitball.inference.population.reweighting import Population, Weighted
from fitball.inference.population.trend import LEAST_TABLES
from fitball.inference.problem.build import NOT_POOLED
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.problem.problem import Problem
from fitball.inference.results.results import Fit, RunStatus, thinned
from fitball.observables import SHARED_SD
from fitball.report.batch.populations import Populated
from fitball.report.batch.rows import DONE, NAME, Row
from fitball.report.fit.folder import write_all
from fitball.report.form.atomic_write import write_text
from fitball.report.form.bounded_read import read_bounded
from fitball.report.saved.fit_file import read_fit
from fitball.report.saved.netcdf_files import DATA_NAME, read_data
from fitball.report.saved.run_file import RUN_NAME, RunRecord, read_run
from fitball.report.saved.structure import FIT_NAME
from fitball.values import FloatArray
from fitball.wording import option

# Digest of what was begun, and the number of steps that it was finished with.
BEGUN_NAME, DONE_NAME = "begun.txt", "done.txt"
# Draws from which a population is told.
DRAWS = 4000
# What a scene tells of a table and no fit of it rests on.
TOLD = ("surface", "ball_type", "ball_temperature", "ball_temperature_sd", "description", "citation")
Member = tuple[RunRecord, ImpactTable]


def joint_populations(
    rows: Sequence[Row],
    folder: Path,
    weighted: Sequence[Populated],
    asked: Sequence[str],
    effort: Effort,
    report: Report = silent,
) -> tuple[Populated, ...]:
    """The `weighted` populations that are `asked` for, or without a name those of doubtful weights, from one fit of
    all tables together. It is kept in the folder: shown again if it is there, gone on with after an interruption.

    Raises ParameterError for what no joint fit has, and for tables that cannot be pooled.
    """
    names = tuple(dict.fromkeys(asked)) or tuple(one.name for one in weighted if one.population.doubtful)
    if not names:
        raise ParameterError(
            f"{option('joint')}: the weights of every population are to be trusted; name the parameters to be fitted "
            "jointly all the same"
        )
    for name in names:
        if "/" in name:
            raise ParameterError(
                f"{option('joint')}: {name} is a ratio, and tables pool parameters; ask for a parameter, such as mu"
            )
    known = {one.name: one for one in weighted if one.name in names}
    # Who has no part in the population, for want of a level or of the parameter, has none in the fit beside it.
    without = {table: why for one in known.values() for table, why in one.left_out.items()}
    members, odd = poolable([row for row in rows if row[NAME] not in without], folder)
    left_out = {**without, **odd}
    problem = posed(members, names)
    place = folder / f"{JOINT}{'+'.join(names)}"
    fit = _fitted(problem, replace(effort, seed=next(iter(members.values()))[0].effort.seed), place, report)
    said = [f"{' and '.join(names)}: a joint fit with one value of every other parameter for all tables, in {place}."]
    said += [f"Not in the joint fit: {name}: {why}." for name, why in left_out.items()]
    if fit.status is RunStatus.NOT_CONVERGED:
        said.append(f"The joint fit did not converge: more than {effort.max_steps:,} steps go on with it.")
    return tuple(replace(_told(known[name], fit), left_out=left_out, said=tuple(said)) for name in names)


def _fitted(problem: Problem, effort: Effort, place: Path, report: Report) -> Fit:
    """The fit that lies there if it is of this problem, else one that goes on with its chain or begins anew."""
    mark, steps = fingerprint(problem, effort), f"{effort.max_steps}\n"
    begun, done = place / BEGUN_NAME, place / DONE_NAME
    same = _says(begun, mark)
    if same and (place / FIT_NAME).is_file() and _says(done, steps):
        return load_fit(place)
    run = begin(problem, effort, place, overwrite=not same, resume=same)
    write_text(begun, mark)
    fit = run.fit(report)
    write_all(fit, place)
    write_text(done, steps)
    return fit


def _says(place: Path, text: str) -> bool:
    try:
        return read_bounded(place) == text.encode()
    except (OSError, ResultFolderError):
        return False


def poolable(rows: Sequence[Row], folder: Path) -> tuple[dict[str, Member], dict[str, str]]:
    """The tables of a batch that can be fitted together, by name, and why others cannot: settings are those that most
    tables have. Raises ParameterError for fewer than three, ResultFolderError for a batch that kept no measurements.
    """
    members: dict[str, Member] = {}
    left_out: dict[str, str] = {}
    for name in (str(row[NAME]) for row in rows if row["outcome"] == DONE):
        saved = read_fit(folder / name)
        if not all((folder / name / file).is_file() for file in (DATA_NAME, RUN_NAME)):
            raise ResultFolderError(
                f"{folder / name}: of an older batch, without measurements; run it again with {option('overwrite')}"
            )
        table, force = read_data(saved.source, folder / name / DATA_NAME)
        members[name] = read_run(folder / name), replace(table, name=name)
        if force is not None:
            left_out[name] = "it has force records, which are fitted alone"
    settings = {name: _settings(record) for name, (record, _table) in members.items() if name not in left_out}
    typical = {
        key: Counter(own.get(key, "none") for own in settings.values()).most_common(1)[0][0]
        for key in dict.fromkeys(key for own in settings.values() for key in own)
    }
    for name, own in settings.items():
        mine = {key: own.get(key, "none") for key in typical}
        odd = [f"{key} = {mine[key]} ({text})" for key, text in typical.items() if mine[key] != text]
        if odd:
            left_out[name] = f"other settings than most tables, {'; '.join(odd[:3])}"
    alike = {name: table for name, (_record, table) in members.items() if name not in left_out}
    left_out |= _measured_otherwise(alike)
    members = {name: member for name, member in members.items() if name not in left_out}
    if len(members) < LEAST_TABLES:
        raise ParameterError(
            f"{option('joint')}: {len(members)} tables can be fitted together, expected at least {LEAST_TABLES}"
            + "".join(f"; {name}: {why}" for name, why in list(left_out.items())[:3])
        )
    return members, left_out


def _measured_otherwise(tables: Mapping[str, ImpactTable]) -> dict[str, str]:
    """Tables whose columns cannot stand below those that most tables have, by name, and why."""
    columns = {name: _columns(table) for name, table in tables.items()}
    usual = Counter(columns.values()).most_common(1)
    odd = {}
    for name in (name for name, own in columns.items() if own != usual[0][0]):
        typical = next(tables[other] for other, own in columns.items() if own == usual[0][0])
        try:
            joined([typical, tables[name]])
        except TableError as error:
            odd[name] = "; ".join(map(str, error.faults))
    return odd


def _columns(table: ImpactTable) -> tuple[object, ...]:
    measured = tuple((item.name, item.sd is None) for item in table.measurements)
    return table.incident_columns, tuple(table.incident_sd), measured


def _settings(record: RunRecord) -> Mapping[str, str]:
    """All that tables must have in common, as texts by name; sizes of noise are read off each table."""
    choices, scene = record.choices, record.scene
    free = ("source", "assumed", "model", *TOLD)
    known = {name: value for name, value in vars(scene).items() if name not in free}
    known |= {name: getattr(choices, name) for name in ("model", "closures", "noise", "offsets", "incident_errors")}
    known |= {f"prior of {name}": text for name, text in choices.priors.items() if name not in NOISE_SPECS}
    known |= {f"{name}, fixed": value for name, value in choices.fix.items()}
    known |= {f"pool of {name}": column for name, column in choices.pool.items()}
    return {name: str(value) for name, value in known.items()}


def posed(members: Mapping[str, Member], names: Sequence[str]) -> Problem:
    """The problem of the tables together, parameters pooled over them. Raises ParameterError for parameters that are
    not free in all of them, and as `pose` does.
    """
    records = [record for record, _table in members.values()]
    choices = records[0].choices
    for name in names:
        within = choices.pool.get(name, NOT_POOLED)
        if name in choices.fix or within != NOT_POOLED:
            why = "is fixed" if name in choices.fix else f"differs over {within}"
            raise ParameterError(f"{option('joint')}: {name} {why} in the tables, and cannot be pooled over them")
    # A size of noise that is not the same in all was read off each table, and is read off all together.
    priors = {
        name: text
        for name, text in choices.priors.items()
        if all(record.choices.priors.get(name) == text for record in records)
    }
    scene, silent_scene = records[0].scene, Scene()
    differing = [key for key in TOLD if any(getattr(one.scene, key) != getattr(scene, key) for one in records)]
    scene = replace(scene, **{key: getattr(silent_scene, key) for key in differing})
    tied = all(SHARED_SD in {**record.choices.priors, **record.choices.fix} for record in records)
    pool = {**choices.pool, **dict.fromkeys(names, ORIGIN)}
    together = replace(choices, priors=priors, pool=pool, velocity_noise="tied" if tied else None)
    return pose([table for _record, table in members.values()], together, scene=scene, force="none", as_read=True)


def _told(base: Populated, fit: Fit) -> Populated:
    """The population of a quantity from a joint fit; `base` is the weighted one."""
    assert fit.posterior is not None and fit.diagnostics is not None
    pooling = next(item for item in fit.problem.pooling if item.parameter == base.quantity.name)
    # A prior may have its shape in the other coordinate, and then tables scatter in that.
    asked = replace(base.quantity, log=pooling.log)
    columns = fit.problem.all_values(thinned(fit.posterior, DRAWS))
    centre, spread = asked.coordinates(columns), columns[pooling.spread_name]
    effective = min(fit.diagnostics.min_ess_bulk, len(centre))

    def known(drawn: FloatArray) -> Known:
        return Known.of(drawn, float(drawn.std()) / np.sqrt(effective))

    tables, own, sds = [], {}, {}
    for label in pooling.labels:
        drawn = np.asarray(asked.coordinates({asked.name: pooling.value(columns, label)}))
        tables.append(Weighted(label, known(drawn), float(drawn.std()), effective, -np.inf))
        alone = np.array(base.ends(base.own[label]))
        own[label] = Known(*(np.log(alone) if asked.log else alone).tolist())
        sds[label] = (own[label].high - own[label].low) / 3.92
    prior = next(item.prior for item in fit.problem.parameters if item.name == asked.name)
    ends, rng = asked.ends({asked.name: prior}), np.random.default_rng([len(own), DRAWS])
    new = drawn_new(np.column_stack([centre, spread]), ends, rng)
    found = Population(known(centre), known(spread), tuple(tables), Known.of(new))
    return Populated(asked, found, own, sds, {}, joint=True)
