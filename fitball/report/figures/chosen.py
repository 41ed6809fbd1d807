"""What a user chose of a figure: parameters, measured columns, groups."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from fitball.base.errors import ParameterError, suggestion


class Chosen(NamedTuple):
    """The `parameters`, measured `columns` and `groups`, labels of surfaces or balls, that a figure
    is to show; all or the usual ones where there are none.
    """

    parameters: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    groups: tuple[str, ...] = ()


# Nothing is chosen: figures as the page has them.
ALL = Chosen()


def chosen_of(available: Iterable[str], wanted: Sequence[str]) -> list[str]:
    """Those of the names `available` that are wanted, in that order; all without any.

    Raises:
        ParameterError: one is not available (`unknown-quantity`).
    """
    names = list(available)
    for name in wanted:
        if name not in names:
            text = f"figure: no '{name}' here: {suggestion(name, names)}"
            raise ParameterError(text, "unknown-quantity")
    return list(dict.fromkeys(wanted)) or names
