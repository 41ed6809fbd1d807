"""A plan for a person as one document, as rows of a table that can be filled in and fitted, and as JSON."""

from __future__ import annotations

import math
from collections.abc import Collection
from pathlib import Path

import numpy as np

from fitball.files import all_or_none
from fitball.inference.design.asked import AS_BEFORE, Setting, columns_read
from fitball.inference.design.make_plan import Plan, Worth
from fitball.inference.design.targets import Part
from fitball.inference.problem.problem import Problem
from fitball.report.form.document import Document, Picture, Row, Section, Table, Words, as_page, on_terminal
from fitball.report.form.files import csv_text, json_text, write_text
from fitball.report.form.numbers import digits, handy, listed, output_scale, percent
from fitball.values import FloatArray
from fitball.wording import spoken

PlanRow = dict[str, object]
# Columns for the uncertainty of an incident state, by whether that is speed and angle or vertical, each with the
# stated sds of a table that ask for it.
INCIDENT_SDS = {
    True: {
        "v_1_sd [m/s]": {"v_x1", "v_y1"}, "theta_1_sd [deg]": {"v_x1", "v_y1"}, "omega_1_sd [rad/s]": {"omega_1"},
    },
    False: {"v_y1_sd [m/s]": {"v_y1"}},
}  # fmt: skip


def plan_rows(plan: Plan, problem: Problem) -> list[PlanRow]:
    """One row for each impact, repeats included, in the columns of the fitted table, so that both can be fitted
    together: incident state, labels of the surface, empty columns for measurements and their sds; then gains and
    expected sds, which a later fit does not read.
    """
    table, found = problem.table, plan.settings
    empty = [name for one in plan.chosen for name in columns_read(problem, one.sensor)]
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
    """The whole plan in SI units; sds of `log` parts are those of the logarithm."""
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
        "court_height": None if plan.height is None else {
            "sd": _number(plan.height.sd), "gap_time": _number(plan.height.gap_time),
        },
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
    """A number to nine digits, more than are significant and the same everywhere; None where there is none."""
    return float(f"{value:.9g}") if math.isfinite(value) else None


# Nats below which a sensor adds nothing worth its cost: as much as chance decides between two impacts.
LEAST_GAIN = 0.05
# An sd that falls to this share or less is named.
NARROWER = 0.9
# Parts of a target that are named in a sentence.
MOST_NAMED = 3
# Parts with a column of their own on a page, and on a first screen.
MOST_COLUMNS, MOST_BRIEF = 4, 2
LEGEND = (
    "gain: expected information gain [nats], added to that of the impacts above it. It is computed to first order "
    "and averaged over the posterior. One nat reduces the sd of one quantity to 37 %. sd: expected after this impact "
    "and those above it."
)
SENSORS_LEGEND = (
    "best impact: gain of the best single impact measured this way. same impacts: gain of the chosen impacts "
    "measured this way; for a drop test, of as many drops. largest effect: the sd that falls most, and its value "
    "without this sensor."
)
CAPTION = (
    "Expected information gain of one more impact, measured as before, over the settings of the machine. Numbers: "
    "chosen impacts in their order. Dots: impacts of the fitted data, at the nearest spin."
)
FIRST_ORDER = (
    "{} posterior draws, to first order. Noise and all other parameters are as uncertain as in the fit. Gains assume "
    "that the model is right."
)
JSON_NAME, PICTURE = "plan.json", "plan.png"


def plan_document(
    plan: Plan, title: str, pictures: Collection[str] = (), command: str | None = None, folder: Path | None = None
) -> Document:
    """The report on a plan, with its map of gains if that is among the `pictures`; `command` is the line that made
    it, None where none did.
    """
    sensors, parts, chosen = sensors_table(plan), parts_table(plan), chosen_table(plan)
    sds = [head for head in chosen[0] if head.startswith("sd of ")]
    named = [plan.settings.named, "sensor", "contact"]
    first = [head for head in chosen[0] if head != "contact" and head not in sds[MOST_BRIEF:]]
    lead: list[Words | Picture | Table] = [
        Words(headline(plan), "lead", rank="first"),
        Table.from_rows(
            "Impacts to measure, best first",
            chosen,
            named,
            brief=first,
            rank="first",
        ),
        *[Picture(name, CAPTION, f"{CAPTION} {headline(plan)[0]}", rank="first") for name in pictures],
        Words(points(plan), "list", rank="first"),
    ]
    sections = [
        Section("sensors", "Ways of measuring", [
            Table.from_rows(
                "Ways of measuring", sensors, ["what it reads", "largest effect"],
                brief=["what it reads", "cost", "same impacts", "largest effect"],
                only="" if len(sensors) > 1 else "page", rank="first",
            ),
            Words(_height_words(plan), "list", rank="first"),
            Words([SENSORS_LEGEND], "quiet", "page"),
        ]),
        Section("sds", "Expected standard deviations", [
            Table("Expected sd of each part of the target, by way of measuring", parts, only="page"),
        ], rank="folded"),
        Section("rests", "What the plan assumes", [
            Words([
                LEGEND, FIRST_ORDER.format(plan.draws), f"Settings: {ranges_text(plan)}.",
                f"Seed {plan.seed}. `plan.json` holds every number of this page and more; `plan.csv` has the impacts "
                "with empty columns to fill in.",
            ], "list", "page"),
            Words([] if command is None else [command], "code", "page"),
        ], rank="folded"),
        Section("", "", [Words([] if folder is None else [
            f"Report: {folder / 'plan.html'}; table to fill in: {folder / 'plan.csv'}"
        ], only="terminal", rank="first")]),
    ]  # fmt: skip
    return Document(title, lead, sections)


def title_of(problem: Problem) -> str:
    """The title of a plan."""
    return f"{problem.table.name}: what to measure next, by the {problem.model.name} model"


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
    """An sd in a handy unit; that of a logarithm in percent of the value."""
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


def headline(plan: Plan) -> list[str]:
    """The best next impact, its gain and that of all, what they reduce most, and the best way of measuring."""
    first = plan.chosen[0]
    times = f", {plan.repeats} times" if plan.repeats > 1 else ""
    by = f" ({first.sensor})" if first.sensor != AS_BEFORE else ""
    sentences = [
        f"Measure next: {setting_text(first.setting)}{times}{by}.",
        f"Expected information gain: {nats(first.gain)} nats about {plan.target}.",
    ]
    count = len(plan.chosen) * plan.repeats
    if count > 1:
        sentences.append(
            f"All {count} impacts below: {nats(plan.gain)} nats. Repeating {count} of the existing impacts: "
            f"{nats(plan.again)} nats."
        )
        sentences.append(_narrowed(plan, plan.chosen[-1].sds))
    return [*sentences, *_best_way(plan)]


def _best_way(plan: Plan) -> list[str]:
    """The best way of measuring, where another than before adds something."""
    best = max(plan.worths, key=lambda worth: worth.batch if math.isfinite(worth.batch) else -1.0)
    if best.batch - plan.worths[0].batch >= LEAST_GAIN:
        k = _narrowed_most(plan, best)
        effect = "" if k is None else f" Expected sd of {plan.parts[k].name}: {_beside(plan, k, best)}."
        return [
            f"The best way of measuring these impacts is {best.sensor} ({best.words}): {nats(best.batch)} nats "
            f"instead of {nats(plan.worths[0].batch)}.{effect}"
        ]
    return []


def points(plan: Plan) -> tuple[str, ...]:
    """What limits the plan: settings and draws that are left out, ranges, cautions of the fit."""
    sentences = []
    for reason, number in plan.failed.items():
        sentences.append(
            f"{number:,} of {math.prod(plan.settings.shape):,} settings are left out. More than half of the "
            f"posterior draws cannot be evaluated there ({reason})."
        )
    partly = [one for one in plan.chosen if one.unsolved > 0.0]
    if partly:
        most = max(one.unsolved for one in partly)
        sentences.append(
            f"At {len(partly)} of the chosen impacts up to {percent(most)} of the draws cannot be evaluated. Their "
            "gains are averages over the other draws."
        )
    if plan.lost > 0.0:
        sentences.append(f"{100.0 * plan.lost:.1f} % of the draws do not give {plan.target} and are left out.")
    if plan.settings.assumed:
        wider = listed([spoken(f"--{name}", name) for name in plan.settings.assumed])
        sentences.append(
            f"Only the range of the fitted data was searched: {ranges_text(plan)}. If your machine reaches further, "
            f"give its range with {wider}."
        )
    return (*sentences, *plan.notes)


def _height_words(plan: Plan) -> list[str]:
    """What gaps are, and what is assumed of the court's height, where a sensor that sees them adds something."""
    least = plan.worths[0].batch + LEAST_GAIN
    if plan.height is None or not any(
        worth.batch >= least for worth in plan.worths if worth.sensor in plan.height.sensors
    ):
        return []
    return [
        "gaps: time, path and turn between the flights before and after a bounce, seen by a camera. "
        f"The height of the court is assumed to be known within {digits(1e3 * plan.height.sd, 2)} mm. At the first "
        f"impact an error of 1 mm changes gap_time by {digits(plan.height.gap_time, 2)} ms."
    ]


def ranges_text(plan: Plan) -> str:
    """The ranges that were searched."""
    found = plan.settings
    if np.all(found.angles > 1.5707):
        return f"{_range(found.speeds)} m/s"
    return f"{_range(found.speeds)} m/s, {_range(np.degrees(found.angles))} deg, spin {_range(found.spins)} rad/s"


def _range(values: FloatArray) -> str:
    low, high = f"{values[0]:.4g}", f"{values[-1]:.4g}"
    return low if low == high else f"{low} to {high}"


def _narrowed(plan: Plan, sds: FloatArray) -> str:
    """The parts whose sd falls most, with their sds then and now."""
    ratios = _ratios(sds, plan.sds)
    order = [k for k in _narrowest(plan, sds) if ratios[k] <= NARROWER][:MOST_NAMED]
    if not order:
        return "No sd falls by a tenth or more."
    texts = [f"{plan.parts[k].name} {_change(plan, k, sds, plan.sds, 'now')}" for k in order]
    return f"Expected sd after these: {', '.join(texts)}."


def _ratios(sds: FloatArray, before: FloatArray) -> FloatArray:
    """The remaining share of each sd."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(before > 0.0, sds / before, 1.0)


def _narrowest(plan: Plan, sds: FloatArray) -> list[int]:
    """The parts, those whose sd falls most first."""
    return [int(k) for k in np.argsort(_ratios(sds, plan.sds), kind="stable")]


def _change(plan: Plan, k: int, sds: FloatArray, before: FloatArray, when: str) -> str:
    part = plan.parts[k]
    return f"{sd_text(part, float(sds[k]))} ({sd_text(part, float(before[k]))} {when})"


def effect_text(plan: Plan, worth: Worth) -> str:
    """The sd that a sensor reduces most on the same impacts, in a cell."""
    base = plan.worths[0]
    if worth is base:
        return ""
    if not math.isfinite(worth.batch):
        return "most draws cannot be evaluated"
    if worth.batch - base.batch < LEAST_GAIN:
        return "nothing more"
    k = _narrowed_most(plan, worth)
    return "no sd falls by a tenth" if k is None else f"{plan.parts[k].name}: {_beside(plan, k, worth)}"


def _narrowed_most(plan: Plan, worth: Worth) -> int | None:
    """The part whose sd a sensor reduces most, if by a tenth."""
    ratios = _ratios(worth.sds, plan.worths[0].sds)
    k = int(np.argmin(ratios))
    return k if ratios[k] <= NARROWER else None


def _beside(plan: Plan, k: int, worth: Worth) -> str:
    return _change(plan, k, worth.sds, plan.worths[0].sds, "without")


def chosen_table(plan: Plan) -> list[Row]:
    """The chosen impacts, with the sds as they are now above them."""
    surfaces = any(one.setting.surface for one in plan.chosen)
    along = any(one.regimes for one in plan.chosen)
    columns = _narrowest(plan, plan.chosen[-1].sds)[:MOST_COLUMNS]

    def sd_cells(sds: FloatArray) -> Row:
        return {f"sd of {plan.parts[k].name}": sd_text(plan.parts[k], float(sds[k])) for k in columns}

    rows = []
    for place, one in enumerate(plan.chosen, 1):
        state = one.setting
        row = {"": str(place), "speed [m/s]": digits(state.speed, 3)}
        row |= (
            {"angle [deg]": f"{math.degrees(state.angle):.0f}", "spin [rad/s]": f"{state.spin:.0f}"} if along else {}
        )
        row |= {plan.settings.named: state.surface} if surfaces else {}
        row |= {"times": str(plan.repeats)} if plan.repeats > 1 else {}
        row |= {"sensor": one.sensor} if plan.by_cost else {}
        row |= {"gain": nats(one.gain)} | sd_cells(one.sds)
        row |= {"contact": next(iter(one.regimes), "-")} if along else {}
        rows.append(row)
    return [dict.fromkeys(rows[0], "") | {"": "now"} | sd_cells(plan.sds), *rows]


def sensors_table(plan: Plan) -> list[Row]:
    """Ways of measuring side by side."""
    rows = []
    for worth in plan.worths:
        row = {"measured by": worth.sensor, "what it reads": worth.words}
        row |= {"cost": f"{worth.cost:g}"} if plan.by_cost else {}
        row |= {"best impact": nats(worth.gain), "same impacts": nats(worth.batch)}
        rows.append(row | {"largest effect": effect_text(plan, worth)})
    return rows


def parts_table(plan: Plan) -> list[list[str]]:
    """Every part of the target: sd now, after as many repeats of existing impacts, and after the chosen impacts by
    each sensor; heads first.
    """
    after = [plan.sds, plan.again_sds, *(worth.sds for worth in plan.worths)]
    rows = [["", "now", "repeats", *(worth.sensor for worth in plan.worths)]]
    rows += [[part.name, *(sd_text(part, float(sds[k])) for sds in after)] for k, part in enumerate(plan.parts)]
    return rows
