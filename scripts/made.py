"""What the snippets of pages gave, kept in a folder: `PAGE.json` beside the folder `PAGE` where they ran."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

from snippets import Outcome, Shell, figures, files, posix_shell, run_page, snippets

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"


def pages() -> dict[str, str]:
    """Text of every page of docs/, by its name without the ending."""
    files = [file for file in sorted(DOCS.rglob("*.md")) if not file.relative_to(DOCS).parts[0].startswith("_")]
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


def outcomes_of(made: Path, page: str) -> list[Outcome] | None:
    """What the snippets of a page gave; None where they have not run."""
    kept = made / f"{page}.json"
    if not kept.is_file():
        return None
    return [Outcome(**item) for item in json.loads(kept.read_text(encoding="utf-8"))["outcomes"]]


def is_current(made: Path, page: str, text: str, code: str | None) -> bool:
    """Whether a page has run as it is, by this code (None: by any)."""
    kept = made / f"{page}.json"
    if not kept.is_file():
        return False
    marks = json.loads(kept.read_text(encoding="utf-8"))
    return marks["page"] == page_mark(text) and code in (None, marks["code"])


def make(made: Path, page: str, text: str, code: str, shell: Shell) -> None:
    """Run the snippets of a page and keep what they gave. Raises SnippetError."""
    # A bundled table is told with its place, which is nobody's but this machine's.
    outcomes = [replace(item, text=item.text.replace(f"{ROOT}/", "")) for item in run_page(text, made / page, shell)]
    kept = {"page": page_mark(text), "code": code, "outcomes": [asdict(item) for item in outcomes]}
    (made / f"{page}.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


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
