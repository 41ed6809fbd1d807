"""Predictions of new impacts for a person: one document, for terminal and page."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from fitball.inference.prediction.new_impacts import NewPrediction, ObservableScore, OutputPrediction
from fitball.observables import COMPARED
from fitball.report.form.document import MOST_ROWS, Document, Part, Picture, Section, Table, Words, as_page, shortened
from fitball.report.form.numbers import Scale, decimals, fixed, listed, output_scale, percent, significant
from fitball.report.predict.rows import level_of, remarks_on
from fitball.wording import screen, spoken

# Up to so many impacts each has a section of its own, besides its line.
IN_FULL = 4
# Remarks on single impacts on a first screen, and in all; the file and JSON hold all.
FIRST_REMARKS, REMARKS = 3, 12
# Impacts that are named in a sentence.
MOST_NAMED = 4
CAPTION = (
    "Predicted rebounds: median, 68 % interval (thick) and 95 % interval (thin) of a new measurement. Where the "
    "noise is not known, they are of the rebound itself. Dots: measured values."
)


def predict_document(
    prediction: NewPrediction,
    ids: Sequence[str],
    scores: Sequence[ObservableScore] = (),
    seen: int = 0,
    title: str = "",
    pictures: Collection[str] = (),
    command: str | None = None,
) -> Document:
    """Impacts with their predicted rebounds, remarks on those that need one, and where the rebounds were measured
    their `scores`; `seen` impacts are among those of the fit. `command` is the line that made it.
    """
    count, table = len(ids), _brief_table(prediction, ids)
    odd = [k for k in range(count) if prediction.range.outside[k] or prediction.failures[k]]
    remarks = [f"{ids[k]}: {text}" for k in odd for text in remarks_on(prediction, k)] if count > 1 else []
    most = REMARKS if screen().full else FIRST_REMARKS
    lead: list[Part] = [Words(answer(prediction, ids, scores, seen), "lead", rank="first")]
    lead += [Picture(name, CAPTION, f"{CAPTION} {count} impacts.", rank="first") for name in pictures]
    if count > 1:
        lead += [Words([_reading(prediction)], rank="first"), table]
    sections = [
        Section("scores", "Measured minus predicted", [_score_table(scores)]),
        Section("remarks", "Limits of the prediction", [
            Words(shortened(remarks, most, _all()), "list", "terminal", rank="first"),
            Words(remarks[:MOST_ROWS], "list", "page"),
        ]),
        *(
            Section(f"impact-{k}", _heading(prediction, k, name), _in_full(prediction, k, alone=count == 1))
            for k, name in enumerate(ids if count <= IN_FULL else ())
        ),
        Section("repeat", "How to repeat this prediction", [
            Words([] if command is None else [command], "code", "page"),
        ], rank="folded"),
    ]  # fmt: skip
    return Document(title, lead, sections)


def predict_page(document: Document, prediction: NewPrediction, ids: Sequence[str]) -> str:
    """The document as a page of HTML with its figure."""
    from fitball.report.figures.canvas import rendered
    from fitball.report.form.document import DPI
    from fitball.report.predict.figure import predict_figure

    return as_page(document, {"rebounds": rendered(predict_figure(prediction, ids), "png", DPI)})


def answer(prediction: NewPrediction, ids: Sequence[str], scores: Sequence[ObservableScore], seen: int) -> list[str]:
    """The rebound of a single impact, or how many were predicted and where that is extrapolation; how it compares
    with what was measured.
    """
    count, outside = len(ids), np.flatnonzero(prediction.range.outside)
    if count == 1:
        outputs = [_with_unit(output) for output in prediction.outputs if output.name in COMPARED]
        where = f" ({level})" if (level := level_of(prediction, 0)) else ""
        sentences = [f"Predicted rebound{where}: {', '.join(outputs)}.", _reading(prediction)]
        sentences += ["Extrapolated: the impact is outside the range of the fitted data."] * len(outside)
    else:
        named = [ids[k] for k in outside[:MOST_NAMED]]
        named += [f"{len(outside) - MOST_NAMED:,} more"] * (len(outside) > MOST_NAMED)
        where = f"{len(outside):,} of them outside" if named else "all within"
        which = f": {listed(named)}" if named else ""
        sentences = [f"{count:,} impacts predicted, {where} the range of the fitted data{which}."]
    withheld = int(np.count_nonzero(prediction.withheld))
    if withheld:
        sentences.append(f"No intervals for {withheld:,} of {count:,}: most draws have no solution there.")
    if scores:
        rms = [f"{one.output} {output_scale(one.output).measured(one.rms, 2)}" for one in scores]
        kind = f"no validation: the fit used {seen:,} of the impacts" if seen else "validation on unseen impacts"
        within = [one.within_95 for one in scores if one.within_95 is not None]
        sentences.append(f"Rms of measured minus predicted: {', '.join(rms)} ({kind}).")
        if within:
            low, high = percent(min(within)), percent(max(within))
            ends = low if low == high else f"{low} to {high}"
            sentences.append(f"Measured values within their 95 % interval: {ends}.")
    return sentences


def _reading(prediction: NewPrediction) -> str:
    """What the brackets are."""
    if not prediction.draws:
        return "At the best-fit parameters, without intervals."
    silent = [output.name for output in prediction.outputs if output.name in COMPARED and output.measured is None]
    but = f" (of the rebound itself for {listed(silent)})" if silent else ""
    return f"Median and, in brackets, 95 % interval of a new measurement{but}."


def _with_unit(output: OutputPrediction) -> str:
    scale, places = _written(output, 0)
    ends = output.rebound if output.measured is None else output.measured
    if output.rebound is None or ends is None:
        return f"{output.name} {scale.fixed(output.point[0], places)} {scale.unit}"
    middle = scale.fixed(output.rebound[2, 0], places)
    return f"{output.name} {middle} {scale.interval(ends[0, 0], ends[4, 0], places)} {scale.unit}"


def _all() -> str:
    return spoken("--full, --out or --json", "see the data frame")


def _score_table(scores: Sequence[ObservableScore]) -> Table:
    rows = [["output", "impacts", "mean", "rms", "rms z", "within 68 %", "within 95 %"]]
    for score in scores:
        scale = output_scale(score.output)
        sizes = (score.bias * scale.factor, score.rms * scale.factor, score.rms_z)
        shares = ["-" if share is None else percent(share) for share in (score.within_68, score.within_95)]
        head = f"{score.output} [{scale.unit}]"
        rows.append([head, f"{score.impacts:,}", *(significant(size, 2) for size in sizes), *shares])
    return Table("Measured minus predicted", rows, rank="first")


def _heading(prediction: NewPrediction, row: int, name: str) -> str:
    impacts = prediction.impacts
    v_x, v_y, omega = impacts.v_x1[row], impacts.v_y1[row], impacts.omega_1[row]
    sense = "no spin" if omega == 0.0 else f"{abs(omega):.1f} rad/s {'topspin' if omega > 0.0 else 'backspin'}"
    angle = np.degrees(np.arctan2(v_y, v_x))
    where = f"{name} ({level})" if (level := level_of(prediction, row)) else name
    return f"{where}: {np.hypot(v_x, v_y):.2f} m/s at {angle:.1f} deg (v_x1 {v_x:.2f}, v_y1 {v_y:.2f} m/s), {sense}"


def _in_full(prediction: NewPrediction, row: int, alone: bool) -> list[Part]:
    """Everything on one impact; on a first screen where it is `alone`."""
    measured = any(output.observed is not None for output in prediction.outputs)
    if prediction.draws == 0:
        heads = ["", "point", *(["measured"] if measured else [])]
    else:
        heads = ["", "median", "rebound 68 %", "rebound 95 %", "measurement 68 %", "measurement 95 %"]
        heads += ["measured", "z"] if measured else []
    rows = [heads, *(_cells(output, row, measured) for output in prediction.outputs)]
    regimes = prediction.regimes[row]
    shares = [f"{name} {percent(share, fine=True)}" if prediction.draws else name for name, share in regimes.items()]
    points = _over(prediction, row)
    points += [f"regime: {', '.join(shares if prediction.draws else shares[:1])}"] if shares else []
    first = [head for head in heads if head not in ("rebound 68 %", "measurement 68 %")]
    return [
        Table("Rebound", rows, brief=first, rank="first" if alone else "full"),
        Words([*remarks_on(prediction, row), *points], "list", rank="first" if alone else "full"),
        _shares(prediction, row),
    ]


def _shares(prediction: NewPrediction, row: int) -> Table:
    """Standard deviations by their source; nothing where the incident state is exact."""
    rows = [["sd due to", "parameters", "incident state", "measurement"]]
    for output in prediction.outputs:
        if output.shares is None:
            continue
        scale, shares = output_scale(output.name), output.shares
        sds = [None if it is None else it[row] for it in (shares.parameters, shares.incident, shares.measurement)]
        cells = [scale.fixed(sd, 0 if sd is None else min(max(scale.decimals(sd), 0), 3)) for sd in sds]
        rows.append([f"{output.name} [{scale.unit}]", *cells])
    return Table("Sources of the uncertainty", rows)


def _over(prediction: NewPrediction, row: int) -> list[str]:
    """The range of each output over model assumptions; nothing where that was not examined."""
    parts = []
    for output in prediction.outputs:
        scale, places = _written(output, row)
        low, high = ("", "") if output.over is None else (scale.fixed(end, places) for end in output.over[:, row])
        parts += [f"{output.name} {low} to {high} {scale.unit}"] * (low != high)
    return [f"range across model variants that fit equally well: {', '.join(parts)}"] if parts else []


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


def _brief_table(prediction: NewPrediction, ids: Sequence[str]) -> Table:
    """One line for each impact: the median, and the 95 % interval of a new measurement (of the rebound where the
    noise is not known); a first screen has no room for the incident state and the angle.
    """
    impacts = prediction.impacts
    outputs = [output for output in prediction.outputs if output.name in COMPARED]
    heads = [f"{output.name} [{output_scale(output.name).unit}]" for output in outputs]
    levels = prediction.levels
    rows = [["impact", *levels, "v_1 [m/s]", "theta_1 [deg]", "omega_1 [rad/s]", *heads]]
    for k, name in enumerate(ids[:MOST_ROWS]):
        mark = "*" if prediction.range.outside[k] or prediction.failures[k] else ""
        angle = np.degrees(np.arctan2(impacts.v_y1[k], impacts.v_x1[k]))
        speed = np.hypot(impacts.v_x1[k], impacts.v_y1[k])
        row = [name + mark, *(labels[k] for labels in levels.values())]
        row += [f"{speed:.1f}", f"{angle:.1f}", f"{impacts.omega_1[k]:.0f}"]
        for output in outputs:
            scale, places = _written(output, k)
            ends = output.rebound if output.measured is None else output.measured
            if output.rebound is None or ends is None:
                row.append(scale.fixed(output.point[k], places))
            else:
                within = scale.interval(ends[0, k], ends[4, k], places)
                row.append(f"{scale.fixed(output.rebound[2, k], places)} {within}")
        rows.append(row)
    first = [*levels, *(head for head, output in zip(heads, outputs, strict=True) if output.name != "theta_2")]
    return Table("Predicted rebounds", rows, count=len(ids), rest=_all(), brief=first, rank="first")
