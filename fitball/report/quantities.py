"""How pages and figures show quantities: units, symbols, values, probabilities."""

from typing import Annotated

import numpy as np

from fitball.base.columns import COLUMNS
from fitball.base.display_units import DEG, M_PER_S, RAD_PER_S
from fitball.base.numbers import Unit, percent
from fitball.base.text import at_level, short, symbol_levels, visible
from fitball.base.values import DataFrame, FloatArray
from fitball.inference.fitted import Fitted

# Kinds of quantities that a reader asks for; noise, ball and camera come after them.
MAIN_KINDS = ("model", "level", "derived")
# Least probability that draws can show, and least distance from one.
_LEAST_CHANCE = 1e-3
# Letters of a label in a figure.
_LABEL_LETTERS = 18
# Matplotlib takes `'` from a font in which it has the place of 0, which is what SVG then shows.
_PRIME = "\N{PRIME}"
# Impacts of the figure of predictions, evenly spread over more.
MOST_REBOUNDS = 400
# Units in which the state of an incident ball is shown, by column.
INCIDENT_UNITS = {"v_1": M_PER_S, "theta_1": DEG, "omega_1": RAD_PER_S}


def unit_of(fit: Fitted, name: str) -> Unit:
    """The unit in which people read a parameter or derived quantity of a fit.

    Raises:
        ParameterError: The fit has no such quantity (`unknown-quantity`).
    """
    return fit.quantity(name).spec.display_unit


def column_unit(name: str) -> Unit:
    """The unit in which people read a column of a table of impacts."""
    return COLUMNS[name].display_unit


def figure_text(text: str, most: int = _LABEL_LETTERS) -> str:
    """A text of a table for a figure: on one line, of at most so many letters, nothing in it a
    formula.
    """
    return short(visible(text).replace("\n", " "), most).replace("$", r"\$")


def quantity_symbol(fit: Fitted, name: str, most: int = _LABEL_LETTERS) -> str:
    """The symbol of a quantity as mathtext, or its name if it has none, with at most so many
    letters of its level.

    Raises:
        ParameterError: The fit has no such quantity (`unknown-quantity`).
    """
    base, level = symbol_levels(name)
    symbol = fit.quantity(name).spec.symbol.replace("'", _PRIME)
    shown = symbol or figure_text(base.replace("_", " "))
    # Two levels have the letters of two.
    letters = most if at_level(name)[1] else 2 * most
    return f"{shown}, {figure_text(level, letters)}" if level else shown


def median_or_point(frame: DataFrame) -> Annotated[FloatArray, "rows"]:
    """The median of each row of a frame, in SI, or the value of the best fit where there are no
    draws.
    """
    point = frame["point"].to_numpy(np.float64)
    median = frame["median"].to_numpy(np.float64)
    return np.where(np.isfinite(median), median, point)


def chance(share: float) -> str:
    """A probability that was counted among draws, as text. Since draws are never all that there
    are, it is at least 0.1 % and at most 99.9 %. Empty for NaN.
    """
    return percent(float(np.clip(share, _LEAST_CHANCE, 1.0 - _LEAST_CHANCE)))


def impact_rows(frame: DataFrame) -> DataFrame:
    """A row an impact: of a frame with a row an impact and measured column, those of its first
    column.
    """
    rows: DataFrame = frame[frame["column"] == frame["column"].iloc[0]]
    return rows


def scored_columns(models: DataFrame) -> list[str]:
    """The measured columns that a comparison scores."""
    return [name for name in COLUMNS if f"rms_{name}" in models.columns]
