"""Works to cite with fitball and with a fit, as BibTeX and as text. `references.bib` has the works."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

from fitball.data.bundled import bundled_tables, bundled_tracks, resolve_tracks
from fitball.errors import ParameterError, suggestion
from fitball.inference.results.results import Fit
from fitball.version import __version__
from fitball.visible import one_line
from fitball.wording import option

# By model; by the beginning of the name of a bundled table or film; by how a fit was made.
MODEL_WORKS = {
    "two-mass": ("jafri2004",), "thesis-exact": ("jafri2004",), "thesis": ("jafri2004",),
    "grip-slip": ("walton1993", "foerster1994", "cross2002", "garwin1969"), "brody": ("brody1984",),
}  # fmt: skip
DATA_WORKS = {"wang": ("jafri2004",), "table_tennis": ("ballprediction2023",), "synthetic": ("fitball",)}
POINT = ("newville2014",)
ENSEMBLES = ("foremanmackey2013", "goodman2010", "terbraak2006", "nelson2014")
WEIGHTED = ("cornuet2012", "vehtari2024")
SAMPLED = ("vehtari2021", "margossian2024", "kallioinen2024", "kumar2019")
VARIED = ("vehtari2017",)
_ENTRY = re.compile(r"^@(?P<kind>\w+)\{(?P<key>\w+),\n(?P<body>.*?)^\}$", re.MULTILINE | re.DOTALL)
_FIELD = re.compile(r"(\w+) = \{((?:[^{}]|\{[^{}]*\})*)\}")
_ESCAPES = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "|": r"\textbar{}", "<": r"\textless{}",
    ">": r"\textgreater{}",
}  # fmt: skip
_LETTERS = {code: letter for letter, code in _ESCAPES.items()}
_CODES = re.compile("|".join([*map(re.escape, _LETTERS), "[{}]", "--"]))


@dataclass(frozen=True)
class Work:
    """A work by its BibTeX type, key and fields, which are LaTeX."""

    kind: str
    key: str
    fields: Mapping[str, str]

    def bibtex(self) -> str:
        """As an entry of a .bib file."""
        lines = [f"  {name} = {{{value}}}," for name, value in self.fields.items()]
        return "\n".join([f"@{self.kind}{{{self.key},", *lines, "}"])

    def text(self) -> str:
        """As a line: authors, year, title, where it is."""
        known = {name: _plain(value) for name, value in self.fields.items()}
        year = f" ({known['year']})" if "year" in known else ""
        head = f"{known['author'].replace(' and ', ', ')}{year}. " if "author" in known else ""
        journal = " ".join(known[name] for name in ("journal", "volume") if name in known)
        names = ("booktitle", "publisher", "school", "howpublished", "pages")
        where = ", ".join(filter(None, [journal, *(known.get(name, "") for name in names)]))
        doi = f"doi:{known['doi']}" if "doi" in known else ""
        return ". ".join(filter(None, [head + known["title"], where, known.get("note"), doi]))


FORMS = {"bibtex": ("\n\n", Work.bibtex), "text": ("\n", Work.text)}


def escaped(text: str) -> str:
    """Text as LaTeX prints it."""
    return "".join(_ESCAPES.get(letter, letter) for letter in text)


def _plain(text: str) -> str:
    """What LaTeX prints, as text."""
    return _CODES.sub(lambda found: "-" if found[0] == "--" else _LETTERS.get(found[0], ""), text)


@cache
def works(version: str = __version__) -> Mapping[str, Work]:
    """All works by key, with fitball of that version."""
    text = (files("fitball.report") / "references.bib").read_text(encoding="utf-8").replace("VERSION", version)
    return {
        found["key"]: Work(found["kind"], found["key"], dict(_FIELD.findall(found["body"])))
        for found in _ENTRY.finditer(text)
    }


def works_of(fit: Fit) -> list[Work]:
    """fitball, then what the fit rests on: its data, model, optimiser, sampler and comparison of model variants.

    Raises ResultFolderError if the files beside `fit.json` are missing.
    """
    known = works(fit.versions.get("fitball", __version__))
    keys = [*MODEL_WORKS.get(fit.fitted.model_name, ()), *POINT]
    if fit.diagnostics is not None:
        keys += (*(ENSEMBLES if fit.diagnostics.pareto_k is None else WEIGHTED), *SAMPLED)
    if fit.assumptions is not None and fit.assumptions.alternatives:
        keys += VARIED
    found = [known["fitball"], *_data_works(fit, known), *(known[key] for key in keys)]
    return list({work.key: work for work in found}.values())


def cited(listed: list[Work], form: str) -> str:
    """Works in one of the `FORMS`. Raises ParameterError for another form."""
    if form not in FORMS:
        raise ParameterError(f"unknown form '{form}' in {option('to')}: {suggestion(form, FORMS)}")
    between, written = FORMS[form]
    return between.join(written(work) for work in listed) + "\n"


def _data_works(fit: Fit, known: Mapping[str, Work]) -> list[Work]:
    """Of a bundled table, also under another name, its source; else what the scene cites."""
    scene = fit.problem.scene
    for name, place in _bundled():
        citation = tomllib.loads(place.with_suffix(".toml").read_text(encoding="utf-8"))["source"]["citation"]
        if scene.citation == citation or fit.source.sha256 == sha256(place.read_bytes()).hexdigest():
            return [known[key] for key in data_keys(name)]
    if not scene.citation:
        return []
    title = escaped(one_line(scene.description or fit.source.name))
    return [Work("misc", "data", {"title": title, "note": escaped(one_line(scene.citation))})]


def data_keys(name: str) -> tuple[str, ...]:
    """Keys of the works behind a bundled table or film."""
    return next(keys for begin, keys in DATA_WORKS.items() if name.startswith(begin))


def _bundled() -> Iterator[tuple[str, Path]]:
    for table in bundled_tables():
        yield table.name, table.path
    for name in bundled_tracks():
        yield name, resolve_tracks(name)
