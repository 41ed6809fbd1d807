"""One report for terminal, page and Markdown: nothing lost, nothing of a table's text obeyed."""

import io
import pickle
import re
import sys
from html.parser import HTMLParser

import pytest

from fitball.base.progress import shown
from fitball.report.blocks import Mark, Picture, Report, Section, Table, Text
from fitball.report.render import to_markdown, to_notebook, to_page, to_text

HOSTILE = "<script>alert(1)</script>\x1b[31m\u202e\udcff\"'|"
REPORT = Report(
    f"wang {HOSTILE}",
    [
        Text(
            [Mark("The model describes the data.", "good"), "Scatter of `v_x2`: 0.51 m/s."],
            "lead",
        ),
        Table(
            "Parameters",
            [
                {
                    "parameter": Mark("mu", "name", "friction"),
                    "median": "0.568",
                    "empty": "",
                    "verdict": Mark("given", "part", HOSTILE),
                },
                {
                    "parameter": Mark("cor_slope", "name", "slope"),
                    "median": "-15.1",
                    "verdict": Mark("identified", "good"),
                    "rests on": "a & b|c",
                },
            ],
            ("verdict", "rests on"),
        ),
        Picture("curves", f"Lines {HOSTILE}"),
        Text([f"label {HOSTILE}", ""], "list"),
    ],
    [
        Section(
            "All",
            [
                Table(
                    "",
                    [{"row": str(k), "value": f"{k}.0"} for k in range(400)],
                    (),
                    "`all.csv`",
                    1000,
                )
            ],
            True,
            "400 rows.",
        ),
        Section(
            "Nothing",
            [Text([""]), Table("", []), Table("", [{"a": ""}])],
            answer="never seen",
        ),
        Section("Repeat", [Text(["fitball calibrate  'a  b'"], "code"), Text(["words " * 40])]),
    ],
)


class Page(HTMLParser):
    """Elements that are open at the end, all tags, texts, and addresses of other places."""

    VOID = ("meta", "img", "br")

    def __init__(self, text):
        super().__init__()
        self.open = []
        self.tags = []
        self.texts = []
        self.links = []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        self.links += [value for name, value in attributes if name in ("src", "href")]
        self.open += [tag] * (tag not in self.VOID)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.texts.append(data)


def test_a_page_is_well_formed_complete_and_needs_nothing_else():
    page = Page(to_page(REPORT, {"curves": b"png"}, "fitball calibrate 'a  b'"))
    assert not page.open
    assert page.links == ["data:image/png;base64,cG5n"]
    assert page.tags.count("details") == 2
    assert page.tags.count("table") == 2
    assert page.tags.count("figure") == 1
    # 2 heads, 2 and 300 rows.
    assert page.tags.count("tr") == 304
    assert "300.0" not in page.texts
    assert {"400 rows.", "299.0", "all.csv"} < {*page.texts}
    assert "... and 700 more: " in page.texts
    assert "fitball calibrate  'a  b'\n" in page.texts
    assert "v_x2" in page.texts
    assert "a & b|c" in page.texts
    assert "script" not in page.tags
    assert any(HOSTILE[:25] in text for text in page.texts)
    for text in (
        to_page(REPORT, {"curves": b"png"}, HOSTILE),
        to_notebook(REPORT),
        to_text(REPORT),
        to_markdown(REPORT),
    ):
        assert not {*"\x1b\u202e\udcff"} & {*text}
        assert "never seen" not in text
    assert "img" not in Page(to_page(REPORT, {})).tags
    assert "html" not in Page(to_notebook(REPORT)).tags
    assert not Page(to_notebook(REPORT)).open
    assert "button" in page.tags
    assert "button" not in Page(to_page(Report("check", [Text(["a"])]), {})).tags


def test_a_terminal_shows_the_summary_or_all_in_its_width():
    summary = to_text(REPORT, full=False)
    full = to_text(REPORT)
    assert full.startswith(summary)
    assert "All" not in summary
    lines = summary.split("\n")
    start = lines.index("Parameters") + 1
    assert lines[start : start + 3] == [
        "parameter  median  verdict     rests on",
        "mu          0.568  given",
        "cor_slope   -15.1  identified  a & b|c",
    ]
    assert "\n39    39.0\n... and 960 more: all.csv" in full
    assert "fitball calibrate  'a  b'" in full
    assert max(map(len, to_text(REPORT._replace(title="wang"), width=60).split("\n"))) <= 60
    below = [line.split()[:1] for line in to_text(REPORT, full=False, width=34).split("\n")]
    assert below.count(["mu"]) == 1
    assert below.count(["cor_slope"]) == 2
    coloured = to_text(REPORT, full=False, colour=True)
    assert re.sub(r"\x1b\[\d+m", "", coloured) == summary
    assert "\x1b[33mgiven\x1b[0m" in coloured


def test_columns_of_wide_letters_and_of_lines_stay_below_each_other():
    rows = [
        {"surface": "\u30af\u30ec\u30fc", "mu": "0.5"},
        {"surface": "Sabl\u0301\ne", "mu": "0.7"},
    ]
    assert to_text(Report("", [Table("", rows)])).split("\n")[-3:] == [
        "surface   mu",
        "\u30af\u30ec\u30fc   0.5",
        "Sabl\u0301 e   0.7",
    ]
    long = [{"a": "x", "reason": "word " * 30}]
    lines = to_text(Report("", [Table("", long, ("reason",))]), width=40).split("\n")
    assert len(lines) == 9
    assert max(map(len, lines)) <= 40
    assert all(line.startswith("   word") for line in lines[5:])


def test_long_tables_are_looked_through_a_few_times_alone():
    class Rows(list):
        seen = 0

        def __iter__(self):
            self.seen += 1
            return super().__iter__()

    rows = Rows([{f"c{k}": "1" for k in range(9)}] * 500)
    report = Report("", [Table("", rows)])
    assert len(to_text(report)) + len(to_page(report, {})) + len(to_markdown(report)) > 0
    assert rows.seen < 20


def test_markdown_has_every_row_and_keeps_its_columns():
    text = to_markdown(REPORT)
    rows = [line for line in text.split("\n") if line.startswith("|")]
    assert len(rows) == 2 + 2 + 2 + 400
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} == {5, 3}
    assert "| ---: |" in text
    assert "`all.csv`" not in text
    assert "    fitball calibrate" in text
    assert "<" not in text
    assert "<" not in to_markdown(Report("`<b>", [Text(["`<b>"]), Table("", [{"a": "`<b>"}])]))


def test_marks_travel_with_their_tone():
    mark = pickle.loads(pickle.dumps(Mark("given", "part", "hint")))
    assert mark == "given"
    assert mark.tone == "part"
    assert mark.hint == "hint"


class Terminal(io.StringIO):
    """Somebody looks on."""

    def isatty(self):
        return True


@pytest.mark.parametrize(
    ("progress", "stream", "stages"),
    [
        (None, Terminal, 2),
        (None, io.StringIO, 0),
        (True, io.StringIO, 2),
        (True, Terminal, 2),
        (False, Terminal, 0),
    ],
)
def test_progress_is_shown_where_somebody_looks_on(progress, stream, stages, monkeypatch):
    monkeypatch.setattr(sys, "stderr", stream())
    with shown(progress) as show:
        for stage in ("search", "sampling"):
            for share in (0.0, 0.5, 1.0, 0.2):
                show(stage, share)
    text = sys.stderr.getvalue()
    assert sum(stage in text for stage in ("search", "sampling")) == stages
    # A terminal has one line, gone at the end; a log one line a stage.
    assert text.count("\n") == (stages if stream is io.StringIO else 0)
    assert "\x1b[A" not in text
    assert text.rstrip(" ").endswith(("\r", "\n")) or not text


def test_progress_of_the_caller_and_messages_above_the_line(monkeypatch):
    import logging

    heard = []
    with shown(lambda *stage: heard.append(stage)) as show:
        show("search", 0.5)
    assert heard == [("search", 0.5)]
    monkeypatch.setattr(sys, "stderr", Terminal())
    log = logging.getLogger("fitball")
    before = (log.level, list(log.handlers))
    with shown(True) as show:
        show("search", 0.5)
        log.info("kernels are compiled once")
    assert "kernels are compiled once\n" in sys.stderr.getvalue()
    assert (log.level, list(log.handlers)) == before
