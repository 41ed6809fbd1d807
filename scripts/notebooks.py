"""Tutorials as notebooks: `notebooks.py FOLDER [--run] [PAGE ...]`, with the extra `notebooks`.

Each page of docs/tutorials, or PAGE, becomes FOLDER/NAME.ipynb. With `--run` it is run, in a folder
of its own that is empty at first, and FOLDER has it with its output.

    ```python      is a cell; `python show` stays text
    ```sh          is a cell of bash that ends at the first error; `sh show` stays text, and of
                   `sh exit=2` the last command must end with that code
    ```csv a.csv   is a cell that writes this file
    ```text        output: stays text
"""

import argparse
import os
import re
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
TUTORIALS = ROOT / "docs" / "tutorials"
# Seconds after which a cell that does not end has failed.
CELL_SECONDS = 1800
# A fenced block: language, the words after it, content.
_FENCE = re.compile(r"^```(\S*) ?(.*)\n((?:.*\n)*?)```$", re.MULTILINE)
# A link to another page.
_LINK = re.compile(r"\[([^\]]+)\]\(\.\./([\w/.-]+\.md)[^)]*\)")
_HEAD = "*Made from `docs/tutorials/{name}.md`. It writes files into its folder.*\n\n"


def cell(block: re.Match[str]) -> str:
    """A fenced block of a page as one that jupytext makes a cell of, if it is to be run."""
    language, words, code = block.groups()
    if "." in words:
        return f"```python\n%%writefile {words}\n{code}```"
    if words == "show":
        return f"```text\n{code}```"
    if language == "sh" and words:
        code_of_exit = words.removeprefix("exit=")
        return f"```python\n%%bash\n{code.rstrip()} || [ $? = {code_of_exit} ]\n```"
    if language == "sh":
        return f"```python\n%%bash -eu\n{code}```"
    return block[0]


def notebook_text(page: Path) -> str:
    """A page as jupytext reads it. Links to other pages, which a notebook does not have beside it,
    become their names.
    """
    text = _FENCE.sub(cell, page.read_text(encoding="utf-8"))
    title, _, rest = text.partition("\n\n")
    head = _HEAD.format(name=page.stem)
    return f"{title}\n\n{head}" + _LINK.sub(r"\1 (`docs/\2`)", rest)


def notebook_of(page: Path) -> Any:
    """A page as a notebook without output. The same page gives the same bytes."""
    import jupytext

    notebook = jupytext.reads(notebook_text(page), fmt="md")
    for number, one in enumerate(notebook.cells):
        # They are random otherwise.
        one["id"] = f"{page.stem}-{number}"
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    return notebook


def run(notebook: Any, folder: Path) -> None:
    """Run all cells in a folder; output goes into the notebook.

    Raises:
        CellExecutionError: a cell fails.
    """
    from nbclient import NotebookClient

    resources = {"metadata": {"path": str(folder)}}
    NotebookClient(notebook, timeout=CELL_SECONDS, resources=resources).execute()


def write(folder: Path, pages: Sequence[Path], is_run: bool) -> int:
    """Write notebooks into a folder, after a run each if they are to be run; how many failed."""
    import nbformat
    from nbclient.exceptions import CellExecutionError

    folder.mkdir(parents=True, exist_ok=True)
    failed = []
    for page in pages:
        notebook = notebook_of(page)
        if is_run:
            with tempfile.TemporaryDirectory() as work:
                try:
                    run(notebook, Path(work))
                except CellExecutionError as error:
                    print(f"==== {page.stem}\n{error}")
                    failed.append(page.stem)
        nbformat.write(notebook, folder / f"{page.stem}.ipynb")
    done = "ran" if is_run else "written"
    print(f"{len(pages) - len(failed)} notebooks {done}, failed: {', '.join(failed) or 'none'}")
    return len(failed)


def main() -> int:
    """Write or run notebooks as the options say; 1 where one fails."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER")
    parser.add_argument("--run", action="store_true")
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE")
    arguments = parser.parse_intermixed_args()
    # Cells of bash call the fitball of this Python.
    os.environ["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    pages = arguments.pages or sorted(TUTORIALS.glob("*.md"))
    return int(write(arguments.folder, pages, arguments.run) > 0)


if __name__ == "__main__":
    sys.exit(main())
