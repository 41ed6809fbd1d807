"""From a table, a scene and the user's choices to a `Problem`."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TypeAlias, TypedDict, Unpack

import numpy as np

from fitball.base.columns import COLUMNS, REBOUND
from fitball.base.errors import FitError, Note, ParameterError, suggestion
from fitball.base.options import read_pairs, read_texts
from fitball.base.priors import ParameterSpec
from fitball.base.text import listed
from fitball.data.idle import idle_keys, idle_note
from fitball.data.load import Sources, load_data
from fitball.data.read import Reading
from fitball.data.scene import Scene, ValueWithSd
from fitball.data.table import UNKNOWN_SPIN_SD, ImpactTable
from fitball.inference.forward import ForwardModel, LeveledParameter, spec_at_label
from fitball.inference.noise import noise_kind
from fitball.inference.problem.camera import CAMERA_SPECS, camera_of
from fitball.inference.problem.fall import DRAG_SPEC, FALL_SPECS, fall_of
from fitball.inference.problem.joint_prior import Parameter, joint_prior
from fitball.inference.problem.levels import (
    ALL,
    NOT_POOLED,
    LevelPrior,
    default_pool,
    level_prior,
    levels_of_pool,
    prior_of_text,
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
from fitball.models.registry import candidates, model_of_data, refuse_what_is_no_name
from fitball.models.registry import model as model_of
from fitball.models.specs import BALL_PARAMETERS, INERTIA, SPECS

# Expected noise of a velocity [m/s] where the scene states none: that of Wang's tables. An angle
# has that of a velocity across the flight.
VELOCITY_SD = 0.25
# Expected noise of a spin [rad/s] where the scene states none: that of Wang's tables.
SPIN_SD = 10.0
# Degrees of freedom of the half-t prior of a scatter beyond stated errors, which may be nothing.
SCATTER_FREEDOM = 4
# Noises that have the size `velocity_sd` of the scene.
VELOCITY_NOISES = ("v_x_sd", "v_y_sd", "speed_sd")
# Parameters that affect the spin most: they are held at zero where neither spins nor times of the
# contact were measured.
SPIN_ONLY = ("eps_10", "eps_slope", "offset")
# The stiffness [N/m] at which `k_y` is held where only a contact time would show it.
HELD_STIFFNESS = 2.0e4
# Spreads of dropped balls and of places of a court, which no problem has: `uses.lab` takes their
# priors.
LAB_SPREADS = ("cor_10_spread", "rating_spread")

Specs: TypeAlias = Mapping[str, ParameterSpec]


class ChoiceOptions(TypedDict, total=False):
    """Options of `calibrate` that make the `Choices` of a fit."""

    model: Model | str
    fix: Mapping[str, float] | None
    prior: Mapping[str, str] | None
    pool: Mapping[str, str] | None
    noise: str
    derive: Mapping[str, str] | None


# By parameter the text of its prior, or the value at which it is fixed and why.
ParameterSettings: TypeAlias = dict[str, str | tuple[float, str]]


def problem_from_sources(
    sources: Sources,
    *,
    scene: Scene | str | Path | None = None,
    as_read: bool = False,
    model: Model | str = "",
    fix: Mapping[str, float] | None = None,
    prior: Mapping[str, str] | None = None,
    pool: Mapping[str, str] | None = None,
    noise: str = "",
    derive: Mapping[str, str] | None = None,
    **reading: Unpack[Reading],
) -> tuple[Problem, Model | None]:
    """The problem of a fit to one or several sources, and its model if the user wrote that.

    Options are those of `calibrate`; `reading` has those of `load_table`.

    Raises:
        InputError: a table or scene has faults, or columns are misread (`misread`).
        ParameterError: there are no sources (`no-data`), or an option is wrong.
        ModelError: the model cannot be used.
        FitError: the data do not allow a fit (`too-few-impacts`, `nothing-to-fit`,
            `singular-errors`).
    """
    table, scene_read = load_data(sources, scene or None, as_read, **reading)
    choices, user_model = choices_of(model, fix, prior, pool, noise, derive)
    problem = build_problem(table, scene_read, choices, user_model)
    problem.refuse_unknown_names()
    return problem, user_model


def choices_of(
    model: Model | str = "",
    fix: Mapping[str, float] | None = None,
    prior: Mapping[str, str] | None = None,
    pool: Mapping[str, str] | None = None,
    noise: str = "",
    derive: Mapping[str, str] | None = None,
) -> tuple[Choices, Model | None]:
    """The choices that options of `calibrate` make, and the model if the user wrote that.

    Raises:
        ParameterError: the value of an option is no mapping (`pairs`).
        ModelError: the user's model cannot be used, or it is no model (`own-model`).
    """
    user_model: Model | None = None
    # A function of the user is no text from which a fit can be made again.
    if isinstance(model, Model):
        user_model = model
        text = model.text
    else:
        refuse_what_is_no_name(model)
        text = model
        if ".py:" in text:
            user_model = model_of(text)
            text = user_model.text
    choices = Choices(
        model=text,
        fix=read_pairs("fix", fix),
        prior=read_texts("prior", prior),
        pool=read_texts("pool", pool),
        noise=noise,
        derive=read_texts("derive", derive),
    )
    return choices, user_model


def _fixed_number(name: str, value: float) -> float:
    """The value at which the user or the scene fixes a parameter. Raises ParameterError
    (`not-a-number`).
    """
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
    user_model: Model | None = None,
    prior_texts: Mapping[str, str] = MappingProxyType({}),
) -> Problem:
    """The problem of a table, with a note on all that is assumed or has no effect. Each column has
    a noise of its own.

    `user_model` is the model if the user wrote that. `prior_texts` are the priors or fixed values
    of all parameters, as a saved fit has them, instead of this version's defaults.

    Raises:
        ParameterError: a prior, a fixed value, a level or the kind of noise is wrong.
        ModelError: the model cannot be used.
        FitError: there are fewer than two impacts (`too-few-impacts`), nothing to fit
            (`nothing-to-fit`), or errors that no fit can weigh (`singular-errors`).
    """
    if len(table) < 2:
        text = (
            f"{table.name} has {len(table)} impact; expected at least 2, since one does not "
            "determine the noise"
        )
        raise FitError(text, "too-few-impacts")
    notes = list[Note]()
    model = _model_of_problem(table, scene, choices, user_model)
    observables = _observables(table, model, notes)
    noise = noise_kind(choices.noise or str(scene.measurement.get("noise", "normal")))
    named = {*choices.prior, *choices.fix, *scene.prior, *scene.fix}
    has_gaps = any(observable.column.gap for observable in observables)
    camera, camera_specs = camera_of(table, scene.camera, named, has_gaps, notes)
    of_ball = _parameters_of_ball(scene, named)
    fall = fall_of(table, scene)
    specs = {spec.name: spec for spec in (*model.parameters, *noise.parameters)} | camera_specs
    specs |= FALL_SPECS if fall is not None else {}
    specs |= _noise_specs(table, scene, observables) | {name: SPECS[name] for name in of_ball}
    timed = scene.contact_time is not None or any(item.column.timed for item in observables)
    settings = _settings(specs, table, scene, choices, prior_texts, timed)
    levels = _leveled_parameters(table, scene, choices, model, settings, timed, notes)
    _refuse_unknown(choices, scene, specs, levels)
    parameters, priors, texts = _parameters_of_problem(specs, settings, levels, scene, notes)
    free = [parameter for parameter in parameters if parameter.fixed is None]
    if all(parameter.spec.name in COMMON_PARAMETERS for parameter in free):
        names = listed(spec.name for spec in model.parameters)
        text = (
            f"{table.name}: every parameter of {model.text} is fixed: free at least one of {names}"
        )
        raise FitError(text, "nothing-to-fit")
    noiseless = {parameter.spec.name for parameter in parameters if parameter.fixed == 0.0}
    forward = ForwardModel(model, noise, levels)
    rows = _measurements(table, forward, observables, noiseless, notes)
    contact_time = scene.contact_time if model.timed else None
    free_bases = {base_of(parameter.spec.name) for parameter in free}
    problem = Problem(
        table=table,
        scene=scene,
        choices=choices,
        forward=forward,
        parameters=tuple(parameters),
        free=tuple(parameter.spec.name for parameter in free),
        prior=joint_prior(free, priors),
        observables=observables,
        rows=rows,
        camera=camera,
        fall=fall,
        contact_time=None if contact_time is None else (contact_time.value, contact_time.sd),
        notes=(*_assumptions(scene, choices, free_bases, timed), *notes),
        prior_texts={INERTIA: repr(model.ball.inertia_ratio), **texts},
    )
    idle = idle_note(idle_keys_of_problem(problem), "this fit")
    return replace(problem, notes=(*problem.notes, *idle))


def idle_keys_of_problem(problem: Problem) -> Iterator[str]:
    """Keys of the scene, `[prior] k_y`, that the fit of a problem does not use."""
    scene = problem.scene
    model = problem.forward.model
    yield from idle_keys(problem.table, scene)
    bases = {base_of(parameter.spec.name) for parameter in problem.parameters}
    if "mu" in scene.surface and "mu" not in bases:
        yield "[surface] mu"
    if scene.contact_time is not None and not model.timed:
        yield "[contact_time]"
    for name in scene.measurement:
        noise = name.removeprefix("nominal_")
        if noise in COMMON_PARAMETERS and noise not in bases:
            yield f"[measurement] {name}"
    for section in ("prior", "fix", "pool"):
        for name in getattr(scene, section):
            if base_of(name) not in {*bases, ALL} and name not in LAB_SPREADS:
                yield f"[{section}] {name}"


def _parameters_of_ball(scene: Scene, named: Collection[str]) -> list[str]:
    """The constants of the ball that are parameters: those with an sd in the scene, and those
    `named` in priors and fixed values.
    """
    sds = scene.ball_sd()
    return [name for name in BALL_PARAMETERS if name in named or name.removeprefix("ball_") in sds]


def _measurements(
    table: ImpactTable,
    forward: ForwardModel,
    observables: Sequence[Observable],
    noiseless: Collection[str],
    notes: list[Note],
) -> Rows:
    """The measurements of a table with their stated errors. `noiseless` names noises that are held
    at zero, so that they add nothing to stated errors.
    """
    columns = [observable.column.name for observable in observables]
    bare = [observable.column.name for observable in observables if observable.noise in noiseless]
    read = table.with_unknown_spins() if forward.model.tangential else table
    errors = row_errors(read, columns, bare)
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


def _model_of_problem(
    table: ImpactTable,
    scene: Scene,
    choices: Choices,
    user_model: Model | None,
) -> Model:
    """The model that the user or the scene chose, or the default for such columns, with the scene's
    ball. Raises ModelError.
    """
    tangential = table.has_tangential
    ball = scene.ball_value()
    text = choices.model or str(scene.model.get("name", ""))
    text = (
        text
        or candidates(
            tangential=tangential,
            spin=table.has_spin,
            timed=table.has_times,
        )[-1]
    )
    chosen = user_model
    if chosen is None:
        chosen = model_of_data(text, ball=ball, tangential=tangential)
    return replace(chosen, ball=ball, tangential=tangential)


def _observables(table: ImpactTable, model: Model, notes: list[Note]) -> tuple[Observable, ...]:
    """The measured columns that the model predicts. Raises FitError (`nothing-to-fit`)."""
    if not model.tangential:
        text = "No motion along the court was measured: only the vertical one is fitted."
        notes.append(Note("vertical-only", text))
    elif "omega_1" not in table.values:
        unknown = f"each incident spin is unknown, 0 ± {UNKNOWN_SPIN_SD:.0f} rad/s"
        still = "Of balls without spin state a column omega_1 = 0."
        if table.has_spin:
            text = f"No incident spin was measured: {unknown}. {still}"
            notes.append(Note("no-incident-spin", text))
        else:
            held = "" if table.has_times else ", and offsets are held at 0"
            text = f"No spin was measured: {unknown}{held}. {still}"
            notes.append(Note("no-spin", text))
    observables = []
    for column in (COLUMNS[name] for name in REBOUND if name in table.values):
        if not model.predicts(column):
            why = f"{model.text} has no time axis"
            if column.tangential and not model.tangential:
                why = "only the vertical motion is fitted"
            notes.append(Note("unused-column", f"{column.name} is not used: {why}."))
        elif column.noise is not None:
            stated = column.name in table.sd
            observables.append(Observable(column, column.noise.name, stated))
    if not observables:
        raise FitError(
            f"{table.name}: {model.text} predicts none of the measured columns",
            "nothing-to-fit",
        )
    return tuple(observables)


def _noise_specs(
    table: ImpactTable,
    scene: Scene,
    observables: Iterable[Observable],
) -> dict[str, ParameterSpec]:
    """The specs of the noises of measured columns, with priors about the sizes that the scene
    expects. Where rows state errors it is the scatter beyond these, which may be zero.
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
    for observable in observables:
        spec = observable.column.noise
        assert spec is not None
        nominal = f"nominal_{observable.noise}"
        if nominal in stated:
            size = f"{stated[nominal]:.10g}"
        elif spec.unit in expected:
            size = expected[spec.unit]
        else:
            # The middle of its usual prior.
            size = spec.prior.partition("(")[2].partition(",")[0]
        prior = f"lognormal({size}, 0.7)"
        meaning = spec.meaning
        if observable.stated:
            prior = f"half-t({size}, {SCATTER_FREEDOM})"
            meaning = f"scatter of {observable.column.name}, beyond stated errors"
        noises[observable.noise] = replace(spec, prior=prior, meaning=meaning)
    return noises


def _settings(
    specs: Specs,
    table: ImpactTable,
    scene: Scene,
    choices: Choices,
    prior_texts: Mapping[str, str],
    timed: bool,
) -> ParameterSettings:
    """The priors and fixed values that replace defaults. Sources in order, of which later ones
    replace earlier ones: a saved fit, facts of the table, numbers of the scene, the scene's
    sections `prior` and `fix`, the user. Raises ParameterError (`not-a-number`).
    """
    # A text with brackets is a prior, any other the value at which the parameter was fixed.
    settings: ParameterSettings = {
        name: text if "(" in text else (float(text), "fixed in the stored fit")
        for name, text in prior_texts.items()
    }
    if table.has_tangential and not table.has_spin and not table.has_times:
        why = "it affects the spin, which was not measured"
        settings |= {name: (0.0, why) for name in SPIN_ONLY if name in specs}
    if "k_y" in specs and "k_theta" not in specs and not timed:
        why = "it affects only the contact time, which was not measured"
        settings["k_y"] = (HELD_STIFFNESS, why)
    # What the scene states as a number, or as a number with an sd; the rest is left out below.
    numbers: dict[str, object] = {"mu": scene.surface.get("mu")}
    measurement = scene.measurement
    numbers |= dict.fromkeys(VELOCITY_NOISES, measurement.get("velocity_sd"))
    numbers |= {name: measurement[name] for name in specs if name in measurement}
    ball = scene.ball_value()
    for key, sd in scene.ball_sd().items():
        parameter = key if key in BALL_PARAMETERS else f"ball_{key}"
        numbers[parameter] = ValueWithSd(getattr(ball, key), sd)
    for name in specs:
        # One value for all sessions, `tilt` for `tilt[monday]`.
        key = name.partition("[")[0]
        if key in CAMERA_SPECS and scene.camera is not None:
            numbers[name] = getattr(scene.camera, key)
    if DRAG_SPEC.name in specs:
        drag = scene.slow_drag()
        numbers[DRAG_SPEC.name] = ValueWithSd(*drag) if drag.sd else drag.value
    for name, number in numbers.items():
        if isinstance(number, ValueWithSd):
            settings[name] = f"normal({number.value:.10g}, {number.sd:.10g})"
        elif isinstance(number, int | float):
            settings[name] = (float(number), "stated in the scene")
    for source, why in ((scene, "fixed by the scene"), (choices, "fixed on request")):
        settings |= source.prior
        for name, value in source.fix.items():
            settings[name] = (_fixed_number(name, value), why)
    return settings


def _leveled_parameters(
    table: ImpactTable,
    scene: Scene,
    choices: Choices,
    model: Model,
    settings: ParameterSettings,
    timed: bool,
    notes: list[Note],
) -> tuple[LeveledParameter, ...]:
    """The parameters that have levels: those that the user or the scene chose, and defaults for the
    others. No fixed parameter has levels. Raises ParameterError.
    """
    names = {spec.name for spec in model.parameters}
    fixed = {name for name, setting in settings.items() if isinstance(setting, tuple)}
    wanted = {name: column for name, column in scene.pool.items() if name in {*names, ALL}}
    wanted |= choices.pool
    pool = {
        name: column
        for name, column in wanted.items()
        if column != NOT_POOLED and name not in fixed
    }
    if wanted.get(ALL) != NOT_POOLED:
        default, notes_on_default = default_pool(table, model, {*wanted, *fixed}, timed)
        pool |= default
        notes += notes_on_default
    return levels_of_pool(table, pool, model)


def _refuse_unknown(
    choices: Choices, scene: Scene, specs: Specs, levels: Sequence[LeveledParameter]
) -> None:
    """Refuse names of priors and fixed values that no parameter has: ParameterError
    (`unknown-parameter`). A scene may serve several models, and name parameters of others.
    """
    spreads = [*(f"{level.parameter}_spread" for level in levels), *LAB_SPREADS]
    of_models = {*SPECS, *COMMON_PARAMETERS}
    others = {name for name in (*scene.prior, *scene.fix) if base_of(name) in of_models}

    def refuse(names: Collection[str], allowed: Collection[str]) -> None:
        for name in names:
            if name not in allowed and name not in others:
                raise ParameterError(
                    f"read '{name}': {suggestion(name, allowed)}",
                    "unknown-parameter",
                )

    refuse([*scene.prior, *choices.prior], [*specs, *spreads])
    refuse([*scene.fix, *choices.fix], [*specs])


def _parameters_of_problem(
    specs: Specs,
    settings: ParameterSettings,
    levels: Sequence[LeveledParameter],
    scene: Scene,
    notes: list[Note],
) -> tuple[list[Parameter], list[LevelPrior], dict[str, str]]:
    """The parameters in order, the joint priors of those with levels, and by name the prior or the
    fixed value of each as text. Raises ParameterError (`prior`, `out-of-bounds`).
    """
    leveled = {level.parameter: level for level in levels}
    parameters = list[Parameter]()
    level_priors = list[LevelPrior]()
    texts = dict[str, str]()
    for name, spec in specs.items():
        text = ""
        value: float | None = None
        why = ""
        setting = settings.get(name, "")
        if isinstance(setting, str):
            text = setting
        else:
            value, why = setting
        prior = prior_of_text(spec, text)
        if prior.source:
            notes.append(Note("published-prior", f"Prior of {name} from {prior.source}."))
        texts[name] = prior.text if value is None else repr(value)
        if name in leveled:
            start = sum(parameter.fixed is None for parameter in parameters)
            spread = str(settings.get(f"{name}_spread", ""))
            level = leveled[name]
            ball = scene.ball_value()
            prior_of_levels = level_prior(level, start, spec, prior, ball, spread, notes)
            level_priors.append(prior_of_levels)
            texts[f"{name}_spread"] = prior_of_levels.text
            prior = prior.at_levels()
            for label in level.labels:
                at_label = spec_at_label(spec, level.name(label), label, f"on {level.column}")
                parameters.append(Parameter(at_label, prior))
            continue
        # A half prior begins at zero whatever the bounds: a scatter beyond stated errors may be
        # held there.
        lowest, _ = prior.support(prior.numbers)
        lower = lowest if lowest == 0.0 and not prior.flat else spec.lower
        if value is not None and not lower <= value <= spec.upper:
            wanted = f"expected {lower:g} to {spec.upper:g} {spec.unit}".rstrip()
            raise ParameterError(f"read {name} = {value:g}; {wanted}", "out-of-bounds")
        # Constants of ball, camera and air, of which the scene has a measurement.
        constants = {*BALL_PARAMETERS, *CAMERA_SPECS, *FALL_SPECS}
        measured = name.partition("[")[0] in constants
        parameters.append(Parameter(spec, prior, value, why, measured))
    return parameters, level_priors, texts


def _assumptions(
    scene: Scene,
    choices: Choices,
    free_bases: Collection[str],
    timed: bool,
) -> Iterable[Note]:
    """Notes on what the scene does not state, where that concerns a free parameter without a stated
    prior. `free_bases` are the names of free parameters without their labels.
    """
    stated = {name.partition("[")[0] for name in (*scene.prior, *choices.prior)}
    default = {*free_bases} - stated
    applies = {
        "no-friction": "mu" in default,
        "no-contact-time": "k_y" in default and not timed,
        "no-velocity-noise": not {*VELOCITY_NOISES}.isdisjoint(default),
        "no-spin-noise": "spin_sd" in default,
    }
    return (note for note in scene.assumed() if applies.get(note.code, True))
