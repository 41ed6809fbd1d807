"""The three best cases of the thesis beside a fit of the same impacts, as parts of a report."""

from __future__ import annotations

from collections.abc import Mapping

from fitball.inference.results.results import Fit
from fitball.inference.thesis.published_cases import CaseComparison, PublishedCase, compare_cases
from fitball.observables import COMPARED, OBSERVABLES
from fitball.report.fit.rows import thesis_rows
from fitball.report.form.document import Part, Table, Words
from fitball.report.form.numbers import THESIS, Scale, digits, handy, output_scale
from fitball.report.form.parameters import parameter_row

PARAMETERS = ("mass_ratio", "k_y", "k_theta", "mu", "eps_10", "eps_slope")
SI_UNITS = {"k_y": "N/m", "k_theta": "N m/rad", "eps_10": "m", "eps_slope": "m/(m/s)"}


CASES = (
    "{} The cases are those of Table 9 of Jafri (2004), with Eq. (53), and the damping and mean restitution of "
    "Chapter V, computed as the thesis does; this fit: {}. Thesis units first, SI below."
)


def case_parts(fit: Fit) -> list[Part]:
    """Fitted values and errors beside those of each case; nothing where the data are not Wang's."""
    given_columns = ("v_y2",) if fit.problem.model.needs_cor else ()
    cases = compare_cases(fit.problem.table, fit.point.rebound, given_columns)
    if cases is None:
        return []
    heads = ("quantity", "unit", "this fit", *(f"case {case.case}" for case in cases.cases))
    values = "the point estimate" if fit.posterior is None else "median and 95 % interval"
    return [
        Words([CASES.format(_sentence(fit, cases), values)], only="page"),
        Table("Parameters beside Table 9", [heads, *_values(fit, cases)], ["unit"], only="page"),
        Table("Root mean square errors on these impacts", [heads, *_errors(cases)], ["unit"], only="page"),
    ]


def _values(fit: Fit, cases: CaseComparison) -> list[tuple[str, ...]]:
    """Parameters in the thesis's units, then in handy multiples of SI where these differ."""
    rows: list[tuple[str, ...]] = []
    thesis = {row.name.rpartition(" = ")[2]: row for row in thesis_rows(fit)}
    fitted = {item.name: parameter_row(item) for item in (*fit.estimates, *fit.derived.values())}
    # The algebraic models have one offset at every speed.
    if "offset" in fitted:
        fitted["eps_10"], thesis["eps_10"] = fitted["offset"], thesis["offset"]
    for name in PARAMETERS:
        if name not in fitted:
            rows.append((name, THESIS[name].unit if name in THESIS else "", "not in this model", *_of(cases, name)))
            continue
        if name in THESIS:
            rows.append((name, THESIS[name].unit, thesis[name].within, *_of(cases, name)))
        scale = handy(name, SI_UNITS.get(name, ""))
        rows.append(("" if name in THESIS else name, scale.unit, fitted[name].within, *_of(cases, name, scale)))
    means = (f"{low:.2f} to {high:.2f} by spin" for low, high in (case.restitution for case in cases.cases))
    cor = fitted.get("cor_10") or fitted.get("cor")
    rows.append(("restitution", "", "measured" if cor is None else f"{cor.within} at 10 m/s", *means))
    return rows


def _of(cases: CaseComparison, name: str, scale: Scale | None = None) -> list[str]:
    chosen = scale or THESIS.get(name, Scale("", 1.0))
    return [digits(case.values[name] * chosen.factor, 3) for case in cases.cases]


def _errors(cases: CaseComparison) -> list[tuple[str, ...]]:
    """Root mean square errors as the thesis prints them (m/s, rad/s, degrees), and in SI where that differs."""
    rows = []
    for name in COMPARED:
        for k, scale in enumerate(dict.fromkeys((output_scale(name), Scale(OBSERVABLES[name].unit, 1.0)))):
            mine = _rms(cases.fitted_rms, name, scale)
            theirs = (_rms(case.rms, name, scale) for case in cases.cases)
            rows.append((name if k == 0 else "", scale.unit, mine, *theirs))
    return rows


def _rms(errors: Mapping[str, float], name: str, scale: Scale) -> str:
    return digits(errors[name] * scale.factor, 2) if name in errors else "told"


def _sentence(fit: Fit, cases: CaseComparison) -> str:
    free, mine = sum(name in fit.problem.model_names for name in fit.problem.free_names), cases.fitted_rms
    return (
        f"On these {len(fit.problem.table)} impacts the point estimate ({free} free parameters of the model) misses "
        f"v_x2 by {digits(mine['v_x2'], 2)} m/s and omega_2 by {digits(mine['omega_2'], 2)} rad/s, the three cases, "
        f"hand-tuned on Wang's impacts, {_range(cases.cases, 'v_x2', 'm/s')} and "
        f"{_range(cases.cases, 'omega_2', 'rad/s')} (root mean square)."
    )


def _range(cases: tuple[PublishedCase, ...], name: str, unit: str) -> str:
    texts = [digits(item.rms[name], 2) for item in sorted(cases, key=lambda item: item.rms[name])]
    return f"{texts[0]} {unit}" if texts[0] == texts[-1] else f"{texts[0]} to {texts[-1]} {unit}"
