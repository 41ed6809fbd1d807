"""Numbers and tables of the pages that come from the last full `fitball bench`, as Markdown."""

from __future__ import annotations

import math

import pandas as pd
from measured import ROOT
from told_of_fits import table

from fitball.bench.errors import FASTEST
from fitball.report.form.numbers import digits

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
        f"A bounce in closed form takes {digits(closed['microseconds'], 2)} microseconds of one core and is off by "
        f"{closed['largest error']:.1e} of the incident speed at most. The fastest integrators that we could "
        f"write against it, compiled and with events located, take {times[0]} times as long for errors below "
        f"{ERRORS[-1]:.0e}, and {times[1]} times for {ERRORS[0]:.0e}."
    )


def speed() -> str:
    """The closed form against its rivals at some errors, and what long tables take."""
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
        f"{digits(longest['milliseconds a log posterior'], 2)} ms, the best fit of them "
        f"{digits(longest['point fit [s]'], 2)} s of CPU and {digits(longest['most memory [MB]'], 2)} MB. All of "
        "`fitball calibrate` on tables that grip-slip made, from the CSV file to the result folder:\n\n"
        f"{table(heads, whole)}"
    )


def densities() -> str:
    """Log posteriors, ours and plain ones."""
    rows = [
        (row["table"], row["log posterior"], digits(row["microseconds"], 2), f"{row['largest error']:.1e}")
        for _, row in _benched("densities").iterrows()
    ]
    return table(("table", "log posterior", "microseconds", "largest error"), rows)


def tables() -> str:
    """Many tables: time of a table, memory, and how these change as a batch goes on."""
    frame = _benched("tables")
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
