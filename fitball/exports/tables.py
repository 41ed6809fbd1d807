"""Tables that replace the solver: the golden impacts, which are inputs and expected rebounds of a port; and rebounds
on a grid, as CSV, with their description as JSON. Settings for game engines with restitution and friction only are
JSON, and a page with instructions.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from fitball.data.lines import parse_grid, parse_impact
from fitball.errors import ParameterError
from fitball.exports.bounces import Bounces, Case, joined
from fitball.inference.prediction.engine_fit import (
    SEED,
    EngineFit,
    EngineSettings,
    Lookup,
    default_axes,
    fit_engine,
    make_lookup,
    middle_impact,
)
from fitball.inference.prediction.outputs import expected_outputs
from fitball.inference.prediction.reach import calibrated_range
from fitball.inference.results.fitted_model import FittedModel
from fitball.inference.results.results import Golden
from fitball.models.kernels.contact import zero_force_release
from fitball.models.types import OUTPUTS, regime_name
from fitball.observables import COMPARED, INCIDENT_UNITS, SI_UNITS
from fitball.report.form.document import Document, Part, Section, Table, Words, as_markdown
from fitball.report.form.files import csv_text, json_text
from fitball.report.form.numbers import output_scale
from fitball.values import Impacts


def golden_ids(golden: Golden) -> tuple[str, ...]:
    """Names of the golden impacts."""
    return tuple(f"golden-{k}" for k in range(1, len(golden.impacts) + 1))


def golden_table(bounces: Bounces, inputs_only: bool = False) -> str:
    """CSV of the golden impacts to 17 digits, with the expected rebounds unless `inputs_only`, and with the labels
    where parameters differ between surfaces or balls.
    """
    golden, labels = joined(bounces)
    fitted = bounces.cases[0].fitted
    expected = {} if inputs_only else expected_outputs(fitted, golden)
    columns = {name: getattr(golden.impacts, name) for name in INCIDENT_UNITS}
    columns |= {name: expected[name] for name in OUTPUTS if name in expected}
    rows: list[dict[str, object]] = []
    for k, label in enumerate(golden_ids(golden)):
        row: dict[str, object] = {"id": label}
        row |= {column: values[k] for column, values in labels.items()}
        row |= {f"{name} [{SI_UNITS[name]}]": repr(float(values[k])) for name, values in columns.items()}
        if fitted.model.needs_cor and golden.impacts.cor is not None:
            row["cor"] = repr(float(golden.impacts.cor[k]))
        if not inputs_only:
            row["regime"] = regime_name(int(golden.rebound.regime[k]))
        rows.append(row)
    return csv_text(rows)


def lookup_texts(bounces: Bounces, range: str | None = None) -> tuple[dict[str, str], str]:
    """The table and its description, and a note; the same grid for every surface and ball, with a column of each.

    Raises ParameterError for a grid that is none.
    """
    axes = default_axes(_whole(bounces)) if range is None else parse_grid(range)
    lookups = [make_lookup(case.fitted, axes) for case in bounces.cases]
    rows = [
        dict(case.labels if bounces.columns else {}) | row
        for case, lookup in zip(bounces.cases, lookups, strict=True)
        for row in _lookup_rows(lookup)
    ]
    notes = [
        f"{case.words}: {_lookup_note(lookup)}" if bounces.columns else _lookup_note(lookup)
        for case, lookup in zip(bounces.cases, lookups, strict=True)
    ]
    return {".csv": csv_text(rows), ".json": json_text(_lookup_json(bounces, lookups))}, "; ".join(notes)


def _whole(bounces: Bounces) -> FittedModel:
    """The model of the first case with the impacts of all."""
    first, others = bounces.cases[0].fitted, [case.fitted.impacts for case in bounces.cases[1:]]
    columns = ("v_x1", "v_y1", "omega_1")
    parts = [first.impacts, *others]
    return replace(
        first, impacts=Impacts(*(np.concatenate([getattr(one, name) for one in parts]) for name in columns))
    )


def _lookup_note(lookup: Lookup) -> str:
    """The interpolation error in one line, and grid points that are extrapolated or have no rebound."""
    count, beyond, valid = len(lookup.points), int(lookup.extrapolated.sum()), lookup.valid
    errors = ", ".join(
        f"{name} {item.largest:.2g} (RMS {item.rms:.2g}) {SI_UNITS[name]}" for name, item in lookup.errors.items()
    )
    notes = [f"largest error of interpolation: {errors}" if errors else "interpolation could not be checked"]
    if beyond:
        notes.append(
            f"{beyond} of {count} points are outside of v_y1 = {valid.low:.4g} to {valid.high:.4g} m/s (column "
            "extrapolated): restitution and offset keep their values at the end of this range"
        )
    notes += [f"{lost} of {count} points have no rebound: {reason}" for reason, lost in lookup.failed.items()]
    return "; ".join(notes)


def _lookup_rows(lookup: Lookup) -> list[dict[str, object]]:
    names = {name: regime_name(int(name)) for name in set(lookup.regime.tolist())}
    rows = []
    for k, point in enumerate(lookup.points.tolist()):
        row: dict[str, object] = {
            f"{axis.name} [{axis.unit.symbol}]": f"{axis.unit.from_si(value):.12g}"
            for axis, value in zip(lookup.axes, point, strict=True)
        }
        for name, column in lookup.outputs.items():
            row[f"{name} [{SI_UNITS[name]}]"] = None if column[k] != column[k] else f"{column[k]:.12g}"
        row["regime"] = names[int(lookup.regime[k])]
        row["extrapolated"] = "yes" if lookup.extrapolated[k] else "no"
        rows.append(row)
    return rows


def _lookup_json(bounces: Bounces, lookups: Sequence[Lookup]) -> dict[str, Any]:
    first = lookups[0]
    found = [_grid_json(case, lookup) for case, lookup in zip(bounces.cases, lookups, strict=True)]
    parameters = found[0].pop("parameters") if len(found) == 1 else None
    return {
        "schema_version": 1,
        "kind": "fitball lookup table",
        "model": bounces.cases[0].fitted.model_name,
        "table": bounces.table or None,
        **({} if parameters is None else {"parameters": parameters}),
        "order": "the last axis varies fastest",
        "axes": [
            {"name": axis.name, "unit": axis.unit.symbol, "values": [*map(axis.unit.from_si, axis.values.tolist())]}
            for axis in first.axes
        ],
        "outputs": {name: SI_UNITS[name] for name in first.outputs},
        **(found[0] if len(found) == 1 else {"columns": list(bounces.columns), "levels": found}),
    }


def _grid_json(case: Case, lookup: Lookup) -> dict[str, Any]:
    """What is known of the grid of one surface and ball."""
    units = {axis.name: axis.unit for axis in lookup.axes}
    return {
        **({"labels": dict(case.labels)} if case.labels else {}),
        "parameters": dict(case.golden.parameters),
        "points": len(lookup.points),
        "points_without_rebound": dict(lookup.failed),
        "points_extrapolated": int(lookup.extrapolated.sum()),
        "valid_range": {
            "v_y1_low": lookup.valid.low,
            "v_y1_high": lookup.valid.high,
            "unit": "m/s",
            "ends_below_by": lookup.valid.below,
            "ends_above_by": lookup.valid.above,
            "outside": "restitution and offset of the normal force keep their values at the nearer end",
        },
        "interpolation": {
            "method": "multilinear in the axes",
            "checked_at": f"{lookup.checked} impacts: midpoints of cells, and random ones (seed {SEED})",
            "errors": {
                name: {
                    "unit": SI_UNITS[name],
                    "largest": item.largest,
                    "rms": item.rms,
                    "largest_at": {axis: units[axis].from_si(value) for axis, value in item.place.items()},
                }
                for name, item in lookup.errors.items()
            },
        },
    }


# Contact time taken where the model has none [s]: a tennis ball's is 4 to 5.5 ms (Cross; Brody).
USUAL_CONTACT = 0.005
# Steps of MuJoCo in one contact below which its integrator, not the numbers given, decides the restitution.
STEPS = 20


def engine_texts(bounces: Bounces, at: str | None = None, engine_inertia: float = 0.4) -> Mapping[str, str]:
    """The page and the JSON, with settings for every surface and ball. Raises ParameterError for an operating point
    that is no one impact.
    """
    point = middle_impact(_whole(bounces)) if at is None else parse_impact(at)
    if not bounces.cases[0].fitted.tangential and (abs(point.v_x1[0]) > 0.0 or abs(point.omega_1[0]) > 0.0):
        raise ParameterError("this fit is of drop tests and has no friction: give v_y alone")
    engines = [fit_engine(case.fitted, point, engine_inertia) for case in bounces.cases]
    return {".md": _engine_page(bounces, engines), ".json": json_text(_engine_json(bounces, engines))}


def mujoco(engine: EngineFit) -> dict[str, Any]:
    """A spring and damper that leave at the wanted restitution when their force ends, as MuJoCo's contact does."""
    time = engine.contact_time if engine.contact_time is not None else USUAL_CONTACT
    damping_ratio, _rest, angle = zero_force_release(min(engine.at_point.e, 1.0 - 1e-9))
    omega = angle / time
    return {
        "solref": [-omega * omega, -2.0 * damping_ratio * omega],
        "solimp": [0.99, 0.99, 0.001, 0.5, 2.0],
        "contact_time": time,
        "contact_time_known": engine.contact_time is not None,
        "timestep_at_most": time / STEPS,
    }


def _settings(item: EngineSettings) -> dict[str, Any]:
    return {
        "restitution": item.e,
        "friction": item.mu,
        "friction_grips_from": item.mu_from,
        "errors_at_point": dict(item.errors),
        "rms_over_range": dict(item.rms),
    }


def _engine_json(bounces: Bounces, engines: Sequence[EngineFit]) -> dict[str, Any]:
    first, engine = bounces.cases[0].fitted, engines[0]
    found = [_case_json(case, item) for case, item in zip(bounces.cases, engines, strict=True)]
    return {
        "schema_version": 1,
        "kind": "fitball engine settings",
        "model": first.model_name,
        "table": bounces.table or None,
        "units": {"speeds": "m/s", "spins": "rad/s", "angles": "rad", "times": "s"},
        "ball": {"mass": first.ball.mass, "radius": first.ball.radius, "inertia_ratio": engine.inertia_ratio},
        "operating_point": {name: float(getattr(engine.point, name)[0]) for name in ("v_x1", "v_y1", "omega_1")},
        **(found[0] if len(found) == 1 else {"columns": list(bounces.columns), "levels": found}),
    }


def _case_json(case: Case, engine: EngineFit) -> dict[str, Any]:
    return {
        **({"labels": dict(case.labels)} if case.labels else {}),
        "outside_calibrated_range": _outside(case.fitted, engine),
        "outside_valid_range": engine.extrapolated,
        "valid_range": {"v_y1_low": engine.valid.low, "v_y1_high": engine.valid.high},
        "mixtures_left_out": engine.unsolved,
        "fitted_rebound": dict(engine.fitted),
        "engine_rebound": dict(engine.engine),
        "at_point": _settings(engine.at_point),
        "over_range": _settings(engine.over_range),
        "mujoco": mujoco(engine),
        "engines": _engines(engine),
    }


def _engines(engine: EngineFit) -> dict[str, Any]:
    """What the page says under "How to set them", by the engines' own names; friction null where a drop test knows
    none.
    """
    e, mu = engine.at_point.e, engine.at_point.mu
    multiply = {"frictionCombine": "Multiply", "bounceCombine": "Multiply"}
    free = {"rough": False, "absorbent": False}
    return {
        "unity": {
            "ball": {"bounciness": e, "dynamicFriction": mu, "staticFriction": mu, **multiply},
            "court": {"bounciness": 1.0, "dynamicFriction": 1.0, "staticFriction": 1.0, **multiply},
        },
        "godot": {
            "ball": {"bounce": e, "friction": mu, **free},
            "court": {"bounce": 0.0, "friction": 1.0 if mu is None else max(1.0, mu), **free},
        },
        "bullet": {
            "ball": {"restitution": e, "friction": mu, "rollingFriction": 0.0, "spinningFriction": 0.0},
            "court": {"restitution": 1.0, "friction": 1.0},
        },
    }


def _engine_page(bounces: Bounces, engines: Sequence[EngineFit]) -> str:
    first, engine, words = bounces.cases[0], engines[0], _PageWords(bounces.measured)
    fitted = first.fitted
    point, inertia = engine.point, fitted.ball.inertia_ratio
    speed = math.hypot(point.v_x1[0], point.v_y1[0])
    angle = math.degrees(math.atan2(point.v_y1[0], point.v_x1[0]))
    state = (
        f"Operating point: {speed:.4g} m/s at {angle:.4g} deg, spin {point.omega_1[0]:.4g} rad/s (topspin positive). "
        f"Ball: mass {fitted.ball.mass * 1e3:.4g} g, radius {fitted.ball.radius * 1e3:.4g} mm, "
        f"inertia {engine.inertia_ratio:.3g} M R^2 in the engine, {inertia:.3g} in the {words.source}."
    )
    limits = (
        "Limits: the engine's ball has the same restitution at every speed and no tangential rebound: neither twist "
        "of the cover nor shift of the normal force. It has the engine's moment of inertia. If your engine lets you "
        f"set it, use that of the ball: `engine_inertia = {inertia:.3g}`."
    )
    ranged = f"Range: mixtures of {words.mixtures}. Best: smallest kinetic energy of the difference."
    title = f"Engine settings for {fitted.model_name}" + (f" on {bounces.name}" if bounces.name else "")
    if first.labels and not bounces.columns:
        title += f", {first.words}"
    about = [*([] if bounces.measured else ["**Nothing was fitted.**"]), *bounces.sources]
    if not bounces.columns:
        settings, notes, errors = _case_parts(engine, words)
        lead: list[Part] = [
            Words([state, *about, *_warning(fitted, engine, words)]), settings, Words([*notes, limits]), errors,
            Words([ranged]),
        ]  # fmt: skip
        return as_markdown(Document(title, lead, [Section("set", "How to set them", [Words(_advice(engine))])]))
    heads = [*bounces.columns, "e", "mu", f"e over {words.range}", f"mu over {words.range}"]
    by_level = [heads] + [
        [*case.labels.values(), f"{item.at_point.e:.4f}", _mu(item.at_point.mu), f"{item.over_range.e:.4f}",
         _mu(item.over_range.mu)]
        for case, item in zip(bounces.cases, engines, strict=True)
    ]  # fmt: skip
    sections = []
    for k, (case, item) in enumerate(zip(bounces.cases, engines, strict=True)):
        settings, notes, errors = _case_parts(item, words)
        parts: list[Part] = [
            settings,
            Words([*_warning(case.fitted, item, words), *notes]),
            errors,
            Words(_advice(item)),
        ]
        sections.append(Section(f"level_{k}", case.words, parts))
    whole: list[Part] = [Words([state, *about]), Table("Settings", by_level), Words([limits, ranged])]
    return as_markdown(Document(title, whole, sections))


class _PageWords:
    """What a page says of a fit, or of a model that nothing was fitted to."""

    def __init__(self, measured: bool) -> None:
        self.source = "fit" if measured else "model"
        self.ball, self.model = ("fitted ball", "fitted model") if measured else ("model", "model")
        self.range = "the calibrated range" if measured else "the bounces of a rally"
        self.mixtures = "the calibrated impacts" if measured else "the bounces of a rally"
        self.outside = "outside the calibrated range" if measured else "unlike the bounces of a rally"


def _case_parts(engine: EngineFit, words: _PageWords) -> tuple[Table, list[str], Table]:
    """Settings, notes and errors of one surface and ball."""
    best, wide = engine.at_point, engine.over_range
    settings = [
        ["", "restitution e", "friction mu"],
        ["best at the operating point", f"{best.e:.4f}", _mu(best.mu)],
        [f"best over {words.range}", f"{wide.e:.4f}", _mu(wide.mu)],
    ]
    notes = []
    if best.mu_from is not None:
        notes.append(
            f"At the operating point the engine's ball grips: every mu above {best.mu_from:.4f} gives the same "
            f"rebound. The mu above is the one with the smallest error over {words.range}."
        )
    if best.mu is None:
        notes.append("The fit is of drop tests: friction is not determined.")
    errors = [
        ["output", words.ball, "engine", "error there",
         "RMS error over the range", "RMS, best over the range"]
    ]  # fmt: skip
    errors += [_row(name, engine) for name in COMPARED]
    return Table("Settings", settings), notes, Table("Errors", errors)


def _outside(fitted: FittedModel, engine: EngineFit) -> bool:
    known = calibrated_range(fitted.impacts, engine.point, fitted.ball.radius, fitted.tangential, ())
    return bool(known.outside[0])


def _warning(fitted: FittedModel, engine: EngineFit, words: _PageWords) -> list[str]:
    notes = []
    if _outside(fitted, engine):
        notes.append(f"**The operating point is {words.outside}.**")
    if engine.extrapolated:
        end, why = engine.valid.low, engine.valid.below
        if engine.point.v_y1[0] > engine.valid.high:
            end, why = engine.valid.high, engine.valid.above
        notes.append(
            f"**It is beyond v_y1 = {end:.4g} m/s, where the {words.model} ends ({why}): restitution and offset keep "
            "their values there.**"
        )
    if engine.unsolved:
        notes.append(f"{engine.unsolved} mixtures of {words.mixtures} have no rebound and are not in the range.")
    return notes


def _mu(value: float | None) -> str:
    return "-" if value is None else f"{value:.4f}"


def _row(name: str, found: EngineFit) -> list[str]:
    scale, near, wide = output_scale(name), found.at_point, found.over_range
    values = (found.fitted[name], found.engine[name], near.errors[name], near.rms[name], wide.rms[name])
    fitted, engine, error, near_rms, wide_rms = (value * scale.factor for value in values)
    numbers = f"{fitted:.3f}", f"{engine:.3f}", f"{error:+.3f}", f"{near_rms:.3f}", f"{wide_rms:.3f}"
    return [f"{name} [{scale.unit}]", *numbers]


def _advice(engine: EngineFit) -> list[str]:
    e, mu = f"{engine.at_point.e:.4f}", "1" if engine.at_point.mu is None else _mu(engine.at_point.mu)
    soft = mujoco(engine)
    stiffness, damping = soft["solref"]
    known = "" if soft["contact_time_known"] else " (assumed: this model has none)"
    return [
        f"**Unity.** Material of the ball: bounciness {e}, dynamic and static friction {mu}; of the court: 1 and 1; "
        "both combine modes Multiply on both (of two different modes the later in Average, Minimum, Multiply, "
        "Maximum is used). Set the bounce threshold of the physics settings below the slowest `v_y1`, and "
        "`Rigidbody.maxAngularVelocity` above the spins. Set `Rigidbody.inertiaTensor` if the ball is not solid.",
        f"**Godot.** `PhysicsMaterial` of the ball: bounce {e}, friction {mu}, rough off; of the court: bounce 0, "
        f"friction at least {mu}, rough and absorbent off. Bounces add, and the lower friction counts. `inertia` of "
        "the body sets the moment of inertia; set linear and angular damp to 0.",
        f"**Bullet.** Ball: `setRestitution({e})`, `setFriction({mu})`; court: 1 and 1, for both are multiplied. "
        "Rolling and spinning friction 0. The moment of inertia is an argument of the body.",
        "**MuJoCo** has no restitution: a contact is a spring and damper, so this is an approximation. Ball: "
        f'`solref="{stiffness:.6g} {damping:.6g}"`, `solimp="0.99 0.99 0.001 0.5 2"`, `condim="3"`, '
        f'`friction="{mu} 0 0"`, `priority="1"` (else the larger friction of the two counts); a contact then lasts '
        f"{soft['contact_time'] * 1e3:.3g} ms{known}, so take a timestep of {soft['timestep_at_most'] * 1e3:.2g} ms "
        'or less, and `cone="elliptic"` with a larger `impratio` against creep. Drop a ball, measure its rebound, '
        "and correct the second number of solref.",
    ]
