"""Engine settings as a page in Markdown and as JSON: numbers, engines, recipes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import msgspec
import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.display_units import DEG
from fitball.base.files import json_bytes
from fitball.base.numbers import fixed
from fitball.base.values import Impacts
from fitball.exports.engine import (
    OUTPUTS,
    SOLIMP,
    EngineSettings,
    contact_duration,
    inertias,
    is_outside,
    limits,
    model_rebounds,
    operating_point,
    settings,
    sphere,
    spring,
)
from fitball.exports.engines import Engine, chosen, recipe
from fitball.exports.parameter_set import ParameterSet
from fitball.models.specs import BALL_PARAMETERS
from fitball.report.blocks import Block, Report, Section, Table, Text
from fitball.report.render import to_markdown
from fitball.version import __version__

# What `works` means, in words.
_WORKS = {
    "settings": "by settings",
    "fine steps": "by settings, with fine steps",
    "port": "by the port only",
}
# Impacts that a developer tries first: v_x1, v_y1 [m/s], omega_1 [rad/s].
_TRIES = (
    ("drop from 1 m", 0.0, 4.43, 0.0),
    ("flat", 20.0, 8.0, 0.0),
    ("topspin", 20.0, 8.0, 200.0),
    ("backspin", 20.0, 8.0, -200.0),
)
_AXES = (
    "Velocity (x, y) [m/s] and angular velocity [rad/s] of the engine just before and after the "
    "contact: x along the court, y up, turns from x to y. Topspin of a ball that flies to +x is "
    "negative. An engine by settings comes as near to its column as the table of engines says."
)
# How many times faster than a step an engine's friction stops a slip: MuJoCo's `solreffriction`.
_SLIP_RATE = 0.75


def _of_sets(
    sets: Sequence[ParameterSet], point: Impacts
) -> list[tuple[ParameterSet, list[EngineSettings]]]:
    """The settings of each set for each inertia, that of the ball last."""
    rows = list[tuple[ParameterSet, list[EngineSettings]]]()
    for parameters in sets:
        of_inertias = [settings(parameters, point, inertia) for inertia in inertias(parameters)]
        rows.append((parameters, of_inertias))
    return rows


def numbers_of(parameters: ParameterSet, setting: EngineSettings, time: float) -> dict[str, float]:
    """Numbers of recipes by name, SI, with a contact of `time` [s]."""
    mass = parameters.values["ball_mass"]
    radius = parameters.values["ball_radius"]
    gyration = setting.inertia * radius**2
    limit = limits(parameters, setting, time)
    return {
        "e": setting.e,
        # Drop tests have no friction: that of a recipe is without effect on a ball that drops.
        "mu": setting.mu,
        "mass": mass,
        "radius": radius,
        "inertia": gyration * mass,
        "gyration": gyration,
        "threshold": limit.speed_threshold,
        "step": limit.contact,
        "slip": _SLIP_RATE / limit.contact,
    }


def recipes(
    numbers: Mapping[str, float], time: float, engines: Mapping[str, Engine], kind: str = "recipe"
) -> dict[str, str]:
    """The recipes of engines that have one, by key, with these numbers and a contact of `time`;
    of the `kind` port those with the port.
    """
    texts = {name: f"{number:.10g}" for name, number in numbers.items()}
    stiffness, damping = spring(numbers["e"], time)
    texts["solref"] = f"{-stiffness:.10g} {-damping:.10g}"
    texts["solimp"] = " ".join(map(str, SOLIMP))
    files = {key: getattr(one, kind) for key, one in engines.items()}
    return {key: recipe(file, texts) for key, file in files.items() if file}


def settings_json(sets: Sequence[ParameterSet], at: str, engine: str = "") -> str:
    """Engine settings of each set at an impact in words, as JSON: SI, null where there is no
    number. `engine` is one engine, all without it.

    Raises:
        ParameterError: the impact cannot be read (`impact`), a model has no rebound there
            (`no-answer`), or there is no such engine (`unknown-engine`).
    """
    engines = chosen(engine)
    point = operating_point(sets, at)
    entries = list[dict[str, object]]()
    for parameters, of_inertias in _of_sets(sets, point):
        time = contact_duration(parameters, point)
        numbers = [numbers_of(parameters, setting, time) for setting in of_inertias]
        rows = list[dict[str, object]]()
        for setting, its in zip(of_inertias, numbers, strict=True):
            units = {
                "inertia_kg_m2": its["inertia"],
                "inertia_per_mass_m2": its["gyration"],
            }
            # Drop tests have no friction.
            friction = {} if parameters.model.tangential else {"mu": None}
            rows.append(setting._asdict() | units | friction)
        own = of_inertias[-1]
        limit = limits(parameters, own, time)
        mujoco = {
            "solref": [-number for number in spring(own.e, time)],
            "solimp": SOLIMP,
            "solreffriction": [-1.0, -numbers[-1]["slip"]],
            "contact_time": time,
            "timestep_at_most": limit.contact,
        }
        entries.append(
            {
                "label": parameters.label,
                "ball": {name: parameters.values[name] for name in BALL_PARAMETERS},
                "outside": is_outside(parameters, point),
                "settings": rows,
                "spin_at_least": limit.spin_at_least,
                "speed_threshold": limit.speed_threshold,
                "step_at_most": {
                    "contact": limit.contact,
                    "lever": limit.lever,
                    "rotation": limit.rotation,
                },
                "mujoco": mujoco,
                "recipes": recipes(numbers[-1], time, engines),
                "ports": recipes(numbers[-1], time, engines, "port"),
            }
        )
    content = {
        "kind": "fitball engine settings",
        "version": 2,
        "fitball": __version__,
        "units": "SI, angles in radians",
        "model": sets[0].model.text,
        "origin": sets[0].origin,
        "operating_point": {name: float(column[0]) for name, column in vars(point).items()},
        "sets": entries,
        "engines": engines,
    }
    # msgspec writes null for numbers that are not finite.
    return json_bytes(msgspec.json.decode(msgspec.json.encode(content))).decode()


def settings_page(sets: Sequence[ParameterSet], at: str, engine: str = "") -> str:
    """A page in Markdown with the engine settings of each set at an impact in words, engines, and
    recipes for the first set. `engine` is one engine, all without it.

    Raises:
        ParameterError: the impact cannot be read (`impact`), a model has no rebound there
            (`no-answer`), or there is no such engine (`unknown-engine`).
    """
    engines = chosen(engine)
    point = operating_point(sets, at)
    first = sets[0]
    columns = [name for name in OUTPUTS if first.model.predicts(COLUMNS[name])]
    rows = list[dict[str, str]]()
    reaches = list[dict[str, str]]()
    notes = list[str]()
    of_sets = _of_sets(sets, point)
    for parameters, of_inertias in of_sets:
        time = contact_duration(parameters, point)
        for setting in of_inertias:
            rows.append(setting_row(parameters, setting, columns, time))
        reaches.append(_limits_row(parameters, of_inertias[-1], time))
        notes += _notes(parameters, of_inertias, point)
    speed, angle = point.polar()
    where = (
        f"{fixed(speed[0], 1)} m/s at {fixed(DEG.factor * angle[0], 1)} deg, spin "
        f"{fixed(point.omega_1[0], 0)} rad/s"
    )
    about = [
        first.origin,
        f"Operating point: {where} (topspin positive); --at names another.",
        "Errors: engine less model at the operating point. rms: over the impacts of the fit, else "
        "of a rally. Both are those of an ideal rigid sphere; the last table says how near an "
        "engine comes to it.",
    ]
    summary: list[Block] = [Text(about), Table("Settings", rows), Text(notes, "list")]
    parameters, of_inertias = of_sets[0]
    time = contact_duration(parameters, point)
    numbers = numbers_of(parameters, of_inertias[-1], time)
    sections = [
        Section("Try it", [Text([_AXES]), _tries(parameters, of_inertias[-1])]),
        Section("Limits", [Text(_REASONS, "list"), Table("", reaches)]),
        Section("Engines", [Text(_ADVICE, "list"), *_engine_tables(engines.values())]),
        *_recipe_sections(engines, recipes(numbers, time, engines), ""),
        Section("The port in an engine", [Text(_IN_ENGINE, "list")]),
        *_recipe_sections(engines, recipes(numbers, time, engines, "port"), "The port in "),
    ]
    return to_markdown(Report(f"Engine settings by {first.model.text}", summary, sections))


def setting_row(
    parameters: ParameterSet, setting: EngineSettings, columns: Sequence[str], time: float
) -> dict[str, str]:
    """The row of a setting in the table, with errors of `columns` and a contact of `time` [s]."""
    numbers = numbers_of(parameters, setting, time)
    row = {
        "surface, ball": parameters.label,
        "inertia [M R^2]": fixed(setting.inertia, 3),
        "[kg m^2]": f"{numbers['inertia']:.4g}",
        "per mass [m^2]": f"{numbers['gyration']:.4g}",
        "restitution e": fixed(setting.e, 4),
    }
    if parameters.model.tangential:
        row["friction mu"] = fixed(setting.mu, 4)
    for kind, errors in (("error", setting.errors), ("rms", setting.rms)):
        for name in columns:
            unit = COLUMNS[name].display_unit
            row[f"{kind} {name} [{unit.name}]"] = fixed(errors[name] * unit.factor, 2)
    return row


def _tries(parameters: ParameterSet, setting: EngineSettings) -> Table:
    """What a ball must do at impacts that a developer tries first, by the port and by settings."""
    tangential = parameters.model.tangential
    tries = _TRIES if tangential else _TRIES[:1]
    impacts = Impacts(*np.array([numbers for _, *numbers in tries]).T)
    radius = parameters.values["ball_radius"]
    of_port = model_rebounds(parameters, impacts)
    if not tangential:
        of_port |= {"v_x2": impacts.v_x1, "omega_2": impacts.omega_1}
    of_settings = sphere(setting.e, setting.mu, setting.inertia, radius, impacts)
    rows = list[dict[str, str]]()
    for k, (name, v_x1, v_y1, omega_1) in enumerate(tries):
        row = {"hit": name, "before": _motion(v_x1, -v_y1, omega_1)}
        for head, after in (("after, port", of_port), ("after, settings", of_settings)):
            v_x2, v_y2, omega_2 = (float(after[column][k]) for column in OUTPUTS)
            row[head] = _motion(v_x2, v_y2, omega_2)
        rows.append(row)
    return Table("", rows, {*rows[0]})


def _motion(v_x: float, v_y: float, omega: float) -> str:
    """Velocity and angular velocity, as engines have them, of a ball with topspin `omega`."""
    return f"({fixed(v_x, 2)}, {fixed(v_y, 2)}), {fixed(0.0 - omega, 0)}"


def _limits_row(parameters: ParameterSet, setting: EngineSettings, time: float) -> dict[str, str]:
    """The row of a set in the table of limits."""
    limit = limits(parameters, setting, time)
    # A ball of drop tests has no spin.
    tangential = parameters.model.tangential
    return {
        "surface, ball": parameters.label,
        "spin at least [rad/s]": fixed(limit.spin_at_least, 0) if tangential else "",
        "bounces from [m/s]": fixed(limit.speed_threshold, 2),
        "step, contact [ms]": f"{1e3 * limit.contact:.2g}",
        "step, lever [ms]": f"{1e3 * limit.lever:.2g}",
        "step, rotation [ms]": f"{1e3 * limit.rotation:.2g}" if tangential else "",
    }


def _notes(
    parameters: ParameterSet, of_inertias: Sequence[EngineSettings], point: Impacts
) -> list[str]:
    """What a reader must know of the settings of a set at an impact (1,)."""
    head = f"{parameters.label}: " if parameters.label else ""
    notes = list[str]()
    if is_outside(parameters, point):
        notes.append(f"{head}the operating point lies outside the measured impacts.")
    if not parameters.model.tangential:
        notes.append(
            f"{head}drop tests determine restitution alone: set friction and inertia by other data."
        )
    if any(setting.grips for setting in of_inertias):
        notes.append(
            f"{head}the engine's ball grips here: friction is that of the model, if enough for it."
        )
    unsolved = of_inertias[0].unsolved
    if unsolved:
        notes.append(f"{head}{unsolved} impacts of the range have no rebound by the model.")
    return notes


def _engine_tables(engines: Iterable[Engine]) -> list[Table]:
    """Tables of engines: whether settings do it and how near, and what must be set."""
    works = list[dict[str, str]]()
    rules = list[dict[str, str]]()
    for one in engines:
        near = [
            f"{hertz} Hz: {v_x} m/s, {v_y} m/s, {omega} rad/s"
            for hertz, (v_x, v_y, omega) in one.seen.items()
        ]
        works.append(
            {
                "engine": one.name,
                "version": one.version,
                "how": _WORKS[one.works] + ("" if one.run else " (not run)"),
                "step": one.step,
                "rms seen, Wang's balls": "; ".join(near),
                "at rest": one.rest,
            }
        )
        rules.append(
            {
                "engine": one.name,
                "restitution": one.restitution,
                "friction": one.friction,
                "no bounce below": one.threshold,
                "largest spin": one.spin_limit,
                "damping": one.damping,
                "inertia": one.inertia,
                "contact": one.contact,
            }
        )
    left = {*works[0], *rules[0]}
    return [Table("How near", works, left), Table("What they do unless told", rules, left)]


def _recipe_sections(
    engines: Mapping[str, Engine], codes: Mapping[str, str], head: str
) -> list[Section]:
    """The recipes, each under the name and version of its engine, behind a `head`."""
    sections = list[Section]()
    for key, code in codes.items():
        one = engines[key]
        content: list[Block] = [Text(code.splitlines(), "code")]
        if one.install:
            content.insert(0, Text([f"Install: `{one.install}`"]))
        sections.append(Section(f"{head}{one.name}: {one.version}", content))
    return sections


_REASONS = (
    "Spin: the largest before or after an impact, and a fifth more. Engines cut faster spins.",
    "Bounces from: an engine that lets slower balls stick loses bounces if it is higher. Lower, a "
    "ball at rest hops, since gravity adds 0.16 m/s in a step of 1/60 s.",
    "Step, contact: a twentieth of the contact, for MuJoCo, whose contact is a spring.",
    "Step, lever: the ball sinks in by less than 0.05 R, for engines that take the point of "
    "contact where shapes overlap (PhysX).",
    "Step, rotation: a turn of less than pi/4, for engines that limit it (Rapier, Box2D).",
)
_ADVICE = (
    "An engine's ball has one restitution at every speed, and no twist of the cover: the rms of "
    "the first table is the best that settings can do. The port has none of these errors.",
    "Take the row with the inertia of the ball, else that of the engine: 0.4 in space, 0.5 in the "
    "plane.",
    "MuJoCo: impratio and noslip_iterations act on the whole model. With impratio 1e-4 other "
    "bodies slide on slopes unless noslip_iterations is set too, and each step costs more.",
    "PyBullet: contactERP and contactBreakingThreshold act on the whole world; bodies that overlap "
    "are not pushed apart.",
    "Unity, Godot 4: documented, not run. Unity's engine PhysX was run.",
)
_IN_ENGINE = (
    "Read velocity and spin before the solver: in the event that begins a contact, or before the "
    "step. After the solver the ball moves away, `status` is 6, and it does not bounce.",
    "Leave the engine's response on, with restitution 0. A sensor bounces rightly and then falls "
    "through the court, since a ball at rest makes no new event.",
    "Set the rebound if `status` is not 6. Raise the limit of spin, which also cuts what the port "
    "returns.",
    "`rebound` takes v_y1 positive towards the court. `rebound_3d` takes vectors as an engine has "
    "them: left-handed axes (Unity) come with left-handed spin, so no mirror is needed.",
    "Of a moving surface subtract its velocity before, add it after.",
    "A rebound that is set at the end of a step of 1/60 s misplaces a ball by 10 to 15 cm after a "
    "second. `step` places it within the step, by gap_time, gap_path and gap_turn, and has rest "
    "and rolling: use it where the ball meets planes alone.",
)
