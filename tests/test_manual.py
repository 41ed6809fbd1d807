"""The manual as a site, and tutorials as notebooks: complete, and nothing of them leads nowhere.
Neither Sphinx nor jupytext is needed.
"""

import re
from itertools import chain
from pathlib import Path

import pytest
from support.scripts import script

import fitball

ROOT = Path(__file__).resolve().parent.parent

manual = script("manual/build")
notebooks = script("notebooks")


def test_every_page_is_in_the_contents_once():
    in_contents = [*chain.from_iterable(manual.CONTENTS.values())]
    assert len(in_contents) == len({*in_contents})
    made = {"api", *manual.PROJECT_PAGES}
    assert {*in_contents} == {*manual.pages()} | made
    assert {"start", "tutorials/student", "physics"} <= {*in_contents}
    assert all((ROOT / source).is_file() for source in manual.PROJECT_PAGES.values())
    tree = manual.contents_tree()
    assert re.findall(r"(?:^|<)([a-z/]+)>?$", tree, re.MULTILINE) == in_contents


def test_every_public_name_is_in_the_reference_once():
    names = [name for of_section in manual.API.values() for name in of_section.split()]
    assert sorted(names) == sorted(fitball.__all__)
    page = manual.api_page()
    for name in names:
        assert len(re.findall(rf":: fitball\.{name}$", page, re.MULTILINE)) == 1, name


def test_pages_of_the_project_link_to_pages_of_the_manual(tmp_path, monkeypatch):
    # Notebooks need jupytext.
    monkeypatch.setattr(manual, "add_notebooks", lambda folder: None)
    manual.lay_out(tmp_path)
    for name, source in manual.PROJECT_PAGES.items():
        text = (tmp_path / f"{name}.md").read_text("utf-8")
        assert "](docs/" not in text, source
        assert f"]({source}" not in text, source
    assert "](readme.md#a-result)" in (tmp_path / "findings.md").read_text("utf-8")
    page = (tmp_path / "physics.md").read_text("utf-8")
    assert page == (ROOT / "docs/physics.md").read_text("utf-8")


@pytest.mark.parametrize(
    "text",
    [
        '<script src="https://cdn.example/mathjax.js"></script>',
        "<img alt='a' src='//example.org/a.png'>",
        '<link rel="stylesheet" href="http://fonts.example/css"/>',
        "@import url('https://fonts.example/css');",
        "body { background: url(https://example.org/a.png) }",
    ],
)
def test_what_loads_from_another_host_is_found(text):
    (found,) = manual.outside_loads({"a.html": text})
    assert found.startswith("a.html: ")


@pytest.mark.parametrize(
    "text",
    [
        '<a href="https://example.org">a link that a reader follows</a>',
        '<script src="_static/search.js"></script>',
        '<link rel="canonical" href="https://example.org/"/>',
        '<math xmlns="http://www.w3.org/1998/Math/MathML"></math>',
    ],
)
def test_what_a_reader_follows_is_no_load(text):
    assert manual.outside_loads({"a.html": text}) == []


def test_links_that_lead_nowhere_are_found(tmp_path):
    texts = {
        "index.html": '<a href="a/b.html#here">1</a><a href="a/b.html#gone">2</a>',
        "a/b.html": '<p id="here"><a href="../index.html">3</a><a href="c.html">4</a>'
        '<a href="#here">5</a><a href="#there">6</a><img src="../curves.png">'
        '<a href="https://example.org/#x">7</a><a href="#">8</a></p>',
    }
    (tmp_path / "a").mkdir()
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    assert manual.dead_links(tmp_path, texts) == [
        "index.html: a/b.html#gone",
        "a/b.html: c.html",
        "a/b.html: #there",
        "a/b.html: ../curves.png",
    ]


def test_a_folder_of_something_else_is_kept(tmp_path):
    (tmp_path / "thesis.tex").write_text("mine")
    with pytest.raises(manual.SiteError, match="something else"):
        manual.build(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "mine"


def test_blocks_become_cells(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "# Title\n\nSee [Films](../films.md#a).\n\n"
        "```csv a.csv\nx\n1\n```\n\n```sh\nfitball check a.csv\n```\n\n"
        "```sh exit=2\nfitball check b.csv\n```\n\n```sh show\npip install .\n```\n\n"
        "```python\nimport fitball\n```\n"
    )
    text = notebooks.notebook_text(page)
    assert "See Films (`docs/films.md`)." in text
    blocks = re.findall(r"^```(\w+)\n(.*?)```$", text, re.MULTILINE | re.DOTALL)
    assert blocks == [
        ("python", "%%writefile a.csv\nx\n1\n"),
        ("python", "%%bash -eu\nfitball check a.csv\n"),
        ("python", "%%bash\nfitball check b.csv || [ $? = 2 ]\n"),
        ("text", "pip install .\n"),
        ("python", "import fitball\n"),
    ]


@pytest.mark.parametrize("page", sorted(notebooks.TUTORIALS.glob("*.md")), ids=lambda p: p.stem)
def test_every_command_of_a_tutorial_is_in_its_notebook(page):
    text = notebooks.notebook_text(page)
    commands = re.findall(r"^fitball \w+", page.read_text("utf-8"), re.MULTILINE)
    assert re.findall(r"^fitball \w+", text, re.MULTILINE) == commands
    # Those that are only shown are no cells.
    run = re.findall(r"^```sh(?! show)", page.read_text("utf-8"), re.MULTILINE)
    assert text.count("%%bash") == len(run)
