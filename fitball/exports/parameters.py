"""The fitted parameters for other programs, as JSON with a schema (`parameters.schema.json`); and for a paper, as a
table in LaTeX (booktabs) and Markdown, rounded by the Particle Data Group's rule.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.adequacy import Answer
from fitball.inference.results.quantiles import ESSENTIALS
from fitball.inference.results.results import Estimate, Fit, LevelEstimate, RunStatus, Verdict
from fitball.models.registry import parameter_spec
from fitball.models.types import OUTPUTS
from fitball.report.form.document import markdown_table
from fitball.report.form.numbers import parameter_row
from fitball.report.saved.structure import plain
from fitball.version import __version__

SCHEMA_VERSION = 1
NUMBERS = ("point", *ESSENTIALS)
# What is told of the table.
TABLE = ("name", "file", "sha256", "impacts", "flipped", "columns")
_ESCAPES = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "|": r"\textbar{}", "<": r"\textless{}",
    ">": r"\textgreater{}",
}  # fmt: skip


def parameter_content(saved: Fit) -> dict[str, Any]:
    """What `parameters.schema.json` describes: SI, no nulls, absent numbers left out."""
    source, impacts, rebound = plain(saved.source), saved.golden.impacts, saved.golden.rebound
    columns = {name: getattr(rebound, name) for name in (*OUTPUTS, "regime")}
    parameter_set: dict[str, Any] = {
        "schema_version": SCHEMA_VERSION,
        "kind": "fitball parameter set",
        "fitball": __version__,
        "status": str(saved.status),
        "model": {"name": saved.fitted.model_name, "closures": dict(saved.fitted.options)},
        "ball": plain(saved.fitted.ball),
        "table": {key: source[key] for key in TABLE} | {"flipped": list(saved.source.flipped)},
        "parameters": {name: _parameter(parameter) for name, parameter in saved.parameters.items()},
    }
    if saved.levels:
        parameter_set["levels"] = _levels(saved.levels)
    if saved.correlation is not None:
        parameter_set["correlation"] = {"names": list(saved.free_names), "values": saved.correlation.tolist()}
    parameter_set["golden"] = {
        "impacts": {name: column for name, column in plain(impacts).items() if column is not None},
        "rebound": {name: column.tolist() for name, column in columns.items() if not np.isnan(column).any()},
    }
    return parameter_set


def _levels(listed: Sequence[LevelEstimate]) -> dict[str, Any]:
    """Values of the parameters that differ between surfaces, balls or tables: by parameter, then by label."""
    levels: dict[str, Any] = {}
    for item in listed:
        one = levels.setdefault(item.parameter, {"column": item.column, "values": {}})
        one["values"][item.label] = _known(item)
    return levels


def _known(item: Estimate | LevelEstimate) -> dict[str, float]:
    return {name: number for name in NUMBERS if (number := getattr(item, name)) is not None}


def role(name: str) -> str:
    """Whether a parameter belongs to the bounce, to the noise of a measurement, or to a group of impacts."""
    return "noise" if name in NOISE_SPECS else "model" if parameter_spec(name) is not None else "group"


def _parameter(parameter: Estimate) -> dict[str, Any]:
    content: dict[str, Any] = {
        "role": role(parameter.name),
        "unit": parameter.unit,
        "meaning": parameter.meaning,
        "fixed": parameter.verdict is Verdict.FIXED,
        "verdict": str(parameter.verdict),
        "prior": parameter.prior,
    }
    if parameter.given:
        content["given"] = list(parameter.given)
    return content | {name: getattr(parameter, name) for name in NUMBERS if getattr(parameter, name) is not None}


@dataclass(frozen=True)
class PaperRow:
    """One parameter as text, in a handy unit; `sd` and `interval_95` are empty without a posterior.

    `mark` refers to a note on what its uncertainty rests on, if not on the table alone.
    """

    name: str
    label: str
    meaning: str
    unit: str
    value: str
    sd: str = ""
    interval_95: str = ""
    mark: str = ""


MARKS = {
    Verdict.PRIOR_DOMINATED: "a",
    Verdict.ONE_SIDED: "b",
    Verdict.GIVEN: "c",
    Verdict.CONDITIONAL: "d",
    Verdict.UNEXAMINED: "e",
}
NOTES = {
    "a": "set by what was assumed beforehand rather than by the impacts",
    "b": "bounded by the impacts from one side only",
    "c": "rests on assumptions that the impacts cannot test",
    "d": "conditional: holds only as far as the model describes the impacts, which it does not, or not all",
    "e": "how far it rests on assumptions could not be examined",
}


def paper_rows(saved: Fit) -> tuple[PaperRow, ...]:
    """Every parameter: median and standard deviation, or the point estimate to four digits."""
    return tuple(_row(parameter) for parameter in saved.parameters.values())


def _row(parameter: Estimate) -> PaperRow:
    row = parameter_row(parameter)
    spec = parameter_spec(parameter.name) or NOISE_SPECS.get(parameter.name)
    paper = PaperRow(row.name, spec.label if spec is not None else "", parameter.meaning, row.unit, row.point)
    if row.median == "-" or parameter.verdict is Verdict.FIXED:
        return paper
    return replace(
        paper, value=row.median, sd=row.sd, interval_95=row.interval_95, mark=MARKS.get(parameter.verdict, "")
    )


def _caption(saved: Fit) -> str:
    """One sentence without markup."""
    table = saved.source
    what = "point estimates"
    if saved.status is not RunStatus.POINT_ONLY:
        what = "posterior median, standard deviation and 95 % interval; without them: a fixed value"
    fitted_to = f"fitted to {table.impacts} impacts ({table.name})"
    text = f"Parameters of the model {saved.fitted.model_name} {fitted_to}: {what}."
    described = saved.adequacy
    if described is not None and described.answer is Answer.FAILS:
        text += " The model does not describe these impacts."
    return text + (" The sampler did not converge." if saved.status is RunStatus.NOT_CONVERGED else "")


def latex_table(saved: Fit) -> str:
    """A `table` environment; needs the package booktabs."""
    lines = [
        "% needs \\usepackage{booktabs}",
        r"\begin{table}",
        r"  \centering",
        rf"  \caption{{{_escaped(_caption(saved))}}}",
        r"  \small",
        r"  \begin{tabular}{@{}lp{0.28\linewidth}rll@{}}",
        r"    \toprule",
        r"    Parameter & & Value & 95\,\% interval & Unit \\",
        r"    \midrule",
    ]
    for row in paper_rows(saved):
        mark = rf"$^{{\mathrm{{{row.mark}}}}}$" if row.mark else ""
        symbol = row.label or _escaped(row.name)
        value = rf"${row.value} \pm {row.sd}${mark}" if row.sd else f"${_power(row.value)}$"
        spread = f"${row.interval_95}$" if row.interval_95 else ""
        lines.append(
            rf"    {symbol} & \raggedright {_escaped(row.meaning)} & {value} & {spread} & {_unit(row.unit)} \\"
        )
    lines += [r"    \bottomrule", r"  \end{tabular}"]
    lines += [rf"  \par\smallskip\footnotesize $^{{\mathrm{{{mark}}}}}$ {note}." for mark, note in _notes(saved)]
    return "\n".join([*lines, r"\end{table}"]) + "\n"


def _notes(saved: Fit) -> list[tuple[str, str]]:
    used = {row.mark for row in paper_rows(saved)}
    return [(mark, note) for mark, note in NOTES.items() if mark in used]


def _escaped(text: str) -> str:
    return "".join(_ESCAPES.get(letter, letter) for letter in text)


def _power(number: str) -> str:
    """A number with a power of ten as LaTeX writes it."""
    return re.sub(r"e([+-])0*(\d+)$", lambda match: rf" \times 10^{{{match[1].strip('+')}{match[2]}}}", number)


def _unit(unit: str) -> str:
    if not unit:
        return ""
    text = re.sub(r"\b1e(-?\d+) ", r"10^{\1}\\,", unit).replace(" ", r"\,").replace("%", r"\%")
    return rf"$\mathrm{{{text}}}$"


def paper_markdown(saved: Fit) -> str:
    """The same as a Markdown table."""
    rows = [["parameter", "meaning", "value", "95 % interval", "unit"]]
    for row in paper_rows(saved):
        superscript = f" ({row.mark})" if row.mark else ""
        value = f"{row.value} ± {row.sd}{superscript}" if row.sd else row.value
        rows.append([f"`{row.name}`", row.meaning, value, row.interval_95, row.unit])
    notes = [f"({mark}) {note}." for mark, note in _notes(saved)]
    return "\n".join([_caption(saved), "", markdown_table(rows), *([""] if notes else []), *notes]) + "\n"
