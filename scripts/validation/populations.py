"""Are populations over many tables found? Tables of known populations are fitted separately and their draws weighted.
The study counts how often intervals of centre, spread, levels and of each table contain the truth. Interim priors are
divided out, and left in as a control that must fail. Sets of ten tables are also fitted together, with the parameter
pooled, for comparison.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from fitball.api.calibrating import pose
from fitball.data.table import ImpactTable
from fitball.inference.population.hyper import Before, Known, TableDraws
from fitball.inference.population.levels import population, population_over
from fitball.inference.population.quantity import default_prior, prior_of, quantity
from fitball.inference.problem.parameters import NOISE_SPECS, parse_prior
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.results.results import Posterior, thinned
from fitball.inference.sampling.ensembles import Schedule
from fitball.models.registry import model
from fitball.observables import SI_UNITS
from fitball.report.form.document import columns
from fitball.values import FloatArray, Impacts
from validation.harness import CHAIN, LEVEL, SCHEDULE, Rate, Row, Study, Verdict, drawn_values, maximum, short_chain

MODEL = "grip-slip"
QUANTITIES = ("mu", "cor_10")
# What is known of a population before its tables, and what they are drawn from: centre and its sd in the coordinate,
# sd of the half-normal distribution of the spread.
POPULATIONS: Mapping[str, tuple[float, float, float]] = {
    "mu": (float(np.log(0.62)), 0.15, 0.15), "cor_10": (0.76, 0.03, 0.03)
}  # fmt: skip
# Priors that the tables are fitted under: beside the populations by about a sd of theirs, as a user may state them
# who has read of other courts. The other parameters are drawn from theirs.
INTERIM: Mapping[str, str] = {"mu": "lognormal(0.45, 0.3)", "cor_10": "normal(0.7, 0.06)"}
OTHERS: Mapping[str, str] = {
    "e_x": "normal(0.1, 0.15)", "offset": "normal(0.002, 0.001)", "cor_slope": "normal(-0.012, 0.004)",
    "velocity_sd": "lognormal(0.5, 0.2)", "spin_sd": "lognormal(20, 0.2)",
}  # fmt: skip
CHOICES = Choices(model=MODEL, priors={**INTERIM, **OTHERS}, velocity_noise="tied")
TABLES, LEVELS, EACH, ROWS, DRAWS = 20, 3, 4, 6, 400
# The joint fit has one value of every other parameter for all tables, fits by themselves one each: so that both ask
# the same they are known there.
KNOWN: Mapping[str, float] = {
    "e_x": 0.1, "offset": 2e-3, "cor_slope": -0.012, "velocity_sd": 0.5, "spin_sd": 20.0
}  # fmt: skip
JOINT_TABLES, JOINT_ROWS, JOINT = 10, 20, Schedule(target_ess=1000.0)
# As far as weights and joint fit may typically lie apart, in sds of the joint posterior; half of a 95 % interval.
APART, REACH = 0.2, 1.96
# With the interim priors left in: a control that must fail.
PRIORS = ("divided out", "left in")


@dataclass(frozen=True)
class Truth:
    """A population: centre and spread of each quantity, in its coordinate."""

    centre: Mapping[str, float]
    spread: Mapping[str, float]


def draw_truth(rng: np.random.Generator) -> Truth:
    """One of the populations that may be."""
    drawn = {name: rng.standard_normal(2) for name in QUANTITIES}
    known = POPULATIONS
    return Truth(
        {name: known[name][0] + known[name][1] * float(z[0]) for name, z in drawn.items()},
        {name: known[name][2] * abs(float(z[1])) for name, z in drawn.items()},
    )


def before(name: str) -> Before:
    """What is known of a population of a quantity before its tables."""
    centre, sd, spread = POPULATIONS[name]
    asked = quantity(name)
    ends = asked.ends({name: prior_of(asked.parts[0], INTERIM[name])})
    size = parse_prior(f"{name}_spread", f"half-normal({spread})", 0.0, np.inf)
    return Before(lambda places: -0.5 * ((places - centre) / sd) ** 2, size, size, ends)


def draw_table(
    truth: Truth, rows: int, rng: np.random.Generator, known: Mapping[str, float] | None = None
) -> tuple[ImpactTable, Mapping[str, float]]:
    """The table of one court, with steep and shallow impacts, and its true parameters. The quantities come from their
    population, those in `known` are given, all others come from their priors.
    """
    specs = {**model(MODEL).specs, **NOISE_SPECS}
    values = {name: float(prior_of(specs[name], text).draw(rng, 1)[0]) for name, text in OTHERS.items()}
    for name in QUANTITIES:
        values[name] = quantity(name).value(truth.centre[name] + truth.spread[name] * float(rng.standard_normal()))
    values |= known or {}
    speed, angle = rng.uniform(14.0, 25.0, rows), np.radians(rng.uniform(22.0, 55.0, rows))
    impacts = Impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-150.0, 150.0, rows))
    rebound = model(MODEL).rebound(
        {name: value for name, value in values.items() if name not in NOISE_SPECS}, impacts
    )
    columns = {"v_x1": impacts.v_x1, "v_y1": impacts.v_y1, "omega_1": impacts.omega_1}
    for name in ("v_x2", "v_y2", "omega_2"):
        sd = values["spin_sd" if name == "omega_2" else "velocity_sd"]
        columns[name] = getattr(rebound, name) + sd * rng.standard_normal(rows)
    frame = {f"{name} [{SI_UNITS[name]}]": column.tolist() for name, column in columns.items()}
    return pose(frame, Choices(model=MODEL), as_read=True).table, values


def short_posterior(problem: Problem, root: np.random.SeedSequence, schedule: Schedule = SCHEDULE) -> Posterior:
    """The posterior of one table by the road of `calibrate` with a shorter chain."""
    sampled = short_chain(problem, maximum(problem, root), int(root.generate_state(1)[0]), schedule)
    values = drawn_values(problem, sampled)
    return Posterior(problem.free_names, values, np.empty(values.shape[:-1]), np.empty((0, values.shape[-1])))


def kept_columns(posterior: Posterior) -> Mapping[str, FloatArray]:
    """As many draws (draws,) of each quantity as a batch keeps."""
    kept = thinned(posterior, DRAWS)
    return {name: kept[:, posterior.names.index(name)] for name in QUANTITIES}


Columns = Mapping[str, FloatArray]


def fitted(
    truths: Sequence[Truth], rng: np.random.Generator, root: np.random.SeedSequence
) -> tuple[Columns, Columns]:
    """A table of each truth, fitted by itself: true values (tables,) and draws (tables, draws) by quantity."""
    values, draws = [], []
    for truth, own in zip(truths, root.spawn(len(truths)), strict=True):
        table, true = draw_table(truth, ROWS, rng)
        values.append(true)
        draws.append(kept_columns(short_posterior(pose(table, CHOICES, as_read=True), own)))
    return (
        {name: np.array([one[name] for one in values]) for name in QUANTITIES},
        {name: np.array([one[name] for one in draws]) for name in QUANTITIES},
    )


def table_draws(name: str, draws: FloatArray, priors: str) -> list[TableDraws]:
    """The tables as a population takes them, from draws (tables, draws), interim priors divided out or left in."""
    asked, divided = quantity(name), priors == PRIORS[0]
    log_prior = asked.log_prior({name: prior_of(asked.parts[0], INTERIM[name])}) if divided else np.zeros_like
    return [TableDraws.drawn(str(k), asked.coordinates({name: own}), log_prior) for k, own in enumerate(draws)]


def populations(seed: int, number: int) -> list[Row]:
    """The records of one population. For each quantity and treatment of the priors: how many intervals contain the
    truth, of how many. For the tables also the mean squared error, and how many weights are unreliable.
    """
    root = np.random.SeedSequence(seed, spawn_key=(number,))
    rng = np.random.default_rng(root.spawn(1)[0])
    truth = draw_truth(rng)
    values, draws = fitted([truth] * TABLES, rng, root)
    return [row for priors in PRIORS for name in QUANTITIES for row in _counted(name, priors, truth, values, draws)]


def _counted(name: str, priors: str, truth: Truth, values: Columns, draws: Columns) -> list[Row]:
    asked, found = quantity(name), population(table_draws(name, draws[name], priors), before(name))
    true = asked.coordinates(values)
    alone = np.quantile(asked.coordinates(draws), (0.025, 0.5, 0.975), axis=1)
    given = np.array([[one.known.low, one.known.median, one.known.high] for one in found.tables]).T
    about, doubtful = {"quantity": name, "priors": priors}, len(found.doubtful)
    rows = [
        {**about, "what": what, **_held([known], np.array([real]))}
        for what, known, real in (
            ("centre", found.centre, truth.centre[name]), ("spread", found.spread, truth.spread[name])
        )
    ]  # fmt: skip
    for what, (low, middle, high), poor in (("tables alone", alone, 0), ("tables given all", given, doubtful)):
        inside = (low <= true) & (true <= high)
        counts = {"holds": int(inside.sum()), "of": inside.size, "not_trusted": poor}
        rows.append({**about, "what": what, **counts, "error": float(np.mean((middle - true) ** 2))})
    return rows


def levels(seed: int, number: int) -> list[Row]:
    """The same of a population over levels: of the intervals of its centre, both spreads and of the levels; `width`
    is their mean.
    """
    root = np.random.SeedSequence(seed, spawn_key=(number, LEVELS))
    rng = np.random.default_rng(root.spawn(1)[0])
    truth, within = draw_truth(rng), draw_truth(rng).spread
    places = {name: truth.centre[name] + truth.spread[name] * rng.standard_normal(LEVELS) for name in QUANTITIES}
    own = [Truth({name: float(places[name][k]) for name in QUANTITIES}, within) for k in range(LEVELS)]
    _values, draws = fitted([one for one in own for _ in range(EACH)], rng, root)
    rows = []
    for priors in PRIORS:
        for name in QUANTITIES:
            tables = table_draws(name, draws[name], priors)
            found = population_over({str(j): tables[j * EACH : (j + 1) * EACH] for j in range(LEVELS)}, before(name))
            assert found.within is not None
            for what, known, true in (
                ("centre of levels", [found.centre], np.array([truth.centre[name]])),
                ("spread between levels", [found.spread], np.array([truth.spread[name]])),
                ("spread within levels", [found.within], np.array([within[name]])),
                ("levels", [level.known for level in found.levels], places[name]),
            ):
                rows.append({"quantity": name, "priors": priors, "what": what, **_held(known, true)})
    return rows


def _held(known: Sequence[Known], truth: FloatArray) -> Row:
    low, high = np.array([[one.low, one.high] for one in known]).T
    inside = (low <= truth) & (truth <= high)
    return {"holds": int(inside.sum()), "of": inside.size, "width": float(np.mean(high - low))}


def joint(seed: int, number: int) -> list[Row]:
    """Ten tables both ways: the distance of the medians of centre and spread, in sds of the joint fit, and the ratio
    of the widths of the intervals.
    """
    root = np.random.SeedSequence(seed, spawn_key=(number, JOINT_TABLES))
    rng = np.random.default_rng(root)
    truth, choices = draw_truth(rng), Choices(model=MODEL, fix=KNOWN, velocity_noise="tied")
    tables = [replace(draw_table(truth, JOINT_ROWS, rng, KNOWN)[0], name=f"t{k}") for k in range(JOINT_TABLES)]
    alone = [
        kept_columns(short_posterior(pose(table, choices, as_read=True), own))
        for table, own in zip(tables, root.spawn(JOINT_TABLES), strict=True)
    ]
    pooled = replace(choices, pool=dict.fromkeys(QUANTITIES, "table"))
    together = short_posterior(pose(tables, pooled, as_read=True), root, JOINT)
    drawn = dict(zip(together.names, together.draws.T, strict=True))
    rows: list[Row] = []
    for name in QUANTITIES:
        asked = quantity(name)
        priors = {name: default_prior(asked.parts[0])}
        draws = [
            TableDraws.drawn(str(k), asked.coordinates(own), asked.log_prior(priors)) for k, own in enumerate(alone)
        ]
        found = population(draws, asked.before(asked.ends(priors)))
        for what, known, both in (
            ("centre", found.centre, asked.coordinates(drawn)), ("spread", found.spread, drawn[f"{name}_spread"])
        ):  # fmt: skip
            low, middle, high = np.quantile(both, (0.025, 0.5, 0.975))
            apart = float((known.median - middle) / ((high - low) / (2.0 * REACH)))
            width = float((known.high - known.low) / (high - low))
            rows.append({"set": number, "quantity": name, "what": what, "apart": apart, "width": width})
    return rows


def studies() -> tuple[Study, Study, Study]:
    """Populations, populations on levels, and joint fits."""
    settings = {
        "model": MODEL, "priors": {**INTERIM, **OTHERS}, "populations": dict(POPULATIONS), "rows": ROWS,
        "draws": DRAWS, **CHAIN,
    }  # fmt: skip
    both = {"tables": JOINT_TABLES, "rows": JOINT_ROWS, "known": dict(KNOWN), "joint": asdict(JOINT)}
    return (
        Study("populations", populations, {**settings, "tables": TABLES}, "populations", "populations"),
        Study("levels", levels, {**settings, "levels": LEVELS, "each": EACH}, "levels", "populations on levels"),
        Study("joint", joint, {**settings, **both}, "joint fits", "sets of ten tables"),
    )


def coverages(rows: Sequence[Row]) -> list[dict[str, object]]:
    """How many intervals contain the truth, of how many, with a 95 % interval of the rate, for each quantity and
    treatment of the priors.
    """
    counts: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        counts.setdefault((row["quantity"], row["what"], row["priors"]), []).append(row)
    found: list[dict[str, object]] = []
    for (name, what, priors), some in counts.items():
        rate = Rate(sum(row["holds"] for row in some), sum(row["of"] for row in some))
        numbers = {"holds": rate.count, "of": rate.total, "share": rate.value, "low": rate.low, "high": rate.high}
        found.append({"quantity": name, "what": what, "priors": priors, **numbers})
    return found


def judge(records: Mapping[str, Sequence[Sequence[Row]]], seed: int) -> Verdict:
    """Do intervals of centre, spreads and levels have their coverage, does the control fail, and do joint fits agree?
    `records` are those of each replicate by the study's name.
    """
    rows = {name: [row for one in some for row in one] for name, some in records.items()}
    found = [*coverages(rows["populations"]), *coverages(rows["levels"])]
    good: dict[str, list[bool]] = {priors: [] for priors in PRIORS}
    for one in found:
        if not str(one["what"]).startswith("tables"):
            good[str(one["priors"])].append(float(str(one["low"])) <= LEVEL <= float(str(one["high"])))
    typical = float(np.median([abs(row["apart"]) for row in rows["joint"]]))
    tables = [row for row in rows["populations"] if row["priors"] == PRIORS[0] and row["what"].startswith("tables")]
    content = {
        "seed": seed,
        "populations": len(records["populations"]),
        "tables": sum(row["of"] for row in tables if row["what"] == "tables alone") // len(QUANTITIES),
        "on_levels": len(records["levels"]),
        "coverages": found,
        "error_given_all": {name: _error(tables, name) for name in QUANTITIES},
        "not_trusted": {name: sum(row["not_trusted"] for row in tables if row["quantity"] == name)
                        for name in QUANTITIES},
        "joint": rows["joint"],
        "typically_apart": typical,
        "holds": all(good[PRIORS[0]]) and not all(good[PRIORS[1]]) and typical <= APART,
    }  # fmt: skip
    return Verdict(content, {"joint": rows["joint"], "coverage": found}, _text(found))


def _error(tables: Sequence[Row], name: str) -> float:
    """Root mean square error of tables given all over that of tables alone."""
    alone, given = (
        sum(row["error"] for row in tables if row["quantity"] == name and row["what"] == what)
        for what in ("tables alone", "tables given all")
    )
    return float(np.sqrt(given / alone))


def _text(found: Sequence[Mapping[str, object]]) -> str:
    shown = [["quantity", "interval of", "priors", "contain the truth", "95 %"]]
    for one in found:
        rate = Rate(int(str(one["holds"])), int(str(one["of"])))
        held = f"{rate.count:,} of {rate.total:,} ({100.0 * rate.count / rate.total:.0f} %)"
        ends = f"[{100.0 * rate.low:.0f}, {100.0 * rate.high:.0f}]"
        shown.append([str(one["quantity"]), str(one["what"]), str(one["priors"]), held, ends])
    return "\n".join(columns(shown, 3)) + "\n"
