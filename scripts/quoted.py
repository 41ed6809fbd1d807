"""Numbers and tables of the pages that come from fits, studies and the last full `fitball bench`, as Markdown."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from statistics import median
from typing import Any

import pandas as pd
from measured import ROOT

from fitball.bench.errors import FASTEST
from fitball.inference.problem.parameters import FORCE_NOISE, NOISE_SPECS
from fitball.models.specs import SPECS
from fitball.report.fit.citations import works
from fitball.report.form.numbers import decimals, digits, fixed, handy
from fitball.thesis.appendices import CASE_IN_APPENDIX_C

VALIDATION = ROOT / "fits" / "validation"
PUBLISHED = "Table 9, case 1"
QUOTED_FINDINGS = ("Appendix C", "Table 9", "Ranking")


def table(heads: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A table in Markdown."""
    lines = [f"| {' | '.join(map(str, row))} |".replace("|  |", "| |") for row in (heads, *rows)]
    return "\n".join([lines[0], "|" + "---|" * len(heads), *lines[1:]])


def priors() -> str:
    """Parameters with bounds and default priors, without those of force records, which are scaled to the records."""
    specs = [spec for spec in (*SPECS.values(), *NOISE_SPECS.values()) if spec.name not in FORCE_NOISE]
    return table(
        ("parameter", "unit", "bounds", "default prior", "meaning"),
        [
            (f"`{spec.name}`", spec.unit or "-", f"{spec.lower:g} to {spec.upper:g}", f"`{spec.prior}`", spec.meaning)
            for spec in specs
        ],
    )


def _value(name: str, item: dict[str, Any]) -> tuple[str, str, str]:
    """Median and sd, the ends over assumptions, and the unit, in which a person reads them."""
    scale = handy(name, item["unit"])
    sd = item["sd"] * scale.factor
    places = decimals(sd)
    ends = [fixed(end * scale.factor, places) for end in item["over"] or ()]
    value = f"{fixed(item['median'] * scale.factor, places)}\u00a0±\u00a0{fixed(sd, places)}"
    return value, " to ".join(ends) or "-", scale.unit or "-"


def wang(numbers: dict[str, Any]) -> str:
    """The fit of Wang's 21 impacts."""
    return table(
        ("parameter of `two-mass`", "median ± sd", "over assumptions", "unit", "verdict"),
        [(f"`{name}`", *_value(name, item), item["verdict"]) for name, item in numbers["parameters"].items()],
    )


def wang_short(numbers: dict[str, Any]) -> str:
    """The parameters of the bounce alone, without slopes."""
    rows = []
    for name, item in numbers["parameters"].items():
        if name in SPECS and not name.endswith("_slope"):
            value, _over, unit = _value(name, item)
            rows.append((f"`{name}`, {SPECS[name].meaning}", value, unit, item["verdict"]))
    return table(("parameter of `two-mass`", "median ± sd", "unit", "verdict"), rows)


def compared(numbers: dict[str, Any]) -> str:
    """Models on Wang's impacts, and the thesis's best case beside them."""
    rows = []
    for place, item in enumerate(numbers["compared"]):
        below = f"{-item['elpd']:.1f} ± {item['se']:.1f}" if place else "-"
        rows.append((f"`{item['name']}`", item["free"], *_missed(item["rms"]), below))
    rows.append((f"thesis, {PUBLISHED} (tuned on these rows)", "-", *_missed(numbers["published"][PUBLISHED]), ""))
    heads = (
        *("model", "free parameters", "error of left-out `v_x2` [m/s]", "`v_y2` [m/s]", "`omega_2` [rad/s]"),
        "log predictive density below the best",
    )
    duel = numbers["duel"]
    decided = "decide" if abs(duel["value"]) > max(4.0, 2.0 * duel["se"]) else "do not decide"
    return (
        f"{table(heads, rows)}\n\n"
        "Is the second mass worth its extra parameters? The log predictive density of `two-mass` less that of "
        f"`grip-slip` is {duel['value']:+.1f} ± {duel['se']:.1f}. These data {decided} the question."
    )


def _missed(rms: dict[str, float]) -> tuple[str, str, str]:
    return f"{rms['v_x2']:.2f}", f"{rms['v_y2']:.2f}", f"{rms['omega_2']:.1f}"


def together(numbers: dict[str, Any]) -> str:
    """The ratio of two stiffnesses from seven impacts."""
    ratio = numbers["ratio"]
    low, median, high = (1e3 * ratio[key] for key in ("q16", "median", "q84"))
    places = decimals(0.5 * (high - low))
    return (
        f"`wang_zero_spin.csv`: `k_theta/k_y` = {fixed(median, places)} × 10⁻³ m², 68 % interval "
        f"{fixed(low, places)} to {fixed(high, places)}, {ratio['verdict']}."
    )


def stiffness(numbers: dict[str, Any]) -> str:
    """`k_y` with force records and without."""
    return (
        "Example: `fitball calibrate synthetic_drop.csv`, five simulated drops with a true `k_y` of 26 kN/m. Their "
        "records deviate from the model by 4 % of the peak.\n\n"
        f"- With the records: {_stiffness(numbers, 'drop')}.\n- Without: {_stiffness(numbers, 'bare')}."
    )


def film(numbers: dict[str, Any]) -> str:
    """Both stiffnesses with gaps between the flights and without."""

    def words(name: str) -> str:
        twist = _stiffness(numbers, f"{name} twist", 1.0, "N m/rad")
        return f"`k_y` {_stiffness(numbers, name)}; `k_theta` {twist}"

    return (
        "Example: `fitball calibrate synthetic_gaps.csv`, 24 simulated impacts on film with a true `k_y` of 20 kN/m "
        "and a true `k_theta` of 19 N m/rad.\n\n"
        f"- With the gaps: {words('film')}.\n"
        f"- With `--ignore gap_time,gap_path,gap_turn`: {words('gapless')}."
    )


def _stiffness(numbers: dict[str, Any], name: str, factor: float = 1e3, unit: str = "kN/m") -> str:
    item = numbers["stiffness"][name]
    low, median, high = (item[key] / factor for key in ("q16", "median", "q84"))
    places = decimals(0.5 * (high - low))
    ends = f"{fixed(low, places)} to {fixed(high, places)}"
    return f"{fixed(median, places)} {unit}, 68 % interval {ends}, {item['verdict']}"


def validation() -> str:
    """Coverage by simulation-based calibration."""
    frame = pd.read_csv(VALIDATION / "summary.csv")
    names = " and ".join(f"`{name}`" for name in dict.fromkeys(frame["model"]))
    low, high = 100.0 * frame["within_95"].min(), 100.0 * frame["within_95"].max()
    verdict = "passes" if (frame["holds"] == "yes").all() else "fails"
    return (
        f"{frame['replicates'].min()} simulated tables each for {names}: the test {verdict}. The 95 % intervals "
        f"contain the true value in {low:.0f} to {high:.0f} % of the tables, depending on the quantity."
    )


def trust() -> str:
    """Rates of the study of trust, a row a kind of table; the page says of how many tables."""
    rows = []
    for _, row in _rates("yes", "no").iterrows():
        name = row["scenario"]
        made = "" if row["made_by_the_model"] == "yes" or name.startswith("all") else "fault: "
        rates = [_rate(row, what) for what in ("objected", "identified_holds", "pinned_called_prior_dominated")]
        rows.append((f"{made}{name}", *rates))
    heads = ("tables", "objected to", "95 % intervals contain the truth", "determined, but called prior-dominated")
    return table(heads, rows)


def trust_line() -> str:
    """The same over all tables, in two sentences."""
    rows = {row["scenario"]: row for _, row in _rates("yes", "no").iterrows()}
    made, other = (rows[f"all {name}"] for name in ("made by the model", "not made by it"))
    return (
        f"Of the tables simulated from the fitted model {_rate(made, 'objected')} are objected to, and of those that "
        f"it did not make {_rate(other, 'objected')}. Of the former, 95 % intervals of identified parameters contain "
        f"the truth in {_rate(made, 'identified_holds')}."
    )


def references() -> str:
    """The works that `fitball cite` knows, a line each."""
    return "\n".join(f"- {work.text()}" for work in works().values() if work.key != "fitball")


def faults() -> str:
    """How often each fault in tables of other code is found with each model, whole and half as large."""
    found: dict[str, dict[str, str]] = {}
    for _, row in _rates("other code").iterrows():
        words, fitted = row["words"].split(", fitted by ")
        whole = words.removesuffix(", 50 % of that")
        found.setdefault(whole, {})[f"`{fitted}`{'' if words == whole else ', half of it'}"] = _rate(row, "objected")
    ways = sorted({way for rates in found.values() for way in rates})
    rows = [(words, *(rates.get(way, "-") for way in ways)) for words, rates in found.items()]
    return table(("fault", *ways), rows)


def _rates(*made: str) -> pd.DataFrame:
    frame = pd.read_csv(VALIDATION / "trust" / "rates.csv")
    return frame[frame["made_by_the_model"].isin(made)]


def _rate(row: Any, what: str) -> str:
    """A share in per cent with the ends of its 95 % interval."""
    if not row[f"{what}_of"]:
        return "-"
    share, low, high = (round(100.0 * row[f"{what}{end}"]) for end in ("", "_low", "_high"))
    return f"{share}\u00a0% [{low},\u00a0{high}]"


def plan() -> str:
    """Predicted gains of plans and those of refits, a row a plan."""
    folder = VALIDATION / "plan"
    gains, sds = pd.read_csv(folder / "gains.csv"), pd.read_csv(folder / "sds.csv")
    words = json.loads((folder / "plan.json").read_text(encoding="utf-8"))["cases"]
    rows = []
    for name, both in gains.groupby("case", sort=False):
        made, again = (both[both["design"] == design].iloc[0] for design in ("planned", "table again"))
        off = 100.0 * (1.0 + sds[(sds["case"] == name) & (sds["design"] == "planned")]["off"])
        found = [f"{one['found [nats]']:.2f}\u00a0±\u00a0{one['se']:.2f}" for one in (made, again)]
        promised = f"{made['promised [nats]']:.2f}"
        rows.append((words[name]["words"], promised, *found, f"{off.min():.0f} to {off.max():.0f} %"))
    heads = ("plan", "predicted", "found by refits", "existing impacts repeated", "sd over predicted sd")
    return table(heads, rows)


def population() -> str:
    """What the study of populations counted, and how joint fits of ten tables compare."""
    folder = VALIDATION / "population"
    found = json.loads((folder / "population.json").read_text(encoding="utf-8"))
    cells: dict[str, dict[str, dict[str, str]]] = {}
    for _, row in pd.read_csv(folder / "coverage.csv").iterrows():
        ends = f" [{100.0 * row['low']:.0f}, {100.0 * row['high']:.0f}]" if row["priors"] == "divided out" else ""
        by = cells.setdefault(row["what"], {}).setdefault(row["quantity"], {})
        by[row["priors"]] = f"{100.0 * row['share']:.0f} %{ends}"
    rows = [(what, *(f"{by['divided out']}; {by['left in']}" for by in two.values())) for what, two in cells.items()]
    less = " and ".join(
        f"{100.0 * (1.0 - share):.0f} % (`{name}`)" for name, share in found["error_given_all"].items()
    )
    apart = [abs(row["apart"]) for row in found["joint"]]
    widths = sorted(row["width"] for row in found["joint"])
    return (
        f"{table(('95 % intervals of', *(f'`{name}`' for name in found['error_given_all'])), rows)}\n\n"
        f"Each cell: share that contains the truth with its 95 % interval; control with priors left in. There are "
        f"{found['populations']} populations of {found['tables'] // found['populations']} tables, and "
        f"{found['on_levels']} of three levels with four tables each.\n\n"
        f"Given all tables, the root mean square error of a table is smaller than alone by {less}. "
        f"Of {found['tables'] * len(found['not_trusted']):,} sets of weights {sum(found['not_trusted'].values())} "
        f"are unreliable. Joint fits (`--pool`) of {len(apart) // 4} sets of ten tables agree: centre and spread "
        f"differ by {median(apart):.2f} sd (median; at most {max(apart):.2f}), widths of intervals by a factor of "
        f"{widths[0]:.2f} to {widths[-1]:.2f}."
    )


def few() -> str:
    """What the study of few levels counted: labs by the number of balls or places, and tables of two surfaces."""
    found = json.loads((VALIDATION / "few" / "few.json").read_text(encoding="utf-8"))
    whole = {(one["quantity"], one["what"], one["fit"]): one for one in found["coverages"]}

    def held(one: dict[str, Any]) -> str:
        ends = ", ".join(f"{100.0 * one[end]:.0f}" for end in ("low", "high"))
        return f"{100.0 * one['holds'] / one['of']:.0f} % [{ends}] of {one['of']}"

    labs = [one for one in found["coverages"] if one["quantity"] in ("balls", "places") and one["fit"] == "stated"]
    rows = []
    for one in labs:
        widths = [row["width"] for row in found["by_labels"] if (row["quantity"], row["what"]) == _key(one)]
        control = whole[(*_key(one), "control")]
        rows.append((one["quantity"], one["what"], held(one), " ".join(f"{w:.2f}" for w in widths), held(control)))
    surfaces = [
        (f"`{name}`", what, held(whole[name, what, "stated"]),
         held(whole[name, what, "control"]) if (name, what, "control") in whole else "-")
        for name in ("mu", "cor_10") for what in ("surface", "equal ones' difference", "different ones' difference")
    ]  # fmt: skip
    heads = ("of", "95 % interval of", "contain the truth")
    told = found["differences"]
    return (
        f"{table((*heads, 'width over Student t: 2, 3, 4, 6 labels', 'control'), rows)}\n\n"
        "Median widths are multiples of Student's t on the means of balls or places. In the control the prior of the "
        "spread is ten times too narrow.\n\n"
        f"{table((*heads, 'control'), surfaces)}\n\n"
        "In the control both surfaces have one value. Frictions that differ by at least "
        f"{told['apart']:g} are found different in {told['found']} of {told['of']} tables."
    )


def _key(one: dict[str, Any]) -> tuple[str, str]:
    return one["quantity"], one["what"]


def tracks() -> str:
    """What the study of films counted: intervals of impacts, spins, fits, and controls."""
    found = json.loads((VALIDATION / "tracks" / "tracks.json").read_text(encoding="utf-8"))
    by = {(one["case"], one["quantity"]): one for one in found["coverage"]}
    still = {(one["case"], one["quantity"]): one for one in found["still_air"]}
    spins = {one["case"]: one for one in found["spins"]}

    def held(one: dict[str, Any]) -> str:
        return f"{100 * one['in_68'] / one['of']:.0f}, {100 * one['in_95'] / one['of']:.0f} %"

    def error(one: dict[str, Any], factor: float = 1.0) -> str:
        return f"{factor * one['sd']:.2g}"

    cases = [*dict.fromkeys(case for case, _name in by)]
    shown = ("v_x1", "v_y2", "omega_1", "gap_time", "gap_path", "gap_turn")
    rows = [(case, *(held(by[case, name]) for name in shown)) for case in cases]
    sizes = [
        (case, error(by[case, "v_x1"]), f"{by[case, 'v_x1']['lines']:.2g}", error(by[case, "v_y2"]),
         f"{by[case, 'v_y2']['lines']:.2g}", error(by[case, "omega_1"]), error(by[case, "gap_time"], 1e3),
         f"{100 * spins[case]['sure'] / spins[case]['of']:.0f} %", f"{spins[case]['wrong']} of {spins[case]['sure']}")
        for case in cases
    ]  # fmt: skip
    fits = [
        (one["case"], f"`{one['parameter']}`", f"{100 * one['level']:.0f} %",
         f"{100 * one['holds'] / one['of']:.0f} % [{100 * one['low']:.0f}, {100 * one['high']:.0f}] of {one['of']}",
         f"{100 * one['sd']:.2g} %", f"{100 * one['off']:+.2g} %",
         "none" if one["lines_off"] is None else f"{100 * one['lines_off']:+.2g} %")
        for one in found["fits"]
    ]  # fmt: skip
    controls = ", ".join(f"`{name}` {held(one)} ({case})" for (case, name), one in still.items() if name in shown[:2])
    real = found["real"]
    most, heads = max(one["of"] for one in by.values()), ("film", *(f"`{name}`" for name in shown))
    return (
        f"Share of 68 % and 95 % intervals that contain the truth, of {most} impacts:\n\n{table(heads, rows)}\n\n"
        "Median standard errors, and root mean square errors of lines through five frames:\n\n"
        + table(
            (
                "film",
                "`v_x1` [m/s]",
                "lines",
                "`v_y2` [m/s]",
                "lines",
                "`omega_1` [rad/s]",
                "`gap_time` [ms]",
                "spins sure",
                "of these wrong",
            ),
            sizes,
        )
        + "\n\nFilms of 21 impacts, whose scale, clock, tilt and court are wrong within their errors, are fitted. "
        "Errors are shares of the value:\n\n"
        + table(
            ("film", "parameter", "interval", "contains the truth", "median sd", "median error", "error by lines"),
            fits,
        )
        + "\n\nControls are wrong on purpose. Without drag and Magnus force the intervals hold in "
        f"{controls}. A court that is taken 1 mm too high moves `gap_time` by {found['height']:.3f} of what geometry "
        "predicts. On the bundled film of a table-tennis ball speeds by odd and by even frames agree within one "
        f"standard error of the frame noise in {real['in_68']}."
    )


def tracks_line() -> str:
    """How well a film determines the vertical stiffness, in a sentence a frame rate."""
    found = json.loads((VALIDATION / "tracks" / "tracks.json").read_text(encoding="utf-8"))
    return " ".join(
        f"In {one['of']} fits to simulated films of {one['case'].removesuffix('/s, fitted')} frames a second the "
        f"median sd of `k_y` is {digits(100 * one['sd'], 2)} %. Their 95 % intervals contain the truth in "
        f"{100 * one['holds'] / one['of']:.0f} % [{100 * one['low']:.0f}, {100 * one['high']:.0f}]."
        for one in found["fits"]
        if one["parameter"] == "k_y" and one["level"] == 0.95
    )


def gaps() -> str:
    """What the study of gaps between the flights counted: intervals, verdicts, and controls."""
    found = json.loads((VALIDATION / "gaps" / "gaps.json").read_text(encoding="utf-8"))

    def held(one: dict[str, Any]) -> str:
        return f"{100.0 * one['holds'] / one['of']:.0f} % [{100.0 * one['low']:.0f}, {100.0 * one['high']:.0f}]"

    by = {(one["case"], one["parameter"], one["level"]): one for one in found["coverages"]}
    cases = [*dict.fromkeys(case for case, *_ in by if case != "all")]
    rows = [
        (f"`{name}`", held(by["all", name, 0.5]), held(by["all", name, 0.95]),
         *(f"{by[case, name, 0.95]['sd']:.2g}" for case in cases))
        for name in dict.fromkeys(name for _case, name, _level in by)
    ]  # fmt: skip
    wrong = [
        (one["control"], f"`{one['parameter']}`", f"{held(one)} of {one['of']}", f"{100.0 * one['predicted']:.0f} %",
         f"{one['shift']:.2f}", f"{one['predicted_shift']:.2f}",
         "-" if one["slope"] is None else f"{one['slope']:.2f} ± {one['slope_se']:.2f}")
        for one in found["controls"]
    ]  # fmt: skip
    said = [f"{found['verdicts'][name].get('identified', 0)} (`{name}`)" for name in ("k_y", "k_theta")]
    heads = (
        "parameter",
        "50 % intervals that contain the truth",
        "95 % intervals",
        *(f"sd, {case}" for case in cases),
    )
    return (
        f"{table(heads, rows)}\n\n"
        f"The shares are of {by['all', 'k_y', 0.95]['of']} films, with their 95 % intervals (Clopper and Pearson). "
        "Sds are medians, in SI; those of `k_y`, `k_theta` and `mu` are shares of the value. "
        f"Of {found['judged']} films with verdicts the data determine the stiffness in {' and '.join(said)}.\n\n"
        + table(
            (
                "control",
                "parameter",
                "95 % intervals that contain the truth",
                "predicted",
                "bias in sds",
                "predicted",
            ),
            wrong,
        )
    )


def thesis(numbers: dict[str, Any]) -> str:
    """Which claims of the thesis hold, and the ranking of its sets."""
    found, rankings = numbers["thesis"], numbers["rankings"]
    names = [key.partition(":")[0] for key in rankings[0] if key.endswith(": score")]
    cases = ", ".join(f"case {case} of Table 9 is set {index}" for case, index in CASE_IN_APPENDIX_C.items())
    cell = "{:.2f} ({:.1f} %)".format
    rows = [
        (item["set"], *(cell(item[f"{name}: score"], 100.0 * item[f"{name}: first"]) for name in names))
        for item in rankings
    ]
    return "\n".join(
        [
            *(f"- **{name}**: {found[name]}" for name in QUOTED_FINDINGS),
            "",
            "Root mean square score of each set of Appendix C, and in brackets how often it is first when impacts "
            "are resampled. The columns: printed outputs, known misprints corrected, recomputed as in the thesis, "
            f"equations solved exactly. C{cases[1:]}.",
            "",
            table(("set", *names), rows).replace(" (0.0 %)", ""),
        ]
    )


# Errors at which the closed form is compared with what is fastest there, and how one would integrate carelessly.
ERRORS = (1e-3, 1e-6, 1e-9, 1e-12)
CARELESS = (
    ("RK4 compiled, events between steps", "400 steps"),
    ("solve_ivp RK45", "rtol 0.001"),
    ("solve_ivp DOP853", "rtol 1e-09"),
    ("solve_ivp DOP853, short steps", "rtol 1e-09"),
)


def _benched(name: str) -> pd.DataFrame:
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


def speed_line() -> str:
    """The closed form against its rivals, in two sentences."""
    closed, rivals = _bounce()
    finer, coarser = (_strongest(rivals, error) for error in (ERRORS[-1], ERRORS[0]))
    times = [digits(rival["microseconds"] / closed["microseconds"], 2) for rival in (finer, coarser)]
    return (
        f"A bounce in closed form takes {digits(closed['microseconds'], 2)} microseconds of one core. Its largest "
        f"error is {closed['largest error']:.1e} of the incident speed. The fastest compiled integrators take "
        f"{times[0]} times as long for errors below {ERRORS[-1]:.0e}, and {times[1]} times for {ERRORS[0]:.0e}."
    )


def speed() -> str:
    """The closed form against its rivals at some errors, and the time for long tables."""
    closed, rivals = _bounce()
    named = [(f"{error:.0e}", _strongest(rivals, error)) for error in ERRORS[::-1]]
    for solver, setting in CARELESS:
        row = rivals[(rivals["solver"] == solver) & (rivals["setting"] == setting)].iloc[0]
        named.append((f"{row['largest error']:.1e}", row))
    rows = [(f"{closed['largest error']:.1e}", "closed form", digits(closed["microseconds"], 2), "1")]
    for error, row in named:
        times = digits(row["microseconds"] / closed["microseconds"], 2)
        rows.append((error, f"{row['solver']}, {row['setting']}", digits(row["microseconds"], 2), times))
    growth = _benched("growth")
    longest = growth[growth["rows"] == growth["rows"].max()].iloc[0]
    whole = [
        (f"{row['rows']:,.0f}", *(digits(value, 3) for name, value in row.items() if name != "rows"))
        for row in _benched("whole").to_dict("records")
    ]
    heads = ("rows", "CPU seconds", "microseconds a row", "most memory [MB]", "report.html [kB]", "fit.json [kB]")
    return (
        f"{table(('error at most', 'fastest', 'microseconds an impact', 'times the closed form'), rows)}\n\n"
        f"A log posterior of {longest['rows']:.0f} impacts takes "
        f"{digits(longest['milliseconds a log posterior'], 2)} ms. Their best fit takes "
        f"{digits(longest['point fit [s]'], 2)} s of CPU and {digits(longest['most memory [MB]'], 2)} MB. A whole "
        "`fitball calibrate` of simulated tables (`grip-slip`), from the CSV file to the result folder:\n\n"
        f"{table(heads, whole)}"
    )


def densities() -> str:
    """Log posteriors, ours and plain ones: microseconds, and in brackets the largest error."""
    frame = _benched("densities")
    rows = [
        (
            name.removeprefix("plain Python, "),
            *(
                f"{digits(row['microseconds'], 2)} ({row['largest error']:.0e})".replace("-", "\u2011")
                for _, row in mine.iterrows()
            ),
        )
        for name, mine in frame.groupby("log posterior", sort=False)
    ]
    return table(("log posterior", *frame["table"].unique()), rows)


def tables() -> str:
    """Many tables: time of a table, memory, and how these change from the first line of a batch to its last."""
    frame = _benched("tables").groupby("cores").nth([0, -1])
    rows = [
        (cores, size, count, f"{wall:.0f}", f"{each:.2f}", f"{parent:.0f}",
         "-" if math.isnan(worker) else f"{worker:.0f}")
        for cores, size, count, wall, each, parent, worker in frame.itertuples(index=False)
    ]  # fmt: skip
    return table(list(frame.columns), rows)


def samplers() -> str:
    """Draws a second by sampler and table; densities a draw over the tables."""
    frame = _benched("samplers")
    names = list(dict.fromkeys(frame["table"]))
    rows = []
    for sampler, mine in frame.groupby("sampler", sort=False):
        found = mine.set_index("table").reindex(names)
        cells = ["-" if math.isnan(value) else digits(value, 2) for value in found["draws a CPU second"]]
        version = "" if sampler == "fitball" else f" ({found['version'].dropna().iloc[0]})"
        asked = found["densities a draw"].dropna()
        span = f"{digits(asked.min(), 2)} to {digits(asked.max(), 2)}" if len(asked) else "-"
        rows.append((f"{sampler}{version}", *cells, span))
    return table(("sampler", *names, "densities a draw"), rows)
