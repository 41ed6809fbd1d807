"""Write the numbers and tables of README.md and docs/ between their marks, from the code and from what `fits/` keeps.

`python scripts/readme.py` renders; with `--measure` it first fits Wang's tables, compares the models and re-derives
the thesis (some minutes), and keeps the figures in `fits/readme/`. Speed comes from `fitball bench`, coverage from
`scripts/validate`; both keep what they found in `fits/`.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

import pandas as pd

from fitball.inference.problem.parameters import FORCE_NOISE, NOISE_SPECS
from fitball.inference.results.results import Verdict, verdict_words
from fitball.models.specs import SPECS
from fitball.report.form.display_units import handy
from fitball.report.form.rounding import decimals, digits, fixed
from fitball.studies.bench.precision import FASTEST
from fitball.studies.thesis.appendix_d import CASE_IN_APPENDIX_C
from fitball.version import __version__

ROOT = Path(__file__).resolve().parent.parent
MARKED = re.compile(
    r"<!-- (?P<name>[\w-]+): written by scripts/readme.py -->\n(?P<old>.*?)<!-- end of (?P=name) -->", re.DOTALL
)
KEPT = ROOT / "fits" / "readme"
NUMBERS = KEPT / "numbers.json"
PICTURE = "curves.png"
LADDER = ("thesis-exact", "two-mass", "grip-slip", "brody")
PUBLISHED = "Table 9, case 1"
TOLD_OF_THESIS = (
    *(
        "Appendix C",
        "Table 9",
        "Ranking",
        "Posterior of thesis",
        "Posterior of thesis-exact",
        "Posterior of two-mass",
    ),
    *("Slips", "Damping c_y"),
)
FITS = ("all", "zero", "drop", "bare")
# Errors at which the closed form is compared with what is fastest there, and how one would integrate carelessly.
ERRORS = (1e-3, 1e-6, 1e-9, 1e-12)
CARELESS = (
    ("RK4 compiled, events between steps", "400 steps"),
    ("solve_ivp RK45", "rtol 0.001"),
    ("solve_ivp DOP853", "rtol 1e-09"),
    ("solve_ivp DOP853, short steps", "rtol 1e-09"),
)
# Without a contact time it would be held.
FREE_K_Y = "k_y=lognormal(2.0e4, 1.0)"


def _fitball(folder: Path, *words: str) -> str:
    """Output of a command, run in `folder`."""
    command = [sys.executable, "-m", "fitball", *words, "--quiet"]
    return subprocess.run(command, cwd=folder, check=True, stdout=subprocess.PIPE, text=True).stdout


def measure() -> None:
    """Fit, compare, re-derive; keep the numbers that the pages quote, and the picture of README.md."""
    KEPT.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        _fitball(folder, "calibrate", "wang_all.csv", "--out", "all")
        _fitball(folder, "calibrate", "wang_zero_spin.csv", "--out", "zero")
        _fitball(folder, "calibrate", "synthetic_drop.csv", "--out", "drop")
        _fitball(folder, "calibrate", "synthetic_drop.csv", "--force", "none", "--prior", FREE_K_Y, "--out", "bare")
        compared = json.loads(_fitball(folder, "compare", "wang_all.csv", "--json", "--out", "compared"))
        derived = json.loads(_fitball(folder, "rederive", "--json", "--out", "derived"))
        fits = {name: json.loads((folder / name / "fit.json").read_text(encoding="utf-8")) for name in FITS}
        shutil.copyfile(folder / "all" / PICTURE, KEPT / PICTURE)
    found = {
        "version": __version__,
        "parameters": {
            name: _parameter(item) | _over(fits["all"]["assumptions"]["parameters"].get(name))
            for name, item in fits["all"]["parameters"].items()
        },
        "known_together": fits["zero"]["identifiability"]["eigendirections"]["sentences"],
        "compared": [_score(item) for item in compared["models"] if item["name"] in LADDER],
        "duel": _duel(compared, "two-mass", "grip-slip"),
        "stiffness": {name: _parameter(fits[name]["parameters"]["k_y"]) for name in ("drop", "bare")},
        "published": {item["name"]: item["rms"] for item in compared["published"]},
        "rankings": derived["rankings"],
        "thesis": {item["name"]: item["finding"] for item in derived["checks"]} | derived["verdicts"],
    }
    NUMBERS.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")


def _parameter(item: dict[str, Any]) -> dict[str, Any]:
    kept = ("unit", "median", "sd", "q16", "q84")
    return {key: item[key] for key in kept} | {"verdict": verdict_words(Verdict(item["verdict"]), item["given"])}


def _over(span: dict[str, Any] | None) -> dict[str, Any]:
    """Lowest and highest median over assumptions that the table cannot tell apart; None of a parameter without."""
    return {"over": None if span is None else [span["low"], span["high"]]}


def _score(item: dict[str, Any]) -> dict[str, Any]:
    return {
        "name": item["name"],
        "free": item["free_parameters"],
        "elpd": item["elpd_difference"]["value"],
        "se": item["elpd_difference"]["se"],
        "rms": item["left_out"][0]["rms"],
    }


def _duel(compared: dict[str, Any], first: str, second: str) -> dict[str, float]:
    """Difference in log predictive density over the impacts, with its standard error."""
    by_name = {item["name"]: item["elpd_by_impact"] for item in compared["models"]}
    gaps = [by_name[first][key] - by_name[second][key] for key in by_name[first]]
    mean = sum(gaps) / len(gaps)
    spread = math.sqrt(sum((gap - mean) ** 2 for gap in gaps) / (len(gaps) - 1))
    return {"value": sum(gaps), "se": math.sqrt(len(gaps)) * spread}


def _priors() -> str:
    rows = ["| parameter | unit | bounds | default prior | meaning |", "|---|---|---|---|---|"]
    rows += [
        f"| `{spec.name}` | {spec.unit or '-'} | {spec.lower:g} to {spec.upper:g} | `{spec.prior}` | {spec.meaning} |"
        for spec in (*SPECS.values(), *NOISE_SPECS.values())
        # Those of force records are scaled to the records; the section on these tells them.
        if spec.name not in FORCE_NOISE
    ]
    return "\n".join(rows)


def _wang(numbers: dict[str, Any]) -> str:
    rows = ["| parameter of `two-mass` | median ± sd | over assumptions | unit | verdict |", "|---|---|---|---|---|"]
    for name, item in numbers["parameters"].items():
        scale = handy(name, item["unit"])
        median, sd = item["median"] * scale.factor, item["sd"] * scale.factor
        places = decimals(sd)
        ends = [fixed(end * scale.factor, places) for end in item["over"] or ()]
        rows.append(
            f"| `{name}` | {fixed(median, places)} ± {fixed(sd, places)} | {' to '.join(ends) or '-'} | "
            f"{scale.unit or '-'} | {item['verdict']} |"
        )
    return "\n".join(rows)


def _wang_short(numbers: dict[str, Any]) -> str:
    """The parameters of the bounce alone."""
    rows = ["| parameter of `two-mass` | median ± sd | unit | verdict |", "|---|---|---|---|"]
    for name, item in numbers["parameters"].items():
        if name not in SPECS:
            continue
        scale = handy(name, item["unit"])
        sd = item["sd"] * scale.factor
        places = decimals(sd)
        value = f"{fixed(item['median'] * scale.factor, places)} ± {fixed(sd, places)}"
        rows.append(f"| `{name}`, {SPECS[name].meaning} | {value} | {scale.unit or '-'} | {item['verdict']} |")
    return "\n".join(rows)


def _compared(numbers: dict[str, Any]) -> str:
    rows = [
        "| model | free parameters | misses left-out `v_x2` by [m/s] | `v_y2` [m/s] | `omega_2` [rad/s] | "
        "log predictive density below the best |",
        "|---|---|---|---|---|---|",
    ]
    for item in numbers["compared"]:
        rms = item["rms"]
        below = "-" if item["name"] == numbers["compared"][0]["name"] else f"{-item['elpd']:.1f} ± {item['se']:.1f}"
        rows.append(
            f"| `{item['name']}` | {item['free']} | {rms['v_x2']:.2f} | {rms['v_y2']:.2f} | {rms['omega_2']:.1f} | "
            f"{below} |"
        )
    rms = numbers["published"][PUBLISHED]
    rows.append(
        f"| thesis, {PUBLISHED} (tuned on these rows) | - | {rms['v_x2']:.2f} | {rms['v_y2']:.2f} | "
        f"{rms['omega_2']:.1f} | |"
    )
    duel = numbers["duel"]
    decided = "decides it" if abs(duel["value"]) > max(4.0, 2.0 * duel["se"]) else "does not decide it"
    rows += [
        "",
        f"Do two masses earn their parameters? `two-mass` against `grip-slip`: {duel['value']:+.1f} ± "
        f"{duel['se']:.1f} in log predictive density; this table {decided}.",
    ]
    return "\n".join(rows)


def _together(numbers: dict[str, Any]) -> str:
    return "Of `wang_zero_spin.csv` the report says: " + "; ".join(numbers["known_together"]) + "."


def _stiffness(numbers: dict[str, Any]) -> str:
    def words(name: str) -> str:
        item = numbers["stiffness"][name]
        low, median, high = (item[key] / 1e3 for key in ("q16", "median", "q84"))
        places = decimals(0.5 * (high - low))
        return f"{fixed(median, places)} [{fixed(low, places)}, {fixed(high, places)}] kN/m, {item['verdict']}"

    return (
        "`fitball calibrate synthetic_drop.csv`, five simulated drops with records that miss the model by 4 % of "
        f"their peak, true `k_y` 26 kN/m: {words('drop')} (68 %); without the records: {words('bare')}."
    )


def _validation() -> str:
    frame = pd.read_csv(ROOT / "fits" / "validation" / "summary.csv")
    names = " and ".join(f"`{name}`" for name in dict.fromkeys(frame["model"]))
    low, high = 100.0 * frame["within_95"].min(), 100.0 * frame["within_95"].max()
    verdict = "hold" if (frame["holds"] == "yes").all() else "do not hold"
    return (
        f"Over {frame['replicates'].min()} simulated tables each, {names} {verdict}: quantity by quantity the 95 % "
        f"intervals have the truth in {low:.0f} to {high:.0f} % of the tables."
    )


def _trust() -> str:
    """Rates of the study of trust, a row a kind of table."""
    rows = [
        "| tables | objected to | intervals of identified parameters hold | pinned, called prior-dominated |",
        "|---|---|---|---|",
    ]
    for _, row in pd.read_csv(ROOT / "fits" / "validation" / "trust" / "rates.csv").iterrows():
        name = row["scenario"]
        made = "" if row["made_by_the_model"] == "yes" or name.startswith("all") else "not made by it: "
        cells = [_rate(row, what) for what in ("objected", "identified_holds", "pinned_called_prior_dominated")]
        rows.append(f"| {made}{name} | {' | '.join(cells)} |")
    return "\n".join(rows)


def _plan() -> str:
    """What plans promised and refits found, a row a plan."""
    folder = ROOT / "fits" / "validation" / "plan"
    gains, sds = pd.read_csv(folder / "gains.csv"), pd.read_csv(folder / "sds.csv")
    words = json.loads((folder / "plan.json").read_text(encoding="utf-8"))["cases"]
    rows = [
        "| plan | promised | nested Monte Carlo | found by refits | as many of the table | sds over promised |",
        "|---|---|---|---|---|---|",
    ]
    for name, both in gains.groupby("case", sort=False):
        plan, table = (both[both["design"] == design].iloc[0] for design in ("planned", "table again"))
        off = 100.0 * (1.0 + sds[(sds["case"] == name) & (sds["design"] == "planned")]["off"])
        rows.append(
            f"| {words[name]['words']} | {plan['promised [nats]']:.2f} "
            f"| {plan['nested [nats]']:.2f} ± {plan['nested se']:.2f} "
            f"| {plan['found [nats]']:.2f} ± {plan['se']:.2f} | "
            f"{table['found [nats]']:.2f} ± {table['se']:.2f} | {off.min():.0f} to {off.max():.0f} % |"
        )
    return "\n".join(rows)


def _population() -> str:
    """What the study of populations counted, and how joint fits of ten tables compare."""
    folder = ROOT / "fits" / "validation" / "population"
    found = json.loads((folder / "population.json").read_text(encoding="utf-8"))
    rows = ["| interval of | priors divided out | priors left in (control) |", "|---|---|---|"]
    frame = pd.read_csv(folder / "coverage.csv")
    for (name, what), pair in frame.groupby(["quantity", "what"], sort=False):
        by = {row["priors"]: row for _, row in pair.iterrows()}
        cells = [
            f"{100.0 * row['share']:.0f} % [{100.0 * row['low']:.0f}, {100.0 * row['high']:.0f}] of {row['of']:,}"
            for row in (by["divided out"], by["left in"])
        ]
        rows.append(f"| `{name}`, {what} | {' | '.join(cells)} |")
    less = " and ".join(
        f"{100.0 * (1.0 - share):.0f} % (`{name}`)" for name, share in found["error_given_all"].items()
    )
    apart = [abs(row["apart"]) for row in found["joint"]]
    widths = sorted(row["width"] for row in found["joint"])
    return "\n".join(
        [
            *rows,
            "",
            f"({found['populations']} populations of {found['tables']:,} tables, each fitted by itself: how many "
            f"95 % intervals hold the truth.) Given all, tables err less than alone, root mean square, by {less}. "
            f"{sum(found['not_trusted'].values())} of {found['tables'] * len(found['not_trusted']):,} weights are "
            f"not to be trusted. On {len(apart) // 4} sets of ten tables of 20 rows the joint fit (`--pool`) has its "
            f"median of centre and spread {median(apart):.2f} sds away (at most {max(apart):.2f}), and intervals "
            f"by weights are {widths[0]:.2f} to {widths[-1]:.2f} times as wide as its.",
        ]
    )


def _rate(row: Any, what: str) -> str:
    """A share in per cent with the ends of its 95 % interval, and of how many."""
    if not row[f"{what}_of"]:
        return "-"
    share, low, high = (round(100.0 * row[f"{what}{end}"]) for end in ("", "_low", "_high"))
    return f"{share} % [{low}, {high}] of {row[f'{what}_of']}"


def _benched(name: str) -> pd.DataFrame:
    """A table of the last full `fitball bench`."""
    return pd.read_csv(ROOT / "fits" / "bench" / f"{name}.csv")


def _bounce() -> tuple[pd.Series, pd.DataFrame]:
    """The closed form and its rivals on Wang's impacts."""
    precision = _benched("precision")
    wang = precision[precision["scene"] == "Wang's 21"]
    return wang[wang["solver"] == FASTEST].iloc[0], wang[~wang["solver"].str.startswith("closed form")]


def _strongest(rivals: pd.DataFrame, error: float) -> pd.Series:
    """Of all rivals at all settings the fastest whose largest error is at most this."""
    good = rivals[rivals["largest error"] <= error]
    return good.loc[good["microseconds"].idxmin()]


def _speed_line() -> str:
    closed, rivals = _bounce()
    finer, coarser = (_strongest(rivals, error) for error in (ERRORS[-1], ERRORS[0]))
    times = [digits(rival["microseconds"] / closed["microseconds"], 2) for rival in (finer, coarser)]
    return (
        f"A bounce in closed form takes {digits(closed['microseconds'], 2)} microseconds of one core and is off by "
        f"{closed['largest error']:.1e} of the incident speed at most. The fastest integrators that we could "
        f"write against it, compiled and with events located, take {times[0]} times as long for errors below "
        f"{ERRORS[-1]:.0e}, and {times[1]} times for {ERRORS[0]:.0e}."
    )


def _speed() -> str:
    closed, rivals = _bounce()
    rows = ["| error at most | fastest | microseconds an impact | times the closed form |", "|---|---|---|---|"]
    rows.append(f"| {closed['largest error']:.1e} | closed form | {digits(closed['microseconds'], 2)} | 1 |")
    named = [(f"{error:.0e}", _strongest(rivals, error)) for error in ERRORS[::-1]]
    for solver, setting in CARELESS:
        row = rivals[(rivals["solver"] == solver) & (rivals["setting"] == setting)].iloc[0]
        named.append((f"{row['largest error']:.1e}", row))
    for error, row in named:
        times = digits(row["microseconds"] / closed["microseconds"], 2)
        rows.append(f"| {error} | {row['solver']}, {row['setting']} | {digits(row['microseconds'], 2)} | {times} |")
    growth = _benched("growth")
    longest = growth[growth["rows"] == growth["rows"].max()].iloc[0]
    rows += [
        "",
        f"A log posterior of {longest['rows']:.0f} impacts takes "
        f"{digits(longest['milliseconds a log posterior'], 2)} ms, the best fit of them "
        f"{digits(longest['point fit [s]'], 2)} s of CPU and {digits(longest['most memory [MB]'], 2)} MB. All of "
        "`fitball calibrate` on tables that grip-slip made, from the CSV file to the result folder:",
        "",
        "| rows | CPU seconds | microseconds a row | most memory [MB] | report.html [kB] | fit.json [kB] |",
        "|---|---|---|---|---|---|",
    ]
    for row in _benched("whole").to_dict("records"):
        shown = [f"{row['rows']:,.0f}", *(digits(value, 3) for name, value in row.items() if name != "rows")]
        rows.append(f"| {' | '.join(shown)} |")
    return "\n".join(rows)


def _densities() -> str:
    rows = ["| table | log posterior | microseconds | largest error |", "|---|---|---|---|"]
    for _, row in _benched("densities").iterrows():
        rows.append(
            f"| {row['table']} | {row['log posterior']} | {digits(row['microseconds'], 2)} | "
            f"{row['largest error']:.1e} |"
        )
    return "\n".join(rows)


def _tables() -> str:
    """Many tables: time of a table, memory, and how these change as a batch goes on."""
    frame = _benched("tables")
    rows = [f"| {' | '.join(frame.columns)} |", "|" + "---|" * len(frame.columns)]
    for row in frame.itertuples(index=False):
        cores, size, tables, wall, each, parent, worker = row
        worked = "-" if math.isnan(worker) else f"{worker:.0f}"
        rows.append(f"| {cores} | {size} | {tables} | {wall:.0f} | {each:.2f} | {parent:.0f} | {worked} |")
    return "\n".join(rows)


def _samplers() -> str:
    """Draws a second by sampler and table; densities a draw over the tables."""
    frame = _benched("samplers")
    tables = list(dict.fromkeys(frame["table"]))
    rows = [f"| sampler | {' | '.join(tables)} | densities a draw |", "|---|" + "---|" * (len(tables) + 1)]
    for sampler, mine in frame.groupby("sampler", sort=False):
        found = mine.set_index("table").reindex(tables)
        cells = ["-" if math.isnan(value) else digits(value, 2) for value in found["draws a CPU second"]]
        version = "" if sampler == "fitball" else f" ({found['version'].dropna().iloc[0]})"
        asked = found["densities a draw"].dropna()
        span = f"{digits(asked.min(), 2)} to {digits(asked.max(), 2)}" if len(asked) else "-"
        rows.append(f"| {sampler}{version} | {' | '.join(cells)} | {span} |")
    return "\n".join(rows)


def _thesis(numbers: dict[str, Any]) -> str:
    found, rankings = numbers["thesis"], numbers["rankings"]
    names = [key.partition(":")[0] for key in rankings[0] if key.endswith(": score")]
    cases = ", ".join(f"case {case} of Table 9 is set {index}" for case, index in CASE_IN_APPENDIX_C.items())
    rows = [
        "",
        "Root mean square score of each set of Appendix C, and how often it is first when impacts are drawn anew: by "
        "its printed outputs, with known misprints mended, recomputed as the thesis did, and with its equations "
        f"solved exactly; {cases}:",
        "",
        f"| set | {' | '.join(names)} |",
        "|---|" + "---|" * len(names),
    ]
    for item in rankings:
        cells = [f"{item[f'{name}: score']:.2f} ({100.0 * item[f'{name}: first']:.1f} %)" for name in names]
        rows.append(f"| {item['set']} | {' | '.join(cells)} |")
    return "\n".join([*(f"- **{name}**: {found[name]}" for name in TOLD_OF_THESIS), *rows])


def blocks() -> dict[str, str]:
    """Every block by the name in its marks."""
    numbers = json.loads(NUMBERS.read_text(encoding="utf-8"))
    return {
        "wang": _wang(numbers),
        "wang-short": _wang_short(numbers),
        "compared": _compared(numbers),
        "together": _together(numbers),
        "stiffness": _stiffness(numbers),
        "validation": _validation(),
        "trust": _trust(),
        "plan": _plan(),
        "population": _population(),
        "speed": _speed(),
        "speed-line": _speed_line(),
        "densities": _densities(),
        "samplers": _samplers(),
        "tables": _tables(),
        "thesis": _thesis(numbers),
        "priors": _priors(),
    }


def pages() -> list[Path]:
    """Every file that may hold blocks."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def updated(text: str, content: dict[str, str]) -> str:
    """A page with every block between its marks. Raises KeyError of a block that nobody writes."""
    return MARKED.sub(
        lambda found: (
            f"<!-- {found['name']}: written by scripts/readme.py -->\n{content[found['name']]}\n"
            f"<!-- end of {found['name']} -->"
        ),
        text,
    )


def main() -> None:
    """Measure, if asked to, and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--measure", action="store_true", help="measure again first")
    if parser.parse_args().measure:
        measure()
    content = blocks()
    for page in pages():
        page.write_text(updated(page.read_text(encoding="utf-8"), content), encoding="utf-8")


if __name__ == "__main__":
    main()
