"""Parameters as a table for a paper: LaTeX (booktabs) and Markdown, rounded by the Particle Data Group's rule."""

from __future__ import annotations

import re
from dataclasses import dataclass

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.adequacy import Answer
from fitball.inference.results.results import Estimate, Fit, RunStatus, Verdict
from fitball.models.registry import parameter_spec
from fitball.report.form.display_units import handy
from fitball.report.form.rounding import decimals, fixed, interval, significant

_ESCAPES = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "|": r"\textbar{}", "<": r"\textless{}",
    ">": r"\textgreater{}",
}  # fmt: skip


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
    scale = handy(parameter.name, parameter.unit)
    spec = parameter_spec(parameter.name) or NOISE_SPECS.get(parameter.name)
    label = spec.label if spec is not None else ""
    head = (parameter.name, label, parameter.meaning, scale.unit)
    if parameter.median is None or parameter.sd is None or parameter.verdict is Verdict.FIXED:
        return PaperRow(*head, significant(parameter.point * scale.factor, 4))
    places = decimals(parameter.sd * scale.factor)
    low, high = (None if end is None else end * scale.factor for end in (parameter.q025, parameter.q975))
    value, sd = (fixed(number * scale.factor, places) for number in (parameter.median, parameter.sd))
    return PaperRow(*head, value, sd, interval(low, high, places), MARKS.get(parameter.verdict, ""))


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


def markdown_table(saved: Fit) -> str:
    """The same as a Markdown table."""
    lines = [_caption(saved), "", "| parameter | meaning | value | 95 % interval | unit |", "|---|---|---|---|---|"]
    for row in paper_rows(saved):
        superscript = f" ({row.mark})" if row.mark else ""
        value = f"{row.value} ± {row.sd}{superscript}" if row.sd else row.value
        cells = (f"`{row.name}`", row.meaning, value, row.interval_95, row.unit)
        # A label may hold what divides cells, or a line break.
        plain = (" ".join(cell.split()).replace("|", r"\|") for cell in cells)
        lines.append("|" + "".join(f" {cell} |" if cell else " |" for cell in plain))
    notes = [f"({mark}) {note}." for mark, note in _notes(saved)]
    return "\n".join([*lines, *([""] if notes else []), *notes]) + "\n"
