"""Populations as a Python user and the terminal see them: one object with a frame, a report and a figure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from fitball.errors import ParameterError, suggestion
from fitball.report.batch.document import (
    LEVEL_HEADS,
    LEVELS,
    centre_heads,
    centre_rows,
    doubts_of_all,
    level_rows,
    pooled_cells,
)
from fitball.report.batch.populations import ALONE, POPULATION_CSV, Populated, population_rows
from fitball.report.form.document import Document, Part, Section, Table, Words, on_terminal

if TYPE_CHECKING:
    import pandas as pd

    from fitball.report.figures.canvas import Figure

NONE = (
    "No parameter is determined by the data of at least three tables. Name one, such as mu. Point fits do not count: "
    "they have no draws."
)


class Populations(Mapping[str, Populated]):
    """Parameters, or ratios of two, over the tables of a batch: `found["mu"]` is the population of one, in its
    coordinate. `to_frame()`, `report()` and `plot()` give values in the unit of the parameter.
    """

    def __init__(self, parts: Sequence[Populated], folder: Path) -> None:
        self._parts = {one.name: one for one in parts}
        self.folder = folder

    def __getitem__(self, name: str) -> Populated:
        """Raises KeyError, with those there are, for a quantity of which no population was asked."""
        if name not in self._parts:
            raise KeyError(f"{name}: {suggestion(name, self._parts)}")
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)

    def only(self, names: Sequence[str]) -> Populations:
        """Those of some quantities; all without names."""
        return Populations([self[name] for name in dict.fromkeys(names or self)], self.folder)

    @property
    def doubtful(self) -> bool:
        """Whether importance weights of a table are unreliable."""
        return any(one.population.doubtful for one in self.values())

    def to_frame(self) -> pd.DataFrame:
        """One row for each number, in SI (column `unit`): `kind` is mean, spread, spread within levels, level, new
        level, new table or table, `median` with `q025` and `q975` the value given all tables, and `alone_median` that
        of a table by itself.

        A spread is a standard deviation of the quantity itself, also where the population is one of logarithms.
        """
        import pandas as pd

        frame = pd.DataFrame([row for one in self.values() for row in population_rows(one)])
        names = {name: f"alone_{name}" for name in ALONE} | {f"pooled_{name}": name for name in ALONE}
        frame = frame.rename(columns=names)
        first = ["quantity", "kind", "level", "table", *ALONE, "unit"]
        return frame[[*first, *(name for name in frame.columns if name not in first)]]

    def report(self) -> str:
        """The result as text: mean and spread, each level, each table alone and given all others."""
        return on_terminal(self._document())

    def _document(self) -> Document:
        parts = tuple(self.values())
        tables = max((len(one.own) for one in parts), default=0)
        over = next((one.over for one in parts if one.over), "")
        heads = centre_heads(parts)
        rows = [(*row[:2], row[2].removeprefix("- of "), *row[3:]) for row in centre_rows((), parts)]
        names = sorted({name for one in parts for name in one.own})
        both = [head for one in parts for head in (f"{one.head} alone", "given all")]
        pooled = [pooled_cells(name, 0, (), parts) for name in names]
        remarks = dict.fromkeys(sentence for one in parts for sentence in one.remarks)
        lead: list[Part] = [
            Words([NONE] * (not parts), "lead", rank="first"),
            Table("Mean and spread over the tables", [(*heads[:2], "tables", *heads[3:]), *rows], rank="first"),
            Words([*remarks, *doubts_of_all(parts)], "list", rank="first"),
        ]
        levels = Table("Each level, and new tables there", [LEVEL_HEADS, *level_rows(parts)], rank="first")
        each = Table(
            "Tables alone and given all others", [("table", *both), *pooled], rest=POPULATION_CSV, rank="first"
        )
        place = [f"Every number: {self.folder / POPULATION_CSV}"] * bool(parts)
        sections = [
            Section("levels", "Levels", [Words([LEVELS] * bool(over)), levels] if over else []),
            Section("pooled", "Each table, given all others", [each] if parts else []),
            Section("", "", [Words(place, only="terminal", rank="first")]),
        ]
        on = f", by {over}" * bool(over)
        title = f"{', '.join(self) or 'Parameters'} over {tables:,} tables{on}"
        return Document(title, lead, sections)

    def plot(self) -> Figure:
        """Medians with 95 % intervals, a panel each: every table alone (grey) and given all others (up to 60 tables),
        every level, the mean and a new table. A matplotlib Figure, with its panels in `axes`.

        Raises ParameterError without a population.
        """
        from fitball.report.batch.figure import population_figure

        if not self:
            raise ParameterError(NONE)
        return population_figure(tuple(self.values()))

    def __repr__(self) -> str:
        told = []
        for one in self.values():
            middle, low, high = (end * one.scale.factor for end in one.ends(one.population.centre))
            unit = f" {one.scale.unit}" if one.scale.unit else ""
            told.append(f"{one.name} {middle:.4g} [{low:.4g}, {high:.4g}]{unit} over {len(one.own):,} tables")
        return f"<Populations: {'; '.join(told) or 'none'}>"

    def _repr_html_(self) -> str:
        """The rows, for a notebook."""
        return f"<p>{escape(repr(self)[1:-1])}</p>{self.to_frame().to_html(max_rows=20, notebook=True)}"
