"""The documentation as a site: snippets run, pages are built without a warning, links lead on, nothing is fetched."""

from __future__ import annotations

import base64
import re
import warnings
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import nbformat
import pytest
from headless import Browser, find_browser
from notebooks import notebook
from quick_shell import make_quick, quick_shell
from snippets import (
    Outcome,
    SharedFits,
    SnippetError,
    figures,
    files,
    is_current,
    make,
    outcomes_of,
    pages,
    run_page,
    snippets,
    woven,
)

import fitball

ROOT = Path(__file__).resolve().parent.parent
PAGES = pages()
RUNNING = [page for page, text in PAGES.items() if any(item.runs for item in snippets(text))]
FOUND = find_browser()
PHONE, SCREEN = 400, 1280


@pytest.fixture(scope="session")
def runner(tmp_path_factory):
    """A function that runs the snippets of a page, once, and the folder of what they gave."""
    made = tmp_path_factory.mktemp("made")
    shell = SharedFits(made, quick_shell)

    def run(page):
        if not is_current(made, page, PAGES[page], None):
            with pytest.MonkeyPatch.context() as patch:
                make_quick(patch)
                make(made, page, PAGES[page], "quick", shell)

    return run, made


@pytest.fixture(scope="session")
def site(runner, tmp_path_factory):
    """The built pages, with what the snippets gave here."""
    from build_docs import build

    run, made = runner
    for page in RUNNING:
        run(page)
    out = tmp_path_factory.mktemp("site")
    with warnings.catch_warnings():
        # Of extensions about coming versions of Sphinx; what is wrong with a page is an error of the build.
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.simplefilter("ignore", PendingDeprecationWarning)
        assert build(made, out, made / "sphinx") == 0
    return out


@pytest.mark.parametrize("page", RUNNING)
def test_the_snippets_of_a_page_run(runner, page):
    run, made = runner
    run(page)
    assert len(outcomes_of(made, page)) == sum(item.runs for item in snippets(PAGES[page]))


def test_the_commands_of_the_front_page_run(tmp_path, monkeypatch):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    make_quick(monkeypatch)
    assert len(run_page(text, tmp_path / "page", quick_shell)) == 2
    first, tests = (item.code.split() for item in snippets(text) if item.language == "sh")
    assert first[:2] == ["scripts/fitball", "calibrate"] and tests == ["scripts/test"]
    assert all((ROOT / place).is_file() for place in (first[0], *tests))


def test_the_front_page_is_short():
    """Well below a thousand words, tables and addresses included only as far as they are words."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    plain = re.sub(r"<!--.*?-->|\]\([^)]*\)|[|`*#-]", " ", text)
    assert 400 < len(re.findall(r"[^\W\d]{2,}", plain)) < 800


class Links(HTMLParser):
    """What a page links to, what it loads, and what can be linked to in it."""

    def __init__(self):
        super().__init__()
        self.links, self.loaded, self.anchors = [], [], set()

    def handle_starttag(self, tag, attrs):
        known = dict(attrs)
        self.anchors |= {known[name] for name in ("id", "name") if known.get(name)}
        if tag == "a" and known.get("href"):
            self.links.append(known["href"])
        elif known.get("src"):
            self.loaded.append(known["src"])
        elif tag == "link" and known.get("rel") not in ("index", "search", "next", "prev"):
            self.loaded.append(known["href"])


def read(page):
    found = Links()
    found.feed(page.read_text(encoding="utf-8"))
    return found


def broken(folder):
    """Links of the pages of a folder that lead nowhere, and what pages would fetch from elsewhere."""
    known = {page: read(page) for page in sorted(folder.rglob("*.html"))}
    faults = []
    for page, found in known.items():
        for target in (*found.links, *found.loaded):
            address = urlsplit(target)
            if address.scheme in ("http", "https") or address.netloc:
                # A reader may follow a link out; a page may not fetch.
                faults += [f"{page.name} fetches {target}"] if target in found.loaded else []
            elif address.scheme == "":
                place = (page.parent / unquote(address.path)).resolve() if address.path else page
                if not place.is_file():
                    faults.append(f"{page.name}: {target} does not exist")
                elif address.fragment and place in known and unquote(address.fragment) not in known[place].anchors:
                    faults.append(f"{page.name}: {target} has no such anchor")
    return faults


def test_every_page_is_built_and_every_link_leads_somewhere(site):
    assert {f"{page}.html" for page in PAGES} <= {page.relative_to(site).as_posix() for page in site.rglob("*.html")}
    assert broken(site) == []
    # From the first page one comes to all others.
    reached, left = set(), [site / "index.html"]
    while left:
        page = left.pop()
        if page not in reached:
            reached.add(page)
            left += [place for place in ((page.parent / urlsplit(link).path).resolve() for link in read(page).links)
                     if place.suffix == ".html" and place.is_file()]  # fmt: skip
    assert {site / f"{page}.html" for page in PAGES} <= reached


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('<a href="none.html">x</a>', "none.html does not exist"),
        ('<a href="#nowhere">x</a>', "#nowhere has no such anchor"),
        ('<script src="https://cdn.example.org/x.js"></script>', "fetches https://cdn.example.org/x.js"),
        ('<link rel="stylesheet" href="//example.org/x.css">', "fetches //example.org/x.css"),
        ('<img src="none.png">', "none.png does not exist"),
    ],
)
def test_a_page_broken_on_purpose_is_found(tmp_path, text, said):
    (tmp_path / "page.html").write_text(f"<p id='here'>{text}</p><a href='#here'>good</a>", encoding="utf-8")
    assert len(broken(tmp_path)) == 1 and said in broken(tmp_path)[0]


def test_the_search_finds_pages_by_the_words_of_a_reader(site):
    index = (site / "searchindex.js").read_text(encoding="utf-8")
    titles = index[index.index("alltitles") :]
    for words in ("Troubleshooting and questions", "One-sided", "Not converged", "How to measure", "Frame rate"):
        assert f'"{words}"' in titles
    assert '"troubleshoot"' in index


def test_every_public_name_and_verb_is_documented(site):
    from fitball.cli.main import VERBS

    text = (site / "api.html").read_text(encoding="utf-8")
    for name in fitball.__all__:
        assert name == "__version__" or f'id="fitball.{name}"' in text, name
    assert set(re.findall(r"^## (\w+)$", PAGES["command-line"], re.MULTILINE)) == {verb.name for verb in VERBS}


def test_formulas_are_drawn_by_the_browser_alone(site):
    text = (site / "inference.html").read_text(encoding="utf-8")
    assert text.count("<math") > 100 and "MathJax" not in text
    assert not re.search(r"<m\w+[^>]*>\\\w+", text)
    # Browsers draw no other alphabet by this attribute.
    assert not re.search('mathvariant="(?!normal|monospace)', text) and "ℒ" in text  # noqa: RUF001


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(FOUND, tmp_path_factory.mktemp("profile")) as found:
        yield found


@pytest.mark.skipif(FOUND is None, reason="no browser is installed: pages are checked as text only")
@pytest.mark.parametrize(("width", "looked_at"), [(PHONE, PAGES), (SCREEN, ("index", "api", "inference", "gallery"))])
def test_pages_hold_in_a_browser(browser, site, width, looked_at):
    """All of them in a narrow window; in a wide one, where a contents list stands beside, one of each kind."""
    faults = []
    for page in looked_at:
        place = site / f"{page}.html"
        visit = browser.visit(place, width)
        faults += [f"{page}: {item}" for item in visit.errors]
        faults += [f"{page}: asks for {item}" for item in visit.requests if not item.startswith(("file:", "data:"))]
        faults += [f"{page}: an image is broken" for item in visit.layout["images"] if not item["natural"] > 0]
        faults += [f"{page}: an image without words" for item in visit.layout["images"] if not item["alt"]]
        if visit.layout["scroll"] > visit.layout["width"]:
            faults.append(f"{page}: {visit.layout['scroll']} px wide in a window of {visit.layout['width']}")
    assert faults == []


def page_of(*fences):
    return "\n".join(f"```{info}\n{code}\n```" for info, code in fences)


@pytest.mark.parametrize(
    ("fences", "said"),
    [
        ([("bash", "false")], "ended with 1, not 0"),
        ([("bash status=2", "true")], "ended with 0, not 2"),
        ([("bash parts=2", "echo one")], "printed 1 paragraphs, not 2"),
        ([("bash quiet", "true")], "means nothing: quiet"),
    ],
)
def test_a_snippet_that_does_not_do_as_its_page_says_is_found(tmp_path, fences, said):
    with pytest.raises(SnippetError, match=said):
        run_page(page_of(*fences), tmp_path / "page")


def test_a_picture_that_no_snippet_draws_is_found(tmp_path):
    with pytest.raises(SnippetError, match=r"no snippet has made none\.png"):
        run_page("<!-- figure: none.png | words -->\n", tmp_path / "page")


def test_snippets_share_a_folder_and_a_namespace_and_are_woven_in(tmp_path):
    text = page_of(
        ("csv a.csv", "x,y\n1,2"), ("bash", "cat a.csv"),
        ("python", "from pathlib import Path; text = Path('a.csv').read_text()"), ("python", "len(text)"),
        ("bash parts=2", "printf 'one\\n\\ntwo\\n\\nthree\\n'"),
        ("python silent", "print('hidden')"), ("text", "shown"),
    )  # fmt: skip
    outcomes = run_page(text, tmp_path / "page")
    assert outcomes == [Outcome("x,y\n1,2"), Outcome(""), Outcome("8"), Outcome("...\n\ntwo\n\n..."), Outcome("")]
    page = woven(text, outcomes, "made")
    assert (
        page.count(":class: output") == 3
        and ":caption: a.csv" in page
        and "hidden" not in page.replace("print('hidden')", "")
    )
    assert not Path("a.csv").exists()


def test_a_fence_in_a_comment_is_run_and_not_shown(tmp_path):
    text = f"before\n\n<!--\n{page_of(('bash', 'echo hidden'))}\n-->\n\nafter\n"
    (outcome,) = run_page(text, tmp_path / "page")
    page = woven(text, [outcome], "made")
    assert outcome.text == "hidden" and "echo" not in page and "<!--" not in page and ":class: output" in page


def test_the_gallery_shows_every_kind_of_figure():
    from fitball.report.figures.registry import FIGURES

    shown = {Path(file).stem for file, _ in figures(PAGES["gallery"])}
    assert shown >= {*FIGURES, "history", "regime_map", "bounce", "compare"}


@pytest.mark.parametrize("page", [page for page, text in PAGES.items() if files(text)])
def test_each_file_that_a_page_links_to_has_an_address_of_its_own(page):
    marks = "".join(f"<!-- file: {file} | words -->\n" for file in files(PAGES[page]))
    linked = re.findall(r'href="([^"]*)"', woven(marks, [], "made", "beside"))
    assert len(set(linked)) == len(linked) == len(files(PAGES[page]))


def test_every_tutorial_is_a_notebook_with_its_outputs(site, runner):
    """Each fence is a cell, in order, those that run with what they gave; links lead out or nowhere."""
    _, made = runner
    tutorials = [page for page in PAGES if page.startswith("tutorials/")]
    assert {site / f"{page}.ipynb" for page in tutorials} == set(site.rglob("*.ipynb"))
    for page in tutorials:
        assert f'href="{Path(page).name}.ipynb"' in (site / f"{page}.html").read_text(encoding="utf-8")
        cells = nbformat.read(site / f"{page}.ipynb", as_version=4)["cells"]
        code = [cell for cell in cells if cell["cell_type"] == "code"]
        fences = [item for item in snippets(PAGES[page]) if item.runs or item.file]
        assert len(code) == len(fences)
        outcomes = iter(outcomes_of(made, page))
        for cell, item in zip(code, fences, strict=True):
            shown = cell["source"].replace("!", "") if item.language == "bash" else cell["source"]
            assert item.code.rstrip() in shown
            if item.runs:
                outcome = next(outcomes)
                expected = bool(outcome.text.strip()) + bool(outcome.html) + len(outcome.pictures)
                assert len(cell["outputs"]) == expected
        words = "".join(cell["source"] for cell in cells if cell["cell_type"] == "markdown")
        assert not re.search(r"\]\((?!https?:|attachment:)", words)
        pictures = [cell for cell in cells for _ in cell.get("attachments", ())]
        assert len(pictures) == len(figures(PAGES[page]))


def test_a_notebook_says_what_the_page_says(tmp_path):
    text = page_of(
        ("csv a.csv", "x\n1"), ("bash", "# a comment\nls a.csv\nls a.*"), ("python", "print(2)\n3"),
        ("c", "int main;"),
    )  # fmt: skip
    before = "# A title\n\nSee [there](../x.md#y) or [here](https://example.org)."
    text = f"{before}\n\n{text}\n<!-- figure: a.csv | Two words -->\n"
    outcomes = run_page(text, tmp_path / "page")
    made = notebook(text, outcomes, tmp_path / "page")
    assert made == notebook(text, outcomes, tmp_path / "page")
    cells = nbformat.reads(made, as_version=4)["cells"]
    sources = [cell["source"] for cell in cells]
    assert sources[0].startswith("# A title\n\n*A page of the documentation")
    assert sources[0].endswith("\n\nSee there or [here](https://example.org).")
    assert sources[1:4] == ["%%writefile a.csv\nx\n1", "# a comment\n!ls a.csv\n!ls a.*", "print(2)\n3"]
    assert [cell["execution_count"] for cell in cells if cell["cell_type"] == "code"] == [1, 2, 3]
    assert [output["text"] for cell in cells[2:4] for output in cell["outputs"]] == ["a.csv\na.csv\n", "2\n3\n"]
    assert sources[4] == "```c\nint main;\n```" and sources[5] == "![Two words](attachment:a.csv)"
    assert cells[5]["attachments"]["a.csv"]["image/png"] == base64.b64encode(b"x\n1\n").decode()
