"""Models compared on one table, for a caller of Python and for the verb `compare`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Unpack

from fitball.api.fit import Fit
from fitball.api.progress import Wanted, reporting
from fitball.api.reading import PathLike, Reading, Table, read
from fitball.data.scene import Scene
from fitball.data.table import ImpactTable
from fitball.inference.comparison import results
from fitball.inference.comparison.candidates import Candidates, build_candidates, default_names
from fitball.inference.comparison.compare import ESS, MAX_STEPS
from fitball.inference.comparison.compare import compare as run_comparison
from fitball.inference.effort import Effort
from fitball.inference.results.results import RunStatus
from fitball.kinds import checked
from fitball.report.compare.document import render, words
from fitball.report.compare.rows import csv_rows, json_content
from fitball.report.form.document import columns as aligned
from fitball.report.form.folders import clear_folder, held
from fitball.scheduling.engine import Engine, engine

if TYPE_CHECKING:
    import pandas as pd

    from fitball.report.figures.canvas import Figure


class Comparison:
    """What `compare` found: models best first, each with its fit (`comparison["two-mass"]`), scores by impacts left
    out, and a recommendation.
    """

    def __init__(self, result: results.Comparison) -> None:
        self.result = result

    @cached_property
    def words(self) -> str:
        """The recommendation."""
        return words(self.result)

    @property
    def status(self) -> RunStatus:
        """Converged when every fit is."""
        return self.result.status

    @property
    def notes(self) -> tuple[str, ...]:
        """What one should know."""
        return self.result.notes

    @property
    def names(self) -> tuple[str, ...]:
        """The models, best first."""
        return tuple(self.result.by_name)

    def __getitem__(self, name: str) -> Fit:
        """The fit of a model."""
        return Fit.of(self.result.by_name[name].fit)

    def __repr__(self) -> str:
        head = f"<Comparison of {len(self.names)} models on {self.result.table.name}: {self.status}>"
        gaps = [self.result.elpd_difference(name, self.names[0]) for name in self.names]
        rows = [["", "elpd difference", "stacking"]] + [
            [name, f"{gap.value:.1f} +- {gap.se:.1f}", f"{self.result.stacking[name]:.2f}"]
            for name, gap in zip(self.names, gaps, strict=True)
        ]
        return "\n".join([head, *(f"  {line}" for line in aligned(rows))])

    def _repr_html_(self) -> str:
        """The summary, as a notebook shows it."""
        return f"<p>{self.words}</p>{self.summary().to_html(notebook=True)}"

    def summary(self) -> pd.DataFrame:
        """One row a model, best first: scores, weights, criteria and errors on impacts left out, in SI."""
        import pandas as pd

        return pd.DataFrame(csv_rows(self.result)).set_index("model")

    def report(self) -> str:
        """All of it as text."""
        return render(self.result)

    def json(self) -> Mapping[str, object]:
        """All of it as `compare.json` has it."""
        return json_content(self.result, self.words)

    def plot(self) -> Figure:
        """Scores and errors of the models, as a matplotlib Figure that pyplot does not know."""
        from fitball.report.compare.figures import compare_figure

        return compare_figure(self.result)

    @checked
    def save(self, folder: PathLike, *, overwrite: bool = False) -> Path:
        """Write `compare.json`, tables and figures. Raises ResultFolderError."""
        from fitball.report.compare.document import JSON_NAME, write_all

        path = Path(folder)
        with held(path):
            clear_folder(path, JSON_NAME, overwrite=overwrite)
            write_all(self.result, path)
        return path

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Comparison):
            return NotImplemented
        timeless = [{key: value for key, value in item.json().items() if key != "seconds"} for item in (self, other)]
        return timeless[0] == timeless[1]

    def __hash__(self) -> int:
        return hash((self.names, self.result.seed, self.result.table.digest))


@dataclass(frozen=True)
class Contest:
    """A comparison that may begin, and what is to be said before it does."""

    table: ImpactTable
    candidates: Candidates
    effort: Effort
    engine: Engine
    quick: bool
    said: tuple[str, ...]

    def compare(self, report: Callable[[str], None] = lambda _stage: None) -> Comparison:
        """Fit and score every model. Raises as `inference.comparison.compare` does."""
        return Comparison(run_comparison(self.table, self.candidates, self.effort, self.engine, self.quick, report))


def contest(
    data: Table | Sequence[Table],
    models: str | Sequence[str] | None,
    *,
    quick: bool,
    seed: int,
    max_steps: int | None,
    cores: int | None,
    scheduler: str | None,
    **reading: Unpack[Reading],
) -> Contest:
    """A comparison of models on a table, see `compare`. Raises ParameterError before anything is fitted."""
    table, known, doubts, _files = read(data, **reading)
    workers = engine(cores, scheduler)
    effort = Effort(seed=seed, max_steps=MAX_STEPS if max_steps is None else max_steps, cores=1, ess=ESS)
    named = (models,) if isinstance(models, str) else models
    names, said = default_names(table, quick) if named is None else (tuple(named), [])
    candidates = build_candidates(table, known, names)
    for candidate in candidates.candidates:
        effort.settings(candidate.problem)
    candidates = replace(candidates, notes=(*doubts, *candidates.notes))
    return Contest(table, candidates, effort, workers, quick, (*table.remarks, *doubts, *known.assumed, *said))


@checked
def compare(
    data: Table | Sequence[Table],
    models: Sequence[str] | None = None,
    *,
    scene: Scene | None = None,
    config: PathLike | None = None,
    units: Mapping[str, str] | None = None,
    quick: bool = False,
    flip: str | Sequence[str] = (),
    columns: Mapping[str, str] | None = None,
    as_read: bool = False,
    seed: int = 1,
    max_steps: int | None = None,
    cores: int | None = None,
    scheduler: str | None = None,
    progress: Wanted = None,
) -> Comparison:
    """Compare models on a table by predictions of impacts left out, as the verb `compare` does.

    `models` are names such as `two-mass+torsion=free` (default: those that can differ on this table, with `quick` the
    main ones); for the table and its options (`scene`, `units`, `flip`, ...) see `calibrate`.
    `cores` models are fitted at once (default: as many as the machine has), each in a process, or as many as there
    are workers on the Dask cluster whose `scheduler` is at that address; results are the same bytes. Raises
    subclasses of FitballError.

    >>> fitball.compare("wang_zero_spin", ["brody"], cores=1)
    Traceback (most recent call last):
    ...
    fitball.errors.FitError: a comparison needs at least two different models; there is 1: name more (models)
    """
    asked = contest(
        data, models, quick=quick, seed=seed, max_steps=max_steps, cores=cores, scheduler=scheduler, scene=scene,
        config=config, units=units, flip=flip, columns=columns, as_read=as_read,
    )  # fmt: skip
    with reporting(progress) as report:
        return asked.compare(lambda stage: report(stage, None))
