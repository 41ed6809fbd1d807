"""Which of the objects of a film are balls: by what `--ball` names, else by their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from shlex import quote

import numpy as np
from numpy.typing import NDArray

from fitball.base.numbers import counted
from fitball.base.text import listed, one_line
from fitball.base.values import FloatArray, IntArray
from fitball.data.cells import TableCells
from fitball.tracks.objects import FilmedBall, chosen_names, is_ball, names_of_masses

# Objects that a message names.
_NAMED_OBJECTS = 8


@dataclass
class Choice:
    """Chooses the balls of a file among the objects of its header, its parts and its ids; notes and
    faults go to its cells. `wanted` is what `--ball` names, "" without it.
    """

    cells: TableCells
    name: str
    wanted: str

    def balls(self, balls: Sequence[FilmedBall]) -> list[FilmedBall]:
        """The balls among the objects of a header: those that are wanted, or say that they are one.
        Faults: none of several parts says that it is a ball.
        """
        names = [ball.name for ball in balls]
        is_named = balls[0].is_named
        if len(balls) > 1:
            names = names if is_named else names_of_masses(self.cells, balls)
            chosen = self._names(names, "object", is_named)
            balls = [ball for ball, name in zip(balls, names, strict=True) if name in chosen]
        # The name of a file says more than that of its only ball.
        if len(balls) == 1 and is_named:
            return [balls[0]._replace(name="")]
        return [*balls]

    def _names(self, names: Sequence[str], level: str, must_say: bool) -> list[str]:
        """The names of balls among those of a level: header, column of parts, or ids. What is left
        out is noted; fault: names `must_say` which is a ball, and do not.
        """
        every = [*dict.fromkeys(names)]
        wanted = chosen_names(every, self.wanted) if self.wanted else []
        chosen = wanted or chosen_names(every, "")
        has = f"{counted(len(every), level)}, {listed(every, most=_NAMED_OBJECTS)}"
        if must_say and len(every) > 1 and not wanted and not any(map(is_ball, every)):
            words = f"read {has}; expected one that is called ball: choose it with --ball"
            self.cells.fault("several-objects", f"{words} {quote(every[0])}")
        elif len(chosen) < len(every):
            words = f"{self.name} has {has}: read was {listed(chosen, most=_NAMED_OBJECTS)}"
            self.cells.note("objects", words)
        return chosen

    def check_wanted(self, balls: Sequence[FilmedBall]) -> None:
        """Add a fault where no object, part or id of a file has the wanted name."""
        if not self.wanted:
            return
        names = [ball.name for ball in balls if ball.name]
        if len(balls) > 1 and not balls[0].is_named:
            names += names_of_masses(self.cells, balls)
        for level in ("part", "id"):
            if level in balls[0].indices:
                names += filter(None, self.cells.text(balls[0].indices[level]))
        names = [*dict.fromkeys(names)]
        if not chosen_names(names, self.wanted):
            has = listed(names, most=_NAMED_OBJECTS) or "no names of objects"
            words = f"ball: nothing is called '{one_line(self.wanted)}'; the file has {has}"
            self.cells.fault("no-object", words)

    def rows(self, parts: Sequence[str], ids: Sequence[str], clock: FloatArray) -> IntArray:
        """The rows whose part and id, in the texts (rows,), are a ball's. Ids of other objects are
        left out where they are seen at the same time as those of balls.
        """
        used = np.ones(len(parts), dtype=np.bool_)
        for texts, level in ((parts, "part"), (ids, "id")):
            names = [*dict.fromkeys(filter(None, texts))]
            if len(names) < 2:
                continue
            of_names = np.array(texts)
            if level == "part":
                chosen = self._names(names, level, must_say=True)
            elif self._are_at_once(names, of_names, clock):
                chosen = self._names(names, level, must_say=False)
            else:
                continue
            # What has no id may be the ball; what is no part is none.
            used &= np.isin(of_names, [*chosen, ""] if level == "id" else chosen)
        return np.flatnonzero(used)

    def _are_at_once(
        self, names: Sequence[str], texts: NDArray[np.str_], clock: FloatArray
    ) -> bool:
        """Whether a ball among names of ids is chosen, or is seen while one that is none is."""
        if self.wanted and chosen_names(names, self.wanted):
            return True
        balls = np.isin(texts, [name for name in names if is_ball(name)])
        others = np.isin(texts, [name for name in names if not is_ball(name)])
        return bool(np.isin(clock[others], clock[balls]).any())
