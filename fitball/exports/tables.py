"""The bounce of a fit as tables of numbers: the golden impacts, what a port is fed with and what it should answer;
and rebounds on a grid, as CSV with what is known of them as JSON.
"""

from __future__ import annotations

from typing import Any

from fitball.data.lines import parse_grid
from fitball.inference.prediction.lookup import SEED, Lookup, default_axes, make_lookup
from fitball.inference.prediction.port_check import expected_outputs
from fitball.inference.results.results import Fit, Golden
from fitball.models.types import OUTPUTS, regime_name
from fitball.observables import INCIDENT_UNITS, SI_UNITS
from fitball.report.form.files import csv_text, json_text


def golden_ids(golden: Golden) -> tuple[str, ...]:
    """Names of the golden impacts."""
    return tuple(f"golden-{k}" for k in range(1, len(golden.impacts) + 1))


def golden_table(saved: Fit, inputs_only: bool = False) -> str:
    """CSV of the golden impacts to 17 digits, with the expected rebounds unless `inputs_only`."""
    golden = saved.golden
    expected = {} if inputs_only else expected_outputs(saved.fitted, golden)
    columns = {name: getattr(golden.impacts, name) for name in INCIDENT_UNITS}
    columns |= {name: expected[name] for name in OUTPUTS if name in expected}
    rows: list[dict[str, object]] = []
    for k, label in enumerate(golden_ids(golden)):
        row: dict[str, object] = {"id": label}
        row |= {f"{name} [{SI_UNITS[name]}]": repr(float(values[k])) for name, values in columns.items()}
        if saved.fitted.model.needs_cor and golden.impacts.cor is not None:
            row["cor"] = repr(float(golden.impacts.cor[k]))
        if not inputs_only:
            row["regime"] = regime_name(int(golden.rebound.regime[k]))
        rows.append(row)
    return csv_text(rows)


def lookup_texts(saved: Fit, range: str | None = None) -> tuple[dict[str, str], str]:
    """The table and its description, and a note. Raises ParameterError for a grid that is none."""
    lookup = make_lookup(saved.fitted, default_axes(saved.fitted) if range is None else parse_grid(range))
    return {".csv": csv_text(_rows(lookup)), ".json": json_text(_content(saved, lookup))}, _note(lookup)


def _note(lookup: Lookup) -> str:
    """The interpolation error in one line, and grid points that are extrapolated or have no rebound."""
    count, beyond, valid = len(lookup.points), int(lookup.extrapolated.sum()), lookup.valid
    errors = ", ".join(
        f"{name} {item.largest:.2g} (RMS {item.rms:.2g}) {SI_UNITS[name]}" for name, item in lookup.errors.items()
    )
    said = [f"largest error of interpolation: {errors}" if errors else "interpolation could not be checked"]
    if beyond:
        said.append(
            f"{beyond} of {count} points lie outside of v_y1 = {valid.low:.4g} to {valid.high:.4g} m/s: restitution "
            "and offset stay there what they are at its ends (column extrapolated)"
        )
    said += [f"{lost} of {count} points have no rebound: {reason}" for reason, lost in lookup.failed.items()]
    return "; ".join(said)


def _rows(lookup: Lookup) -> list[dict[str, object]]:
    names = {name: regime_name(int(name)) for name in set(lookup.regime.tolist())}
    rows = []
    for k, point in enumerate(lookup.points.tolist()):
        row: dict[str, object] = {
            f"{axis.name} [{axis.unit.symbol}]": f"{axis.unit.from_si(value):.12g}"
            for axis, value in zip(lookup.axes, point, strict=True)
        }
        for name, column in lookup.outputs.items():
            row[f"{name} [{SI_UNITS[name]}]"] = None if column[k] != column[k] else f"{column[k]:.12g}"
        row["regime"] = names[int(lookup.regime[k])]
        row["extrapolated"] = "yes" if lookup.extrapolated[k] else "no"
        rows.append(row)
    return rows


def _content(saved: Fit, lookup: Lookup) -> dict[str, Any]:
    units = {axis.name: axis.unit for axis in lookup.axes}
    return {
        "schema_version": 1,
        "kind": "fitball lookup table",
        "model": saved.fitted.model_name,
        "table": saved.source.file,
        "parameters": dict(saved.golden.parameters),
        "order": "the last axis varies fastest",
        "axes": [
            {"name": axis.name, "unit": axis.unit.symbol, "values": [*map(axis.unit.from_si, axis.values.tolist())]}
            for axis in lookup.axes
        ],
        "outputs": {name: SI_UNITS[name] for name in lookup.outputs},
        "points": len(lookup.points),
        "points_without_rebound": dict(lookup.failed),
        "points_extrapolated": int(lookup.extrapolated.sum()),
        "valid_range": {
            "v_y1_low": lookup.valid.low,
            "v_y1_high": lookup.valid.high,
            "unit": "m/s",
            "ends_below_by": lookup.valid.below,
            "ends_above_by": lookup.valid.above,
            "outside": "restitution and offset of the normal force stay what they are at the nearer end",
        },
        "interpolation": {
            "method": "multilinear in the axes",
            "checked_at": f"{lookup.checked} impacts: midpoints of cells, and random ones (seed {SEED})",
            "errors": {
                name: {
                    "unit": SI_UNITS[name],
                    "largest": item.largest,
                    "rms": item.rms,
                    "largest_at": {axis: units[axis].from_si(value) for axis, value in item.place.items()},
                }
                for name, item in lookup.errors.items()
            },
        },
    }
