"""A page: how the findings of one kind are laid out, drawn and filed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Generic, NamedTuple, TypeAlias, TypeVar

from fitball.base.values import Figure
from fitball.report.blocks import Report

Content = TypeVar("Content")
# Functions by the name of the figure that they draw, and of the file whose bytes they make.
Figures: TypeAlias = Mapping[str, Callable[[], Figure]]
Files: TypeAlias = Mapping[str, Callable[[], bytes]]


class Layout(NamedTuple):
    """A page of certain findings: functions that make its report, its figures, and its files
    besides these.
    """

    report: Callable[[], Report]
    figures: Callable[[], Figures]
    files: Callable[[], Files]


def _no_figures(_content: object) -> Figures:
    return {}


def _no_files(_content: object) -> Files:
    return {}


@dataclass(frozen=True)
class Page(Generic[Content]):
    """The page of findings of one kind. Its functions go from such findings to a report, to figures
    by name, and to files by name that are neither of these nor frames.
    """

    report: Callable[[Content], Report]
    figures: Callable[[Content], Figures] = _no_figures
    files: Callable[[Content], Files] = _no_files

    def of(self, content: Content) -> Layout:
        """The page of these findings; nothing is laid out before one of its functions is called."""
        return Layout(
            partial(self.report, content),
            partial(self.figures, content),
            partial(self.files, content),
        )
