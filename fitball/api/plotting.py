"""Figures of a fit by name, from the registry of figures."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

from fitball.errors import ParameterError, suggestion
from fitball.inference.identifiability.examine import with_profiles
from fitball.inference.results.evidence import LEFT_OUT
from fitball.inference.results.results import Fit
from fitball.kinds import checked
from fitball.report.figures.registry import FIGURES
from fitball.scheduling.engine import engine

if TYPE_CHECKING:
    from fitball.report.figures.canvas import Figure


class Plots:
    """Figures of a fit: `fit.plot.corner()` or `fit.plot("corner")` gives a matplotlib Figure, whose panels are its
    `axes`. None is known to pyplot: nothing has to be closed, and a notebook shows the one that a cell ends with.
    """

    def __init__(self, fit: Fit) -> None:
        self._fit = fit

    @checked
    def __call__(self, kind: str) -> Figure:
        """A figure by name. Raises ParameterError for a name that is none, ResultFolderError where the fit has not
        what it shows.
        """
        from fitball.report.figures.registry import draw

        if kind not in FIGURES:
            raise ParameterError(f"unknown figure '{kind}': {suggestion(kind, FIGURES)}")
        return draw(kind, profiled(self._fit) if kind == "profiles" else self._fit)

    @checked
    def corner(self, package: str = "fitball") -> Figure:
        """All pairs of parameters, drawn at once in one Axes; with `package="corner"` by the package of that name, in
        the same units, each pair in an Axes of its own. Raises ParameterError for another package, ResultFolderError
        for a point fit.
        """
        if package == "fitball":
            return self("corner")
        if package != "corner":
            raise ParameterError(f"package={package!r}: expected 'fitball' or 'corner'")
        from fitball.report.figures.corner import package_corner_figure

        return package_corner_figure(self._fit)

    def __getattr__(self, kind: str) -> Callable[[], Figure]:
        if kind not in FIGURES:
            raise AttributeError(f"there is no figure '{kind}': {suggestion(kind, FIGURES)}")
        return lambda: self(kind)

    def __iter__(self) -> Iterator[str]:
        """The names of the figures that this fit can show."""
        from fitball.report.figures.registry import drawable_kinds

        return iter(drawable_kinds(self._fit))

    def __dir__(self) -> list[str]:
        return sorted(FIGURES)

    def __repr__(self) -> str:
        width = max(map(len, FIGURES))
        return "\n".join(["figures, as in fit.plot.corner():", *(
            f"  {name:{width}}  {text.summary}" for name, text in FIGURES.items()
        )])  # fmt: skip


def lacks_profiles(fit: Fit) -> bool:
    """Whether there are no profiles that could be computed."""
    from fitball.report.figures.profiles import has_profiles

    return not has_profiles(fit) and fit.identifiability.profiles_missing in ("", LEFT_OUT)


def profiled(fit: Fit, cores: int | None = None, scheduler: str | None = None) -> Fit:
    """The fit with its profiles, computed now where it has none and does not say why, by so many processes (default:
    all cores) or on the Dask cluster whose `scheduler` is at that address.
    """
    if not lacks_profiles(fit):
        return fit
    workers = engine(cores, scheduler)
    return replace(fit, identifiability=with_profiles(fit.problem, fit.point, fit.identifiability, workers))
