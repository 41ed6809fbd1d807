"""Its page and figures."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from fitball.base.columns import COLUMNS
from fitball.base.display_units import PLAIN
from fitball.base.findings import Findings
from fitball.base.numbers import fixed, percent
from fitball.base.text import listed
from fitball.base.values import DataFrame, Figure
from fitball.data.bundled import printed
from fitball.models.specs import SPECS
from fitball.report.blocks import Block, Mark, Picture, Report, Section, Table, Text
from fitball.report.page import Page
from fitball.report.quantities import chance, records
from fitball.report.style import MARKERS, MEASURED, SERIES, few_ticks, legend_above, new_figure
from fitball.thesis.appendices import MEAN_COR, OUTPUTS, SCALES, headed
from fitball.thesis.posteriors import slope_of
from fitball.thesis.printed import C1, C2
from fitball.thesis.ranking import OWN, SAMPLES

# Share of bootstrap samples from which on a place is sure, its complement rules it out; relative
# difference of scores that counts as none; the region of a posterior outside of which a point is
# named; standard errors that part slopes.
_SURE = 0.95
_EQUAL = 0.01
_REGION = 0.99
_APART = 3.0
_SYMBOLS = {"mass_ratio": "M1/M", "k_y": "K_y", "k_theta": "K_theta", "C1": "C1", "C2": "C2"}
_CAPTIONS = {
    "glance": "Left, middle: draws of three free fits to Wang's 21 impacts, and the cases of "
    "Table 9. Right: the "
    "offset of each impact without any model ± sd, Eq. (53), and the median line of each fit with "
    "its 95 % band.",
    "chapter_v": "Dots: Wang's measurements. Lines: the computation with damping and restitution "
    "of Chapter V. Open "
    "marks: Appendix C, which has another damping.",
}
_SCORE = (
    f"Score: rms error of velocity and spin over {SCALES['v_x2']:g} m/s and {SCALES['omega_2']:g} "
    "rad/s on Wang's 21 "
    f"impacts; in brackets the share of {SAMPLES:,} bootstrap samples in which the set is first. "
    "Recomputed: at "
    "Wang's own impacts. Exact: the thesis's equations, solved without its slips."
)
_PLACES = (
    "Region: the probability of the region of highest density on whose edge the point lies. "
    "Below: the share of "
    "draws below its value. Model thesis is the thesis's own computation, slips included; "
    "two-mass needs M1/M above "
    "COR."
)


def report(result: Findings) -> Report:
    """Is it reproduced, is Table 9's claim true, what do the data say; then each result."""
    frames = result.frames
    summary: list[Block] = [
        Text(
            [
                _reproduced(frames["counts"]),
                *_claim(frames["rankings"]),
                _outside(frames["places"]),
                _slope(frames["offsets"]),
            ],
            "lead",
        ),
        _ranking(frames["rankings"]),
        Text([_SCORE], "quiet"),
        Text([note.text for note in result.notes], "list"),
        Picture("glance", _CAPTIONS["glance"]),
    ]
    sections = [
        Section(
            "Appendices C and D",
            [_counts(frames["counts"]), _exceptions(frames["appendix_c"])],
            True,
            _unexplained(frames["appendix_c"]),
        ),
        Section(
            "The three cases of Table 9",
            [
                _cases(frames),
                _parameters(frames["parameters"]),
                _places(frames["places"]),
                Text([_PLACES], "quiet"),
            ],
            True,
            "Errors on Wang's impacts, and where the cases lie in free fits.",
        ),
        Section(
            "Figs 36 to 44",
            [Picture("chapter_v", _CAPTIONS["chapter_v"])],
            True,
            "All points are in `figures.csv`, offsets by impact in `offsets.csv`.",
        ),
        Section(
            "Slips of the thesis",
            [_slips(frames["slips"]), Text(_errata(), "list")],
            True,
            "What the computation does besides its equations, and what changes without it.",
        ),
    ]
    return Report(
        "Jafri (2004), Chapter V and Appendices C and D, computed again",
        summary,
        sections,
    )


def _reproduced(counts: DataFrame) -> Mark:
    row = counts.iloc[0]
    text = (
        f"Appendix C: {row['within 0.1 %']:.0f} of {row['rows']} rows are reproduced within 0.1 % "
        "in both velocity "
        f"and spin, {row['within 0.5 %']:.0f} within 0.5 %, {row['within 1 %']:.0f} within 1 %."
    )
    return Mark(text, "part" if row["within 1 %"] < row["rows"] else "good")


def _claim(rankings: DataFrame) -> list[str]:
    """Whether Table 9's cases are the three best sets."""
    rows = records(rankings[rankings["source"] == "recomputed"])
    verdicts: dict[str, list[str]] = {}
    for row in sorted((row for row in rows if row["case"]), key=lambda row: str(row["case"])):
        share = row["among_three"]
        word = "holds" if share >= _SURE else "fails" if share <= 1.0 - _SURE else "is open"
        verdicts.setdefault(word, []).append(row["case"])
    words = listed(
        f"{word} for case{'s' * (len(found) > 1)} {listed(found)}"
        for word, found in verdicts.items()
    )
    best = min(rows, key=lambda row: row["score"])
    equal = [str(row["set"]) for row in rows if row["score"] <= (1.0 + _EQUAL) * best["score"]]
    return [
        "Table 9 claims that its cases are the three best of seven sets. Recomputed, this "
        f"{words}.",
        f"Sets {listed(equal)} of Appendix C fit equally well: their scores differ by less than "
        f"{percent(_EQUAL)}.",
    ]


def _outside(places: DataFrame) -> str:
    cases = places[places["point"].str.startswith("case")]
    beyond = cases[cases["level"] > _REGION].groupby("model", sort=False).size()
    text = listed(f"{beyond.get(name, 0)} of 3 ({name})" for name in dict.fromkeys(cases["model"]))
    return f"Cases outside the {percent(_REGION)} region of a free fit: {text}."


def _slope(offsets: DataFrame) -> str:
    slope, error = slope_of(offsets)
    away = abs(slope - C1) / error
    grows = "does not grow" if away > _APART else "may grow"
    return (
        f"The offset {grows} with the vertical speed as Eq. (53) says: without any model its "
        "slope is "
        f"{PLAIN.plus_minus(slope, error)} in/(m/s), in Eq. (53) {C1:g}, {away:.0f} standard "
        "errors away."
    )


def _ranking(rankings: DataFrame) -> Table:
    rows = []
    for number, mine in rankings.groupby("set"):
        first = mine.iloc[0]
        cells = {
            row["source"]: f"{row['score']:.2f} ({percent(row['first'])})" for row in records(mine)
        }
        named = f" (case {first['case']})" if first["case"] else ""
        rows.append(
            {
                "set": f"{number}{named}",
                "M1/M": first["mass_ratio"],
                "K_y [lb/in]": str(first["k_y [lb/in]"]),
            }
            | cells
        )
    return Table("Seven sets: score (first)", rows)


def _counts(counts: DataFrame) -> Table:
    heads = [head for head in map(str, counts) if head.startswith("within")]
    rows = [
        {"table": row["table"], "output": row["output"], "rows": str(row["rows"])}
        | {head: fixed(row[head], 0) for head in heads}
        for row in records(counts)
    ]
    return Table("Rows that agree with print", rows, ("table", "output"))


def _unexplained(rows: DataFrame) -> str:
    kinds = [rows[f"{name}_cause"].str.partition(":")[0] for name in SCALES]
    off = sum(int((kind != "").sum()) for kind in kinds)
    unknown = sum(int(kind.isin(["unexplained", "unlisted"]).sum()) for kind in kinds)
    return (
        f"{off} velocities and spins deviate by more than 0.1 %; of {unknown} the cause is not "
        "known."
    )


def _exceptions(frame: DataFrame) -> Table:
    rows = []
    for row in records(frame):
        for name in SCALES:
            if row[f"{name}_cause"]:
                kind, _, why = row[f"{name}_cause"].partition(": ")
                rows.append(
                    {
                        "row": f"{row['table']} case {row['case']}",
                        "column": name,
                        "printed": PLAIN.number(row[headed(name)], 5),
                        "computed": PLAIN.number(row[name], 5),
                        "error [%]": fixed(row[f"{name}_error"], 2),
                        "kind": kind,
                        "cause": why,
                    }
                )
    return Table("Rows of Appendix C that deviate", rows, ("row", "column", "kind", "cause"))


def _cases(frames: Mapping[str, DataFrame]) -> Table:
    ways = {"thesis": "computation of Chapter V", "exact": "its equations solved exactly"}
    rows = [
        {"of": row["case"], "by": ways[row["by"]]}
        | {headed(name): fixed(row[headed(name)], 2) for name in OUTPUTS}
        for row in records(frames["cases"])
    ]
    rows += [
        {"of": "free fit", "by": row["model"]}
        | {headed(name): fixed(row[f"rms {name}"], 2) for name in SCALES}
        for row in records(frames["fits"])
    ]
    return Table("Rms errors on Wang's 21 impacts", rows, ("of", "by"))


def _parameters(frame: DataFrame) -> Table:
    rows = []
    for name, mine in frame.groupby("parameter", sort=False):
        first = mine.iloc[0]
        cells = {
            row["model"]: PLAIN.with_interval(row["median"], row["q025"], row["q975"])
            for row in records(mine)
        }
        rows.append(
            {"": f"{_SYMBOLS.get(str(name), name)} {first['unit']}".strip()}
            | {case: PLAIN.number(first[case]) for case in _cases_of(frame)}
            | cells
        )
    return Table("Free fits: median and 95 % interval, in the thesis's units", rows)


def _cases_of(frame: DataFrame) -> list[str]:
    return [head for head in map(str, frame) if head.startswith("case") or head == OWN]


def _places(frame: DataFrame) -> Table:
    rows = []
    for row in records(frame):
        cells = {
            f"{symbol} below": chance(row[f"{name}_below"]) for name, symbol in _SYMBOLS.items()
        }
        level = Mark(chance(row["level"]), "poor" if row["level"] > _REGION else "")
        rows.append({"model": row["model"], "point": row["point"], "region": level, **cells})
    return Table("Where the cases lie in free fits", rows, ("model", "point"))


def _slips(frame: DataFrame) -> Table:
    heads = [headed(name) for name in ("v_x2", "v_y2", "omega_2")]
    rows = [
        {"slip": row["slip"], "where": row["where"]}
        | {f"{head} changes": PLAIN.number(row[head], 2) if row[head] else "" for head in heads}
        | {"rows within 0.1 %": str(row["rows within 0.1 %"])}
        for row in records(frame)
    ]
    title = "Without one slip: rms change of the 147 rows, and rows that then agree with print"
    return Table(title, rows, ("where",))


def _errata() -> list[str]:
    """Slips of the text, which no row shows."""
    rows = [row for row in printed("errata").to_dict("records") if row["table"][0] not in "CD"]
    return [f"{row['table']}, {row['column']}: {row['evidence']}." for row in rows]


def figures(result: Findings) -> Mapping[str, Callable[[], Figure]]:
    """Parameters and offsets at a glance; Figs 36 to 44."""
    return {
        "glance": lambda: _glance(result.frames),
        "chapter_v": lambda: _chapter_v(result.frames["figures"]),
    }


def _glance(frames: Mapping[str, DataFrame]) -> Figure:
    figure, axes = new_figure(1, 3, high=3.9, wide=10.5)
    draws = frames["draws"]
    offsets = frames["offsets"]
    table = frames["parameters"]
    stiffness, ratio, line = axes[0]
    speeds = np.linspace(4.0, 17.0, 40)
    handles = []
    for colour, (name, mine) in zip(SERIES, draws.groupby("model", sort=False), strict=False):
        for axis, across in ((stiffness, "k_y [lb/in]"), (ratio, "mass_ratio")):
            axis.plot(
                mine[across],
                mine["k_theta [lb in/rad]"],
                ".",
                color=colour,
                markersize=3,
                alpha=0.5,
            )
        low, middle, high = np.quantile(
            np.outer(mine["C1"], speeds) + mine["C2"].to_numpy()[:, np.newaxis],
            (0.025, 0.5, 0.975),
            axis=0,
        )
        line.fill_between(speeds, low, high, color=colour, alpha=0.16, linewidth=0)
        line.plot(speeds, middle, color=colour, linewidth=1.5)
        handles.append(Line2D([], [], color=colour, marker=".", label=str(name)))
    points = table.drop_duplicates("parameter").set_index("parameter")
    for axis, across in ((stiffness, "k_y"), (ratio, "mass_ratio")):
        for name in _cases_of(points):
            at = (points[name][across], points[name]["k_theta"])
            axis.plot(*at, "x", color=MEASURED, markersize=7, markeredgewidth=1.6)
            beside = 10 if name == "case 2" and across == "mass_ratio" else 0
            axis.annotate(
                name.removeprefix("case "),
                at,
                textcoords="offset points",
                xytext=(beside, 6),
                ha="center",
            )
        axis.set(yscale="log", ylim=(20.0, 3000.0))
    stiffness.set(xscale="log", xlim=(50.0, 300.0))
    stiffness.set_xticks([60, 100, 200], ["60", "100", "200"])
    stiffness.xaxis.set_minor_locator(NullLocator())
    stiffness.set_ylabel(rf"{SPECS['k_theta'].symbol} [lb in/rad]")
    stiffness.set_xlabel(rf"{SPECS['k_y'].symbol} [lb/in]")
    ratio.set_xlabel(SPECS["mass_ratio"].symbol)
    line.errorbar(
        offsets["v_y1 [m/s]"],
        offsets["offset [in]"],
        offsets["sd [in]"],
        fmt="o",
        color=MEASURED,
        markersize=4,
        linewidth=0.9,
    )
    line.plot(speeds, C1 * speeds + C2, "--", color=MEASURED, linewidth=1.5)
    line.set(ylim=(-0.15, 0.75), xlabel=r"$v_{y1}$ [m/s]", ylabel="offset [in]")
    handles += _keys(("x", "", "Table 9"), ("o", "", "without a model"), ("", "--", "Eq. (53)"))
    legend_above(figure, handles)
    return figure


def _keys(*shown: tuple[str, Any, str]) -> list[Any]:
    return [
        Line2D([], [], color=MEASURED, marker=mark, linestyle=line, label=text)
        for mark, line, text in shown
    ]


def _chapter_v(points: DataFrame) -> Figure:
    figure, axes = new_figure(3, 3, high=7.4, wide=9.0, sharex="col", sharey="row")
    lines = [*zip(SERIES, MARKERS[1:], dict.fromkeys(points["case"]), strict=False)]
    for column, spin in enumerate(MEAN_COR):
        for row, (output, unit) in enumerate(OUTPUTS.items()):
            axis: Any = axes[row, column]
            for colour, marker, name in lines:
                mine = points[(points["case"] == name) & (points["spin"] == spin)]
                angle = mine["theta_1 [deg]"]
                axis.plot(angle, mine[f"{output} recomputed [{unit}]"], color=colour, linewidth=1.4)
                axis.plot(
                    angle,
                    mine[f"{output} printed [{unit}]"],
                    marker,
                    color=colour,
                    markerfacecolor="none",
                )
            axis.plot(
                angle,
                mine[f"{output} measured [{unit}]"],
                "o",
                color=MEASURED,
                markersize=4.5,
            )
            few_ticks(axis.yaxis)
        axes[0, column].set_title(spin.replace("zero", "zero spin"))
        axes[2, column].set_xlabel(r"$\theta_1$ [deg]")
    for row, (output, unit) in enumerate(OUTPUTS.items()):
        axes[row, 0].set_ylabel(f"{COLUMNS[output].symbol} [{unit}]")
    shown = [
        Line2D([], [], color=each, marker=mark, markerfacecolor="none", label=name)
        for each, mark, name in lines
    ]
    legend_above(figure, [*shown, *_keys(("o", "", "measured"))])
    return figure


PAGE = Page(report, figures)
