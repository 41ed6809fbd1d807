"""A plan for a person as one document, as rows of a table that can be filled in and fitted, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path

import numpy as np

from fitball.files import all_or_none
from fitball.inference.design.asked import AS_BEFORE, Part, Setting
from fitball.inference.design.make_plan import Plan, Worth
from fitball.inference.problem.problem import Problem
from fitball.observables import OBSERVABLES
from fitball.report.form.document import Document, Picture, Row, Section, Table, Words, as_page, on_terminal
from fitball.report.form.files import csv_text, json_text, write_text
from fitball.report.form.numbers import digits, handy, listed, output_scale, percent
from fitball.values import FloatArray
from fitball.wording import spoken

PlanRow = dict[str, object]
# What states the uncertainty of an incident state, by whether that is speed and angle or vertical, and which stated
# sds of a table call for it.
INCIDENT_SDS = {
    True: {
        "v_1_sd [m/s]": {"v_x1", "v_y1"}, "theta_1_sd [deg]": {"v_x1", "v_y1"}, "omega_1_sd [rad/s]": {"omega_1"},
    },
    False: {"v_y1_sd [m/s]": {"v_y1"}},
}  # fmt: skip


def plan_rows(plan: Plan, problem: Problem) -> list[PlanRow]:
    """A row an impact, repeats included, in the columns that the fitted table has, so that both can be fitted
    together: incident state, labels of the surface, what is to be measured and stated (empty), and behind it gains
    and expected sds, which reading leaves aside.
    """
    table, found = problem.table, plan.settings
    empty = [name for one in plan.chosen for name in one.sensor.split("+") if name in OBSERVABLES]
    empty = list(dict.fromkeys([*(item.name for item in problem.observables), *empty]))
    stated = [f"{item.name}_sd" for item in problem.observables if item.sd is not None]
    incident = [
        head for head, names in INCIDENT_SDS[table.has_tangential].items() if names & table.incident_sd.keys()
    ]
    spun = "omega_1" in table.incident_columns or any(one.setting.spin for one in plan.chosen)
    rows: list[PlanRow] = []
    for place, one in enumerate(plan.chosen, 1):
        state = one.setting
        for repeat in range(1, plan.repeats + 1):
            row: PlanRow = {"id": f"{place}.{repeat}" if plan.repeats > 1 else str(place)}
            if table.has_tangential:
                row |= {"v_1 [m/s]": _number(state.speed), "theta_1 [deg]": _number(math.degrees(state.angle))}
                row |= {"omega_1 [rad/s]": _number(state.spin)} if spun else {}
            else:
                row["v_y1 [m/s]"] = _number(state.speed)
            at = found.rows[found.surfaces.index(state.surface)]
            row |= {pooling.column: pooling.labels[int(pooling.index[at])] for pooling in problem.pooling}
            row |= dict.fromkeys(f"{name} [{output_scale(name).unit}]" for name in empty)
            row |= dict.fromkeys(f"{name} [{output_scale(name.removesuffix('_sd')).unit}]" for name in stated)
            row |= dict.fromkeys(incident)
            row |= {"sensor": one.sensor, "gain of all repeats [nats]": _number(one.gain)}
            for part, sd in zip(plan.parts, one.sds, strict=True):
                unit = "" if part.log or not part.unit else f" [{part.unit}]"
                row[f"expected sd of {'ln ' if part.log else ''}{part.name}{unit}"] = _number(float(sd))
            rows.append(row)
    return rows


def plan_json(plan: Plan) -> PlanRow:
    """All of it, SI units; sds of `log` parts are those of the logarithm."""
    found = plan.settings
    return {
        "target": plan.target,
        "parts": [
            {"name": part.name, "unit": part.unit, "log": part.log, "sd": _number(float(sd))}
            for part, sd in zip(plan.parts, plan.sds, strict=True)
        ],
        "repeats": plan.repeats,
        "chosen": [
            {
                **_state(one.setting), "sensor": one.sensor, "gain": _number(one.gain), "sds": _numbers(one.sds),
                "unsolved": one.unsolved, "regimes": dict(one.regimes),
            }
            for one in plan.chosen
        ],
        "gain": _number(plan.gain),
        "table_again": {"gain": _number(plan.again), "sds": _numbers(plan.again_sds)},
        "sensors": [
            {
                "name": worth.sensor, "words": worth.words, "cost": worth.cost, "best": _state(worth.best),
                "gain": _number(worth.gain), "batch": _number(worth.batch),
                "sds": _numbers(worth.sds),
            }
            for worth in plan.worths
        ],
        "settings": {
            "surfaces": list(found.surfaces), "speeds": _numbers(found.speeds), "angles": _numbers(found.angles),
            "spins": _numbers(found.spins), "assumed": list(found.assumed), "left_out": dict(plan.failed),
            "gains": [_number(float(gain)) for gain in plan.gains.ravel()],
        },
        "draws": plan.draws,
        "lost": plan.lost,
        "seed": plan.seed,
        "notes": list(plan.notes),
    }  # fmt: skip


def _state(setting: Setting) -> PlanRow:
    state: PlanRow = {"surface": setting.surface} if setting.surface else {}
    return state | {
        "v_1": _number(setting.speed),
        "theta_1": _number(setting.angle),
        "omega_1": _number(setting.spin),
    }


def _numbers(values: FloatArray) -> list[float | None]:
    return [_number(float(value)) for value in np.asarray(values).ravel()]


def _number(value: float) -> float | None:
    """A number to nine digits, which is more than it means and the same everywhere; None where there is none."""
    return float(f"{value:.9g}") if math.isfinite(value) else None


# Nats below which nothing is said of a difference: two impacts in three of a pair cannot be told apart by it.
TELLING = 0.05
# An sd that falls to this share or less is named.
NARROWER = 0.9
# Parts of a target that are named in a sentence.
MOST_NAMED = 3
# Parts with a column of their own on a terminal.
MOST_COLUMNS = 4
LEGEND = (
    "Gain: nats that the impact is expected to tell beyond those before it, to first order, averaged over the "
    "posterior; one nat narrows one quantity to 37 % of its sd. Behind it the expected sd of each part of the target."
)
SENSORS_LEGEND = (
    "Best impact: the gain of the best single impact read that way. Same batch: the impacts above read that way; of "
    "a drop as many drops."
)
CAPTION = (
    "Expected gain of one more impact, measured as before, over what the machine can be set to. Numbers: the chosen "
    "impacts in their order. Dots: impacts of the fitted table, at the nearest spin."
)
FIRST_ORDER = (
    "{} draws of the posterior to first order; noise and all other parameters as uncertain as the fit left them. "
    "Within the fitted model: what it does not describe no gain counts."
)
JSON_NAME, PICTURE = "plan.json", "plan.png"


def plan_document(
    plan: Plan, title: str, pictures: Collection[str] = (), command: str | None = None, folder: Path | None = None
) -> Document:
    """All that is said of a plan, with its map of gains if that is among the `pictures`; `command` is the line that
    made it, None where none did.
    """
    said, sensors, parts = headline(plan), sensors_table(plan), parts_table(plan)
    sections = [
        Section("impacts", "Impacts to measure, best first", [
            Table.of("Chosen impacts", chosen_table(plan), ["surface", "sensor", "contact"], rank="first"),
            Words([f"{LEGEND} `plan.csv` has these impacts with empty columns to fill in."], "quiet", "page"),
            *[Picture(name, CAPTION, f"{CAPTION} {said}") for name in pictures],
        ]),
        Section("sensors", "Ways of measuring", [
            Table.of(
                "Ways of measuring side by side", sensors, ["what it reads"], only="" if len(sensors) > 1 else "page"
            ),
            Words([SENSORS_LEGEND], "quiet", "page"),
            Table("Expected sd of each part of the target after the batch", parts, only="page"),
        ]),
        Section("rests", "What this rests on", [
            Words([
                f"Settings looked at: {ranges_text(plan)}.", FIRST_ORDER.format(plan.draws),
                f"Seed {plan.seed}. `plan.json` holds every number of this page and more.",
            ], "list", "page"),
            Words([] if command is None else [command], "code", "page"),
        ]),
        Section("", "", [Words([] if folder is None else [
            f"{folder / 'plan.html'}; plan.csv has the impacts to measure, with empty columns to fill in"
        ], only="terminal")]),
    ]  # fmt: skip
    return Document(title, [Words([said], "lead", rank="first"), Words(points(plan), "list", rank="first")], sections)


def title_of(problem: Problem) -> str:
    """What a plan is headed by."""
    return f"{problem.table.name}, {problem.model.name}: what to measure next"


def render(plan: Plan, problem: Problem, folder: Path | None = None) -> str:
    """A plan on a terminal."""
    return on_terminal(plan_document(plan, title_of(problem), folder=folder))


@all_or_none()
def write_all(plan: Plan, problem: Problem, folder: Path, command: str | None = None) -> None:
    """Write every file, each whole or not at all, `plan.json` last; `command` is the line that asked.

    Raises ResultFolderError.
    """
    from fitball.report.figures.canvas import save_figure
    from fitball.report.plan.figure import plan_figure

    title = title_of(problem)
    images = {"map": save_figure(plan_figure(plan, title), folder / PICTURE)}
    write_text(folder / "plan.html", as_page(plan_document(plan, title, images, command), images))
    write_text(folder / "plan.csv", csv_text(plan_rows(plan, problem)))
    write_text(folder / JSON_NAME, json_text(plan_json(plan)))


def sd_text(part: Part, sd: float) -> str:
    """An sd in the unit people read: of a logarithm in percent of the value."""
    if not math.isfinite(sd):
        return "-"
    if part.log:
        return f"{digits(100.0 * sd, 2)} %"
    scale = handy(part.name, part.unit)
    # A unit such as 1e-3 s/m is a factor to a reader.
    return f"{digits(sd * scale.factor, 2)} {'x ' if scale.unit[:1].isdigit() else ''}{scale.unit}".strip()


def setting_text(setting: Setting) -> str:
    """An incident state in words."""
    angle = math.degrees(setting.angle)
    way = f"at {angle:.0f} deg, {spin_text(setting.spin)}"
    if angle > 89.99 and setting.spin == 0.0:
        way = "straight down"
    text = f"{digits(setting.speed, 3)} m/s {way}"
    return f"{text}, {setting.surface}" if setting.surface else text


def spin_text(spin: float) -> str:
    """A spin in words."""
    return "no spin" if abs(spin) < 0.5 else f"{abs(spin):.0f} rad/s {'topspin' if spin > 0.0 else 'backspin'}"


def nats(gain: float) -> str:
    """A gain with two decimals, of a small one two digits; a dash where there is none."""
    if not math.isfinite(gain):
        return "-"
    return f"{gain:.2f}" if abs(gain) >= 0.1 else f"{gain:.2g}"


def headline(plan: Plan) -> str:
    """The best next impact, and what the batch is worth."""
    first = plan.chosen[0]
    times = f", {plan.repeats} times" if plan.repeats > 1 else ""
    by = f" ({first.sensor})" if first.sensor != AS_BEFORE else ""
    text = f"Measure next: {setting_text(first.setting)}{times}{by}. "
    return f"{text}It is worth {nats(first.gain)} nats about {plan.target}."


def points(plan: Plan) -> tuple[str, ...]:
    """What else stands out: the batch, the table again, sensors, what rests on what."""
    said = []
    count = len(plan.chosen) * plan.repeats
    if count > 1:
        said.append(
            f"All {count} impacts below tell {nats(plan.gain)} nats; "
            f"as many of the fitted table, measured again, {nats(plan.again)}. {_narrowed(plan, plan.chosen[-1].sds)}"
        )
    said += [sensor_text(plan, worth) for worth in plan.worths if worth.sensor != AS_BEFORE]
    for reason, number in plan.failed.items():
        said.append(
            f"{number:,} of {math.prod(plan.settings.shape):,} settings are left out: at each more than half of the "
            f"draws of the posterior cannot be evaluated ({reason})."
        )
    partly = [one for one in plan.chosen if one.unsolved > 0.0]
    if partly:
        most = max(one.unsolved for one in partly)
        said.append(
            f"At {len(partly)} of the chosen impacts up to {percent(most)} of the draws cannot be evaluated; "
            "gains are averaged over the others."
        )
    if plan.lost > 0.0:
        said.append(f"{100.0 * plan.lost:.1f} % of the draws have no answer for {plan.target} and are left out.")
    if plan.settings.assumed:
        wider = listed([spoken(f"--{name}", name) for name in plan.settings.assumed])
        said.append(
            f"Ranges of {listed(plan.settings.assumed)} are those of the fitted table: {ranges_text(plan)}. What "
            f"lies beyond may tell more: say by {wider} what can be reached."
        )
    return (*said, *plan.notes)


def ranges_text(plan: Plan) -> str:
    """The ranges that were looked at."""
    found = plan.settings
    if np.all(found.angles > 1.5707):
        return f"{_range(found.speeds)} m/s"
    return f"{_range(found.speeds)} m/s, {_range(np.degrees(found.angles))} deg, spin {_range(found.spins)} rad/s"


def _range(values: FloatArray) -> str:
    low, high = f"{values[0]:.4g}", f"{values[-1]:.4g}"
    return low if low == high else f"{low} to {high}"


def _narrowed(plan: Plan, sds: FloatArray) -> str:
    """The parts that narrow most, with their sds now and then."""
    ratios = _ratios(sds, plan.sds)
    order = [k for k in _narrowest(plan, sds) if ratios[k] <= NARROWER][:MOST_NAMED]
    if not order:
        return "No sd falls by a tenth."
    return f"Expected sd of {listed([f'{plan.parts[k].name} {_change(plan, k, sds)}' for k in order])}."


def _ratios(sds: FloatArray, before: FloatArray) -> FloatArray:
    """What is left of each sd."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(before > 0.0, sds / before, 1.0)


def _narrowest(plan: Plan, sds: FloatArray) -> list[int]:
    """The parts, those that narrow most first."""
    return [int(k) for k in np.argsort(_ratios(sds, plan.sds), kind="stable")]


def _change(plan: Plan, k: int, sds: FloatArray) -> str:
    part = plan.parts[k]
    return f"from {sd_text(part, plan.sds[k])} to about {sd_text(part, float(sds[k]))}"


def sensor_text(plan: Plan, worth: Worth) -> str:
    """What a sensor is worth on the same impacts, in a sentence."""
    base = plan.worths[0]
    what = f"{worth.sensor} ({worth.words})"
    if not math.isfinite(worth.batch):
        return f"{what}: most draws of the posterior cannot be evaluated there."
    if worth.best.angle > 1.57 and worth.batch < base.batch and "drop" in worth.sensor:
        return f"{what}: as many drops tell {nats(worth.batch)} nats, the impacts below {nats(base.batch)}."
    more = worth.batch - base.batch
    if more < TELLING:
        return f"{what} adds next to nothing to the impacts below ({more:+.2f} nats)."
    ratios = _ratios(worth.sds, base.sds)
    k = int(np.argmin(ratios))
    part, told = plan.parts[k], ""
    if ratios[k] <= NARROWER:
        without = sd_text(part, float(base.sds[k]))
        told = f" and tell {part.name}: sd {_change(plan, k, worth.sds)} (without it {without})"
    return f"{what} would add {more:.2f} nats to the impacts below{told}."


def chosen_table(plan: Plan) -> list[Row]:
    """The batch, below the sds as they are now."""
    surfaces = any(one.setting.surface for one in plan.chosen)
    along = any(one.regimes for one in plan.chosen)
    shown = sorted(_narrowest(plan, plan.chosen[-1].sds)[:MOST_COLUMNS])

    def told(sds: FloatArray) -> Row:
        return {f"sd of {plan.parts[k].name}": sd_text(plan.parts[k], float(sds[k])) for k in shown}

    rows = []
    for place, one in enumerate(plan.chosen, 1):
        state = one.setting
        row = {"": str(place), "speed [m/s]": digits(state.speed, 3)}
        row |= (
            {"angle [deg]": f"{math.degrees(state.angle):.0f}", "spin [rad/s]": f"{state.spin:.0f}"} if along else {}
        )
        row |= {"surface": state.surface} if surfaces else {}
        row |= {"times": str(plan.repeats)} if plan.repeats > 1 else {}
        row |= {"sensor": one.sensor} if plan.by_cost else {}
        row |= {"gain": nats(one.gain)} | ({"contact": next(iter(one.regimes), "-")} if along else {})
        rows.append(row | told(one.sds))
    return [dict.fromkeys(rows[0], "") | {"": "now"} | told(plan.sds), *rows]


def sensors_table(plan: Plan) -> list[Row]:
    """Ways of measuring side by side."""
    rows = []
    for worth in plan.worths:
        row = {"measured by": worth.sensor, "what it reads": worth.words}
        row |= {"cost": f"{worth.cost:g}"} if plan.by_cost else {}
        row |= {"best impact": nats(worth.gain), "same batch": nats(worth.batch)}
        rows.append(row)
    return rows


def parts_table(plan: Plan) -> list[list[str]]:
    """Every part of the target: sd now, after as many impacts of the table, and after the batch by each sensor; heads
    first.
    """
    after = [plan.sds, plan.again_sds, *(worth.sds for worth in plan.worths)]
    rows = [["", "now", "table again", *(worth.sensor for worth in plan.worths)]]
    rows += [[part.name, *(sd_text(part, float(sds[k])) for sds in after)] for k, part in enumerate(plan.parts)]
    return rows
