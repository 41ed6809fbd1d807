"""From table and scene to a problem: which model, which parameters, what is known; nothing is computed yet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace

import numpy as np

from fitball.data.published import with_published
from fitball.data.scene import NO_CONTACT_TIME, NO_MU, NO_SPIN_SD, NO_VELOCITY_SD, Scene
from fitball.data.table import ImpactTable
from fitball.errors import FitError
from fitball.inference.problem.camera import CAMERA_SPECS, View, build_view
from fitball.inference.problem.force_records import ForceRecords, force_noise, records_for
from fitball.inference.problem.noise import NoiseKind, noise_kind
from fitball.inference.problem.observables import (
    Observable,
    build_observables,
    expected_sizes,
    named_noise,
    noise_by_column,
    noise_parameters,
    scatter_specs,
)
from fitball.inference.problem.parameters import NOISE_SPECS, Parameter, Prior, build_parameters, parse_prior
from fitball.inference.problem.pooling import (
    ALL,
    NOT_POOLED,
    GroupBias,
    Pooling,
    build_group_bias,
    build_pooling,
    default_pool,
)
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.problem.row_errors import RowErrors, refuse_singular, row_errors
from fitball.inference.problem.spreads import LAB_SPREADS, kind_of
from fitball.models.model import Model
from fitball.models.registry import Reduced, entry, model
from fitball.models.specs import BALL_PARAMETERS, ParameterSpec
from fitball.observables import NOISE_OF, SHARED_SD, VELOCITIES
from fitball.values import Impacts

__all__ = ["Choices", "as_if_filmed", "build_problem", "impacts_with_cor", "reduction"]


def build_problem(table: ImpactTable, scene: Scene, choices: Choices, force: ForceRecords | None = None) -> Problem:
    """Free only parameters that the table, and its `force` records, can show, with notes on what was left
    out.

    Raises FitError when the model can answer for no column of the table, or nothing is left to fit, and what `model`
    and `build_parameters` raise.
    """
    name = choices.model or scene.model
    closures = {**(scene.closures if name == scene.model else {}), **choices.closures}
    chosen, fixed, notes = _compose(table, scene, name, closures)
    noise_of = _noise_of(table, scene, choices, notes)
    observables, unused = build_observables(table, table.has_tangential, chosen, noise_of)
    notes += unused
    if not observables:
        raise FitError(f"{table.source}: model {name} predicts none of the measured columns")
    errors = _errors(table, observables, choices, notes)
    if errors is not None and errors.uncertain and force is not None:
        notes.append("force records are compared at the stated incident speed, assumed exact")
    contact_time = scene.contact_time if chosen.has_time else None
    records = records_for(chosen, scene, force, notes)
    measured_time = any(observable.column.timed for observable in observables)
    timed = contact_time is not None or measured_time or records is not None
    if "k_y" in chosen.parameter_names and "k_theta" not in chosen.parameter_names and not timed:
        fixed["k_y"] = (2.0e4, "it affects only the contact time, which was not measured")
    priors = _scene_priors(scene, fixed)
    noise = noise_parameters(observables, table, scene, priors, fixed)
    if records is not None:
        noise += force_noise(records, scene, priors, fixed)
    ball_names = tuple(name for name in BALL_PARAMETERS if name.removeprefix("ball_") in scene.ball_sd)
    names = (*chosen.parameter_names, *noise)
    asked = {**scene.priors, **scene.fix, **choices.priors, **choices.fix}
    camera, remarks = build_view(table, scene, asked, chosen, observables)
    notes += remarks
    seen, held = camera.specs(scene) if camera is not None else ({}, {})
    fixed |= held
    known = {*names, *ball_names, *seen}
    fixed = {key: value for key, value in fixed.items() if key in known}
    priors = {key: value for key, value in priors.items() if key in known}
    priors |= {key: value for key, value in scene.priors.items() if name == scene.model or key in known}
    scene_fix = {key: value for key, value in scene.fix.items() if name == scene.model or key in known}
    for key in {**scene.priors, **choices.priors}:
        fixed.pop(key, None)
    fixed |= {key: (value, "fixed by the scene") for key, value in scene_fix.items()}
    fixed |= {key: (value, "fixed on request") for key, value in choices.fix.items()}
    wanted, published = with_published({**priors, **choices.priors})
    kind = noise_kind(choices.noise or scene.distribution)
    wished = {**scene.pool, **choices.pool}
    pool = dict(wished)
    if pool.get(ALL) != NOT_POOLED:
        own, remarks = default_pool(table, chosen, fixed, {*pool}, choices.offsets or scene.offsets, measured_time)
        pool |= own
        notes += remarks
    pool = {key: column for key, column in pool.items() if column != NOT_POOLED}
    levels, offsets, extra, known_spreads = _structure(table, scene, choices, chosen, observables, wanted, kind, pool)
    extra |= seen
    spreads = _spreads(table, wanted, extra)
    wanted = {key: text for key, text in wanted.items() if key not in spreads}
    sources = {**known_spreads, **published}
    scatter = scatter_specs(observables)
    parameters = build_parameters(names, {**chosen.specs, **scatter}, wanted, fixed, ball_names, extra, sources)
    if errors is not None and errors.columns:
        still = {item.name for item in parameters if item.fixed is not None and not item.fixed > 0.0}
        noises = {item.name: item.noise for item in observables}
        refuse_singular(table, errors, [noises[name] not in {None, *still} for name in errors.columns])
    if all(parameter.name in NOISE_SPECS for parameter in parameters if parameter.free):
        raise FitError(
            f"{table.source}: every parameter of model {name} is fixed: free at least one that is not a noise"
        )
    notes += [f"prior of {key} from {source}" for key, source in published.items()]
    notes += [
        f"{pooling.parameter} is fitted to each {pooling.column}, partially pooled"
        for pooling in levels
        if pooling.parameter in wished
    ]
    return Problem(
        table=table,
        scene=scene,
        model=chosen,
        parameters=parameters,
        observables=observables,
        impacts=impacts_with_cor(table, chosen),
        contact_time=contact_time,
        notes=(
            *(note for note in scene.assumed if note not in _idle(known, fixed.keys(), timed)),
            *notes,
            *([chosen.remark] if chosen.remark else []),
        ),
        pooling=levels,
        spreads=spreads,
        group_bias=offsets,
        errors=errors,
        camera=camera,
        force=records,
        noise=kind,
        choices=choices,
    )


def _noise_of(table: ImpactTable, scene: Scene, choices: Choices, notes: list[str]) -> Mapping[str, str]:
    """The noise parameter of each column; a table's is the same whatever the model."""
    column = choices.offsets or scene.offsets
    groups = 0 if column is None else len(set(table.labels.get(column, ())))
    named = named_noise(scene, scene.priors, scene.fix, choices.priors, choices.fix)
    return noise_by_column(table, choices.velocity_noise or scene.velocity_noise, named, groups, notes)


def _idle(parameters: Set[str], fixed: Set[str], timed: bool) -> set[str]:
    """Statements of a scene that no parameter of the problem uses."""
    velocities = {SHARED_SD, *(NOISE_OF[name] for name in VELOCITIES)} - fixed
    about = {NO_MU: {"mu"}, NO_VELOCITY_SD: velocities, NO_SPIN_SD: {"spin_sd"}, NO_CONTACT_TIME: {"k_y"}}
    return {text for text, names in about.items() if not names & parameters} | ({NO_CONTACT_TIME} if timed else set())


def _errors(
    table: ImpactTable, observables: Sequence[Observable], choices: Choices, notes: list[str]
) -> RowErrors | None:
    errors = row_errors(table, observables, choices.incident_errors)
    if errors is not None and errors.columns:
        notes.append("stated errors of a row belong together, as in the table's covariance")
    if table.incident_covariance is not None:
        stated = ", ".join(f"{column}_sd" for column in table.incident_sd) or "covariance"
        notes.append(
            f"{stated}: the incident state is uncertain: marginalised to first order, more finely near a kink"
            if choices.incident_errors
            else f"{stated}: uncertainty of incident columns ignored on request"
        )
    return errors


def _structure(
    table: ImpactTable,
    scene: Scene,
    choices: Choices,
    chosen: Model,
    observables: tuple[Observable, ...],
    priors: Mapping[str, str],
    noise: NoiseKind,
    pool: Mapping[str, str],
) -> tuple[tuple[Pooling, ...], GroupBias | None, dict[str, ParameterSpec], dict[str, str]]:
    """The `pool`ing and group offsets asked for, the parameters that these and `noise` bring, and where priors of
    spreads that nobody chose were published.
    """
    extra = {spec.name: spec for spec in noise.parameters}
    specs = chosen.specs
    known = {
        name: parse_prior(name, priors.get(name, spec.prior), spec.lower, spec.upper, spec.unit)
        for name, spec in specs.items()
        if name in pool and name in chosen.parameter_names
    }
    levels = build_pooling(table, pool, chosen.parameter_names, known)
    sources = {}
    for pooling in levels:
        extra |= pooling.specs(specs[pooling.parameter].unit, known[pooling.parameter], scene.tennis)
        source = pooling.spread_prior(known[pooling.parameter], scene.tennis).source
        if source and pooling.spread_name not in priors:
            sources[pooling.spread_name] = source
    column = choices.offsets or scene.offsets
    offsets = None if column is None else build_group_bias(table, column)
    if offsets is not None:
        sizes = {name: getattr(scene, name) or size for name, size in expected_sizes(scene, table).items()}
        extra |= offsets.specs(observables, sizes)
    return levels, offsets, extra, sources


def _spreads(table: ImpactTable, priors: Mapping[str, str], extra: Mapping[str, ParameterSpec]) -> dict[str, Prior]:
    """Chosen `priors` of spreads that are no parameter of the fit: of dropped balls, of places of a court."""
    kinds = {kind_of(column) for column in table.labels}
    return {
        name: parse_prior(name, text, 0.0, math.inf)
        for name, text in priors.items()
        if name not in extra and LAB_SPREADS.get(name) in kinds - {None}
    }


def reduction(table: ImpactTable, name: str, options: Mapping[str, str]) -> Reduced | None:
    """What the model called `name` is on a table that shows only part of it; None where it cannot be fitted."""
    known = entry(name, options)
    if not table.has_tangential:
        return known.vertical
    return Reduced() if table.has_spin else known.spinless


def _compose(
    table: ImpactTable, scene: Scene, name: str, closures: Mapping[str, str]
) -> tuple[Model, dict[str, tuple[float, str]], list[str]]:
    """The model reduced to what the table shows, parameters that act nowhere, and why."""
    fixed: dict[str, tuple[float, str]] = {}
    notes = []
    reduced = reduction(table, name, closures)
    if not table.has_tangential:
        notes.append("no motion along the court was measured: only the vertical motion is fitted")
    elif not table.has_spin:
        notes.append(
            "no spin was measured: incident spin is assumed zero, shell and core rotate together, and "
            "the offset is fixed at zero"
        )
        for parameter in ("eps_10", "eps_slope", "offset"):
            fixed[parameter] = (0.0, "it affects the spin, which was not measured")
    elif "omega_1" not in table.incident_columns:
        notes.append("no column omega_1: the incident spin is assumed zero")
    if reduced is None:
        raise FitError(f"{table.source}: model {name} needs measured spin")
    closures = {**reduced.closures, **closures}
    return model(name, ball=scene.ball, tangential=table.has_tangential, **closures), fixed, notes


def _scene_priors(scene: Scene, fixed: dict[str, tuple[float, str]]) -> dict[str, str]:
    priors = {}
    if scene.mu is not None:
        value, sd = scene.mu
        if sd is None:
            fixed["mu"] = (value, "stated in the scene")
        else:
            priors["mu"] = f"normal({value:.10g}, {sd:.10g})"
    balls = {"mass": scene.ball.mass, "radius": scene.ball.radius, "inertia_ratio": scene.ball.inertia_ratio}
    for key, sd in scene.ball_sd.items():
        name = key if key == "inertia_ratio" else f"ball_{key}"
        priors[name] = f"normal({balls[key]:.10g}, {sd:.10g})"
    return priors


def as_if_filmed(problem: Problem, key: str, value: float, free: bool = False) -> Problem:
    """The problem as if its camera, of which nothing is stated by this key, had this `value`, or it were fitted."""
    known = problem.camera or View((), ("",), np.zeros(len(problem.impacts), dtype=np.int64))
    camera = replace(known, keys=(*known.keys, key))
    spec = CAMERA_SPECS[key]
    prior = parse_prior(key, spec.prior, spec.lower, spec.upper, spec.unit)
    names = (camera.name(key, session) for session in camera.sessions)
    added = tuple(
        Parameter(replace(spec, name=name), prior, None if free else value, "" if free else "supposed")
        for name in names
    )
    return replace(problem, camera=camera, parameters=(*problem.parameters, *added))


def impacts_with_cor(table: ImpactTable, chosen: Model) -> Impacts:
    """The impacts, each with its measured restitution where the model wants it, and only there.

    Raises FitError without `v_y2`, in any row, and where noise has put a restitution above 1.
    """
    if not chosen.needs_cor:
        return replace(table.impacts, cor=None)
    rebound = table.measurement("v_y2")
    if rebound is None:
        raise FitError(f"{table.source}: cor = measured needs a column v_y2")
    if not rebound.complete:
        gaps = np.flatnonzero(~rebound.measured)
        raise FitError(
            f"{table.source}: cor = measured needs v_y2 of every impact, and {gaps.size} have none "
            f"(first: {table.ids[gaps[0]]}). Leave such rows out, or fit the restitution (cor = line or mean)"
        )
    cor = rebound.values / table.impacts.v_y1
    above = np.flatnonzero(cor > 1.0)
    if above.size:
        first, more = above[0], f" and {above.size - 1:,} more exceed that" if above.size > 1 else " exceeds that"
        raise FitError(
            f"{table.source}: cor = measured needs coefficients of restitution of at most 1. Impact "
            f"{table.ids[first]}{more} ({cor[first]:.4g}). Leave such rows out, or fit the restitution "
            "(cor = line or mean)"
        )
    return replace(table.impacts, cor=cor)
