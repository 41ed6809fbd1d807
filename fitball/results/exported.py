"""`Exported`, the result of `export`: files that stand alone, without a page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from fitball.base.errors import FolderError, Note, ParameterError
from fitball.base.files import ResultFolder, result_folder
from fitball.base.text import listed
from fitball.base.values import DataFrame, Figure
from fitball.results.result import Result


@dataclass(frozen=True, eq=False, repr=False)
class Exported(Result):
    """Files, by name their `contents`; `save` writes them alone, and without a folder the command
    line prints their text.

    Example:
        >>> import fitball
        >>> fitball.export(model="two-mass", to="json")
        <Exported: parameters.json>
    """

    record: ClassVar[str] = ""
    contents: Mapping[str, str | bytes]
    notes: tuple[Note, ...] = ()

    def __repr__(self) -> str:
        return f"<Exported: {listed(self.contents)}>"

    @property
    def frames(self) -> Mapping[str, DataFrame]:
        """An empty mapping: the numbers are in the files.

        Example:
            >>> import fitball
            >>> exported = fitball.export(model="two-mass", to="json")
            >>> exported.frames
            {}
        """
        return {}

    def plot(self, name: str) -> Figure:
        """An export has no figures.

        Raises:
            ParameterError: whatever the name (`unknown-figure`).

        Example:
            >>> import fitball
            >>> exported = fitball.export(model="two-mass", to="json")
            >>> exported.plot("curves")
            Traceback (most recent call last):
            fitball.base.errors.ParameterError: ...
        """
        raise ParameterError(f"no figure '{name}': an export has none", "unknown-figure")

    def report(self, **_options: object) -> str:
        """The text of the files itself, whatever the width or colour.

        Raises:
            ParameterError: a file is no text (`no-text`).

        Example:
            >>> import fitball
            >>> exported = fitball.export(model="two-mass", to="json")
            >>> print(exported.report()[:1])
            {
        """
        for name, content in self.contents.items():
            if isinstance(content, bytes):
                raise ParameterError(
                    f"{name} is no text: name a folder for it, --out DIR",
                    "no-text",
                )
        return "\n".join(str(content).removesuffix("\n") for content in self.contents.values())

    def _repr_html_(self) -> str:
        return f"<p>{listed(self.contents)}: save(folder) writes it.</p>"

    def json(self) -> dict[str, Any]:
        """The texts by name, under `files`, as `--json` prints them. There are no notes, and files
        that are no text are left out.

        Example:
            >>> import fitball
            >>> exported = fitball.export(model="two-mass", to="json")
            >>> list(exported.json()["files"])
            ['parameters.json']
        """
        texts = {
            name: content for name, content in self.contents.items() if isinstance(content, str)
        }
        return {"files": texts, "notes": [], "exit_code": self.exit_code}

    def save(
        self, folder: str | Path | ResultFolder, *, overwrite: bool = False, **_options: object
    ) -> tuple[Path, ...]:
        """Write the files and nothing else, and return their paths.

        Raises:
            FolderError: a file is there already (`older-result`), another run holds the folder
                (`folder-in-use`), or it cannot be made or written (`no-folder`, `not-written`).

        Example:
            >>> import fitball
            >>> exported = fitball.export(model="two-mass", to="json")
            >>> [path.name for path in exported.save("exports")]
            ['parameters.json']
        """
        if not isinstance(folder, ResultFolder):
            with result_folder(Path(folder)) as locked:
                return self.save(locked, overwrite=overwrite)
        existing = [name for name in self.contents if (folder.path / name).exists()]
        if existing and not overwrite:
            remedy = "replace it with --overwrite (overwrite=True), or name another folder (--out)"
            raise FolderError(
                f"{folder.path / existing[0]}: is there already; {remedy}",
                "older-result",
            )
        files = {
            name: content.encode() if isinstance(content, str) else content
            for name, content in self.contents.items()
        }
        return tuple(folder.write(name, file) for name, file in files.items())
