"""On which surface, and with which ball, each new impact is, where parameters of a fit differ between these."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fitball.data.labels import role_of
from fitball.errors import ParameterError
from fitball.inference.problem.level_names import at_level, checked_label, column_of, columns_of
from fitball.inference.problem.pooling import FEW_LEVELS, NEW
from fitball.inference.results.fitted_model import FittedModel
from fitball.visible import some

# The label of each impact, by column.
ImpactLevels = Mapping[str, tuple[str, ...]]
# Labels that are asked for: one for all impacts, or one for each.
Asked = Mapping[str, str | Sequence[str]]


def levels_of_impacts(
    fitted: FittedModel, count: int, asked: Asked, cells: Mapping[str, Sequence[str]], ids: Sequence[str] = ()
) -> ImpactLevels:
    """The labels (impacts,) of `count` impacts by column, as they were fitted or `new`: those of `cells`, the label
    columns of their table, and those `asked` for where the table has none. `ids` are the names of impacts.

    Raises ParameterError for impacts without a label, for labels that were not fitted, for those asked for where the
    table has labels, and for columns over which no parameter differs.
    """
    named, written = columns_of(fitted.levels, asked), written_columns(fitted, cells)
    found = {}
    for column in fitted.labels:
        own = written.get(column)
        labels = _labels(fitted, column, count, named.get(column), None if own is None else cells[own], ids)
        found[column] = _checked(fitted, column, labels, ids)
    return found


def written_columns(fitted: FittedModel, cells: Collection[str]) -> dict[str, str]:
    """For each column over which a parameter differs, the column of another table that names the same: the one of its
    name, else the only one that names surfaces, balls or places as it does.
    """
    found = {}
    for column in fitted.labels:
        same = [name for name in cells if column_of(fitted.levels, name) == column]
        role = role_of(column)
        alike = [name for name in cells if role is not None and role_of(name) is role]
        if same or len(alike) == 1:
            found[column] = (same or alike)[0]
    return found


def _labels(
    fitted: FittedModel,
    column: str,
    count: int,
    asked: str | Sequence[str] | None,
    cells: Sequence[str] | None,
    ids: Sequence[str],
) -> Sequence[str]:
    written = ("",) * count if cells is None else cells
    empty = [k for k, cell in enumerate(written) if not cell]
    if not empty and asked is not None:
        raise ParameterError(
            f"{at_level(column, asked if isinstance(asked, str) else '...')}: the table names a {column} in every "
            "row, which the prediction follows: leave it out, or remove the column"
        )
    if asked is None:
        if len(empty) == count:
            checked_label(fitted.levels, column, None)
        if empty:
            where = some([ids[k] if ids else f"impact {k + 1}" for k in empty])
            raise ParameterError(
                f"column {column} is empty for {where}: fill these cells, or name what they have by "
                f"{at_level(column, fitted.labels[column][0])}"
            )
        return written
    if isinstance(asked, str):
        return [cell or asked for cell in written]
    if len(asked) != count:
        raise ParameterError(f"levels: {column} has {len(asked)} labels, expected one for each of {count} impacts")
    return [cell or label for cell, label in zip(written, asked, strict=True)]


def _checked(fitted: FittedModel, column: str, labels: Sequence[str], ids: Sequence[str]) -> tuple[str, ...]:
    known = dict[str, str]()
    for k, label in enumerate(labels):
        if label in known:
            continue
        try:
            known[label] = checked_label(fitted.levels, column, label)
        except ParameterError as error:
            raise ParameterError(f"{ids[k]}: {error}" if len(set(labels)) > 1 and ids else str(error)) from None
    return tuple(known[label] for label in labels)


def by_levels(
    fitted: FittedModel, levels: ImpactLevels, count: int, seed: np.random.SeedSequence
) -> Iterator[tuple[FittedModel, NDArray[np.int64]]]:
    """The model at each combination of levels, and its impacts; the model as it is where none of its parameters has
    levels. One new surface is the same for all impacts.
    """
    if not fitted.levels:
        yield fitted, np.arange(count)
        return
    rows: dict[tuple[str, ...], list[int]] = {}
    for k, labels in enumerate(zip(*levels.values(), strict=True)):
        rows.setdefault(labels, []).append(k)
    for labels, places in rows.items():
        named = dict(zip(levels, labels, strict=True))
        yield fitted.at(named, np.random.default_rng(seed)), np.array(places, dtype=np.int64)


def is_new(fitted: FittedModel, levels: ImpactLevels, count: int) -> NDArray[np.bool_]:
    """Which impacts are on a surface, or with a ball, of which nothing was measured, (impacts,)."""
    found = np.zeros(count, dtype=np.bool_)
    for column, labels in levels.items():
        found |= np.array([label not in fitted.labels[column] for label in labels], dtype=np.bool_)
    return found


def new_words(fitted: FittedModel, columns: Sequence[str]) -> list[str]:
    """What to know of predictions for a new label of these columns."""
    notes = []
    for column in columns:
        known = fitted.labels[column]
        few = "" if len(known) >= FEW_LEVELS else (
            f"; {len(known)} of them say little of another one, so the intervals depend on the prior of the spread"
        )  # fmt: skip
        notes.append(
            f"{column} {NEW}: nothing was measured of it. Its parameters are drawn from the population of "
            f"{some(known)}, and the intervals are wider than theirs{few}"
        )
    return notes
