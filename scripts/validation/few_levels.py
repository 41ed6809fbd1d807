"""Do 95 % intervals hold, and stay narrow, where few levels were measured? Labs with two to six balls or places, and
tables of two surfaces, against the truth.

*Labs*: three drops of each ball, or five impacts at each place. How far these lie apart is drawn from a range that
owes nothing to the prior of the spread. Counted are the intervals of the mean, of each label and of a new one; widths
are compared with those of Student's t on the means of the labels. In the control the prior of the spread is ten times
too narrow. *Surfaces*: 10 to 30 impacts on each of two, with equal or different friction and restitution, fitted with
`mu` and `cor_10` pooled, by a short chain. In the control both surfaces have one value. Controls must not hold.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from scipy.stats import binom, t

from fitball.api.calibrating import pose
from fitball.data.labels import Role
from fitball.inference.prediction.drop_test import one_way, spread_of_balls
from fitball.inference.problem.parameters import Prior, parse_prior
from fitball.inference.problem.problem import Choices, Problem
from fitball.inference.problem.spreads import published_spread
from fitball.inference.sampling.ensembles import ENSEMBLES, Schedule, Settings, default_walkers, sample
from fitball.models.registry import model
from fitball.observables import SI_UNITS
from fitball.report.form.document import columns
from fitball.values import FloatArray, Impacts
from validation.harness import CHAIN, LEVEL, MAX_STEPS, Rate, Row, Study, Verdict, drawn_values, rate

LABELS = (2, 3, 4, 6)
# Of the restitution of balls, and of the rating of places: centre, range of the sd between labels, sd of one repeat,
# repeats. Balls of 254 cm differ by 0.5 to 4 cm and repeat by 0.5 cm; places differ by 0.5 to 5 points.
LABS: Mapping[str, tuple[float, tuple[float, float], float, int]] = {
    "balls": (0.745, (0.0013, 0.0106), 0.0013, 3), "places": (37.0, (0.5, 5.0), 1.0, 5)
}  # fmt: skip
OF_LABS = ("mean", "new one", "each")
WIDEST = 1.5
# By so much a control's prior is too narrow.
NARROW = 0.1
STATED, CONTROL = "stated", "control"
MODEL, POOL = "grip-slip", {"mu": "surface", "cor_10": "surface"}
NAMES = ("clay", "hard")
SURFACE, EQUAL, DIFFERENT = "surface", "equal ones' difference", "different ones' difference"
TRUE: Mapping[str, float] = {"e_x": 0.1, "offset": 2e-3, "cor_slope": -0.012}
NOISE: Mapping[str, float] = {"velocity_sd": 0.2, "spin_sd": 8.0}
FRICTION, RESTITUTION, ROWS = (0.5, 0.8), (0.70, 0.82), (10, 30)
# Frictions that differ by so much are called different.
APART = 0.1
SHORT = Schedule(warm_up=120, first_check=200, target_ess=200.0, target_r_hat=1.05)
# Of so many tables one is fitted with one value for both surfaces, too.
EVERY = 6


def spread_of(kind: str) -> Prior:
    """The prior of the spread between the labels of a lab by default."""
    if kind == "balls":
        return spread_of_balls(True)
    known = published_spread("rating", Role.PLACE)
    assert known is not None
    return known.prior


def labs(seed: int, number: int) -> list[Row]:
    """The intervals of one lab with balls and one with places, under both priors: `inside`, and the `width` over that
    of Student's t (of one label that of the means too).
    """
    count, rows = LABELS[number % len(LABELS)], []
    for kind, (centre, (least, most), noise, each) in LABS.items():
        rng = np.random.default_rng([seed, number, each])
        true = centre + rng.uniform(least, most) * rng.standard_normal(count + 1)
        index = np.repeat(np.arange(count), each)
        values = true[index] + noise * rng.standard_normal(index.size)
        means = values.reshape(count, each).mean(axis=1)
        student = 2.0 * t.ppf(0.5 + LEVEL / 2.0, count - 1) * means.std(ddof=1)
        stated = spread_of(kind)
        # Normal: the tails of Student's t would forgive it.
        narrow = parse_prior("spread", f"half-normal({NARROW * stated.b:.6g})", 0.0, np.inf)
        for name, prior in ((STATED, stated), (CONTROL, narrow)):
            found = one_way(values, np.ones((index.size, 1)), index, prior, rng)
            assert not isinstance(found, str)
            mean = found.coefficients[:, 0]
            new = mean + found.between * rng.standard_normal(mean.size)
            for what, draws, truth, wide in (
                (OF_LABS[0], mean, centre, student / np.sqrt(count)),
                (OF_LABS[1], new, true[count], student * np.sqrt(1.0 + 1.0 / count)),
                (OF_LABS[2], found.levels[:, 0], true[0], student / np.sqrt(count)),
            ):
                low, high = np.quantile(draws, (0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0))
                about = {"of": kind, "labels": count, "fit": name, "what": what}
                rows.append({**about, "inside": bool(low <= truth <= high), "width": float((high - low) / wide)})
    return rows


def draw_sheet(equal: bool, rng: np.random.Generator) -> tuple[Mapping[str, list[float] | list[str]], FloatArray]:
    """A table of two surfaces, and the true friction and restitution (surfaces, 2) on them."""
    true = np.stack([rng.uniform(*FRICTION, 2), rng.uniform(*RESTITUTION, 2)], axis=1)
    if equal:
        true[1] = true[0]
    sheet: dict[str, list[float] | list[str]] = {"surface": []}
    made: dict[str, list[FloatArray]] = {}
    for name, (mu, cor) in zip(NAMES, true, strict=True):
        rows = int(rng.integers(ROWS[0], ROWS[1] + 1))
        speed, angle = rng.uniform(14.0, 25.0, rows), np.radians(rng.uniform(12.0, 40.0, rows))
        impacts = Impacts(speed * np.cos(angle), speed * np.sin(angle), rng.uniform(-150.0, 150.0, rows))
        rebound = model(MODEL).rebound({**TRUE, "mu": float(mu), "cor_10": float(cor)}, impacts)
        here = {"v_x1": impacts.v_x1, "v_y1": impacts.v_y1, "omega_1": impacts.omega_1}
        for column in ("v_x2", "v_y2", "omega_2"):
            sd = NOISE["spin_sd" if column == "omega_2" else "velocity_sd"]
            here[column] = getattr(rebound, column) + sd * rng.standard_normal(rows)
        for column, values in here.items():
            made.setdefault(f"{column} [{SI_UNITS[column]}]", []).append(values)
        sheet["surface"] = [*sheet["surface"], *[name] * rows]
    return {**{head: np.concatenate(parts).tolist() for head, parts in made.items()}, **sheet}, true


def surfaces(seed: int, number: int) -> list[Row]:
    """The intervals of `mu` and `cor_10` of each surface of one table, and of their differences; surfaces are equal
    in every second table.
    """
    equal = number % 2 == 0
    rng = np.random.default_rng([seed, number])
    sheet, true = draw_sheet(equal, rng)
    rows: list[Row] = []
    for fit in (STATED, CONTROL) if number // 2 % EVERY == 0 else (STATED,):
        pool = {"all": "none", **(POOL if fit == STATED else {})}
        problem = pose(sheet, Choices(model=MODEL, pool=pool, velocity_noise="tied"), as_read=True)
        drawn = problem.all_values(_draws(problem, true, int(rng.integers(2**31))))
        own = {item.parameter: item for item in problem.pooling}
        for k, name in enumerate(POOL):
            levels = [own[name].value(drawn, label) if own else drawn[name] for label in NAMES]
            asked = [(SURFACE, levels[j], true[j, k]) for j in range(2)]
            if own:
                asked.append((EQUAL if equal else DIFFERENT, levels[1] - levels[0], true[1, k] - true[0, k]))
            for what, draws, truth in asked:
                low, high = np.quantile(draws, (0.5 - LEVEL / 2.0, 0.5 + LEVEL / 2.0))
                about = {"of": name, "fit": fit, "what": what, "truth": float(truth)}
                found = {"inside": bool(low <= truth <= high), "zero": bool(low <= 0.0 <= high)}
                rows.append({**about, **found, "width": float(high - low)})
    return rows


def _draws(problem: Problem, true: FloatArray, seed: int) -> FloatArray:
    """Draws (draws, free) by a short chain that is begun at the truth (surfaces, 2)."""
    begun = {**TRUE, **NOISE, **dict(zip(POOL, true.mean(axis=0).tolist(), strict=True))}
    for k, pooling in enumerate(problem.pooling):
        levels = np.log(true[:, k]) if pooling.log else true[:, k]
        middle, size = float(levels.mean()), max(0.02, float(np.ptp(levels)) / 2.0)
        begun |= {pooling.parameter: float(np.exp(middle)) if pooling.log else middle, pooling.spread_name: size}
        places = map(pooling.place_name, pooling.labels)
        begun |= dict(zip(places, ((levels - middle) / size).tolist(), strict=True))
    begun = {parameter.name: begun.get(parameter.name, 0.0) for parameter in problem.parameters}
    settings = Settings(default_walkers(problem.dimension), ENSEMBLES, MAX_STEPS, 1, seed, SHORT)
    start = problem.to_coordinates(problem.free_rows([begun]))
    sampled = sample(problem, start, settings, None, False, lambda _progress: None)
    return drawn_values(problem, sampled).reshape(-1, problem.dimension)


def studies() -> tuple[Study, Study]:
    """Labs, and tables of two surfaces."""
    lab = {"labs": {name: list(map(str, known)) for name, known in LABS.items()}, "labels": LABELS}
    priors = {name: spread_of(name).text for name in LABS}
    sheet = {"model": MODEL, "true": dict(TRUE), "noise": dict(NOISE), "mu": FRICTION, "cor_10": RESTITUTION}
    chain = {**CHAIN, **asdict(SHORT), "rows": ROWS, "control": EVERY}
    spreads = {name: _text(name) for name in POOL}
    return (
        Study("labs", labs, {**lab, "priors": priors}, "labs", "labs"),
        Study("surfaces", surfaces, {**sheet, **chain, "priors": spreads}, "two surfaces", "tables"),
    )


def _text(parameter: str) -> str:
    known = published_spread(parameter, Role.SURFACE)
    assert known is not None
    return known.text


def coverages(rows: Sequence[Row]) -> list[dict[str, object]]:
    """How many intervals contain the truth, of how many, and their median width, by quantity, kind and fit."""
    kept: dict[tuple[str, str, str], list[Row]] = {}
    for row in rows:
        kept.setdefault((row["of"], row["what"], row["fit"]), []).append(row)
    return [
        {"quantity": name, "what": what, "fit": fit, **_numbers(some)} for (name, what, fit), some in kept.items()
    ]


def _numbers(rows: Sequence[Row]) -> dict[str, object]:
    held = rate(row["inside"] for row in rows)
    return {
        "holds": held.count, "of": held.total, "low": held.low, "high": held.high,
        "width": float(np.median([row["width"] for row in rows])),
    }  # fmt: skip


def judge(records: Mapping[str, Sequence[Sequence[Row]]], seed: int) -> Verdict:
    """Do intervals hold in 95 % within binomial limits (all of them together in 95 % of such studies), are those of
    labs at most `WIDEST` times as wide as Student's, are equal surfaces not called different, and do controls fail?
    """
    rows = {name: [row for one in some for row in one] for name, some in records.items()}
    found = [*coverages(rows["labs"]), *coverages(rows["surfaces"])]
    stated = [one for one in found if one["fit"] == STATED]
    limit = (1.0 - LEVEL) / len(stated)
    by_labels = [
        {"quantity": kind, "labels": count, "what": what, **_numbers(some)}
        for kind in LABS
        for count in LABELS
        for what in OF_LABS
        if (some := [row for row in rows["labs"] if _key(row) == (kind, count, what)])
    ]
    controls = [
        min((_chances(one)[0] for one in found if one["fit"] == CONTROL and one["quantity"] == name), default=1.0)
        for name in (*LABS, *POOL)
    ]
    apart = [row for row in rows["surfaces"] if (row["of"], row["what"]) == ("mu", DIFFERENT)]
    apart = [row for row in apart if abs(row["truth"]) >= APART]
    content = {
        "seed": seed,
        "labs": len(records["labs"]),
        "tables": len(records["surfaces"]),
        "coverages": found,
        "by_labels": by_labels,
        "differences": {"apart": APART, "found": sum(not row["zero"] for row in apart), "of": len(apart)},
        # A continuous prior draws equal surfaces together: their intervals may hold more often.
        "holds": all(min(_chances(one)[: 1 if one["what"] == EQUAL else 2]) > limit / 2.0 for one in stated)
        and max(controls) < limit
        and all(float(str(one["width"])) <= WIDEST for one in stated if one["quantity"] in LABS),
    }
    return Verdict(content, {"coverage": found, "by_labels": by_labels}, _words(content))


def _key(row: Row) -> tuple[str, int, str] | None:
    return (row["of"], row["labels"], row["what"]) if row["fit"] == STATED else None


def _chances(one: Mapping[str, object]) -> tuple[float, float]:
    """Chances of so few intervals that hold, and of so many, if each does so in 95 %."""
    count, total = int(str(one["holds"])), int(str(one["of"]))
    return float(binom.cdf(count, total, LEVEL)), float(binom.sf(count - 1, total, LEVEL))


def _words(content: Mapping[str, Any]) -> str:
    def held(one: Mapping[str, Any]) -> str:
        return f"{Rate(one['holds'], one['of'])} of {one['of']}"

    every = [["of", "interval of", "fit", "contain the truth (95 %)", "median width"]]
    every += [
        [one["quantity"], one["what"], one["fit"], held(one), f"{one['width']:.3g}"] for one in content["coverages"]
    ]
    each = [["of", "labels", "interval of", "contain the truth (95 %)", "median width"]]
    each += [
        [one["quantity"], str(one["labels"]), one["what"], held(one), f"{one['width']:.2f}"]
        for one in content["by_labels"]
    ]
    told = content["differences"]
    last = f"Differences of mu of at least {told['apart']:g}: found in {told['found']} of {told['of']} tables."
    head = "Widths of balls and places are multiples of Student's t on the means of the labels.\n"
    return "\n".join([head, *columns(every, 3), "", *columns(each, 3), "", last]) + "\n"
