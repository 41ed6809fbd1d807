"""How pages and figures name quantities: unit, symbol, middle."""

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.display_units import DEG, M_PER_S, RAD_PER_S
from fitball.base.numbers import Unit, percent
from fitball.base.text import short, visible
from fitball.base.values import DataFrame, FloatArray
from fitball.inference.fitted import Fitted

# Kinds of quantities that a reader asks for; noise, ball and camera come after them.
MAIN_KINDS = ("model", "level", "derived")
# Letters of a label in a figure.
_LABEL = 18
# Impacts of the figure of predictions, evenly spread over more.
MOST_REBOUNDS = 400
# What is said of the state of an incident ball, and the unit.
INCIDENT_UNITS = {"v_1": M_PER_S, "theta_1": DEG, "omega_1": RAD_PER_S}


def unit_of(fit: Fitted, name: str) -> Unit:
    """The unit in which people read a parameter or derived quantity of a fit."""
    return fit.quantity(name).spec.display_unit


def column_unit(name: str) -> Unit:
    """The unit in which people read a column."""
    return COLUMNS[name].display_unit


def figure_text(text: str, most: int = _LABEL) -> str:
    """A text of a table as matplotlib draws it: one line, nothing in it a formula."""
    return short(visible(text).replace("\n", " "), most).replace("$", r"\$")


def symbol_of(fit: Fitted, name: str, most: int = _LABEL) -> str:
    """Mathtext of a quantity, with at most so many letters of its level, or the name of one that
    has no symbol.
    """
    base, bracket, level = name.partition("[")
    shown = fit.quantity(name).spec.symbol or figure_text(base.replace("_", " "))
    return f"{shown}, {figure_text(level[:-1], most)}" if bracket else shown


def median_or_point(frame: DataFrame) -> FloatArray:
    """The median of each row (rows,), and what the best fit says where there are no draws."""
    point = frame["point"].to_numpy(np.float64)
    median = frame["median"].to_numpy(np.float64)
    return np.where(np.isfinite(median), median, point)


def chance(share: float) -> str:
    """A probability counted among draws, which are never all that there are; empty for NaN."""
    return percent(float(np.clip(share, 1e-3, 1.0 - 1e-3)))


def first_rows(frame: DataFrame) -> DataFrame:
    """A row an impact of a frame with a row an impact and column."""
    rows: DataFrame = frame[frame["column"] == frame["column"].iloc[0]]
    return rows


def scored_columns(models: DataFrame) -> list[str]:
    """The measured columns that a comparison scores."""
    return [name for name in COLUMNS if f"rms_{name}" in models.columns]
