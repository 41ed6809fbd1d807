"""Coefficients of restitution become rebound speeds.

`cor` is the ratio of the vertical speeds after and before the impact, `height_ratio` that of the
heights of rebound and drop. In vacuum that is the square of the other; in air it is less.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from fitball.base.itf import is_tennis_ball
from fitball.base.text import listed
from fitball.base.values import Ball, FloatArray
from fitball.data.cells import TableCells
from fitball.data.kinematics import Columns, velocity

# Ratios of tennis balls that may be of speeds, of balls that hardly bounce, or of heights: balls
# that rebound as the rules say rise to 0.53 to 0.59 of the drop height, and worn ones to 0.45.
_DOUBTFUL = (0.45, 0.62)
# Share by which a coefficient of restitution may differ from speeds beside it without a note.
_NOTED = 0.01
# Share by which it may not.
_GROSS = 0.2


def heights_of_ratios(
    cells: TableCells,
    columns: Columns,
    unnamed_cor: str,
    ball: Ball,
) -> dict[str, FloatArray]:
    """The columns (rows,) in SI with rebound heights in place of ratios of heights. `unnamed_cor`
    is what the column `cor` is called in the file, empty where the user says that it is `cor`.
    Faults: `no-drop-height`; `ambiguous-cor` where that of drop heights may be a ratio of heights.
    """
    with_heights = dict(columns)
    is_measured = "rebound_height" in columns or "v_y2" in columns
    if unnamed_cor and {"cor", "drop_height"} <= columns.keys() and not is_measured:
        _check_doubtful(cells, columns["cor"], unnamed_cor, ball)
    ratio = with_heights.pop("height_ratio", None)
    ratio_sd = with_heights.pop("height_ratio_sd", None)
    if ratio is None:
        return with_heights
    drop = columns.get("drop_height")
    if drop is None:
        words = (
            "a ratio of heights needs the drop height; expected a column drop_height, or --columns "
            '"cor=..." if it is the ratio of speeds'
        )
        cells.fault("no-drop-height", words, "height_ratio")
        return with_heights
    if "rebound_height" in columns:
        measured = columns["rebound_height"] / drop
        _compare(cells, "height_ratio", ratio, {"rebound_height/drop_height": measured})
        return with_heights
    with_heights["rebound_height"] = ratio * drop
    if ratio_sd is not None:
        with_heights["rebound_height_sd"] = ratio_sd * drop
    return with_heights


def _check_doubtful(cells: TableCells, cor: FloatArray, their: str, ball: Ball) -> None:
    """Add a fault where the ratios (rows,) of a tennis ball, called `their` in the file, may be of
    speeds or of heights.
    """
    median = float(np.median(cor[np.isfinite(cor)])) if np.isfinite(cor).any() else np.nan
    if is_tennis_ball(ball) and _DOUBTFUL[0] <= median <= _DOUBTFUL[1]:
        words = (
            f"the median, {median:.3g}, may be a ratio of speeds or of heights; expected which: "
            f'--columns "cor={their}" for speeds, --columns "height_ratio={their}" for heights'
        )
        cells.fault("ambiguous-cor", words, "cor")


def speeds_of_ratios(
    cells: TableCells,
    columns: Columns,
    corr: dict[str, FloatArray],
    heights: Columns,
) -> dict[str, FloatArray]:
    """The columns (rows,) in SI with v_y2 = cor v_y1 in place of `cor`, errors by JCGM 100:2008,
    Eq. 13: those of `cor` and v_y1 are independent, so that v_y2 is correlated with v_y1 (`corr`,
    by pair). Where a rebound was measured `cor` is compared with it; `heights` are columns before
    they became speeds. Faults: `contradiction`.
    """
    with_speeds = dict(columns)
    cor = with_speeds.get("cor")
    incident = velocity(columns, "1").get("v_y1", columns.get("v_y1"))
    if cor is None or incident is None:
        return with_speeds
    del with_speeds["cor"]
    cor_sd = with_speeds.pop("cor_sd", None)
    ratios = _ratios(columns, heights)
    if "v_y2" in velocity(columns, "2") or _nearest(cor, ratios)[1] < _NOTED:
        _compare(cells, "cor", cor, ratios)
        return with_speeds
    with_speeds["v_y2"] = cor * incident
    if np.isfinite(cor).any():
        cells.note("cor", _words(cor, cor_sd, "drop_height" in heights))
    incident_sd = columns.get("v_y1_sd")
    if cor_sd is None:
        return with_speeds
    of_cor = cor_sd * incident
    of_incident = 0.0 if incident_sd is None else cor * incident_sd
    with_speeds["v_y2_sd"] = np.hypot(of_cor, of_incident)
    if incident_sd is not None:
        corr["v_y1,v_y2"] = np.nan_to_num(of_incident / with_speeds["v_y2_sd"])
    return with_speeds


def _words(cor: FloatArray, sd: FloatArray | None, dropped: bool) -> str:
    """What was made of a column `cor`, and what it is not."""
    low, high = np.nanmin(cor), np.nanmax(cor)
    words = f"v_y2 is cor v_y1, cor {low:.3g} to {high:.3g}"
    if sd is not None:
        words += ", its sd cor_sd v_y1"
    if dropped:
        words += (
            ". It is taken as the ratio of speeds at the ground. If it is the root of a ratio of "
            "heights, give rebound_height: through air it is up to 0.03 too small"
        )
    return words


def _ratios(columns: Columns, heights: Columns) -> dict[str, FloatArray]:
    """What a coefficient of restitution (rows,) may be beside both ends of a bounce, by words."""
    before = velocity(columns, "1")
    after = velocity(columns, "2")
    ratios = {}
    with np.errstate(divide="ignore", invalid="ignore"):
        for first, second in (("v_y1", "v_y2"), ("v_1", "v_2")):
            if first in before and second in after:
                ratios[f"{second}/{first}"] = after[second] / before[first]
        if "drop_height" in heights and "rebound_height" in heights:
            ratio = heights["rebound_height"] / heights["drop_height"]
            ratios["the root of rebound_height/drop_height"] = np.sqrt(ratio)
            ratios["rebound_height/drop_height"] = ratio
    return ratios


def _nearest(read: FloatArray, ratios: Mapping[str, FloatArray]) -> tuple[str, float]:
    """Which of some ratios (rows,) a column is, and by which share it differs from that in the
    median; infinite where there is none, or no row has both.
    """
    nearest = ("", np.inf)
    for words, ratio in ratios.items():
        share = np.abs(read / ratio - 1.0)
        if np.isfinite(share).any() and float(np.nanmedian(share)) < nearest[1]:
            nearest = (words, float(np.nanmedian(share)))
    return nearest


def _compare(
    cells: TableCells,
    name: str,
    read: FloatArray,
    ratios: Mapping[str, FloatArray],
) -> None:
    """Note that a column of ratios (rows,) follows from others and is not used, and in which rows
    it differs from them. Faults: `contradiction`.
    """
    basis, _ = _nearest(read, ratios)
    if not basis:
        return
    expected = ratios[basis]
    share = np.abs(read / expected - 1.0)
    for row in np.flatnonzero(share > _GROSS).tolist():
        words = (
            f"read {read[row]:.4g}, but {basis} is {expected[row]:.4g}; expected agreement: check "
            "the row"
        )
        cells.fault("contradiction", words, name, row)
    cells.note("ratio-not-used", f"{name} is {basis}: it is not used")
    rows = np.flatnonzero((share > _NOTED) & (share <= _GROSS))
    if rows.size:
        where = f"{100.0 * float(share[rows].max()):.2g} %"
        numbers = listed(cells.rows[rows].astype(str))
        words = f"{name} differs from {basis} by up to {where} (rows {numbers})"
        cells.note("disagreement", words)
