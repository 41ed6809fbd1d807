"""A page with what its snippets gave, as a notebook that can be downloaded and run again.

Prose becomes cells of text, Python snippets cells of code with their outputs; a shell command is called with `!`, a
file of the page is written with `%%writefile`. Links within the documentation become plain words: from a notebook
they lead nowhere.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import nbformat
from nbformat import v4
from snippets import FENCE, FIGURE, FILE, Outcome, Snippet, parsed

# Links to pages and to headings, not to the web.
INSIDE = re.compile(r"(?<!!)\[([^\]]+)\]\((?!https?:)[^)]+\)")
BEGIN = (
    "*A page of the documentation of fitball, with its outputs. To run it again you need fitball and Jupyter in one "
    "environment.*"
)


def notebook(text: str, outcomes: Sequence[Outcome], folder: Path) -> str:
    """The page as the text of a notebook of format 4; `folder` holds the pictures of its outcomes.

    Raises nbformat.ValidationError.
    """
    title, rest = text.split("\n", 1)
    cells = list(_cells(f"{title}\n\n{BEGIN}\n{rest}", iter(outcomes), folder))
    count = 0
    for place, cell in enumerate(cells):
        # The same page gives the same bytes.
        cell["id"] = f"cell-{place + 1}"
        if cell["cell_type"] == "code":
            count += 1
            cell["execution_count"] = count
            for output in cell["outputs"]:
                if output["output_type"] == "execute_result":
                    output["execution_count"] = count
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    made = v4.new_notebook(cells=cells, metadata={"kernelspec": kernel, "language_info": {"name": "python"}})
    nbformat.validate(made)
    return str(nbformat.writes(made))


def _cells(text: str, outcomes: Iterator[Outcome], folder: Path) -> Iterator[Any]:
    end = 0
    for found in FENCE.finditer(text):
        yield from _prose(text[end : found.start()], folder)
        end = found.end()
        item = parsed(found)
        if item.file is not None:
            yield v4.new_code_cell(f"%%writefile {item.file}\n{item.code.rstrip()}")
        elif item.runs:
            yield _code(item, next(outcomes), folder)
        else:
            yield v4.new_markdown_cell(found.group())
    yield from _prose(text[end:], folder)


def _code(item: Snippet, outcome: Outcome, folder: Path) -> Any:
    code = item.code.rstrip()
    if item.language == "bash":
        code = re.sub(r"^(?=[^#\s])", "!", code, flags=re.MULTILINE)
    outputs = []
    if outcome.text.strip():
        outputs.append(v4.new_output("stream", name="stdout", text=outcome.text.rstrip("\n") + "\n"))
    if outcome.html:
        outputs.append(v4.new_output("execute_result", data={"text/html": outcome.html}))
    outputs += [
        v4.new_output("display_data", data={"image/png": _encoded(folder / name)}) for name in outcome.pictures
    ]
    hidden = {"jupyter": {"source_hidden": True}} if item.hidden else {}
    return v4.new_code_cell(code, outputs=outputs, metadata=hidden)


def _prose(text: str, folder: Path) -> Iterator[Any]:
    attached = {}

    def picture(found: re.Match[str]) -> str:
        name = found["file"].replace("/", "-")
        attached[name] = {"image/png": _encoded(folder / found["file"])}
        return f"![{found['words']}](attachment:{name})"

    words = FIGURE.sub(picture, text)
    words = FILE.sub(lambda found: f"{found['words']}: `{found['file']}`", words)
    words = INSIDE.sub(r"\1", words).strip()
    if words:
        yield v4.new_markdown_cell(words, **({"attachments": attached} if attached else {}))


def _encoded(place: Path) -> str:
    return base64.b64encode(place.read_bytes()).decode("ascii")
