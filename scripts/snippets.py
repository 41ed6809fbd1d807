"""Snippets of a Markdown page: read, run in a folder as a reader would run them, and woven in with what they gave.

A fence says in its first line what becomes of it. `bash` and `python` are run, one after another, in one folder
and one namespace for each page; `csv NAME`, `toml NAME` and the like are written to the file NAME first; any other
fence is only shown. Further words:

- `silent`: what it prints is not shown;
- `parts=1,4-6`: of what it prints these paragraphs only, counted from 1;
- `status=2`: the exit code it must have;
- `needs=node`: it is run only where that program is on the path, and only shown elsewhere.

The code of a fence inside an HTML comment (`<!--` on the line before, `-->` on the line after) is run and not shown.
`<!-- figure: FILE | WORDS -->` shows a picture that earlier snippets drew; `<!-- file: FILE | WORDS -->` links to
a file that they wrote.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import importlib
import io
import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

FENCE = re.compile(
    r"^(?P<hidden><!--\n)?(?P<marks>```+)(?P<info>[a-z]\w*[^\n`]*)\n(?P<code>.*?)^(?P=marks)$(?(hidden)\n-->$)",
    re.DOTALL | re.MULTILINE,
)
FIGURE = re.compile(r"^<!-- figure: (?P<file>\S+) \| (?P<words>[^\n]*) -->$", re.MULTILINE)
FILE = re.compile(r"^<!-- file: (?P<file>\S+) \| (?P<words>[^\n]*) -->$", re.MULTILINE)
RUN = ("bash", "python")
# Of the terminal that a page shows.
COLUMNS = "88"


@dataclass(frozen=True)
class Snippet:
    """A fence: its language, code, the file it becomes, and what is shown of its output."""

    language: str
    code: str
    file: str | None = None
    silent: bool = False
    parts: tuple[int, ...] = ()
    status: int = 0
    needs: str = ""
    hidden: bool = False

    @property
    def runs(self) -> bool:
        """Whether it is run."""
        return self.language in RUN

    def visible(self, printed: str) -> str:
        """The part of its output that the page shows."""
        paragraphs = re.split(r"\n[ \t]*\n", printed.strip("\n"))
        if self.silent:
            return ""
        if not self.parts:
            return "\n\n".join(paragraphs)
        if self.parts[-1] > len(paragraphs):
            raise SnippetError(f"{self.code}\nprinted {len(paragraphs)} paragraphs, not {self.parts[-1]}:\n{printed}")
        chosen = []
        for place, number in enumerate(self.parts):
            if number > 1 and (place == 0 or self.parts[place - 1] != number - 1):
                chosen.append("...")
            chosen.append(paragraphs[number - 1])
        return "\n\n".join([*chosen, "..."] if self.parts[-1] < len(paragraphs) else chosen)


@dataclass(frozen=True)
class Outcome:
    """What a snippet gave: text, a table in HTML, pictures (files in the folder of the page)."""

    text: str = ""
    html: str = ""
    pictures: tuple[str, ...] = ()


class SnippetError(Exception):
    """A snippet did not do what its page says."""


# Runs shell code in a folder: exit code and what it printed.
Shell = Callable[[str, Path], tuple[int, str]]


def parsed(found: re.Match[str]) -> Snippet:
    """The snippet of a match of FENCE."""
    info, code = found["info"], found["code"]
    language, *words = info.split()
    parts: list[int] = []
    status, file, silent, needs = 0, None, False, ""
    for word in words:
        key, given, value = word.partition("=")
        if key == "parts" and given:
            for item in value.split(","):
                first, _, last = item.partition("-")
                parts += range(int(first), int(last or first) + 1)
        elif key == "status" and given:
            status = int(value)
        elif key == "needs" and given:
            needs = value
        elif word == "silent":
            silent = True
        elif language not in RUN and not given and file is None:
            file = word
        else:
            raise SnippetError(f"the fence {info!r} has a word that means nothing: {word}")
    return Snippet(language, code, file, silent, tuple(parts), status, needs, bool(found["hidden"]))


def snippets(text: str) -> list[Snippet]:
    """The fences of a page in their order."""
    return [parsed(found) for found in FENCE.finditer(text)]


def figures(text: str) -> list[tuple[str, str]]:
    """File and words of every picture that a page expects of its snippets."""
    return [(found["file"], found["words"]) for found in FIGURE.finditer(text)]


def files(text: str) -> list[str]:
    """Every file of its snippets that a page links to."""
    return [found["file"] for found in FILE.finditer(text)]


def posix_shell(code: str, folder: Path) -> tuple[int, str]:
    """Run by `sh`, which stops at the first command that fails. Returns stdout, after a failure with stderr."""
    done = subprocess.run(
        ["sh", "-e", "-c", code], cwd=folder, capture_output=True, text=True, check=False,
        # A reader has `python`; a machine may have none but that of the environment this runs in.
        env=dict(os.environ, COLUMNS=COLUMNS, PATH=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"),
    )  # fmt: skip
    return done.returncode, done.stdout + (done.stderr if done.returncode else "")


def run_page(text: str, folder: Path, shell: Shell = posix_shell) -> list[Outcome]:
    """Run the snippets of a page in `folder`, which is made anew. One outcome for each snippet that runs.

    Raises SnippetError where an exit code is another, an exception is raised, or a picture is missing.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    with _on_the_path(folder):
        outcomes = _run_all(snippets(text), folder, shell)
    if "matplotlib.pyplot" in sys.modules:
        # What a page drew by pyplot would stay open, as in a notebook.
        sys.modules["matplotlib.pyplot"].close("all")
    for file in (*(file for file, _ in figures(text)), *files(text)):
        if not (folder / file).is_file():
            raise SnippetError(f"no snippet has made {file}")
    return outcomes


@contextlib.contextmanager
def _on_the_path(folder: Path) -> Iterator[None]:
    """Modules of the folder can be imported, as in a notebook, and are forgotten afterwards."""
    before = list(sys.path)
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
    try:
        yield
    finally:
        sys.path[:] = before
        for name, module in list(sys.modules.items()):
            if Path(getattr(module, "__file__", None) or "/").is_relative_to(folder):
                del sys.modules[name]


def _run_all(items: list[Snippet], folder: Path, shell: Shell) -> list[Outcome]:
    names: dict[str, Any] = {"__name__": "__main__"}
    outcomes = []
    for item in items:
        if item.file is not None:
            (folder / item.file).write_text(item.code, encoding="utf-8")
        elif item.needs and shutil.which(item.needs) is None:
            outcomes.append(Outcome())
        elif item.language == "bash":
            status, printed = shell(item.code, folder)
            if status != item.status:
                raise SnippetError(f"{item.code}\nended with {status}, not {item.status}:\n{printed}")
            outcomes.append(Outcome(item.visible(printed)))
        elif item.language == "python":
            outcomes.append(_run_python(item, folder, names, len(outcomes)))
    return outcomes


def _run_python(item: Snippet, folder: Path, names: dict[str, Any], place: int) -> Outcome:
    """As in a cell of a notebook: the value of a last expression is shown, figures as pictures."""
    tree = ast.parse(item.code)
    last = tree.body[-1] if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    if last is not None:
        tree.body.pop()
    printed = io.StringIO()
    value = None
    try:
        with contextlib.chdir(folder), contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
            exec(compile(tree, "snippet", "exec"), names)
            if last is not None:
                value = eval(compile(ast.Expression(last.value), "snippet", "eval"), names)
    except Exception as error:
        raise SnippetError(f"{item.code}\nraised {type(error).__name__}: {error}") from error
    if item.silent or value is None:
        return Outcome(item.visible(printed.getvalue()))
    pictures = []
    for drawn in _drawn(value):
        pictures.append(f"cell-{place + 1}-{len(pictures) + 1}.png")
        drawn.savefig(folder / pictures[-1], dpi=110, bbox_inches="tight")
    if pictures:
        return Outcome(item.visible(printed.getvalue()), pictures=tuple(pictures))
    if hasattr(value, "_repr_html_"):
        return Outcome(item.visible(printed.getvalue()), html=value._repr_html_())
    return Outcome(item.visible(f"{printed.getvalue()}{value!r}"))


def _drawn(value: Any) -> list[Any]:
    """Figures of a value, be it a figure, axes, or an array of them."""
    if hasattr(value, "savefig"):
        return [value]
    if hasattr(value, "get_figure"):
        return [value.get_figure()]
    if hasattr(value, "ravel") and getattr(value, "dtype", None) is not None and value.dtype.kind == "O":
        # Axes that were taken out of a grid belong to no figure.
        found = [item.get_figure() for item in value.ravel() if hasattr(item, "get_figure")]
        return [figure for figure in dict.fromkeys(found) if figure is not None]
    return []


def woven(text: str, outcomes: list[Outcome], place: str, beside: str = "") -> str:
    """The page as Sphinx reads it, with what its snippets gave; `place` leads from the page to their folder, `beside`
    to where files that are linked to will lie.
    """
    left = iter(outcomes)

    def fence(found: re.Match[str]) -> str:
        item = parsed(found)
        if item.file is not None:
            return _block("text", item.code, f":caption: {item.file}")
        if not item.runs:
            return _block(item.language, item.code)
        code = "" if item.hidden else _block("bash" if item.language == "bash" else "python", item.code)
        return code + _given(next(left), place)

    def figure(found: re.Match[str]) -> str:
        return f"```{{figure}} {place}/{found['file']}\n:alt: {found['words']}\n\n{found['words']}\n```"

    def link(found: re.Match[str]) -> str:
        target = f"{beside}/{found['file']}"
        return f'```{{raw}} html\n<p><a class="reference" href="{target}">{found["words"]}</a></p>\n```'

    return FILE.sub(link, FIGURE.sub(figure, FENCE.sub(fence, text)))


def _block(language: str, code: str, *options: str) -> str:
    body = code if code.endswith("\n") else code + "\n"
    return "\n".join([f"````{{code-block}} {language}", *options, "", body + "````"])


def _given(outcome: Outcome, place: str) -> str:
    parts = [""]
    if outcome.text.strip():
        parts.append(_block("text", outcome.text, ":class: output"))
    if outcome.html:
        parts.append(f'````{{raw}} html\n<div class="table-wrapper frame">{outcome.html}</div>\n````')
    parts += [f"```{{image}} {place}/{name}\n:alt: figure drawn by the lines above\n```" for name in outcome.pictures]
    return "\n\n".join(parts)


ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"


def pages() -> dict[str, str]:
    """Text of every page of docs/, by its name without the ending; the paper is none."""
    first = {file: file.relative_to(DOCS).parts[0] for file in sorted(DOCS.rglob("*.md"))}
    files = [file for file, part in first.items() if not part.startswith("_") and part != "paper"]
    return {file.relative_to(DOCS).with_suffix("").as_posix(): file.read_text(encoding="utf-8") for file in files}


def code_mark() -> str:
    """Digest of all that a snippet may run."""
    digest = hashlib.sha256()
    for folder in ("fitball", "datasets"):
        for file in sorted((ROOT / folder).rglob("*")):
            if file.is_file() and "__pycache__" not in file.parts:
                digest.update(file.name.encode() + file.read_bytes())
    return digest.hexdigest()


def page_mark(text: str) -> str:
    """Digest of what a page runs and expects to be drawn; its prose may change."""
    return hashlib.sha256(repr((snippets(text), figures(text), files(text))).encode()).hexdigest()


def outcomes_of(folder: Path, page: str) -> list[Outcome] | None:
    """What the snippets of a page gave; None where they have not run."""
    kept = folder / f"{page}.json"
    if not kept.is_file():
        return None
    return [Outcome(**item) for item in json.loads(kept.read_text(encoding="utf-8"))["outcomes"]]


def is_current(folder: Path, page: str, text: str, code: str | None) -> bool:
    """Whether a page has run as it is, by this code (None: by any)."""
    kept = folder / f"{page}.json"
    if not kept.is_file():
        return False
    marks = json.loads(kept.read_text(encoding="utf-8"))
    return marks["page"] == page_mark(text) and code in (None, marks["code"])


def make(folder: Path, page: str, text: str, code: str, shell: Shell) -> None:
    """Run the snippets of a page and keep what they gave. Raises SnippetError."""
    # Messages name a bundled table with its place on this machine.
    outcomes = [
        replace(item, text=item.text.replace(f"{ROOT}/", "")) for item in run_page(text, folder / page, shell)
    ]
    kept = {"page": page_mark(text), "code": code, "outcomes": [asdict(item) for item in outcomes]}
    (folder / f"{page}.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


class SharedFits:
    """A shell in which a bundled table is fitted or compared once, however many pages do it with the same words."""

    def __init__(self, made: Path, shell: Shell = posix_shell) -> None:
        self._place, self._shell = made / "shared", shell
        self._done: dict[str, tuple[int, str]] = {}
        shutil.rmtree(self._place, ignore_errors=True)

    def __call__(self, code: str, folder: Path) -> tuple[int, str]:
        """Run, or take what was run. See `snippets.Shell`."""
        words = code.split()
        known = words[:2] == ["fitball", "calibrate"] and len(words) == 3
        known = known or (words[:2] == ["fitball", "compare"] and words[3:] == ["--quick"])
        if not known or not (ROOT / "datasets" / words[2]).is_file() or (folder / words[2]).exists():
            return self._shell(code, folder)
        key = " ".join(words)
        place = self._place / hashlib.sha256(key.encode()).hexdigest()[:12]
        if key not in self._done:
            place.mkdir(parents=True)
            self._done[key] = self._shell(code, place)
        shutil.copytree(place, folder, dirs_exist_ok=True)
        return self._done[key]
