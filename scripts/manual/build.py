"""The manual as a site: what is in it, and how it is built (`scripts/docs.py --site FOLDER`).

Pages are those of docs/, as they are. What Sphinx needs besides is written in a folder that is
removed again: the tree of pages, the reference of Python from docstrings, and the pages of the
project's own folder with their links.
"""

import importlib.util
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from html.parser import HTMLParser
from pathlib import Path, PurePosixPath
from types import ModuleType
from urllib.parse import unquote

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent.parent
DOCS = ROOT / "docs"
# Pages of docs/ by their part of the manual, without ending. `api` and those of PROJECT_PAGES are
# written by the build.
CONTENTS = {
    "First steps": ["start", "tables", "verdicts", "using"],
    "Tutorials": [
        "tutorials/student",
        "tutorials/notebook",
        "tutorials/film",
        "tutorials/lab",
        "tutorials/lecture",
        "tutorials/game",
    ],
    "Further": ["films", "python", "ports"],
    "How it works": ["physics", "inference", "findings", "speed"],
    "Look up": ["reference", "api", "formats", "glossary"],
    "The project": [
        "readme",
        "changelog",
        "contributing",
        "architecture",
        "support",
        "security",
        "conduct",
    ],
}
# Pages of the project's own folder, by their name in the manual.
PROJECT_PAGES = {
    "readme": "README.md",
    "changelog": "CHANGELOG.md",
    "contributing": "CONTRIBUTING.md",
    "support": "SUPPORT.md",
    "security": "SECURITY.md",
    "conduct": "CODE_OF_CONDUCT.md",
}
# Public names by section of the reference.
API = {
    "Verbs": "calibrate check compare predict plan plot simulate track batch export rederive bench",
    "Reading": "load_fit load_batch load_table load_scene contact_time",
    "Models": "model model_from impacts regime_name",
    "Results": "Result Fit Frames Film Batch Exported Drawn",
    "Other types": "Scene ImpactTable Impacts Ball Model Rebound FitballError Verdict __version__",
}
# How a page may ask for another host: what loads without a click.
_LOADS = re.compile(
    r"""<(?:script|img|iframe|source|video|audio|embed|object)\b[^>]*?
        (?:src|srcset|data)\s*=\s*["']?(?:https?:)?//
      | <link\b(?![^>]*rel=["']?canonical)[^>]*?href\s*=\s*["']?(?:https?:)?//
      | @import\s+(?:url\()?["']?(?:https?:)?//
      | url\(\s*["']?(?:https?:)?//""",
    re.VERBOSE | re.IGNORECASE,
)


class SiteError(Exception):
    """The manual cannot be built as it should be; the message says why."""


def pages() -> Iterator[str]:
    """Pages of docs/ without ending, but for the front page."""
    for path in sorted(DOCS.rglob("*.md")):
        name = path.relative_to(DOCS).with_suffix("").as_posix()
        # The paper is written for a journal.
        if name != "index" and not name.startswith("paper/"):
            yield name


def directive(name: str) -> str:
    """What makes Sphinx write the reference of a public name from its docstring."""
    if name == "__version__":
        return ".. py:data:: fitball.__version__\n\n   Version of the package, a text.\n"
    if name == "Verdict":
        return (
            ".. py:data:: fitball.Verdict\n\n   What a fit says of a value, a literal type; see "
            ":doc:`verdicts`.\n"
        )
    if name[0].islower():
        return f".. autofunction:: fitball.{name}\n"
    members = "   :members:\n   :inherited-members: Exception, Mapping, Struct, tuple\n"
    return f".. autoclass:: fitball.{name}\n{members}"


def api_page() -> str:
    """The reference of all public names, as MyST."""
    sections = [
        "# Python reference",
        "All public names, from their docstrings. [In Python](python.md) shows how they are used.",
    ]
    for title, names in API.items():
        body = "\n".join(directive(name) for name in names.split())
        sections += [f"## {title}", f"````{{eval-rst}}\n{body}````"]
    return "\n\n".join(sections) + "\n"


def contents_tree() -> str:
    """The tree of contents, which Sphinx shows at the side of each page."""
    trees = []
    for caption, names in CONTENTS.items():
        # Its title is that of the front page.
        lines = "\n".join("README <readme>" if name == "readme" else name for name in names)
        trees.append(f"```{{toctree}}\n:hidden:\n:caption: {caption}\n:maxdepth: 2\n\n{lines}\n```")
    return "\n\n" + "\n\n".join(trees) + "\n"


def notebooks_script() -> ModuleType:
    """`scripts/notebooks.py` as a module."""
    spec = importlib.util.spec_from_file_location("notebooks", HERE.parent / "notebooks.py")
    if spec is None or spec.loader is None:
        raise ImportError("scripts/notebooks.py is no module")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def add_notebooks(folder: Path) -> None:
    """Put each tutorial beside its page as a notebook, which the page offers."""
    notebooks_script().write(folder, sorted(folder.glob("*.md")), is_run=False)
    for page in folder.glob("*.md"):
        offer = f"\n{{download}}`This page as a notebook <{page.stem}.ipynb>`\n"
        page.write_text(page.read_text(encoding="utf-8") + offer, encoding="utf-8")


def lay_out(folder: Path) -> None:
    """Write the sources of the manual: pages as they are, and those that the build makes."""
    shutil.copytree(DOCS, folder, dirs_exist_ok=True, ignore=shutil.ignore_patterns("paper"))
    add_notebooks(folder / "tutorials")
    (folder / "api.md").write_text(api_page(), encoding="utf-8")
    shutil.copy(ROOT / "CITATION.cff", folder)
    for name, source in PROJECT_PAGES.items():
        text = (ROOT / source).read_text(encoding="utf-8").replace("](docs/", "](")
        (folder / f"{name}.md").write_text(text, encoding="utf-8")
    for page in folder.glob("*.md"):
        text = page.read_text(encoding="utf-8")
        for name, source in PROJECT_PAGES.items():
            text = re.sub(rf"\]\((\.\./)?{re.escape(source)}", f"]({name}.md", text)
        page.write_text(text, encoding="utf-8")
    index = folder / "index.md"
    index.write_text(index.read_text(encoding="utf-8") + contents_tree(), encoding="utf-8")


def outside_loads(texts: Mapping[str, str]) -> list[str]:
    """What pages, by their names, load from another host."""
    return [
        f"{name}: {match[0]}" for name, text in texts.items() for match in _LOADS.finditer(text)
    ]


class Places(HTMLParser):
    """The `anchors` of a page, and where its `links` lead."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors = set[str]()
        self.links = list[str]()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take what a tag is called by, and where it leads."""
        values = dict(attrs)
        self.anchors |= {values.get("id") or ""}
        for key in ("href", "src"):
            if key in values:
                self.links.append(values[key] or "")


def dead_links(site: Path, texts: Mapping[str, str]) -> list[str]:
    """Links of pages, by their names, to a file or an anchor that the site does not have."""
    places = {name: Places(text) for name, text in texts.items() if name.endswith(".html")}
    dead = []
    for name, page in places.items():
        for link in page.links:
            # Addresses of other sites, pictures within the page, the top of the page.
            if re.match(r"\w+:|#?$", link):
                continue
            path, _, anchor = unquote(link).partition("#")
            file = path.partition("?")[0]
            target = (site / PurePosixPath(name).parent / file).resolve() if file else site / name
            inside = target.relative_to(site.resolve()).as_posix() if file else name
            is_known = not anchor or anchor in getattr(places.get(inside), "anchors", ())
            if not target.is_file() or not is_known:
                dead.append(f"{name}: {link}")
    return dead


def sphinx(site: Path) -> None:
    """Write the pages.

    Raises:
        SiteError: Sphinx is not installed, or warns of anything.
    """
    with tempfile.TemporaryDirectory() as temporary:
        sources = Path(temporary, "sources")
        lay_out(sources)
        command = [sys.executable, "-P", "-m", "sphinx", "-b", "html", "-W", "--keep-going", "-q"]
        command += ["-d", f"{temporary}/trees", "-c", str(HERE), str(sources), str(site)]
        if subprocess.run(command).returncode:
            raise SiteError("the manual was not built; the lines above say why")


def build(site: Path) -> int:
    """Build the manual into a folder, in the place of an older one; how many pages it has.

    Raises:
        SiteError: the folder holds something else, Sphinx is not installed or warns of anything, or
            a page loads from another host or has a link that leads nowhere.
    """
    if site.exists() and any(site.iterdir()):
        if not (site / "objects.inv").is_file():
            raise SiteError(f"{site} holds something else than the manual: name an empty folder")
        shutil.rmtree(site)
    sphinx(site)
    texts = {}
    for path in sorted(site.rglob("*")):
        if path.suffix in (".html", ".css", ".js"):
            texts[path.relative_to(site).as_posix()] = path.read_text(encoding="utf-8")
    faults = [f"loads from another host: {words}" for words in outside_loads(texts)]
    faults += [f"leads nowhere: {words}" for words in dead_links(site, texts)]
    if faults:
        raise SiteError("\n".join(faults))
    return sum(name.endswith(".html") for name in texts)
