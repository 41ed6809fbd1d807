"""A lookup table as CSV, and what is known of it as JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from fitball.data.lines import parse_grid
from fitball.inference.prediction.lookup import SEED, Lookup, default_axes, make_lookup
from fitball.inference.results.results import Fit
from fitball.models.types import regime_name
from fitball.observables import SI_UNITS
from fitball.report.form.files import csv_text, json_text


def lookup_texts(saved: Fit, grid: str | None) -> Mapping[str, str]:
    """The table and its description. Raises ParameterError for a grid that is none."""
    axes = default_axes(saved.fitted) if grid is None else parse_grid(grid)
    lookup = make_lookup(saved.fitted, axes)
    content = json_text(_content(saved, lookup))
    return {".csv": csv_text(_rows(lookup)), ".json": content}


def lookup_note(texts: Mapping[str, str]) -> str:
    """The interpolation error in one line, and grid points that are extrapolated or have no rebound."""
    content = json.loads(texts[".json"])
    errors = content["interpolation"]["errors"]
    parts = [f"{name} {item['largest']:.2g} (RMS {item['rms']:.2g}) {item['unit']}" for name, item in errors.items()]
    note = f"largest error of interpolation: {', '.join(parts)}" if parts else "interpolation could not be checked"
    reasons = "; ".join(f"{count} of {content['points']} points have no rebound: {reason}"
                        for reason, count in content["points_without_rebound"].items())  # fmt: skip
    beyond, valid = content["points_extrapolated"], content["valid_range"]
    if beyond:
        note += (
            f"; {beyond} of {content['points']} points lie outside of v_y1 = {valid['v_y1_low']:.4g} to "
            f"{valid['v_y1_high']:.4g} m/s: restitution and offset stay there what they are at its ends (column "
            "extrapolated)"
        )
    return note + (f"; {reasons}" if reasons else "")


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
