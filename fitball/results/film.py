"""`Film`, the result of `track`."""

from __future__ import annotations

from typing import ClassVar

from fitball.report.page import Layout
from fitball.results.result import Result
from fitball.tracks.film import Filmed


class Film(Filmed, Result):
    """Impacts found on film: `table` has them as `calibrate` takes them, `refused` says why other
    clips have none.

    Example:
        >>> import fitball
        >>> fitball.track("table_tennis_topspin")
        <Film: impacts (11 rows), tracks (375 rows) and session (1 row)>
    """

    record: ClassVar[str] = "impacts.csv"
    # Instead of that of the dataclass, which prints all frames.
    __repr__ = Result.__repr__

    @classmethod
    def of(cls, filmed: Filmed) -> Film:
        """Impacts found on film as a result.

        Example:
            >>> import fitball
            >>> fitball.Film.of(fitball.track("table_tennis_topspin"))
            <Film: impacts (11 rows), tracks (375 rows) and session (1 row)>
        """
        film = cls.__new__(cls)
        film.__dict__.update(filmed.__dict__)
        return film

    @property
    def exit_code(self) -> int:
        """1 if some of several films or recordings could not be used, else 0.

        Example:
            >>> import fitball
            >>> fitball.track("table_tennis_topspin").exit_code
            0
        """
        return int(any(made is not None and made.refused for made in (self.watched, self.heard)))

    @property
    def _layout(self) -> Layout:
        from fitball.report.track import PAGE, PAGE_OF_SOUND

        return (PAGE if self.heard is None else PAGE_OF_SOUND).of(self)
