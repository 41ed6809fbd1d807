"""A fit in few words: the lines of its `repr`, a table for a notebook, a report in the manner of lmfit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

from fitball.inference.results.quantiles import SUMMARY
from fitball.inference.results.results import Estimate, Fit, Verdict
from fitball.report.fit.rows import sampler_words
from fitball.report.form.document import columns, wrapped
from fitball.report.form.numbers import listed
from fitball.report.form.parameters import ParameterRow, parameter_row

# Correlations that a report lists.
WORTH_TELLING = 0.5


def _head(saved: Fit) -> str:
    table, free = saved.source, len(saved.free_names)
    return (
        f"{saved.fitted.model_name} to {table.name}: {table.impacts:,} impacts, {free} free parameter"
        f"{'s' if free != 1 else ''}, {saved.status}"
    )


def _rows(saved: Fit) -> list[tuple[Estimate, ParameterRow]]:
    return [(item, parameter_row(item)) for item in saved.parameters.values()]


def _brief(saved: Fit) -> list[str]:
    """Whether the model describes the table, and the parameters that were fitted by what the table says of them."""
    adequacy, rows = saved.adequacy, _rows(saved)
    lines = [] if adequacy is None else [f"does the model describe the table: {adequacy.answer}"]
    for verdict in Verdict:
        told = [f"{item.name} = {row.plus_minus}" for item, row in rows if item.verdict is verdict]
        if told and verdict is not Verdict.FIXED:
            lines.append(f"{verdict}: {'; '.join(told)}")
    return lines


def short_text(saved: Fit) -> str:
    """What it is and what it found, in a few lines."""
    return "\n".join([f"<Fit of {_head(saved)}>", *wrapped(_brief(saved), "  ", " " * 4)])


def html_text(saved: Fit) -> str:
    """The same as a table of HTML."""
    heads = ("", "median", "sd", "95 %", "unit", "verdict")
    lines = []
    for item, row in _rows(saved):
        cells = (item.name, row.best, row.sd, row.interval_95, row.unit, row.verdict)
        shown = "".join(f"<td>{escape(cell)}</td>" for cell in cells[1:])
        lines.append(f'<tr title="{escape(item.meaning)}"><th>{escape(item.name)}</th>{shown}</tr>')
    top = "".join(f"<th>{head}</th>" for head in heads)
    return (
        f"<p><b>Fit of {escape(_head(saved))}</b>{''.join(f'<br>{escape(line)}' for line in _brief(saved)[:1])}</p>"
        f"<table><thead><tr>{top}</tr></thead><tbody>{''.join(lines)}</tbody></table>"
    )


def report_text(saved: Fit) -> str:
    """Outcome, statistics, parameters, correlations and notes."""
    measured = listed(saved.source.measurements)
    head = f"{saved.fitted.model_name} on {saved.source.name}: {saved.source.impacts:,} impacts with {measured}"
    closures = ", ".join(f"{name} = {value}" for name, value in saved.fitted.options.items())
    lines = ["[[Fit]]", f"    {head}; {len(saved.free_names)} free parameters"]
    lines += [f"    closures: {closures}"] if closures else []
    lines += wrapped([saved.verdict], " " * 4, " " * 4)
    lines += ["[[Statistics]]", *(f"    {name:<24} = {value}" for name, value in _statistics(saved).items())]
    lines += ["[[Parameters]] (median +- sd; 95 % interval; prior in SI)", *_parameter_lines(saved)]
    lines += [] if saved.correlation is None else _correlations(saved.free_names, saved.correlation.tolist())
    if saved.notes:
        lines += ["[[Notes]]", *wrapped(saved.notes, " " * 4, " " * 6)]
    return "\n".join(lines)


def _statistics(saved: Fit) -> dict[str, str]:
    sampler = saved.diagnostics
    told = {
        "log posterior": f"{saved.log_posterior:.3f}",
        "log likelihood": f"{saved.log_likelihood:.3f}",
        "chi-square": f"{saved.least_squares.chi_square:.3f}",
        "degrees of freedom": str(saved.least_squares.degrees_of_freedom),
    }
    if sampler is not None:
        told |= {
            "sampler": sampler_words(sampler),
            "effective sample size": f"{min(sampler.min_ess_bulk, sampler.min_ess_tail):.0f}",
            "R-hat": f"{sampler.max_r_hat:.4f}",
        }
    return told | {"seed": str(saved.seed)}


def _parameter_lines(saved: Fit) -> list[str]:
    cells = []
    for item, row in _rows(saved):
        fixed = item.verdict is Verdict.FIXED
        interval = "" if row.interval_95 == "-" else row.interval_95
        cells.append([f"{item.name}:", row.plus_minus, interval, "" if fixed else item.prior, row.verdict])
    return [f"    {line}" for line in columns(cells, left=5)]


def _correlations(names: Sequence[str], matrix: Sequence[Sequence[float]]) -> list[str]:
    """Pairs that are correlated by more than WORTH_TELLING, the strongest first."""
    pairs = [(abs(matrix[i][j]), names[j], names[i], matrix[i][j]) for i in range(len(names)) for j in range(i)]
    told = sorted((pair for pair in pairs if pair[0] > WORTH_TELLING), reverse=True)
    if not told:
        return []
    return [
        f"[[Correlations]] (those above {WORTH_TELLING:g})",
        *(f"    C({one}, {other}) = {value:+.3f}" for _size, one, other, value in told),
    ]


def summary_columns(saved: Fit) -> Mapping[str, list[object]]:
    """Columns of a table with one row a parameter, in SI; None where a point fit has no number."""
    known = saved.parameters.values()
    names = ("unit", *SUMMARY, "point", "prior", "contraction", "verdict", "ess_bulk", "ess_tail", "r_hat")
    table: dict[str, list[object]] = {name: [getattr(item, name) for item in known] for name in names}
    return table | {"verdict": [item.verdict_words for item in known]}
