"""Table, scene and choices -> `Problem`, in one pass."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np

from fitball.base.columns import COLUMNS, REBOUND
from fitball.base.errors import FitError, Note, ParameterError, suggestion
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.base.text import listed
from fitball.data.bundled import PUBLISHED, published_prior
from fitball.data.read import load_data
from fitball.data.scene import Scene, ValueWithSd
from fitball.data.table import ImpactTable
from fitball.inference.forward import ForwardModel, LeveledParameter, spec_at_label
from fitball.inference.noise import noise_kind
from fitball.inference.problem.camera import CAMERA_SPECS, camera_of
from fitball.inference.problem.joint_prior import Parameter, joint_prior
from fitball.inference.problem.levels import (
    ALL,
    NOT_POOLED,
    LevelPrior,
    default_pool,
    level_prior,
    levels_of_pool,
)
from fitball.inference.problem.problem import (
    COMMON_PARAMETERS,
    Choices,
    Observable,
    Problem,
    Rows,
    base_of,
)
from fitball.inference.problem.row_errors import row_errors
from fitball.models.model import Model
from fitball.models.registry import candidates, model_of_data
from fitball.models.registry import model as model_of
from fitball.models.specs import BALL_PARAMETERS, SPECS

# Noise of a velocity [m/s] that is expected where the scene expects none: that of Wang's tables.
# An angle has that of a velocity across the flight.
VELOCITY_SD = 0.25
# Noise of a spin [rad/s] that is expected where the scene expects none: that of Wang's tables.
SPIN_SD = 10.0
# Degrees of freedom of the half-t prior of a scatter beyond stated errors, which may be nothing.
SCATTER_FREEDOM = 4
# Noises that the scene states together, as that of a velocity.
VELOCITY_NOISES = ("v_x_sd", "v_y_sd", "speed_sd")
# What acts on the spin alone, and is held where none was measured.
SPIN_ONLY = ("eps_10", "eps_slope", "offset")
# The stiffness [N/m] that is held where only a contact time would show it.
STIFFNESS = 2.0e4
# Spreads of dropped balls and of places of a court, which no problem has: `uses.lab` asks for their
# priors.
LAB_SPREADS = ("cor_10_spread", "rating_spread")

Specs: TypeAlias = Mapping[str, ParameterSpec]
# Of each parameter the text of a prior, or a value and why it is fixed.
Given: TypeAlias = dict[str, str | tuple[float, str]]


def problem_from_sources(
    sources: Sequence[Any],
    *,
    scene: Any = "",
    as_read: bool = False,
    model: Model | str = "",
    fix: Mapping[str, float] | None = None,
    prior: Mapping[str, str] | None = None,
    pool: Mapping[str, str] | None = None,
    noise: str = "",
    **reading: Any,
) -> tuple[Problem, Model | None]:
    """The problem of one fit to some sources, by the options of `calibrate` (`reading` as
    `load_table`), and its model if that is one of one's own. Raises as reading and `build_problem`
    do.
    """
    known = load_data(sources, scene or None, as_read, **reading)
    choices, own = choices_of(model, fix, prior, pool, noise)
    return build_problem(*known, choices, own), own


def choices_of(
    model: Model | str = "",
    fix: Mapping[str, float] | None = None,
    prior: Mapping[str, str] | None = None,
    pool: Mapping[str, str] | None = None,
    noise: str = "",
) -> tuple[Choices, Model | None]:
    """Choices by the options of `calibrate`, and the model if that is one of one's own."""
    own: Model | None = None
    # A function of one's own is no text that a fit can be made of again.
    if isinstance(model, Model):
        own = model
    elif ".py:" in model:
        own = model_of(model)
    choices = Choices(
        model=own.text if own else str(model),
        fix=dict(fix or {}),
        prior=dict(prior or {}),
        pool=dict(pool or {}),
        noise=noise,
    )
    return choices, own


def _number(name: str, value: Any) -> float:
    """A value that is fixed. Raises ParameterError (`not-a-number`)."""
    try:
        return float(value)
    except (TypeError, ValueError):
        raise ParameterError(
            f"fix: read {name} = {value!r}; expected a number in SI",
            "not-a-number",
        ) from None


def build_problem(
    table: ImpactTable,
    scene: Scene,
    choices: Choices,
    own: Model | None = None,
    prior_texts: Mapping[str, str] = MappingProxyType({}),
) -> Problem:
    """The problem, with a note on all that was assumed or is idle; each column has a noise of its
    own. `prior_texts` are prior or fixed value of all parameters, as a saved fit has them, instead
    of this version's defaults. Raises ParameterError, ModelError, FitError (`too-few-impacts`,
    `nothing-to-fit`).
    """
    if len(table) < 2:
        text = (
            f"{table.name} has {len(table)} impact; expected at least 2, since one does not "
            "determine the noise"
        )
        raise FitError(text, "too-few-impacts")
    notes = list[Note]()
    model = _model(table, scene, choices, own)
    observables = _observables(table, model, notes)
    noise = noise_kind(choices.noise or str(scene.measurement.get("noise", "normal")))
    named = [*choices.prior, *choices.fix, *scene.prior, *scene.fix]
    camera, of_camera = camera_of(
        table,
        scene.camera,
        named,
        {item.column.gap for item in observables},
        notes,
    )
    uncertain = [name for name in BALL_PARAMETERS if name.removeprefix("ball_") in scene.ball_sd()]
    specs = {spec.name: spec for spec in (*model.parameters, *noise.parameters)} | of_camera
    specs |= _noises(table, scene, observables) | {name: SPECS[name] for name in uncertain}
    timed = scene.contact_time is not None or any(item.column.timed for item in observables)
    given = _given(specs, table, scene, choices, prior_texts, timed)
    levels = _levels(table, scene, choices, model, given, timed, notes)
    _refuse_unknown(choices, scene, specs, levels)
    parameters, priors, texts = _parameters(specs, given, levels, scene, notes)
    free = [item for item in parameters if item.fixed is None]
    if all(item.spec.name in COMMON_PARAMETERS for item in free):
        names = listed(spec.name for spec in model.parameters)
        text = (
            f"{table.name}: every parameter of {model.text} is fixed: free at least one of {names}"
        )
        raise FitError(text, "nothing-to-fit")
    exact = {item.spec.name for item in parameters if item.fixed == 0.0}
    forward = ForwardModel(model, noise, levels)
    rows = _rows(table, forward, observables, exact, notes)
    time = scene.contact_time if model.timed else None
    free_bases = {base_of(item.spec.name) for item in free}
    return Problem(
        table=table,
        scene=scene,
        choices=choices,
        forward=forward,
        parameters=tuple(parameters),
        free=tuple(item.spec.name for item in free),
        prior=joint_prior(free, priors),
        observables=observables,
        rows=rows,
        camera=camera,
        contact_time=None if time is None else (time.value, time.sd),
        notes=(*_assumed(scene, choices, free_bases, timed), *notes),
        prior_texts=texts,
    )


def _rows(
    table: ImpactTable,
    forward: ForwardModel,
    observables: Sequence[Observable],
    exact: Collection[str],
    notes: list[Note],
) -> Rows:
    """What was measured, with its stated errors; noises that are `exact` add nothing to these."""
    columns = [item.column.name for item in observables]
    noiseless = [item.column.name for item in observables if item.noise in exact]
    errors = row_errors(table, columns, noiseless)
    sd = np.zeros((len(table), len(columns)))
    if errors is None:
        unstated = np.zeros(len(table))
        sds = [np.nan_to_num(table.sd.get(name, unstated)) for name in columns]
        sd = np.stack(sds, axis=1)
    else:
        notes.append(errors.note)
    index = forward.levels_of(table.labels, len(table))
    y = np.stack([table.values[name] for name in columns], axis=1)
    return Rows(table.impacts, y, sd, errors, index)


def _model(table: ImpactTable, scene: Scene, choices: Choices, own: Model | None) -> Model:
    """The model that was chosen, or the usual one of such columns, with the scene's ball. Raises
    ModelError.
    """
    tangential = table.has_tangential
    ball = scene.ball_value()
    text = choices.model or str(scene.model.get("name", ""))
    text = text or candidates(tangential=tangential, spin=table.has_spin)[-1]
    chosen = model_of_data(text, ball=ball, tangential=tangential) if own is None else own
    return replace(chosen, ball=ball, tangential=tangential)


def _observables(table: ImpactTable, model: Model, notes: list[Note]) -> tuple[Observable, ...]:
    """The measured columns that the model predicts. Raises FitError (`nothing-to-fit`)."""
    if not model.tangential:
        text = "No motion along the court was measured: only the vertical one is fitted."
        notes.append(Note("vertical-only", text))
    elif not table.has_spin:
        text = "No spin was measured: incident spin is taken as zero, and offsets are held at 0."
        notes.append(Note("no-spin", text))
    elif "omega_1" not in table.values:
        notes.append(
            Note("no-incident-spin", "No column omega_1: the incident spin is taken as zero.")
        )
    found = []
    for column in (COLUMNS[name] for name in REBOUND if name in table.values):
        if not model.predicts(column):
            why = f"{model.text} has no time axis"
            if column.tangential and not model.tangential:
                why = "only the vertical motion is fitted"
            notes.append(Note("unused-column", f"{column.name} is not used: {why}."))
        elif column.noise is not None:
            found.append(Observable(column, column.noise.name, column.name in table.sd))
    if not found:
        raise FitError(
            f"{table.name}: {model.text} predicts none of the measured columns",
            "nothing-to-fit",
        )
    return tuple(found)


def _noises(
    table: ImpactTable,
    scene: Scene,
    observables: Iterable[Observable],
) -> dict[str, ParameterSpec]:
    """The noise of each column, with a prior about the size that the scene expects; beyond stated
    errors a scatter, which may be nothing.
    """
    stated = {
        name: float(size)
        for name, size in scene.measurement.items()
        if isinstance(size, int | float)
    }
    velocity = stated.get("nominal_velocity_sd", stated.get("velocity_sd", VELOCITY_SD))
    speed, _ = table.impacts.polar()
    angle = float(np.arctan2(velocity, np.median(speed)))
    spin = stated.get("nominal_spin_sd", SPIN_SD)
    expected = {"m/s": f"{velocity:.10g}", "rad": f"{angle:.2g}", "rad/s": f"{spin:.10g}"}
    noises = {}
    for item in observables:
        spec = item.column.noise
        assert spec is not None
        nominal = f"nominal_{item.noise}"
        if nominal in stated:
            size = f"{stated[nominal]:.10g}"
        elif spec.unit in expected:
            size = expected[spec.unit]
        else:
            # The middle of its usual prior.
            size = spec.prior.partition("(")[2].partition(",")[0]
        prior = f"lognormal({size}, 0.7)"
        meaning = spec.meaning
        if item.stated:
            prior = f"half-t({size}, {SCATTER_FREEDOM})"
            meaning = f"scatter of {item.column.name}, beyond stated errors"
        noises[item.noise] = replace(spec, prior=prior, meaning=meaning)
    return noises


def _given(
    specs: Specs,
    table: ImpactTable,
    scene: Scene,
    choices: Choices,
    known: Mapping[str, str],
    timed: bool,
) -> Given:
    """What is given of parameters, later ones before earlier ones: a saved fit, facts of the table,
    numbers of the scene, its sections, the user.
    """
    given: Given = {
        name: text if "(" in text else (float(text), "fixed in the stored fit")
        for name, text in known.items()
    }
    if table.has_tangential and not table.has_spin:
        why = "it affects the spin, which was not measured"
        given |= {name: (0.0, why) for name in SPIN_ONLY if name in specs}
    if "k_y" in specs and "k_theta" not in specs and not timed:
        given["k_y"] = (STIFFNESS, "it affects only the contact time, which was not measured")
    ball = scene.ball_value()
    noise = scene.measurement
    numbers: dict[str, object] = {"mu": scene.surface.get("mu")}
    numbers |= dict.fromkeys(VELOCITY_NOISES, noise.get("velocity_sd"))
    numbers |= {name: noise[name] for name in specs if name in noise}
    for key, sd in scene.ball_sd().items():
        numbers[key if key in BALL_PARAMETERS else f"ball_{key}"] = ValueWithSd(
            getattr(ball, key), sd
        )
    for name in specs:
        if (key := name.partition("[")[0]) in CAMERA_SPECS and scene.camera is not None:
            numbers[name] = getattr(scene.camera, key)
    for name, number in numbers.items():
        if isinstance(number, ValueWithSd):
            given[name] = f"normal({number.value:.10g}, {number.sd:.10g})"
        elif isinstance(number, int | float):
            given[name] = (float(number), "stated in the scene")
    for source, why in ((scene, "fixed by the scene"), (choices, "fixed on request")):
        given |= source.prior
        for name, value in source.fix.items():
            given[name] = (_number(name, value), why)
    return given


def _levels(
    table: ImpactTable,
    scene: Scene,
    choices: Choices,
    model: Model,
    given: Given,
    timed: bool,
    notes: list[Note],
) -> tuple[LeveledParameter, ...]:
    """The parameters that differ between labels: as asked, else by default; none that has a
    value.
    """
    names = {spec.name for spec in model.parameters}
    fixed = {name for name, text in given.items() if isinstance(text, tuple)}
    wanted = {name: column for name, column in scene.pool.items() if name in {*names, ALL}}
    wanted |= choices.pool
    pool = {
        name: column
        for name, column in wanted.items()
        if column != NOT_POOLED and name not in fixed
    }
    if wanted.get(ALL) != NOT_POOLED:
        more, remarks = default_pool(table, model, {*wanted, *fixed}, timed)
        pool |= more
        notes += remarks
    return levels_of_pool(table, pool, model)


def _refuse_unknown(
    choices: Choices, scene: Scene, specs: Specs, levels: Sequence[LeveledParameter]
) -> None:
    """Raises ParameterError (`unknown-parameter`) for a name that nothing has; a scene may serve
    several models.
    """
    spreads = [*(f"{level.parameter}_spread" for level in levels), *LAB_SPREADS]
    of_models = {*SPECS, *COMMON_PARAMETERS}
    others = {name for name in (*scene.prior, *scene.fix) if base_of(name) in of_models}

    def refuse(names: Collection[str], known: Collection[str]) -> None:
        for name in names:
            if name not in known and name not in others:
                raise ParameterError(
                    f"read '{name}': {suggestion(name, known)}",
                    "unknown-parameter",
                )

    refuse([*scene.prior, *choices.prior], [*specs, *spreads])
    refuse([*scene.fix, *choices.fix], [*specs])


def _parameters(
    specs: Specs,
    given: Given,
    levels: Sequence[LeveledParameter],
    scene: Scene,
    notes: list[Note],
) -> tuple[list[Parameter], list[LevelPrior], dict[str, str]]:
    """The parameters in order, the joint priors of those at levels, and the prior or value of each
    as text.
    """
    by_level = {level.parameter: level for level in levels}
    parameters = list[Parameter]()
    joint = list[LevelPrior]()
    texts = dict[str, str]()
    for name, spec in specs.items():
        text = ""
        value: float | None = None
        why = ""
        stated = given.get(name, "")
        if isinstance(stated, str):
            text = stated
        else:
            value, why = stated
        if text.startswith(PUBLISHED):
            prior = published_prior(spec, text)
        else:
            prior = parse_prior(spec, text)
        if prior.source:
            notes.append(Note("published-prior", f"Prior of {name} from {prior.source}."))
        texts[name] = prior.text if value is None else repr(value)
        if name in by_level:
            start = sum(item.fixed is None for item in parameters)
            spread = given.get(f"{name}_spread", "")
            level = level_prior(
                by_level[name],
                start,
                spec,
                prior,
                scene.ball_value(),
                str(spread),
                notes,
            )
            joint.append(level)
            prior = prior.at_levels()
            texts[f"{name}_spread"] = level.text
            where = by_level[name]
            for label in where.labels:
                on = f"on {where.column}"
                at = spec_at_label(spec, where.name(label), label, on)
                parameters.append(Parameter(at, prior))
            continue
        # A half prior begins at zero whatever the bounds: a scatter beyond stated errors may be
        # held there.
        begins, _ = prior.support(prior.numbers)
        lower = begins if begins == 0.0 and not prior.flat else spec.lower
        if value is not None and not lower <= value <= spec.upper:
            wanted = f"expected {lower:g} to {spec.upper:g} {spec.unit}".rstrip()
            raise ParameterError(f"read {name} = {value:g}; {wanted}", "out-of-bounds")
        measured = name in BALL_PARAMETERS or name.partition("[")[0] in CAMERA_SPECS
        parameters.append(Parameter(spec, prior, value, why, measured))
    return parameters, joint, texts


def _assumed(
    scene: Scene,
    choices: Choices,
    free: Collection[str],
    timed: bool,
) -> Iterable[Note]:
    """What the scene left open, where that concerns a free parameter for which no prior was
    stated.
    """
    stated = {name.partition("[")[0] for name in (*scene.prior, *choices.prior)}
    default = {*free} - stated
    about = {
        "no-friction": "mu" in default,
        "no-contact-time": "k_y" in default and not timed,
        "no-velocity-noise": not {*VELOCITY_NOISES}.isdisjoint(default),
        "no-spin-noise": "spin_sd" in default,
    }
    return (note for note in scene.assumed() if about.get(note.code, True))
