"""A fit in other forms, by name: texts, or files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fitball.errors import ParameterError, suggestion
from fitball.exports import FORMAT_NAMES, KINDS, OWNERS
from fitball.inference.results.results import Fit
from fitball.report.form.files import refuse_existing, write_bytes, write_text
from fitball.wording import spoken

if TYPE_CHECKING:
    import xarray as xr

NETCDF = "netcdf"


@dataclass(frozen=True)
class Exported:
    """A fit in another form: `stem` of its files by default, `texts` by ending, a `note` on what one should know at
    once; `tree` is what has no text.
    """

    stem: str
    texts: Mapping[str, str]
    note: str = ""
    tree: xr.DataTree | None = None

    def write(self, out: Path, overwrite: bool = False) -> tuple[Path, ...]:
        """Write the files, each whole or not at all: in a folder under the name of the form, else as named; of
        several, the endings follow the stem of what was named. Raises ResultFolderError, for files that exist too
        unless they may be replaced.
        """
        endings = [*self.texts] if self.tree is None else [".nc"]
        if out.is_dir():
            places = tuple(out / f"{self.stem}{ending}" for ending in endings)
        else:
            # `speed-1.5` has no ending of its own.
            stem = out.stem if out.suffix in endings else out.name
            places = (out,) if len(endings) == 1 else tuple(out.with_name(f"{stem}{ending}") for ending in endings)
        for place in places:
            refuse_existing(place, overwrite)
        for ending, place in zip(endings, places, strict=True):
            if self.tree is None:
                write_text(place, self.texts[ending], named=True)
            else:
                write_bytes(place, self.tree.to_netcdf(engine="h5netcdf"), named=True)
        return places


def exported(
    saved: Fit, to: str, options: Mapping[str, Any], tree: Callable[[], tuple[xr.DataTree, str]]
) -> Exported:
    """A fit in the form called `to`; `tree` makes what netCDF holds, with a note. Raises ParameterError for an
    unknown form, or an option that it does not have.
    """
    if to not in FORMAT_NAMES:
        raise ParameterError(f"unknown format '{to}': {suggestion(to, FORMAT_NAMES)}")
    given = {name: value for name, value in options.items() if value is not None and value is not False}
    for name in given:
        if name not in OWNERS:
            raise ParameterError(f"unknown option '{name}': {suggestion(name, OWNERS)}")
        if to not in OWNERS[name]:
            owners = " and ".join(filter(None, (", ".join(OWNERS[name][:-1]), OWNERS[name][-1])))
            raise ParameterError(
                spoken(
                    f"--{name.replace('_', '-')} belongs to --to {owners}, not to --to {to}",
                    f"{name} belongs to the format {owners}, not to {to}",
                )
            )
        kind, words = KINDS[name]
        if not isinstance(given[name], kind):
            raise ParameterError(f"{name} = {given[name]!r}: expected {words}")
    if to == NETCDF:
        whole, note = tree()
        return Exported("arviz", {}, note, whole)
    # Formats load what fits and verbs have no need of.
    from fitball.exports.formats import TEXT_FORMATS, Options

    chosen = TEXT_FORMATS[to]
    json_alone = given.pop("json", False)
    texts = chosen.make(saved, Options(**given))
    notes = (chosen.note(texts), saved.at_common if chosen.bounces else "")
    return Exported(chosen.stem, {".json": texts[".json"]} if json_alone else texts, "; ".join(filter(None, notes)))
