"""Progress for a caller of Python: a bar where somebody looks on, nothing in scripts and tests."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from fitball.inference.sampling.convergence import Convergence
from fitball.inference.sampling.ensembles import Progress

# Is told the stage of a run and, while sampling, how far that is.
Report: TypeAlias = Callable[[str, Progress | None], None]
# True, False, a function that is told, or None: as it suits who looks on.
Wanted: TypeAlias = bool | Report | None


def silent(_stage: str, _progress: Progress | None) -> None:
    """Tell nobody."""


def somebody_looks_on() -> bool:
    """Whether this is a terminal or a notebook."""
    notebook = "ipykernel" in sys.modules and "IPython" in sys.modules
    return notebook or bool(sys.stderr is not None and sys.stderr.isatty())


@contextmanager
def reporting(wanted: Wanted) -> Iterator[Report]:
    """What tells of a run, and cleans up behind it."""
    if callable(wanted):
        yield wanted
    elif not (somebody_looks_on() if wanted is None else wanted):
        yield silent
    else:
        bar = Bar()
        try:
            yield bar
        finally:
            bar.close()


class Bar:
    """A bar of tqdm for terminals and notebooks: the stage, and while sampling the steps up to the next look at
    whether they are enough.
    """

    def __init__(self) -> None:
        with warnings.catch_warnings():
            # In a notebook without widgets tqdm asks for them; it writes text all the same.
            warnings.simplefilter("ignore")
            from tqdm.auto import tqdm

            self.bar: Any = tqdm(total=1, leave=False, bar_format="{desc} {bar} {elapsed}")

    def __call__(self, stage: str, progress: Progress | None) -> None:
        """Show a stage, or a step of the sampler."""
        self.bar.set_description_str(stage if progress is None else sampling_words(progress), refresh=False)
        self.bar.total = 1 if progress is None else max(progress.next_check, progress.step)
        self.bar.n = 0 if progress is None else progress.step
        self.bar.refresh()

    def close(self) -> None:
        """Leave no trace."""
        self.bar.close()


def sampling_words(progress: Progress) -> str:
    """How far the sampler is."""
    words = f"sampling: step {progress.step}"
    return words if progress.convergence is None else f"{words}, {_convergence(progress.convergence)}"


def _convergence(found: Convergence) -> str:
    return f"effective sample size {found.min_ess:.0f} (wanted 1000), R-hat {found.max_r_hat:.3f} (below 1.01)"
