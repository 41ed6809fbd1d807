"""A parameter set as JSON, with verdicts and correlations, and `fit.summary` as a table in LaTeX
and Markdown.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from msgspec import json
from msgspec.structs import asdict

from fitball.base.errors import ParameterError, suggestion
from fitball.base.files import json_bytes
from fitball.base.text import one_line, symbol_levels
from fitball.exports.parameter_set import UNSURE, ParameterSet
from fitball.inference.fitted import Fitted
from fitball.inference.schema import Estimate
from fitball.report.blocks import Report, Table, Text
from fitball.report.cite import escaped
from fitball.report.fit_words import interval_text, shown_texts
from fitball.report.frame_rows import frame_rows
from fitball.report.quantities import MAIN_KINDS, unit_of
from fitball.report.render import to_markdown
from fitball.version import __version__

# The kind of the JSON file, by which programs recognize it.
JSON_KIND = "fitball parameter set"
# The version of its layout: it grows when programs that read the file must be changed.
JSON_VERSION = 1
# Verdicts of values that the data determine, alone or under assumptions.
DETERMINED_BY_DATA = ("identified", "given")
# The remark on values that the data determine only under assumptions; UNSURE has the others.
_GIVEN = {"given": "depends on model assumptions that the data cannot test"}
# The note of each verdict in tables.
_REMARKS = {**_GIVEN, **UNSURE}
# Where LaTeX may break a word without a hyphen, and letters between two such places.
_BREAK = r"\allowbreak{}"
_PIECE = 8
# An open end of an interval.
_LDOTS = r"$\ldots$"


def as_json(sets: Sequence[ParameterSet], fit: Fitted | None) -> str:
    """Parameter sets, and the fit if they are of one, as JSON: SI, null where there is no value.

    `sets` are the values on each surface with each ball, at the best fit. `parameters` and
    `derived` have the estimates of a fit: numbers, prior, verdict, whether the data determine the
    value (`determined`), and the reason. `correlation` is that of the free parameters, of the
    draws.
    """
    first = sets[0]
    content: dict[str, object] = {
        "kind": JSON_KIND,
        "version": JSON_VERSION,
        "fitball": __version__,
        "units": "SI, angles in radians",
        "model": {
            "name": first.model.name,
            "text": first.model.text,
            "options": dict(first.model.options),
        },
        "fitted": fit is not None,
        "origin": first.origin,
        "sets": [
            {
                "label": parameters.label,
                "values": dict(parameters.values),
                "remarks": dict(parameters.sources),
                "measured": _range(parameters),
            }
            for parameters in sets
        ],
    }
    if fit is not None:
        content |= _of_fit(fit)
    # msgspec writes null for numbers that are not finite.
    encoded = json.encode(content, enc_hook=lambda number: number.item())
    return json_bytes(json.decode(encoded)).decode()


def _range(parameters: ParameterSet) -> dict[str, list[float]] | None:
    """Smallest and largest value of each incident column on this surface, SI; None without
    impacts.
    """
    if parameters.impacts is None:
        return None
    return {
        name: [float(column.min()), float(column.max())]
        for name, column in vars(parameters.impacts).items()
    }


def _of_fit(fit: Fitted) -> dict[str, object]:
    """The fields of JSON that only a fit has."""
    table = fit.run.table
    content: dict[str, object] = {
        "table": {
            "name": table.name,
            "impacts": len(table),
            "sha256": [entry.get("sha256", "") for entry in table.read],
        },
        "status": fit.status,
        "adequacy": {"answer": fit.adequacy.answer, "sentence": fit.adequacy.sentence},
        "not_determined": [
            estimate.name
            for estimate in fit.reported
            if estimate.verdict not in (*DETERMINED_BY_DATA, "fixed")
        ],
        "parameters": {name: _estimate(estimate) for name, estimate in fit.parameters.items()},
        "derived": {name: _estimate(estimate) for name, estimate in fit.derived.items()},
        "modes": [asdict(mode) for mode in fit.modes],
        "correlation": None,
    }
    if fit.posterior is not None:
        matrix = fit.correlation
        content["correlation"] = {
            "names": list(matrix.columns),
            "values": matrix.to_numpy().tolist(),
        }
    return content


def _estimate(estimate: Estimate) -> dict[str, object]:
    """The fields of an estimate but its name, which is its key, and whether it is determined."""
    fields = asdict(estimate) | {"determined": estimate.verdict in DETERMINED_BY_DATA}
    return {key: value for key, value in fields.items() if key != "name"}


class _Row(NamedTuple):
    """A quantity as texts of a table. `sd` and `interval` are empty without a posterior; `mark`
    refers to its `note`, which is empty where there is none.
    """

    name: str
    symbol: str
    meaning: str
    value: str
    sd: str
    interval: str
    unit: str
    note: str
    mark: str = ""


def _rows(fit: Fitted) -> Iterator[_Row]:
    """Rows of the parameters of model and levels, of derived quantities, then of the noise."""
    for row in frame_rows(fit.summary):
        if row.text("kind") not in (*MAIN_KINDS, "noise"):
            continue
        unit = unit_of(fit, row.text("name"))
        name = row.text("name")
        sampled = bool(np.isfinite(row.number("median"))) and row.number("sd") > 0.0
        # A few far draws make an sd that no reader expects after a plus-minus sign.
        wide = 0.5 * (row.number("q84") - row.number("q16"))
        middle = row.number("median") if sampled else row.number("point")
        value, _, sd = unit.plus_minus(middle, wide).partition(" ± ")
        interval = interval_text(fit, row, unit) if sampled else ""
        shown, _ = shown_texts(fit, row, unit)
        if shown[:1] in ("<", ">"):
            value, sd, interval = shown, "", ""
        yield _Row(
            name,
            fit.quantity(name).spec.symbol,
            row.text("meaning"),
            value,
            sd,
            interval,
            unit.name,
            _REMARKS.get(row.text("verdict"), ""),
        )


def _chosen_rows(fit: Fitted, chosen: Sequence[str]) -> list[_Row]:
    """The rows of these names in their order, all without any. Raises ParameterError."""
    rows = {row.name: row for row in _rows(fit)}
    for name in chosen:
        if name not in rows:
            raise ParameterError(f"no row '{name}': {suggestion(name, rows)}", "unknown-quantity")
    return [rows[name] for name in dict.fromkeys(chosen or rows)]


def _marked(rows: Sequence[_Row]) -> tuple[list[_Row], list[tuple[str, str]]]:
    """Rows with the marks of their notes, a, b, c in the order in which they come first, and each
    mark with its note.
    """
    marks = dict[str, str]()
    marked = []
    for row in rows:
        mark = ""
        if row.note:
            mark = marks.setdefault(row.note, "abcde"[len(marks)])
        marked.append(row._replace(mark=mark))
    return marked, [(mark, words) for words, mark in marks.items()]


def _caption(fit: Fitted) -> str:
    """The caption of a table of parameters: model, data, and what its numbers are."""
    what = "point estimates"
    if fit.posterior is not None:
        what = (
            "posterior median, half of the central 68 % interval, 95 % interval; values "
            "without them are fixed"
        )
    model = fit.problem.forward.model.text
    table = fit.run.table
    caption = (
        f"Parameters of {model} fitted to {len(table):,} impacts ({one_line(table.name)}): {what}."
    )
    if fit.adequacy.answer == "does not describe":
        caption += " The model does not describe these data."
    if fit.status == "not converged":
        caption += " The sampler did not converge."
    return caption


def as_latex(fit: Fitted, chosen: Sequence[str] = (), *, siunitx: bool = False) -> str:
    """The parameters of a fit, or those chosen, as a `table` environment of LaTeX, narrow enough
    for a column of `article`; it needs the package booktabs, or with `siunitx` that one as well.

    Texts of users are escaped, so that none is a command.

    Raises:
        ParameterError: there is no such quantity (`unknown-quantity`).
    """
    rows, notes = _marked(_chosen_rows(fit, chosen))
    packages = ("booktabs", "siunitx") if siunitx else ("booktabs",)
    lines = [
        *(rf"% needs \usepackage{{{package}}}" for package in packages),
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{{_latex(_caption(fit))}}}",
        r"  \footnotesize",
        r"  \setlength{\tabcolsep}{3pt}",
        r"  \begin{tabular}{@{}p{0.44\linewidth}ll@{}}",
        r"    \toprule",
        r"    Parameter & Value & 95\,\% interval \\",
        r"    \midrule",
    ]
    for row in rows:
        base, level = symbol_levels(row.name)
        symbol = row.symbol or _latex(base)
        if level:
            symbol += f", {_latex(level).replace(chr(0x2212), '$-$')}"
        unit = _si_unit(row.unit) if siunitx else _unit(row.unit)
        meaning = rf"\raggedright {symbol}{f' ({unit})' if unit else ''}: {_latex(row.meaning)}"
        mark = rf"$^{{\mathrm{{{row.mark}}}}}$" if row.mark else ""
        numbers = (_si_value(row), _si_interval(row)) if siunitx else _plain_numbers(row)
        lines.append(f"    {meaning} & {numbers[0]}{mark} & {numbers[1]} \\\\")
    lines += [r"    \bottomrule", r"  \end{tabular}"]
    # A box as wide as the column, in which long notes are broken.
    lines += [
        rf"  \par\smallskip\parbox{{\linewidth}}{{$^{{\mathrm{{{mark}}}}}$ {words}.}}"
        for mark, words in notes
    ]
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def _plain_numbers(row: _Row) -> tuple[str, str]:
    """Value with sd and interval of a row as LaTeX writes them without a package."""
    sd = rf" \pm {row.sd}" if row.sd else ""
    interval = row.interval.replace("...", r"\ldots")
    return f"${_power(row.value)}{sd}$", f"${_power(interval)}$" if interval else ""


def _si_value(row: _Row) -> str:
    """Value with sd of a row in a command of siunitx, which rounds nothing."""
    if row.value[:1] in ("<", ">"):
        return f"${_power(row.value)}$"
    return rf"\num{{{row.value}{f' +- {row.sd}' if row.sd else ''}}}"


def _si_interval(row: _Row) -> str:
    """The interval of a row in commands of siunitx; open ends are dots."""
    ends = row.interval.strip("[]").split(", ")
    if len(ends) < 2:
        return ""
    return f"[{', '.join(_LDOTS if end == '...' else rf'{chr(92)}num{{{end}}}' for end in ends)}]"


def _si_unit(unit: str) -> str:
    """A unit as siunitx writes it from letters, with products and powers of its own; empty without
    a unit.
    """
    power = re.match(r"1e(-?\d+) ", unit)
    text = unit[power.end() :] if power else unit
    text = text.replace("%", r"\percent").replace(" ", ".")
    times = rf"$10^{{{power[1]}}}$\," if power else ""
    return rf"{times}\unit{{{text}}}" if text else ""


def _latex(text: str) -> str:
    """A text of a user on one line, escaped for LaTeX, which may break a long word."""
    return " ".join(
        _BREAK.join(escaped(word[begin : begin + _PIECE]) for begin in range(0, len(word), _PIECE))
        if len(word) > 2 * _PIECE
        else escaped(word)
        for word in one_line(text, 1000).split(" ")
    )


def _power(number: str) -> str:
    """Numbers with a power of ten as LaTeX writes them."""
    return re.sub(
        r"e([+-])0*(\d+)",
        lambda match: rf" \times 10^{{{match[1].strip('+')}{match[2]}}}",
        number,
    )


def _unit(unit: str) -> str:
    """A unit as LaTeX writes it; empty without a unit."""
    text = re.sub(r"\b1e(-?\d+) ", r"10^{\1}\\,", unit)
    text = re.sub(r"\^(-?\d+)", r"^{\1}", text).replace(" ", r"\,").replace("%", r"\%")
    return rf"$\mathrm{{{text}}}$" if text else ""


def as_markdown(fit: Fitted, chosen: Sequence[str] = ()) -> str:
    """The parameters of a fit, or those chosen, as a table in Markdown.

    Raises:
        ParameterError: there is no such quantity (`unknown-quantity`).
    """
    rows, marks = _marked(_chosen_rows(fit, chosen))
    cells = []
    for row in rows:
        sd = f" ± {row.sd}" if row.sd else ""
        mark = f" ({row.mark})" if row.mark else ""
        cells.append(
            {
                "parameter": f"`{row.name}`",
                "meaning": row.meaning,
                "value": f"{row.value}{sd}{mark}",
                "95 % interval": row.interval,
                "unit": row.unit,
            }
        )
    notes = [f"({mark}) {words}." for mark, words in marks]
    table = Table("", cells, ("meaning", "unit"))
    return to_markdown(Report("Parameters", [Text([_caption(fit)]), table, Text(notes)]))
