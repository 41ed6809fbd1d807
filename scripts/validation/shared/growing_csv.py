"""A CSV file that grows by one line for each replicate of a study, in order, so that an interrupted run goes on.

The first line is a comment with all that the lines depend on. The same seed gives the same bytes, whatever the number
of processes and interruptions.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fitball.errors import ResultFolderError
from fitball.files import refusal
from fitball.report.form.files import write_text

NUMBER = "replicate"


@dataclass(frozen=True)
class GrowingCsv:
    """The file at `path` with `columns` after the number of the replicate, made with `settings`; `what` it holds."""

    path: Path
    columns: Sequence[str]
    settings: Mapping[str, object]
    what: str

    @property
    def _head(self) -> str:
        marked = json.dumps(self.settings, sort_keys=True)
        return f"# {marked}\n{','.join([NUMBER, *self.columns])}\n"

    def open(self) -> int:
        """Make the file, or mend the end of one that was cut off; returns how many replicates it holds.

        Raises ResultFolderError when it cannot be read or written, or was made with other settings.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not self.path.exists():
                write_text(self.path, self._head)
            text = self.path.read_bytes().decode("utf-8")
            if not text.startswith(self._head):
                raise ResultFolderError(
                    f"{self.path}: holds {self.what} of another run (seed, model, priors, table or version differ); "
                    "remove it, or name another folder"
                )
            whole = text[: text.rindex("\n") + 1]
            if whole != text:
                write_text(self.path, whole)
        except (OSError, UnicodeDecodeError) as error:
            raise ResultFolderError(f"{self.path}: cannot be read or written: {error}") from None
        return whole.count("\n") - self._head.count("\n")

    def append(self, number: int, cells: Sequence[str]) -> None:
        """Add one replicate. Raises ResultFolderError."""
        try:
            with self.path.open("a", encoding="utf-8", newline="") as file:
                csv.writer(file, lineterminator="\n").writerow([number, *cells])
        except OSError as error:
            raise ResultFolderError(refusal(self.path, error, len(",".join(cells)))) from None

    def rows(self, count: int) -> Iterator[tuple[int, Mapping[str, str]]]:
        """The first `count` replicates by number. Raises ResultFolderError for a damaged line."""
        with self.path.open(encoding="utf-8", newline="") as file:
            next(file)
            for number, row in enumerate(csv.DictReader(file)):
                if number == count:
                    break
                if row.get(NUMBER) != str(number) or None in row or None in row.values():
                    raise self.damaged(number)
                yield number, row

    def damaged(self, number: int) -> ResultFolderError:
        """The error of a replicate whose line is not what was written."""
        return ResultFolderError(
            f"{self.path}: line {number + 3} is damaged; remove it and all that follow, and run again"
        )
