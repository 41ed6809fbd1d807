"""A result as text, page, JSON and folder: the same numbers in each, the record last."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from fitball.base.errors import FolderError, Note, ParameterError
from fitball.base.files import result_folder
from fitball.base.findings import Findings
from fitball.base.numbers import Unit
from fitball.report.blocks import Picture, Report, Section, Table, Text
from fitball.report.page import Page
from fitball.report.style import axis_label, draw_styled, image_bytes, new_figure
from fitball.results.exported import Exported
from fitball.results.result import Frames, Result


def draw():
    figure, axes = new_figure(1, 2, high=2.0, sharey=True)
    axes[0, 0].plot([0.0, 1.0], [0.0, -1.0])
    axes[0, 1].set_xlabel(axis_label("$v_1$", Unit("m/s")))
    return figure


class Toy(Result):
    """A result whose page is this module."""

    record = "own.json"
    notes = (Note("doubt", "a doubt"),)

    @property
    def frames(self):
        index = pd.Index(["mu", "k_y", "drop"], name="name")
        values = [0.1 + 0.2, np.inf, -np.inf]
        return {
            "summary": pd.DataFrame({"median": values, "kind": ["model", None, None]}, index=index)
        }

    @property
    def _layout(self):
        return PAGE.of(self)


def report(result):
    values = [
        {"name": name, "value": f"{value:.3f}"}
        for name, value in result.frames["summary"]["median"].items()
    ]
    return Report(
        "Toy",
        [Text(["An answer."], "lead"), Table("", values)],
        [Section("More", [Picture("line", "A line.")])],
    )


def figures(_result):
    return {"line": draw, "other": draw}


def files(_result):
    return {"own.json": lambda: b"{}", "references.bib": lambda: b"@misc{}"}


PAGE = Page(report, figures, files)


def test_the_folder_has_all_of_it_and_the_record_last(tmp_path, monkeypatch):
    moved = []
    replace = os.replace
    monkeypatch.setattr(os, "replace", lambda *paths: moved.append(paths[1]) or replace(*paths))
    places = Toy().save(tmp_path, command="fitball toy 'a b'")
    order = [place.name for place in places]
    assert [path.name for path in moved if path in places] == order
    assert order[-1] == "own.json"
    # Of the figures those that the report shows.
    assert sorted(order) == ["line.png", "own.json", "references.bib", "report.html", "summary.csv"]
    page = (tmp_path / "report.html").read_text()
    assert "0.300" in page
    assert "data:image/png;base64," in page
    assert "fitball toy &#39;a b&#39;" in page
    back = pd.read_csv(tmp_path / "summary.csv", index_col="name")
    assert back["median"].tolist() == [0.1 + 0.2, np.inf, -np.inf]
    with pytest.raises(FolderError):
        Toy().save(tmp_path)
    Toy().save(tmp_path, overwrite=True, figures=False)
    assert not (tmp_path / "line.png").exists()
    assert "data:image" not in (tmp_path / "report.html").read_text()
    with result_folder(tmp_path / "held") as folder:
        assert len(Toy().save(folder, figures=False)) == 4


def test_text_notebook_and_json_say_the_same():
    toy = Toy()
    assert "0.300" in toy.report()
    assert "More" in toy.report(colour=True)
    assert "\x1b[" not in toy.report()
    assert "More" not in toy.report(full=False)
    assert "0.300" in toy._repr_html_()
    assert "<html" not in toy._repr_html_()
    printed = json.loads(json.dumps(toy.json(), allow_nan=False))
    rows = [("mu", 0.1 + 0.2, "model"), ("k_y", None, None), ("drop", None, None)]
    summary = [dict(zip(("name", "median", "kind"), row, strict=True)) for row in rows]
    notes = [{"code": "doubt", "text": "a doubt"}]
    assert printed == {"frames": {"summary": summary}, "notes": notes, "exit_code": 0}


def test_frames_have_their_page_and_their_exit_code():
    result = Frames(Findings(Toy().frames, failed=True), PAGE)
    assert result.exit_code == 1
    assert result.record == "report.html"
    assert "0.300" in result.report()


def test_files_alone_have_no_frames_and_refuse_figures():
    exported = Exported({"a.txt": "text\n"})
    assert exported.frames == {}
    assert exported.report() == "text"
    assert exported.json()["files"] == {"a.txt": "text\n"}
    with pytest.raises(ParameterError) as caught:
        exported.plot("line")
    assert caught.value.code == "unknown-figure"


def test_a_result_without_figures_says_so():
    with pytest.raises(ParameterError) as caught:
        Frames(Findings({}), Page(report)).plot("x")
    assert caught.value.code == "unknown-figure"
    assert "none" in str(caught.value)
    assert "known:" not in str(caught.value)


def test_a_figure_by_its_name_is_the_same_file_each_time_and_outside_of_pyplot():
    import matplotlib.pyplot as plt

    with plt.rc_context({"axes.facecolor": "red", "font.size": 30}):
        first = {form: image_bytes(Toy().plot("line"), form) for form in ("png", "svg", "pdf")}
    assert first == {form: image_bytes(draw_styled(draw), form) for form in first}
    assert not plt.get_fignums()
    assert first["png"].startswith(b"\x89PNG")
    assert not re.search(
        rb"[Mm]atplotlib|20\d\d-",
        first["png"] + first["pdf"],
    )
    with pytest.raises(ParameterError) as caught:
        Toy().plot("lines")
    assert caught.value.code == "unknown-figure"
    assert "'line'" in str(caught.value)


def test_nothing_is_laid_out_before_a_report_is_asked_for():
    heavy = ("matplotlib", "pandas", "scipy", "jinja2", "tqdm", "joblib")
    code = (
        "import sys, fitball.results.result, fitball.base.columns\n"
        f"print([name for name in {heavy} if name in sys.modules])"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        == "[]\n"
    )
