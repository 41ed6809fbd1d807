"""`fitball compare` as a user sees it: files, words, exit codes, faults."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import signal
import time

import numpy as np
import pytest
from headless import Browser
from samples import HANG
from test_report_browser import FOUND, PHONE, SCREEN, complaints
from test_report_html import faults

from fitball.cli.main import main
from fitball.inference.results.evidence import Answer
from fitball.report.compare.document import ANSWERS, ASSUMED, ERRORS, LEGEND

ROWS = """id,group,v_x1 [m/s],v_y1 [m/s],omega_1 [rpm],v_x2 [m/s],v_y2 [m/s],omega_2 [rpm]
a,flat,16.0,5.0,0,11.5,4.1,2400
b,flat,15.0,7.5,50,8.9,6.0,2700
c,flat,13.0,10.0,0,7.6,7.6,2500
d,top,10.0,13.0,900,6.6,9.5,2100
e,top,6.0,15.0,1000,4.6,10.6,1300
f,top,14.0,8.0,1100,9.8,6.4,3000
"""
PAIR = ["--models", "brody,grip-slip", "--max-steps", "300", "--cores", "1", "--quick"]


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    """A comparison of two models in a folder of its own: (folder, exit code, stdout, stderr)."""
    import contextlib

    place = tmp_path_factory.mktemp("compare")
    (place / "balls.csv").write_text(ROWS, encoding="utf-8")
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(place), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = main(["compare", "balls.csv", *PAIR])
    return place, code, out.getvalue(), err.getvalue()


def test_files_are_complete_and_agree(done):
    place, code, out, err = done
    folder = place / "fits" / "balls" / "compare"
    assert code in (0, 1), err
    assert sorted(item.name for item in folder.iterdir()) == [
        "compare.csv", "compare.html", "compare.json", "compare.png", "compare.txt", "forest.png",
        "scores.png",
    ]  # fmt: skip
    assert all(place.read_bytes().startswith(b"\x89PNG") for place in folder.glob("*.png"))
    content = json.loads((folder / "compare.json").read_text(encoding="utf-8"))
    assert content["kind"] == "fitball comparison"
    assert content["scored_columns"] == ["v_x2", "v_y2", "omega_2"]
    best, other = content["models"]
    gaps = np.array([other["elpd_by_impact"][key] - best["elpd_by_impact"][key] for key in "abcdef"])
    assert other["elpd_difference"]["value"] == pytest.approx(gaps.sum())
    assert other["elpd_difference"]["se"] == pytest.approx(np.sqrt(6) * np.std(gaps, ddof=1))
    assert other["elpd_difference"]["value"] <= 0.0
    assert sum(item["weights"]["stacking"] for item in content["models"]) == pytest.approx(1.0)
    schemes = {item["scheme"]: item for item in best["left_out"]}
    assert set(schemes) == {"each impact", "each group", "shallowest third", "steepest third"}
    assert schemes["steepest third"]["impacts"] == ["d", "e"]
    assert schemes["each group"]["parts"] == ["flat", "top"]
    assert set(content["assumptions"]) == {*best["point"], "court pace rating"} & {
        *other["point"],
        "court pace rating",
    }
    friction = content["assumptions"]["mu"]
    assert list(friction["by_model"]) == [best["name"], other["name"]]
    medians = [item["median"] for item in friction["by_model"].values()]
    assert min(medians) <= friction["stacked"]["median"] <= max(medians)
    with (folder / "compare.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["model"] for row in rows] == [best["name"], other["name"]]
    for row, item in zip(rows, (best, other), strict=True):
        assert float(row["elpd"]) == item["elpd"]
        mine = next(part for part in item["left_out"] if part["scheme"] == "each impact")
        assert float(row["rms, each impact: omega_2 [rad/s]"]) == pytest.approx(mine["rms"]["omega_2"])
        degrees = float(row["rms, each impact: theta_2 [deg]"])
        assert np.radians(degrees) == pytest.approx(mine["rms"]["theta_2"])
    # The answer comes first.
    assert squeezed(out.partition("===\n")[2]).startswith(squeezed(content["words"])[:60])


def test_the_first_screen_is_short_and_has_the_answer(done):
    place, _code, out, err = done
    assert "balls: 2 models on 6 impacts, scored by v_x2, v_y2, omega_2" in out
    assert len(out.splitlines()) <= 40
    assert "With 6 impacts" in out and str(place.parts[-1]) not in out
    assert "fits/balls/compare/compare.html" in out
    full = (place / "fits" / "balls" / "compare" / "compare.txt").read_text(encoding="utf-8")
    assert len(full.splitlines()) > 60 and "AICc" in full and "AICc" not in out
    assert "grip-slip: sampling (0 of 2 done)" in err or "brody: sampling (0 of 2 done)" in err
    assert "no scene file" in err
    # Nothing of the thesis beside data that are not Wang's.
    assert "Table 9" not in out


def plain(html):
    """The words of a page, a blank between any two."""
    import html as entities

    return " ".join(entities.unescape(re.sub(r"<[^>]*>", " ", re.sub(r"data:image/[^\"]*", "", html))).split())


def squeezed(text):
    """Letters and digits alone: lines break elsewhere on a terminal."""
    return re.sub(r"\W+", "", text)


def test_the_page_says_what_the_terminal_says(done):
    place = done[0]
    out = (place / "fits" / "balls" / "compare" / "compare.txt").read_text(encoding="utf-8")
    page = (place / "fits" / "balls" / "compare" / "compare.html").read_text(encoding="utf-8")
    assert faults(page) == []
    shown = plain(page)
    # "None" may begin a sentence.
    assert not re.search(r"\b(nan|Undefined|inf)\b|>None<", re.sub(r"data:image/[^\"]*", "", page))
    assert "fitball compare balls.csv --models brody,grip-slip" in shown
    content = json.loads((place / "fits" / "balls" / "compare" / "compare.json").read_text(encoding="utf-8"))
    models = [model["name"] for model in content["models"]]
    texts = [*LEGEND, ERRORS, *ASSUMED, *(f"{note}." for note in content["notes"])]
    texts += re.split(r"(?<=[a-z.]\.) (?=[A-Z])", content["words"])
    texts += [f"{name}: none" for name in models]
    for model in content["models"]:
        answer = ANSWERS[Answer(model["adequacy"]["answer"])].partition("{")[0]
        texts.append(f"{model['name']}: {answer}")
    for text in texts:
        assert squeezed(text) in squeezed(out) and squeezed(text) in squeezed(shown), text
    best = content["models"][0]
    for name, verdict in best["verdicts"].items():
        assert re.search(rf"{name} {verdict}", shown)


def test_the_page_predicts_impacts_left_out_as_compare_json_has_them(done):
    place = done[0] / "fits" / "balls" / "compare"
    content = json.loads((place / "compare.json").read_text(encoding="utf-8"))
    shown = plain((place / "compare.html").read_text(encoding="utf-8"))
    measured = {row["id"]: row for row in csv.DictReader(io.StringIO(ROWS))}
    ways = [
        next(item for item in model["left_out"] if item["scheme"] == "each impact") for model in content["models"]
    ]
    for name, row in measured.items():
        value = float(row["v_x2 [m/s]"])
        cells = [value, *(value + way["errors"]["v_x2"][way["impacts"].index(name)] for way in ways)]
        assert " | ".join(f"{cell:.2f}" for cell in cells) in shown, name


@pytest.mark.skipif(FOUND is None, reason="no browser is installed")
@pytest.mark.parametrize(("width", "scheme"), [(PHONE, "light"), (SCREEN, "dark")])
def test_the_page_holds_in_a_browser(done, tmp_path, width, scheme):
    page = done[0] / "fits" / "balls" / "compare" / "compare.html"
    with Browser(FOUND, tmp_path) as browser:
        visit = browser.visit(page, width, scheme)
    assert complaints(visit, page) == []
    assert len(visit.layout["images"]) == 3 and visit.layout["anchors"] >= 7


def test_a_second_run_refuses(done, capsys):
    place = done[0]
    folder = place / "fits" / "balls" / "compare"
    assert main(["compare", str(place / "balls.csv"), *PAIR, "--out", str(folder)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (folder / "compare.json").exists()


def test_few_impacts_and_a_drop_test(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    speeds = (3.0, 5.0, 8.0, 11.0, 13.0)
    lines = "\n".join(f"{v},{v * (0.86 - 0.012 * v) + 0.01 * (-1) ** int(v):.3f}" for v in speeds)
    (tmp_path / "drop.csv").write_text(f"v_y1,v_y2\n{lines}\n", encoding="utf-8")
    assert main(["compare", "drop.csv", "--quick", "--json", "--max-steps", "200", "--cores", "1"]) in (0, 1)
    captured = capsys.readouterr()
    content = json.loads(captured.out)
    assert content["meaningful"] is False
    assert "5 impacts are too few" in content["words"]
    assert {item["name"] for item in content["models"]} == {"two-mass", "two-mass+cor=mean"}
    assert "brody, grip-slip, thesis-exact" in captured.err
    two = "\n".join(lines.split("\n")[:2])
    (tmp_path / "two.csv").write_text(f"v_y1,v_y2\n{two}\n", encoding="utf-8")
    assert main(["compare", "two.csv"]) == 2
    assert "needs at least 3" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["nothing.csv"], "no such file"),
        (["wang_zero_spin.csv", "--models", "brody"], "at least two different models"),
        (["wang_zero_spin.csv", "--models", "brody,,two-mass"], "brody,,two-mass"),
        (["wang_zero_spin.csv", "--models", "brody,thesis"], "is not ranked"),
        (["wang_zero_spin.csv", "--models", "brody,two-mass+spin=both"], "unknown option 'both' of closure spin"),
        (["wang_zero_spin.csv", "--seed", "-1"], "seed = -1"),
        (["wang_zero_spin.csv", "--cores", "0"], "cores = 0"),
        (["wang_zero_spin.csv", "--max-steps", "5"], "max_steps = 5"),
    ],
)
def test_faults_end_with_two_and_without_a_folder(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    assert main(["compare", *words]) == 2
    err = capsys.readouterr().err
    assert message in err
    assert "Traceback" not in err
    assert not (tmp_path / "fits").exists()


# Run by every Python that finds it: a worker says that it has begun, and begins in earnest when Ctrl-C has come.
WORKERS_WAIT = """
import os, signal, sys, time
from pathlib import Path

if any("loky.backend.popen" in word for word in sys.orig_argv):
    Path(__file__).with_name(f"{os.getpid()}.begun").touch()
    while signal.SIGINT not in signal.sigpending():
        time.sleep(0.01)
"""


def wait_for(state):
    """Until it is true."""
    for _ in range(int(HANG / 0.05)):
        if state():
            return
        time.sleep(0.05)
    raise AssertionError("it never came")


def gone(group):
    """Whether no process of a group is left."""
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.mark.skipif(os.name != "posix", reason="there are no process groups")
def test_ctrl_c_ends_every_process_and_says_so(tmp_path, start):
    """The real thing: a terminal's Ctrl-C reaches parent and workers, these halfway through their start."""
    first = tmp_path / "first"
    first.mkdir()
    (first / "sitecustomize.py").write_text(WORKERS_WAIT, encoding="utf-8")
    words = ("-m", "fitball", "compare", "wang_all.csv", "--cores", "3", "--out", "a")
    process = start(*words, cwd=tmp_path, first=first)
    wait_for(lambda: len([*first.glob("*.begun")]) == 2 or process.poll() is not None)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=HANG)
    assert process.returncode == 130, err
    assert "interrupted" in err
    assert "Traceback" not in err
    assert not out
    assert not (tmp_path / "a" / "compare.json").exists()
    # No worker stays behind; the tracker of multiprocessing sees that its parent is gone, and leaves a moment later.
    wait_for(lambda: gone(process.pid))
