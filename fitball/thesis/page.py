"""The page of `rederive` and its figures."""

from collections.abc import Callable, Mapping, Sequence
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import NullLocator

from fitball.base.columns import COLUMNS
from fitball.base.display_units import PLAIN
from fitball.base.findings import Findings
from fitball.base.numbers import fixed, percent
from fitball.base.text import listed
from fitball.base.values import DataFrame, Figure
from fitball.data.bundled import printed_table
from fitball.models.specs import SPECS
from fitball.report.blocks import Block, Mark, Picture, Report, Section, Table, Text
from fitball.report.frame_rows import frame_rows
from fitball.report.page import Page
from fitball.report.quantities import chance
from fitball.report.style import (
    MEASURED_COLOUR,
    SERIES_COLOURS,
    SERIES_MARKERS,
    few_ticks,
    legend_above,
    new_figure,
)
from fitball.thesis.appendices import JUDGED_OUTPUTS, MEAN_COR, SCALES, head_of
from fitball.thesis.posteriors import slope_of
from fitball.thesis.printed import C1, C2
from fitball.thesis.ranking import BOOTSTRAP_SAMPLES, USER_SET

# Share of bootstrap samples from which on a claim of rank holds; below its complement it fails.
_SURE_SHARE = 0.95
# Relative difference of scores below which sets fit equally well.
_EQUAL_SCORES = 0.01
# Probability of the region of a posterior outside of which a case is counted and marked.
_NAMED_REGION = 0.99
# Standard errors from which on two slopes differ.
_SLOPE_ERRORS = 3.0
# Parameters of `places_frame`, and how the table heads them.
_SYMBOLS = {"mass_ratio": "M1/M", "k_y": "K_y", "k_theta": "K_theta", "C1": "C1", "C2": "C2"}
_CAPTIONS = {
    "glance": "Left, middle: draws of three free fits to Wang's 21 impacts, and the cases of "
    "Table 9. Right: the offset of each impact without any model ± sd, Eq. (53), and the median "
    "line of each fit with its 95 % band.",
    "chapter_v": "Dots: Wang's measurements. Lines: the computation with damping and restitution "
    "of Chapter V. Open marks: Appendix C, which has another damping.",
}
_SCORE = (
    f"Score: rms error of velocity and spin over {SCALES['v_x2']:g} m/s and {SCALES['omega_2']:g} "
    f"rad/s on Wang's 21 impacts; in brackets the share of {BOOTSTRAP_SAMPLES:,} bootstrap samples "
    "in which the set is first. Recomputed: at Wang's own impacts. Exact: the thesis's equations, "
    "solved without its slips."
)
_PLACES = (
    "Region: the probability of the region of highest density on whose edge the point lies. "
    "Below: the share of draws below its value. Model thesis is the thesis's own computation, "
    "slips included; two-mass needs M1/M above COR."
)
# Vertical speeds over which lines of offsets are drawn [m/s]: a little beyond Wang's.
_SPEEDS = np.linspace(4.0, 17.0, 40)


def report(result: Findings) -> Report:
    """The report of `rederive`: whether Appendix C is reproduced, whether Table 9's claim holds,
    and the results of free fits; then each result.
    """
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
    """The sentence on rows of Appendix C that are reproduced."""
    row = counts.iloc[0]
    text = (
        f"Appendix C: {row['within 0.1 %']:.0f} of {row['rows']} rows are reproduced within 0.1 % "
        f"in both velocity and spin, {row['within 0.5 %']:.0f} within 0.5 %, "
        f"{row['within 1 %']:.0f} within 1 %."
    )
    return Mark(text, "part" if row["within 1 %"] < row["rows"] else "good")


def _claim(rankings: DataFrame) -> list[str]:
    """Whether Table 9's cases are the three best sets, and which sets fit equally well."""
    rows = frame_rows(rankings[rankings["source"] == "recomputed"])
    of_cases = [row for row in rows if row.text("case")]
    cases = sorted(of_cases, key=lambda row: row.text("case"))
    by_verdict: dict[str, list[str]] = {}
    for row in cases:
        verdict = _verdict(row.number("among_three"))
        by_verdict.setdefault(verdict, []).append(row.text("case"))
    sentences = []
    for verdict, numbers in by_verdict.items():
        noun = "case" if len(numbers) == 1 else "cases"
        sentences.append(f"{verdict} for {noun} {listed(numbers)}")
    best = min(row.number("score") for row in rows)
    equal = [row.text("set") for row in rows if row.number("score") <= (1.0 + _EQUAL_SCORES) * best]
    return [
        "Table 9 claims that its cases are the three best of seven sets. Recomputed, this "
        f"{listed(sentences)}.",
        f"Sets {listed(equal)} of Appendix C fit equally well: their scores differ by less than "
        f"{percent(_EQUAL_SCORES)}.",
    ]


def _verdict(share: float) -> str:
    """Whether a claim holds that is true of this share of bootstrap samples."""
    if share >= _SURE_SHARE:
        return "holds"
    if share <= 1.0 - _SURE_SHARE:
        return "fails"
    return "is open"


def _outside(places: DataFrame) -> str:
    """The sentence on cases of Table 9 that lie far out in the free fits."""
    cases = places[places["point"].str.startswith("case")]
    outside = cases[cases["level"] > _NAMED_REGION].groupby("model", sort=False).size()
    models = dict.fromkeys(cases["model"])
    text = listed(f"{outside.get(name, 0)} of 3 ({name})" for name in models)
    return f"Cases outside the {percent(_NAMED_REGION)} region of a free fit: {text}."


def _slope(offsets: DataFrame) -> str:
    """The sentence on the slope of the offset over the vertical speed."""
    slope, error = slope_of(offsets)
    away = abs(slope - C1) / error
    grows = "does not grow" if away > _SLOPE_ERRORS else "may grow"
    estimate = PLAIN.plus_minus(slope, error)
    return (
        f"The offset {grows} with the vertical speed as Eq. (53) says: without any model its "
        f"slope is {estimate} in/(m/s), in Eq. (53) {C1:g}, {away:.0f} standard errors away."
    )


def _ranking(rankings: DataFrame) -> Table:
    """A row a set of Appendix C, a column a source."""
    rows = []
    for number, of_set in rankings.groupby("set"):
        first = of_set.iloc[0]
        case = f" (case {first['case']})" if first["case"] else ""
        cells = {
            "set": f"{number}{case}",
            "M1/M": first["mass_ratio"],
            "K_y [lb/in]": str(first["k_y [lb/in]"]),
        }
        for row in frame_rows(of_set):
            score, first_share = row.numbers("score", "first")
            cells[row.text("source")] = f"{score:.2f} ({percent(first_share)})"
        rows.append(cells)
    return Table("Seven sets: score (first)", rows)


def _counts(counts: DataFrame) -> Table:
    """Rows that agree with print, a row an output."""
    heads = [head for head in map(str, counts) if head.startswith("within")]
    rows = []
    for row in frame_rows(counts):
        cells = {name: row.text(name) for name in ("table", "output", "rows")}
        for head in heads:
            cells[head] = fixed(row.number(head), 0)
        rows.append(cells)
    return Table("Rows that agree with print", rows, left=("table", "output"))


def _unexplained(rows: DataFrame) -> str:
    """The sentence on deviations from Appendix C whose cause is not known."""
    deviate = 0
    unknown = 0
    for name in SCALES:
        kinds = rows[f"{name}_cause"].str.partition(":")[0]
        deviate += int((kinds != "").sum())
        unknown += int(kinds.isin(["unexplained", "unlisted"]).sum())
    return (
        f"{deviate} velocities and spins deviate by more than 0.1 %; of {unknown} the cause is not "
        "known."
    )


def _exceptions(frame: DataFrame) -> Table:
    """A row a velocity or spin of Appendix C that deviates, with its cause."""
    rows = []
    for row in frame_rows(frame):
        for name in SCALES:
            kind, _, why = row.text(f"{name}_cause").partition(": ")
            if not kind:
                continue
            rows.append(
                {
                    "row": f"{row.text('table')} case {row.text('case')}",
                    "column": name,
                    "printed": PLAIN.number(row.number(head_of(name)), 5),
                    "computed": PLAIN.number(row.number(name), 5),
                    "error [%]": fixed(row.number(f"{name}_error"), 2),
                    "kind": kind,
                    "cause": why,
                }
            )
    left = ("row", "column", "kind", "cause")
    return Table("Rows of Appendix C that deviate", rows, left)


def _cases(frames: Mapping[str, DataFrame]) -> Table:
    """Rms errors of each set by each way of computing, and of each free fit."""
    ways = {"thesis": "computation of Chapter V", "exact": "its equations solved exactly"}
    rows = []
    for row in frame_rows(frames["cases"]):
        cells = {"of": row.text("case"), "by": ways[row.text("by")]}
        for name in JUDGED_OUTPUTS:
            cells[head_of(name)] = fixed(row.number(head_of(name)), 2)
        rows.append(cells)
    for row in frame_rows(frames["fits"]):
        cells = {"of": "free fit", "by": row.text("model")}
        for name in SCALES:
            cells[head_of(name)] = fixed(row.number(f"rms {name}"), 2)
        rows.append(cells)
    return Table("Rms errors on Wang's 21 impacts", rows, left=("of", "by"))


def _parameters(frame: DataFrame) -> Table:
    """A row a parameter, a column a set or a free fit."""
    rows = []
    for name, of_parameter in frame.groupby("parameter", sort=False):
        first = of_parameter.iloc[0]
        cells = {"": f"{_SYMBOLS.get(str(name), name)} {first['unit']}".strip()}
        for case in _cases_of(frame):
            cells[case] = PLAIN.number(first[case])
        for row in frame_rows(of_parameter):
            median, low, high = row.numbers("median", "q025", "q975")
            cells[row.text("model")] = PLAIN.with_interval(median, low, high)
        rows.append(cells)
    return Table("Free fits: median and 95 % interval, in the thesis's units", rows)


def _cases_of(frame: DataFrame) -> list[str]:
    """Columns of `parameters_frame` that are sets: the cases, and a reader's."""
    return [head for head in map(str, frame) if head.startswith("case") or head == USER_SET]


def _places(frame: DataFrame) -> Table:
    """Where the cases lie in the free fits, a row a model and point."""
    rows = []
    for row in frame_rows(frame):
        level = row.number("level")
        tone = "poor" if level > _NAMED_REGION else ""
        cells = {
            "model": row.text("model"),
            "point": row.text("point"),
            "region": Mark(chance(level), tone),
        }
        for name, symbol in _SYMBOLS.items():
            cells[f"{symbol} below"] = chance(row.number(f"{name}_below"))
        rows.append(cells)
    return Table("Where the cases lie in free fits", rows, left=("model", "point"))


def _slips(frame: DataFrame) -> Table:
    """What changes without each slip, a row a slip."""
    heads = [head_of(name) for name in ("v_x2", "v_y2", "omega_2")]
    rows = []
    for row in frame_rows(frame):
        cells = {"slip": row.text("slip"), "where": row.text("where")}
        for head in heads:
            change = row.number(head)
            cells[f"{head} changes"] = PLAIN.number(change, 2) if change else ""
        cells["rows within 0.1 %"] = row.text("rows within 0.1 %")
        rows.append(cells)
    title = "Without one slip: rms change of the 147 rows, and rows that then agree with print"
    return Table(title, rows, left=("where",))


def _errata() -> list[str]:
    """Sentences on slips of the thesis's text, which no row of Appendices C and D shows."""
    errata = printed_table("errata").to_dict("records")
    of_text = [erratum for erratum in errata if erratum["table"][0] not in "CD"]
    return [f"{row['table']}, {row['column']}: {row['evidence']}." for row in of_text]


def figures(result: Findings) -> Mapping[str, Callable[[], Figure]]:
    """The figures `glance`, parameters and offsets, and `chapter_v`, Figs 36 to 44."""
    return {
        "glance": lambda: _glance(result.frames),
        "chapter_v": lambda: _chapter_v(result.frames["figures"]),
    }


def _glance(frames: Mapping[str, DataFrame]) -> Figure:
    """Draws and cases over stiffness and over mass ratio, and offsets over the vertical speed."""
    figure, axes = new_figure(1, 3, high=3.9, wide=10.5)
    stiffness, ratio, line = axes[0]
    handles = _draw_fits(axes[0], frames["draws"])
    points = frames["parameters"].drop_duplicates("parameter").set_index("parameter")
    for axis, across in ((stiffness, "k_y"), (ratio, "mass_ratio")):
        for name in _cases_of(points):
            at = (points[name][across], points[name]["k_theta"])
            axis.plot(*at, "x", color=MEASURED_COLOUR, markersize=7, markeredgewidth=1.6)
            # Case 2 lies upon another there.
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
    _draw_offsets(line, frames["offsets"])
    handles += _keys(("x", "", "Table 9"), ("o", "", "without a model"), ("", "--", "Eq. (53)"))
    legend_above(figure, handles)
    return figure


def _draw_fits(axes: Sequence[Axes], draws: DataFrame) -> list[Line2D]:
    """Draw each fit in three panels: draws over stiffness and over mass ratio, and its line of
    offsets with its band. The handles of the legend are returned.
    """
    stiffness, ratio, line = axes
    handles = []
    by_model = draws.groupby("model", sort=False)
    for colour, (name, of_fit) in zip(SERIES_COLOURS, by_model, strict=False):
        torsion = of_fit["k_theta [lb in/rad]"]
        for axis, across in ((stiffness, "k_y [lb/in]"), (ratio, "mass_ratio")):
            axis.plot(of_fit[across], torsion, ".", color=colour, markersize=3, alpha=0.5)
        offsets = np.outer(of_fit["C1"], _SPEEDS) + of_fit["C2"].to_numpy()[:, np.newaxis]
        low, middle, high = np.quantile(offsets, (0.025, 0.5, 0.975), axis=0)
        line.fill_between(_SPEEDS, low, high, color=colour, alpha=0.16, linewidth=0)
        line.plot(_SPEEDS, middle, color=colour, linewidth=1.5)
        handles.append(Line2D([], [], color=colour, marker=".", label=str(name)))
    return handles


def _draw_offsets(axis: Axes, offsets: DataFrame) -> None:
    """Draw the offsets of the impacts without any model, and Eq. (53)."""
    axis.errorbar(
        offsets["v_y1 [m/s]"],
        offsets["offset [in]"],
        offsets["sd [in]"],
        fmt="o",
        color=MEASURED_COLOUR,
        markersize=4,
        linewidth=0.9,
    )
    axis.plot(_SPEEDS, C1 * _SPEEDS + C2, "--", color=MEASURED_COLOUR, linewidth=1.5)
    axis.set(ylim=(-0.15, 0.75), xlabel=r"$v_{y1}$ [m/s]", ylabel="offset [in]")


def _keys(*keys: tuple[str, Literal["", "--"], str]) -> list[Line2D]:
    """Handles of a legend from marker, line style and text."""
    return [
        Line2D([], [], color=MEASURED_COLOUR, marker=mark, linestyle=line, label=text)
        for mark, line, text in keys
    ]


def _chapter_v(points: DataFrame) -> Figure:
    """Outputs over the angle of incidence, a row an output, a column a spin."""
    figure, axes = new_figure(3, 3, high=7.4, wide=9.0, sharex="col", sharey="row")
    cases = [*zip(SERIES_COLOURS, SERIES_MARKERS[1:], dict.fromkeys(points["case"]), strict=False)]
    for column, spin in enumerate(MEAN_COR):
        of_spin = points[points["spin"] == spin]
        for row, (output, unit) in enumerate(JUDGED_OUTPUTS.items()):
            axis = axes[row, column]
            for colour, marker, name in cases:
                case = of_spin[of_spin["case"] == name]
                angle = case["theta_1 [deg]"]
                recomputed = case[f"{output} recomputed [{unit}]"]
                in_print = case[f"{output} printed [{unit}]"]
                axis.plot(angle, recomputed, color=colour, linewidth=1.4)
                axis.plot(angle, in_print, marker, color=colour, markerfacecolor="none")
            # All cases have the same impacts.
            measured = case[f"{output} measured [{unit}]"]
            axis.plot(angle, measured, "o", color=MEASURED_COLOUR, markersize=4.5)
            few_ticks(axis.yaxis)
        axes[0, column].set_title(spin.replace("zero", "zero spin"))
        axes[2, column].set_xlabel(r"$\theta_1$ [deg]")
    for row, (output, unit) in enumerate(JUDGED_OUTPUTS.items()):
        axes[row, 0].set_ylabel(f"{COLUMNS[output].symbol} [{unit}]")
    handles = [
        Line2D([], [], color=colour, marker=marker, markerfacecolor="none", label=name)
        for colour, marker, name in cases
    ]
    legend_above(figure, [*handles, *_keys(("o", "", "measured"))])
    return figure


PAGE = Page(report, figures)
