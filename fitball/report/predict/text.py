"""Predictions of new impacts as a person reads them on a terminal."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitball.inference.prediction.holdout_scores import ObservableScore
from fitball.inference.prediction.new_impacts import NewPrediction, OutputPrediction
from fitball.observables import COMPARED
from fitball.report.form.display_units import INCIDENT, output_scale
from fitball.report.form.rounding import decimals, fixed, interval, significant
from fitball.report.form.text_table import MOST_LINES, columns, more, wrapped
from fitball.wording import spoken

# Up to so many impacts each has a table of its own; more stand one per line.
IN_FULL = 4
# Remarks on single impacts that are printed; the file and JSON hold all.
REMARKS = 12


def render_prediction(prediction: NewPrediction, ids: Sequence[str]) -> str:
    """Impacts with their predicted rebounds, and remarks on those that need one."""
    count = len(ids)
    if count <= IN_FULL:
        blocks = [_in_full(prediction, k, name) for k, name in enumerate(ids)]
        return "\n\n".join("\n".join(block) for block in blocks)
    lines = _in_brief(prediction, ids)
    odd = [k for k in range(count) if prediction.range.outside[k] or prediction.failures[k]]
    remarks = [(ids[k], text) for k in odd for text in remarks_on(prediction, k)]
    if remarks:
        outside = np.count_nonzero(prediction.range.outside)
        lines += ["", f"* outside what the fit was calibrated on ({outside} impacts)"]
        lines += _wrapped(*(f"{name}: {text}" for name, text in remarks[:REMARKS]))
        if len(remarks) > REMARKS:
            lines.append(f"  and {len(remarks) - REMARKS} more: {_all()}")
    return "\n".join(lines)


def _all() -> str:
    return spoken("see --out or --json", "see the data frame")


def _wrapped(*texts: str) -> list[str]:
    return wrapped(texts, "  ", " " * 4)


def _heading(prediction: NewPrediction, row: int, name: str) -> str:
    impacts = prediction.impacts
    v_x, v_y, omega = impacts.v_x1[row], impacts.v_y1[row], impacts.omega_1[row]
    sense = "no spin" if omega == 0.0 else f"{abs(omega):.1f} rad/s {'topspin' if omega > 0.0 else 'backspin'}"
    angle = np.degrees(np.arctan2(v_y, v_x))
    return f"{name}: {np.hypot(v_x, v_y):.2f} m/s at {angle:.1f} deg (v_x1 {v_x:.2f}, v_y1 {v_y:.2f} m/s), {sense}"


def _in_full(prediction: NewPrediction, row: int, name: str) -> list[str]:
    lines = [_heading(prediction, row, name)]
    measured = any(output.observed is not None for output in prediction.outputs)
    if prediction.draws == 0:
        heads = ["", "point", *(["measured"] if measured else [])]
    else:
        heads = ["", "median", "rebound 68 %", "rebound 95 %", "measurement 68 %", "measurement 95 %"]
        heads += ["measured", "z"] if measured else []
    body = [_cells(output, row, measured) for output in prediction.outputs]
    lines += [f"  {line}" for line in columns([heads, *body])]
    lines += _shares(prediction, row)
    lines += _over(prediction, row)
    if prediction.regimes[row]:
        lines += _wrapped("regime: " + _regimes(prediction, row))
    return lines + _wrapped(*remarks_on(prediction, row))


def _shares(prediction: NewPrediction, row: int) -> list[str]:
    """Standard deviations by what they come from; nothing where the incident state is exact."""
    body = []
    for output in prediction.outputs:
        if output.shares is None:
            continue
        scale = output_scale(output.name)
        shares = (output.shares.parameters, output.shares.incident, output.shares.measurement)
        sizes = [None if sd is None else float(sd[row] * scale.factor) for sd in shares]
        cells = [fixed(size, 0 if size is None else min(max(decimals(size), 0), 3)) for size in sizes]
        body.append([f"{output.name} [{scale.unit}]", *cells])
    heads = ["one sd owed to", "parameters", "incident state", "measurement"]
    return ["", *(f"  {line}" for line in columns([heads, *body]))] if body else []


def _over(prediction: NewPrediction, row: int) -> list[str]:
    """How far each output moves over assumptions; nothing where that was not looked at."""
    parts = []
    for output in prediction.outputs:
        if output.over is None:
            continue
        scale, places = output_scale(output.name), _places(output, row)
        low, high = (fixed(float(end * scale.factor), places) for end in output.over[:, row])
        if low != high:
            parts.append(f"{output.name} {low} to {high} {scale.unit}")
    return _wrapped(f"over assumptions that the table cannot tell apart: {', '.join(parts)}") if parts else []


def _places(output: OutputPrediction, row: int) -> int:
    """Decimals that the uncertainty of the rebound supports, between none and three; three without one."""
    if output.rebound is None:
        return 3
    levels = output.rebound[:, row] * output_scale(output.name).factor
    # A rebound that most draws agree on to the last digit has no inner interval.
    half = 0.5 * max(levels[3] - levels[1], 0.5 * (levels[4] - levels[0]))
    return min(max(decimals(float(half)), 0), 3)


def _cells(output: OutputPrediction, row: int, measured: bool) -> list[str]:
    scale, places = output_scale(output.name), _places(output, row)
    cells = [f"{output.name} [{scale.unit}]"]
    observed = ["-"] if measured else []
    if output.observed is not None:
        observed = [fixed(float(output.observed[row] * scale.factor), places)]
    if output.rebound is None:
        return [*cells, fixed(float(output.point[row] * scale.factor), places), *observed]
    cells.append(fixed(float(output.rebound[2, row] * scale.factor), places))
    for levels in (output.rebound, output.measured):
        ends = None if levels is None else levels[:, row] * scale.factor
        for low, high in ((1, 3), (0, 4)):
            cells.append("-" if ends is None else interval(float(ends[low]), float(ends[high]), places))
    if measured:
        cells += [*observed, "-" if output.z is None else fixed(float(output.z[row]), 1)]
    return cells


def _regimes(prediction: NewPrediction, row: int) -> str:
    shares = prediction.regimes[row]
    if prediction.draws == 0:
        return next(iter(shares))
    return ", ".join(f"{name} {_percent(share)}" for name, share in shares.items())


def _percent(share: float) -> str:
    """A share of draws; what is rarer than one in a thousand is no certainty."""
    if share < 0.001:
        return "< 0.1 %"
    if 0.999 < share < 1.0:
        return "> 99.9 %"
    return f"{100.0 * share:.{1 if share < 0.1 else 0}f} %"


def _in_brief(prediction: NewPrediction, ids: Sequence[str]) -> list[str]:
    """One line per impact: the median, and the 95 % interval of a new measurement (of the rebound where the noise is
    not known).
    """
    impacts = prediction.impacts
    heads = ["impact", "v_1 [m/s]", "theta_1 [deg]", "omega_1 [rad/s]"]
    shown = [output for output in prediction.outputs if output.name in COMPARED]
    heads += [f"{item.name} [{output_scale(item.name).unit}]" for item in shown]
    rows = []
    for k, name in enumerate(ids[:MOST_LINES]):
        mark = "*" if prediction.range.outside[k] or prediction.failures[k] else ""
        angle = np.degrees(np.arctan2(impacts.v_y1[k], impacts.v_x1[k]))
        speed = np.hypot(impacts.v_x1[k], impacts.v_y1[k])
        cells = [name + mark, f"{speed:.1f}", f"{angle:.1f}", f"{impacts.omega_1[k]:.0f}"]
        rows.append([*cells, *(_brief_cell(item, k) for item in shown)])
    lines = [*columns([heads, *rows]), *more(len(ids), _all())]
    if prediction.draws:
        lines += [
            "",
            "Median, and in brackets 95 % of new measurements (of rebounds where their noise is not known).",
        ]
    return lines


def _brief_cell(output: OutputPrediction, row: int) -> str:
    scale, places = output_scale(output.name), _places(output, row)
    if output.rebound is None:
        return fixed(float(output.point[row] * scale.factor), places)
    ends = (output.rebound if output.measured is None else output.measured)[:, row] * scale.factor
    middle = fixed(float(output.rebound[2, row] * scale.factor), places)
    return f"{middle} {interval(float(ends[0]), float(ends[4]), places)}"


def remarks_on(prediction: NewPrediction, row: int) -> list[str]:
    """What is special about one impact: outside, extrapolated, not solvable for a share of the draws."""
    reach = prediction.range
    parts = []
    for name, beyond in reach.beyond.items():
        if beyond[row] != 0.0:
            scale = INCIDENT[name]
            low, high = (end * scale.factor for end in reach.limits[name])
            word = "above" if beyond[row] > 0.0 else "below"
            amount = abs(beyond[row]) * scale.factor
            parts.append(f"{name} {amount:.3g} {scale.unit} {word} {low:.4g} to {high:.4g} {scale.unit}")
    if reach.hull_distance is not None and reach.new_combination[row]:
        parts.append(
            f"combination of velocity and spin {reach.hull_distance[row]:.2g} m/s away from those calibrated on "
            f"(flagged from {reach.slack:.2g} m/s)"
        )
    remarks = ["outside the calibrated range: " + "; ".join(parts) + "."] if parts else []
    if reach.lines and reach.beyond["v_y1"][row] != 0.0:
        word = "line is" if len(reach.lines) == 1 else "lines are"
        amount = abs(float(reach.beyond["v_y1"][row]))
        remarks.append(f"the {' and '.join(reach.lines)} {word} extrapolated by {amount:.3g} m/s in v_y1.")
    reasons = "; ".join(prediction.failures[row])
    if reasons and prediction.draws == 0:
        remarks.append(f"the point estimate cannot be solved there: {reasons}.")
    elif reasons:
        rest = "that is most of them: no intervals" if prediction.withheld[row] else "intervals are of the rest"
        remarks.append(
            f"{_percent(prediction.unsolved[row])} of the draws cannot be solved there ({reasons}); {rest}."
        )
    return remarks


def render_scores(scores: Sequence[ObservableScore], seen: int, count: int) -> str:
    """Residuals and coverage of the measured columns; `seen` of the `count` impacts are among those of the fit."""
    heads = ["output", "impacts", "mean residual", "rms residual", "rms z", "within 68 %", "within 95 %"]
    rows = []
    for score in scores:
        scale, within = output_scale(score.output), (score.within_68, score.within_95)
        sizes = (score.bias * scale.factor, score.rms * scale.factor, score.rms_z)
        shares = ["-" if share is None else f"{100.0 * share:.0f} %" for share in within]
        head = [f"{score.output} [{scale.unit}]", str(score.impacts)]
        rows.append([*head, *map(significant, sizes), *shares])
    title = "Measured against predicted: validation on unseen impacts"
    if seen:
        title = f"Measured against predicted: no validation, {seen} of {count} impacts are among those of the fit"
    return "\n".join([title, "", *columns([heads, *rows])])
