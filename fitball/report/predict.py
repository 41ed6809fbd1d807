"""Predictions of new impacts: for a person as a document, for machines as flat rows and JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from fitball.inference.prediction.new_impacts import NewPrediction, ObservableScore, OutputPrediction
from fitball.inference.results.quantiles import BAND
from fitball.observables import COMPARED, OBSERVABLES
from fitball.report.form.document import MOST_LINES, Document, Part, Section, Table, Words
from fitball.report.form.numbers import INCIDENT, Scale, decimals, fixed, output_scale, percent, significant
from fitball.values import FloatArray
from fitball.wording import spoken

# Up to so many impacts each has a section of its own; of more each has a line.
IN_FULL = 4
# Remarks on single impacts that are printed; the file and JSON hold all.
REMARKS = 12


def predict_document(
    prediction: NewPrediction, ids: Sequence[str], scores: Sequence[ObservableScore] = (), seen: int = 0
) -> Document:
    """Impacts with their predicted rebounds, remarks on those that need one, and where the rebounds were measured
    their `scores`; `seen` impacts are among those of the fit.
    """
    count, parts = len(ids), []
    if count <= IN_FULL:
        sections = [
            Section(f"impact-{k}", _heading(prediction, k, name), _in_full(prediction, k))
            for k, name in enumerate(ids)
        ]
    else:
        parts = _in_brief(prediction, ids)
        odd = [k for k in range(count) if prediction.range.outside[k] or prediction.failures[k]]
        remarks = [f"{ids[k]}: {text}" for k in odd for text in remarks_on(prediction, k)]
        left = [f"and {len(remarks) - REMARKS} more: {_all()}"] if len(remarks) > REMARKS else []
        outside = f"* outside what the fit was calibrated on ({np.count_nonzero(prediction.range.outside)} impacts)"
        sections = [Section("remarks", outside, [Words([*remarks[:REMARKS], *left], "list")])]
    title = "Measured against predicted: validation on unseen impacts"
    if seen:
        title = f"Measured against predicted: no validation, {seen} of {count} impacts are among those of the fit"
    rows = [["output", "impacts", "mean residual", "rms residual", "rms z", "within 68 %", "within 95 %"]]
    for score in scores:
        scale = output_scale(score.output)
        sizes = (score.bias * scale.factor, score.rms * scale.factor, score.rms_z)
        shares = ["-" if share is None else percent(share) for share in (score.within_68, score.within_95)]
        rows.append([f"{score.output} [{scale.unit}]", str(score.impacts), *map(significant, sizes), *shares])
    scored = Section("scores", title, [Table("Measured against predicted", rows)])
    return Document("", parts, [*sections, scored])


def _all() -> str:
    return spoken("see --out or --json", "see the data frame")


def _heading(prediction: NewPrediction, row: int, name: str) -> str:
    impacts = prediction.impacts
    v_x, v_y, omega = impacts.v_x1[row], impacts.v_y1[row], impacts.omega_1[row]
    sense = "no spin" if omega == 0.0 else f"{abs(omega):.1f} rad/s {'topspin' if omega > 0.0 else 'backspin'}"
    angle = np.degrees(np.arctan2(v_y, v_x))
    return f"{name}: {np.hypot(v_x, v_y):.2f} m/s at {angle:.1f} deg (v_x1 {v_x:.2f}, v_y1 {v_y:.2f} m/s), {sense}"


def _in_full(prediction: NewPrediction, row: int) -> list[Part]:
    measured = any(output.observed is not None for output in prediction.outputs)
    if prediction.draws == 0:
        heads = ["", "point", *(["measured"] if measured else [])]
    else:
        heads = ["", "median", "rebound 68 %", "rebound 95 %", "measurement 68 %", "measurement 95 %"]
        heads += ["measured", "z"] if measured else []
    said, shares = _over(prediction, row), prediction.regimes[row]
    told = [f"{name} {percent(share, fine=True)}" if prediction.draws else name for name, share in shares.items()]
    said += [f"regime: {', '.join(told if prediction.draws else told[:1])}"] if told else []
    return [
        Table("Rebound", [heads, *(_cells(output, row, measured) for output in prediction.outputs)]),
        _shares(prediction, row),
        Words([*said, *remarks_on(prediction, row)], "list"),
    ]


def _shares(prediction: NewPrediction, row: int) -> Table:
    """Standard deviations by what they come from; nothing where the incident state is exact."""
    rows = [["one sd owed to", "parameters", "incident state", "measurement"]]
    for output in prediction.outputs:
        if output.shares is None:
            continue
        scale, shares = output_scale(output.name), output.shares
        sds = [None if it is None else it[row] for it in (shares.parameters, shares.incident, shares.measurement)]
        cells = [scale.fixed(sd, 0 if sd is None else min(max(scale.decimals(sd), 0), 3)) for sd in sds]
        rows.append([f"{output.name} [{scale.unit}]", *cells])
    return Table("What the uncertainty comes from", rows)


def _over(prediction: NewPrediction, row: int) -> list[str]:
    """How far each output moves over assumptions; nothing where that was not looked at."""
    parts = []
    for output in prediction.outputs:
        scale, places = _written(output, row)
        low, high = ("", "") if output.over is None else (scale.fixed(end, places) for end in output.over[:, row])
        parts += [f"{output.name} {low} to {high} {scale.unit}"] * (low != high)
    return [f"over assumptions that the table cannot tell apart: {', '.join(parts)}"] if parts else []


def _written(output: OutputPrediction, row: int) -> tuple[Scale, int]:
    """The unit of an output, and the decimals that the uncertainty of the rebound supports, between none and three;
    three without one.
    """
    scale = output_scale(output.name)
    if output.rebound is None:
        return scale, 3
    levels = output.rebound[:, row] * scale.factor
    # A rebound that most draws agree on to the last digit has no inner interval.
    half = 0.5 * max(levels[3] - levels[1], 0.5 * (levels[4] - levels[0]))
    return scale, min(max(decimals(float(half)), 0), 3)


def _cells(output: OutputPrediction, row: int, measured: bool) -> list[str]:
    scale, places = _written(output, row)
    head = f"{output.name} [{scale.unit}]"
    observed = [scale.fixed(None if output.observed is None else output.observed[row], places)] * measured
    if output.rebound is None:
        return [head, scale.fixed(output.point[row], places), *observed]
    cells = [head, scale.fixed(output.rebound[2, row], places)]
    for levels in (output.rebound, output.measured):
        for low, high in ((1, 3), (0, 4)):
            cells.append("-" if levels is None else scale.interval(levels[low, row], levels[high, row], places))
    return [*cells, *observed, *[fixed(None if output.z is None else output.z[row], 1)] * measured]


def _in_brief(prediction: NewPrediction, ids: Sequence[str]) -> list[Part]:
    """One line per impact: the median, and the 95 % interval of a new measurement (of the rebound where the noise is
    not known).
    """
    impacts = prediction.impacts
    shown = [output for output in prediction.outputs if output.name in COMPARED]
    heads = ["impact", "v_1 [m/s]", "theta_1 [deg]", "omega_1 [rad/s]"]
    rows = [[*heads, *(f"{item.name} [{output_scale(item.name).unit}]" for item in shown)]]
    for k, name in enumerate(ids[:MOST_LINES]):
        mark = "*" if prediction.range.outside[k] or prediction.failures[k] else ""
        angle = np.degrees(np.arctan2(impacts.v_y1[k], impacts.v_x1[k]))
        speed = np.hypot(impacts.v_x1[k], impacts.v_y1[k])
        row = [name + mark, f"{speed:.1f}", f"{angle:.1f}", f"{impacts.omega_1[k]:.0f}"]
        for item in shown:
            scale, places = _written(item, k)
            ends = item.rebound if item.measured is None else item.measured
            if item.rebound is None or ends is None:
                row.append(scale.fixed(item.point[k], places))
            else:
                within = scale.interval(ends[0, k], ends[4, k], places)
                row.append(f"{scale.fixed(item.rebound[2, k], places)} {within}")
        rows.append(row)
    brackets = "Median, and in brackets 95 % of new measurements (of rebounds where their noise is not known)."
    return [Table("Impacts", rows, count=len(ids), rest=_all()), Words([brackets] if prediction.draws else [])]


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
            f"{percent(prediction.unsolved[row], fine=True)} of the draws cannot be solved there ({reasons}); {rest}."
        )
    return remarks


def _columns(output: OutputPrediction) -> dict[str, FloatArray]:
    """Every column of one output in SI, by what it is; those that do not exist are absent."""
    columns: dict[str, FloatArray] = {"point": output.point}
    if output.rebound is not None:
        columns["median"] = output.rebound[2]
        columns |= {f"mean_{name}": output.rebound[k] for k, name in enumerate(BAND) if name != "median"}
    if output.measured is not None:
        columns |= {f"data_{name}": output.measured[k] for k, name in enumerate(BAND) if name != "median"}
    if output.shares is not None:
        columns |= {"sd_parameters": output.shares.parameters, "sd_incident": output.shares.incident}
        if output.shares.measurement is not None:
            columns["sd_measurement"] = output.shares.measurement
    if output.over is not None:
        columns |= {"over_low": output.over[0], "over_high": output.over[1]}
    if output.observed is not None and output.residual is not None:
        columns |= {"measured": output.observed, "residual": output.residual}
    return columns


def _number(value: float) -> float | None:
    """None for what does not exist."""
    return None if math.isnan(value) else float(value)


def prediction_csv_rows(prediction: NewPrediction, ids: Sequence[str]) -> list[dict[str, object]]:
    """One row per impact; headers carry units. Intervals `mean_*` are of the rebound itself, `data_*` of a new
    measurement of it.
    """
    impacts, reach = prediction.impacts, prediction.range
    columns: dict[str, Sequence[object]] = {
        "id": ids,
        "v_x1 [m/s]": impacts.v_x1.tolist(),
        "v_y1 [m/s]": impacts.v_y1.tolist(),
        "omega_1 [rad/s]": impacts.omega_1.tolist(),
    }
    for output in prediction.outputs:
        scale = output_scale(output.name)
        for kind, column in _columns(output).items():
            columns[f"{output.name}_{kind} [{scale.unit}]"] = [_number(value) for value in column * scale.factor]
        if output.z is not None:
            columns[f"{output.name}_z"] = [_number(value) for value in output.z]
    columns["regimes"] = [
        "; ".join(f"{name} {share:.4g}" for name, share in row.items()) for row in prediction.regimes
    ]
    columns["failed"] = [sum(row.values()) for row in prediction.failures]
    columns["failed_because"] = ["; ".join(row) for row in prediction.failures]
    columns["intervals"] = [intervals_of(prediction, k) for k in range(len(impacts))]
    columns["outside"] = ["yes" if flag else "no" for flag in reach.outside]
    for name, beyond in reach.beyond.items():
        scale = INCIDENT[name]
        columns[f"{name}_beyond [{scale.unit}]"] = (beyond * scale.factor).tolist()
    if reach.hull_distance is not None:
        columns["hull_distance [m/s]"] = reach.hull_distance.tolist()
    columns["extrapolated"] = [_extrapolated(prediction, k) for k in range(len(impacts))]
    return [{name: column[k] for name, column in columns.items()} for k in range(len(impacts))]


def intervals_of(prediction: NewPrediction, row: int) -> str:
    """What the intervals of one impact are made of."""
    if prediction.draws == 0:
        return "none"
    if prediction.withheld[row]:
        return "withheld"
    return "the draws that can be solved" if prediction.failures[row] else "all draws"


def _extrapolated(prediction: NewPrediction, row: int) -> str:
    return " ".join(prediction.range.lines) if prediction.range.beyond["v_y1"][row] != 0.0 else ""


def prediction_json(
    prediction: NewPrediction, ids: Sequence[str], scores: Sequence[ObservableScore], notes: Sequence[str]
) -> dict[str, Any]:
    """All of it in SI (angles in radians), one object per impact."""
    reach = prediction.range
    impacts: list[dict[str, Any]] = []
    for k, name in enumerate(ids):
        outputs = {
            output.name: {kind: _number(column[k]) for kind, column in _columns(output).items()}
            | ({} if output.z is None else {"z": _number(output.z[k])})
            for output in prediction.outputs
        }
        state = {axis: float(getattr(prediction.impacts, axis)[k]) for axis in ("v_x1", "v_y1", "omega_1")}
        impacts.append(
            {"id": name}
            | state
            | {
                "outputs": outputs,
                "regimes": dict(prediction.regimes[k]),
                "failed": dict(prediction.failures[k]),
                "intervals": intervals_of(prediction, k),
                "outside": bool(reach.outside[k]),
                "beyond": {quantity: float(column[k]) for quantity, column in reach.beyond.items()},
                "hull_distance": None if reach.hull_distance is None else float(reach.hull_distance[k]),
                "extrapolated": _extrapolated(prediction, k).split(),
            }
        )
    return {
        "units": {output.name: OBSERVABLES[output.name].unit for output in prediction.outputs},
        "draws": prediction.draws,
        "calibrated": {name: list(ends) for name, ends in reach.limits.items()},
        "hull_slack": reach.slack,
        "impacts": impacts,
        "validation": [asdict(score) for score in scores],
        "outside": int(np.count_nonzero(reach.outside)),
        "notes": list(notes),
    }
