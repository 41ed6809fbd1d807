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

from fitball.base.files import json_bytes
from fitball.base.text import at_level, one_line
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
# The letter and the note of each verdict in tables.
_REMARKS = {**_GIVEN, **UNSURE}
_MARKS = {
    verdict: (mark, words) for mark, (verdict, words) in zip("abcde", _REMARKS.items(), strict=True)
}


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
    refers to a note.
    """

    name: str
    symbol: str
    meaning: str
    value: str
    sd: str
    interval: str
    unit: str
    mark: str


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
        mark = _MARKS.get(row.text("verdict"), ("", ""))[0]
        yield _Row(
            name,
            fit.quantity(name).spec.symbol,
            row.text("meaning"),
            value,
            sd,
            interval,
            unit.name,
            mark,
        )


def _notes(rows: Sequence[_Row]) -> list[tuple[str, str]]:
    """The marks that stand in rows, each with its note."""
    used = {row.mark for row in rows}
    return [(mark, words) for mark, words in _MARKS.values() if mark in used]


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


def as_latex(fit: Fitted) -> str:
    """The parameters of a fit as a `table` environment of LaTeX, which needs the package booktabs.

    Texts of users are escaped, so that none is a command.
    """
    rows = list(_rows(fit))
    lines = [
        r"% needs \usepackage{booktabs}",
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{{_latex(_caption(fit))}}}",
        r"  \small",
        r"  \begin{tabular}{@{}lp{0.28\linewidth}rll@{}}",
        r"    \toprule",
        r"    Parameter & & Value & 95\,\% interval & Unit \\",
        r"    \midrule",
    ]
    for row in rows:
        base, level = at_level(row.name)
        symbol = row.symbol or _latex(base)
        if level:
            symbol += f", {_latex(level)}"
        mark = rf"^{{\mathrm{{{row.mark}}}}}" if row.mark else ""
        sd = rf" \pm {row.sd}" if row.sd else ""
        value = f"${_power(row.value)}{sd}{mark}$"
        interval = f"${row.interval.replace('...', chr(92) + 'ldots')}$" if row.interval else ""
        meaning = rf"\raggedright {_latex(row.meaning)}"
        lines.append(
            f"    {symbol} & {meaning} & {value} & {_power(interval)} & {_unit(row.unit)} "
            f"{chr(92) * 2}"
        )
    lines += [r"    \bottomrule", r"  \end{tabular}"]
    lines += [
        rf"  \par\smallskip\footnotesize $^{{\mathrm{{{mark}}}}}$ {words}."
        for mark, words in _notes(rows)
    ]
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def _latex(text: str) -> str:
    """A text of a user on one line, escaped for LaTeX."""
    return escaped(one_line(text, 1000))


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


def as_markdown(fit: Fitted) -> str:
    """The parameters of a fit as a table in Markdown."""
    rows = list(_rows(fit))
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
    notes = [f"({mark}) {words}." for mark, words in _notes(rows)]
    table = Table("", cells, ("meaning", "unit"))
    return to_markdown(Report("Parameters", [Text([_caption(fit)]), table, Text(notes)]))
