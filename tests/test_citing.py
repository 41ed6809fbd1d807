"""`fitball cite`: entries that BibTeX reads, for each model, table and sampler; the citation file, and the paper."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

import fitball
from fitball.cli.main import main
from fitball.data.bundled import bundled_names, bundled_tracks, resolve_tracks
from fitball.models.registry import MODELS
from fitball.report.fit import citations
from fitball.report.fit.citations import Work, data_keys, escaped, works, works_of
from fitball.report.fit.methods import methods_text
from fitball.version import __version__

ROOT = Path(__file__).resolve().parent.parent
ENTRY = re.compile(r"@[a-z]+\{(\w+),\n(?:  [a-z]+ = \{(?:[^{}]|\\[{}]|\{[^{}]*\})*\},\n)+\}\n?")
NEEDED = {
    "article": {"author", "title", "journal", "year"}, "mastersthesis": {"author", "title", "school", "year"},
    "incollection": {"author", "title", "booktitle", "publisher", "year"}, "misc": {"title"},
}  # fmt: skip


def keys_of(text):
    """Keys of the entries; nothing else is in the text."""
    assert ENTRY.sub("", text).strip() == ""
    keys = [found[1] for found in ENTRY.finditer(text)]
    assert len(set(keys)) == len(keys)
    return keys


def test_every_work_of_the_file_is_read_and_whole():
    text = (ROOT / "fitball/report/references.bib").read_text(encoding="utf-8")
    assert list(works()) == re.findall(r"^@\w+\{(\w+),", text, re.MULTILINE)
    assert text.count(" = {") == sum(len(work.fields) for work in works().values())
    for work in works().values():
        assert keys_of(work.bibtex()) == [work.key] and set(work.fields) >= NEEDED[work.kind]
        assert re.fullmatch(r"10\.\d{4,}/\S+", work.fields.get("doi", "10.1000/1"))
        assert not re.search(r"[{}\\]|--", work.text()) and work.fields.get("year", "") in work.text()


def test_each_model_table_and_sampler_has_its_works():
    assert set(citations.MODEL_WORKS) == set(MODELS)
    groups = [*citations.MODEL_WORKS.values(), *map(data_keys, (*bundled_names(), *bundled_tracks()))]
    groups += [citations.POINT, citations.ENSEMBLES, citations.WEIGHTED, citations.SAMPLED, citations.VARIED]
    assert all(groups) and set().union(*groups) == set(works())


def test_a_fit_cites_all_that_its_methods_name(small_fit, capsys):
    assert main(["cite", str(small_fit)]) == 0
    out, fit = capsys.readouterr().out, fitball.load_fit(small_fit)
    parts = (citations.MODEL_WORKS["grip-slip"], citations.POINT, citations.ENSEMBLES, citations.SAMPLED)
    varied = citations.VARIED if fit.assumptions.alternatives else ()
    assert keys_of(out) == ["fitball", "jafri2004", *(key for part in (*parts, varied) for key in part)]
    assert fit.cite() == fitball.cite(small_fit) == out and f"Version {__version__}" in out
    text = fitball.cite(fit, to="text")
    for name, year in re.findall(r"([A-Z][a-z]+)(?: and \w+| et al\.|, \w+ and \w+)? \(?(\d{4})", methods_text(fit)):
        assert any(name in line and year in line for line in text.splitlines()), name


def test_a_weighted_fit_and_a_point_fit_cite_their_own_methods(short_fit):
    weighted = replace(short_fit, diagnostics=replace(short_fit.diagnostics, pareto_k=0.3))
    found = {work.key for work in works_of(weighted)}
    assert found >= set(citations.WEIGHTED) and not found & set(citations.ENSEMBLES)
    two_masses = replace(weighted, fitted=replace(weighted.fitted, model_name="two-mass"))
    assert [work.key for work in works_of(two_masses)].count("jafri2004") == 1
    found = {work.key for work in works_of(replace(short_fit, diagnostics=None))}
    assert found >= set(citations.POINT) and not found & {*citations.ENSEMBLES, *citations.SAMPLED}


def test_data_of_ones_own_are_cited_by_their_scene(short_fit):
    hostile = "Lab & Co, 100 % {sure} \\input{x} #1_2 ~ $"
    scene = replace(short_fit.problem.scene, citation=hostile, description="")
    own = replace(short_fit, source=replace(short_fit.source, sha256="0" * 64),
                  problem=replace(short_fit.problem, scene=scene))  # fmt: skip
    (data,) = [work for work in works_of(own) if work.key == "data"]
    assert keys_of(data.bibtex()) == ["data"] and data.fields["note"] == escaped(hostile)
    assert hostile in data.text()
    copied = replace(own, source=short_fit.source)
    assert "jafri2004" in {work.key for work in works_of(copied)} and "data" not in {w.key for w in works_of(copied)}
    film = tomllib.loads(resolve_tracks("table_tennis_topspin").with_suffix(".toml").read_text(encoding="utf-8"))
    scene = replace(scene, citation=film["source"]["citation"])
    tracked = replace(own, problem=replace(own.problem, scene=scene))
    assert "ballprediction2023" in {work.key for work in works_of(tracked)}
    silent = replace(own, problem=replace(own.problem, scene=replace(scene, citation="")))
    assert {work.key for work in works_of(silent)}.isdisjoint({"data", "jafri2004"})


def test_a_mistaken_form_is_refused_in_words(capsys):
    assert main(["cite", "--to", "bibtx"]) == 2
    assert "did you mean 'bibtex'?" in capsys.readouterr().err
    with pytest.raises(fitball.FitballError, match="nowhere"):
        fitball.cite("nowhere")
    assert Work("misc", "x", {"title": "T"}).text() == "T"


def test_the_citation_file_has_what_its_format_requires():
    text = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    top = dict(re.findall(r"^([a-z-]+): *(.*)$", text, re.MULTILINE))
    assert {"message", "title", "authors", "abstract", "keywords"} <= set(top)
    names = ("cff-version", "version", "license", "type")
    assert [top[name] for name in names] == ["1.2.0", __version__, "MIT", "software"]
    assert top["title"].strip('"') == works()["fitball"].fields["title"]
    assert works()["fitball"].fields["author"].strip("{}") in text
    # Each reference has what the format requires, and none an identifier that does not exist.
    references = text.split("references:")[1].split("  - type: ")[1:]
    assert references and all(f"\n    {key}:" in one for one in references for key in ("title", "authors", "year"))
    assert not re.search("orcid|doi|email|affiliation", text)


def test_the_paper_cites_what_its_references_have_and_nothing_invented():
    paper, bib = ((ROOT / "docs/paper" / name).read_text(encoding="utf-8") for name in ("paper.md", "paper.bib"))
    head, _, body = paper.removeprefix("---\n").partition("\n---\n")
    assert set(re.findall(r"@([a-z]+\d*)", body)) == set(keys_of(bib)) - {"fitball"}
    assert not re.search("orcid|email|corresponding", head) and "The fitball authors" in head
    assert 750 <= len(re.findall(r"[^\W\d_]{2,}", re.sub(r"<!--.*?-->|\[?@[^\]\s]+", " ", body))) <= 1750
    sections = ("Summary", "Statement of need", "State of the field", "Software design", "Research impact statement",
                "AI usage disclosure", "Acknowledgements", "References")  # fmt: skip
    assert [name for name in re.findall(r"^# (.+)$", body, re.MULTILINE) if name in sections] == list(sections)
    for work in works().values():
        assert work.key == "fitball" or work.key not in keys_of(bib) or work.bibtex() in bib
