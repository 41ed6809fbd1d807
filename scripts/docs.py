"""Generated parts, links, words and commands of README.md and docs/: `docs.py [--check] [--run]
[--site FOLDER] [PAGE ...]`.

Without an option the generated parts are written from the code. `--check` names those that are out
of date and links that lead nowhere, and counts words. `--run` runs the pages, each in a folder that
is empty at first (in DIR with `--keep DIR`, where it stays):

    ```sh          in bash, must succeed; `sh exit=2` must end with that code; `sh show` is not run
    ```python      blocks of a page share their names; `python show` is not run
    ```csv a.csv   is written to that file, of any language
    ```text        output: lines that are not printed are listed, but are no fault, since digits
                   depend on the machine

Words are counted without generated parts and output, and without pages for developers.

`--site` builds the manual as a site, with the extras `docs` and `notebooks`
(scripts/manual/build.py).
"""

import argparse
import ast
import importlib.util
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

from fitball import cli
from fitball.base import units as spellings
from fitball.base.columns import COLUMNS
from fitball.base.prior_families import FAMILIES
from fitball.data import scene as scenes
from fitball.data.bundled import published_priors
from fitball.exports.engines import engines
from fitball.models.registry import MODELS, model
from fitball.models.specs import BALL_PARAMETERS, SPECS

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs/tutorials").glob("*.md")),
]
# Limit of words in docs/, so that pages are shortened where others grow.
MOST_WORDS = 16_000
# A generated part of a page, with its name.
_PART = re.compile(r"(<!-- generated: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
# A fenced block: fence, language, the words after it, content.
_FENCE = re.compile(r"^(`{3,})(\S*) ?(.*)\n((?:.*\n)*?)\1$", re.MULTILINE)
# How the package says who carries a code, where the name of the call does not.
_CARRIERS = {"fault": "Fault", "_fault": "Fault", "refusal": "Fault", "note": "Note"}
# A code of an error, a fault or a note.
_CODE = re.compile(r"[a-z]+(-[a-z]+)*")
# Seconds after which a page that does not end has failed.
PAGE_SECONDS = 3600
# A page as a program: line n of the page is its line n, so that tracebacks lead there.
_RUN = """import subprocess, sys
def _sh(code, exit_code):
    print("$ " + code.rstrip().replace("\\n", "\\n$ "), flush=True)
    shell = ["bash", "-euo", "pipefail", "-c", code]
    process = subprocess.run(shell, stdout=subprocess.PIPE, text=True)
    printed.extend(process.stdout.splitlines())
    print(process.stdout, flush=True)
    if process.returncode != exit_code:
        raise SystemExit(f"exit code {process.returncode}, expected {exit_code}: {code}")
def _text(block):
    for line in set(block.splitlines()) - set(printed) if printed else ():
        print("NOT PRINTED NOW:", line)
printed = []
names = {"__name__": "__main__", "_sh": _sh, "_text": _text}
exec(compile(sys.argv[2], sys.argv[1], "exec"), names)
"""


def table(heads: str, rows: Iterable[Iterable[object]]) -> str:
    """A table of Markdown with heads that are separated by `|`."""
    lines = [heads.split("|"), ["---"] * (heads.count("|") + 1), *rows]
    return "".join(f"| {' | '.join(str(cell) for cell in line)} |\n" for line in lines)


def load_script(name: str) -> ModuleType:
    """Another script of this folder as a module."""
    place = Path(__file__).parent / f"{name}.py"
    spec = importlib.util.spec_from_file_location(place.stem, place)
    if spec is None or spec.loader is None:
        raise ImportError(f"{place} is no module")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def columns_table() -> str:
    """The table of columns of numbers."""
    rows = []
    for column in COLUMNS.values():
        unit, factor = ("deg", 57.29577951) if column.unit == "rad" else (column.unit, 1.0)
        limits = " to ".join(f"{limit * factor:.4g}" for limit in column.limits)
        rows.append((f"`{column.name}`", column.title, unit, limits, column.opposite))
    return table("column|means|without a unit|limits|`--flip` reads it", rows)


def units_table() -> str:
    """The table of units, with the words by which people spell them."""
    words = {**spellings._WORDS, **spellings._WHOLE}
    rows = []
    for si, factors in spellings._UNITS.items():
        for symbol, (above, below) in factors.items():
            others = [word for word, meaning in words.items() if meaning == symbol != word]
            spelled = ", ".join(f"`{word}`" for word in others)
            rows.append((f"`{symbol}`", f"{above / below:.8g} {si}", spelled))
    return table("unit|is|also spelled", rows)


def scene_value(kind: object) -> str:
    """What a key of a scene takes, in words."""
    if isinstance(kind, scenes._Range):
        # Limits that large are none.
        if kind.low > -1e300:
            return f"{kind.low:g} to {kind.high:g} {kind.unit}"
        return "a number in SI"
    if isinstance(kind, tuple):
        return ", ".join(f"`{text}`" for text in kind) or "a text"
    return "columns"


def scene_table() -> str:
    """The table of keys of scenes."""
    rows = []
    for key, kind in scenes._KEYS.items():
        section, _, name = key.partition(".")
        rows.append((f"`[{section}]`", f"`{name or 'value, sd'}`", scene_value(kind)))
    return table("section|key|takes", rows)


def options_text() -> str:
    """A section for each verb with a table of its arguments and options; then those of all."""
    shared = cli.help_of(cli.VERBS["calibrate"]).arguments
    sections = []
    for verb in cli.VERBS.values():
        words = cli.help_of(verb)
        rows = []
        for name, parameter in cli.parameters_of(verb).items():
            # No option: the command line shows progress by itself.
            if name == "progress":
                continue
            value, meaning = words.arguments.get(name) or shared.get(name) or ("", "")
            is_option = parameter.kind is parameter.KEYWORD_ONLY
            flag = f"--{name.replace('_', '-')} " if is_option else ""
            rows.append((f"`{(flag + value).strip()}`", meaning))
        sections += [f"### {verb.__name__}", words.summary]
        if words.text:
            sections.append(words.text)
        if rows:
            sections.append(table("argument|means", rows).rstrip())
    common = [(f"`--{name}`", meaning) for name, meaning in cli.OUTPUT_OPTIONS.items()]
    return "\n\n".join([*sections, "### Every verb", table("option|means", common)])


def parameters_table() -> str:
    """The table of parameters of models, with their default priors."""
    names_of = {name: {spec.name for spec in model(name).parameters} for name in MODELS}
    rows = []
    for name, spec in SPECS.items():
        models = ", ".join(text for text, names in names_of.items() if name in names)
        if not models and name in BALL_PARAMETERS:
            models = "all, with an sd in the scene"
        elif not models:
            models = "two-mass with other options"
        rows.append((f"`{name}`", spec.meaning, spec.unit, f"`{spec.prior}`", models))
    return table("parameter|means|unit|default prior|models", rows)


def families_table() -> str:
    """The table of families of priors; their meaning is the first sentence of each class."""
    rows = []
    for family in FAMILIES.values():
        meaning = (family.__doc__ or "").partition(".")[0].replace("\n", " ")
        rows.append((f"`{family.form}`", " ".join(meaning.split()), family.coordinate_kind.name))
    return table("prior|of|coordinate", rows)


def priors_table() -> str:
    """The table of published priors."""
    rows = []
    for row in published_priors():
        prior = f"`{row['distribution']}({row['value']}, {row['sd']})`"
        source = f"{row['source']}: {row['note']}"
        rows.append((f"`{row['parameter']}`", f"`literature:{row['key']}`", prior, source))
    return table("parameter|key|prior|source", rows)


def codes_of_call(call: ast.Call) -> tuple[str, list[str]]:
    """Who carries the code in a call, a class of errors, `Fault` or `Note`, and the texts among its
    first arguments that look like a code; no texts of other calls.
    """
    name = getattr(call.func, "id", getattr(call.func, "attr", ""))
    carrier = _CARRIERS.get(name, name)
    if carrier not in ("Fault", "Note") and not carrier.endswith("Error"):
        return carrier, []
    constants = [argument.value for argument in call.args if isinstance(argument, ast.Constant)]
    texts = [value for value in constants if isinstance(value, str)]
    return carrier, [text for text in texts[:2] if _CODE.fullmatch(text)]


def handed_texts(node: ast.AST, places: Mapping[str, int]) -> list[str]:
    """The text that a node hands on as a code may be: the argument at one of the `places` of calls,
    by name of a function; what is handed back first; a key that is set.
    """
    values: Sequence[ast.expr] = ()
    if isinstance(node, ast.Call):
        place = places.get(getattr(node.func, "id", ""), len(node.args))
        values = node.args[place : place + 1]
    elif isinstance(node, ast.Return | ast.Yield) and isinstance(node.value, ast.Tuple):
        values = node.value.elts[:1]
    elif isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store):
        values = [node.slice]
    constants = [value.value for value in values if isinstance(value, ast.Constant)]
    texts = [value for value in constants if isinstance(value, str)]
    return [text for text in texts if _CODE.fullmatch(text)]


def passed_codes(tree: ast.Module) -> Iterator[tuple[str, str]]:
    """Carrier and code of what a module passes to carriers as a variable `code`."""
    places = {}
    calls_of_carriers = set[ast.AST]()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            names = [argument.arg for argument in node.args.args]
            if "code" in names and names[0] == "self":
                # Methods that add what they are given are carriers themselves.
                calls_of_carriers |= {*ast.walk(node)}
            elif "code" in names:
                places[node.name] = names.index("code")
    texts = {text for node in ast.walk(tree) for text in handed_texts(node, places)}
    for node in {*ast.walk(tree)} - calls_of_carriers:
        if isinstance(node, ast.Call):
            carrier, _ = codes_of_call(node)
            is_passed = any(getattr(value, "id", "") == "code" for value in node.args)
            if is_passed and carrier in ("Fault", "Note"):
                yield from ((carrier, text) for text in texts)


def codes_table() -> str:
    """The table of codes of errors, faults and notes, as calls in the package have them."""
    codes_by_carrier = dict[str, set[str]]()
    for path in Path(cli.__file__).parent.rglob("*.py"):
        tree = ast.parse(path.read_text("utf-8"))
        for carrier, code in passed_codes(tree):
            codes_by_carrier.setdefault(carrier, set()).add(code)
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                carrier, codes = codes_of_call(node)
                if codes:
                    codes_by_carrier.setdefault(carrier, set()).update(codes)
    rows = []
    for carrier, of_carrier in sorted(codes_by_carrier.items()):
        rows.append((carrier, ", ".join(f"`{code}`" for code in sorted(of_carrier))))
    return table("carried by|codes", rows)


def shapes_table() -> str:
    """The table of films as packages write them, of `scripts/shapes.py`."""
    shapes: Any = load_script("shapes")
    rows = []
    for shape in shapes.SHAPES:
        package = f"{shape.package} {shapes.PACKAGES[shape.package]}"
        rows.append((package, shape.call, f"`{shape.header}`"))
    return table("written by|call|header, or contents", rows)


def engines_table() -> str:
    """The table of physics engines, of `fitball/exports/engines/engines.toml`."""
    rows = []
    for engine in engines().values():
        way = {"settings": "settings", "fine steps": "settings, fine steps", "port": "port only"}
        run = "" if engine.run else ", not run"
        seen = ""
        for rate, (v_x2, v_y2, omega_2) in engine.seen.items():
            seen = f"{v_x2}, {v_y2}, {omega_2} at {rate} Hz"
        rows.append((engine.name, engine.version, way[engine.works] + run, seen))
    return table("engine|version|by|rms of `v_x2`, `v_y2` [m/s], `omega_2` [rad/s]", rows)


# What writes a generated part, by the name that pages have for it.
GENERATORS = {
    "columns": columns_table,
    "units": units_table,
    "scene": scene_table,
    "options": options_text,
    "parameters": parameters_table,
    "families": families_table,
    "priors": priors_table,
    "codes": codes_table,
    "shapes": shapes_table,
    "engines": engines_table,
}


def with_generated(text: str) -> str:
    """A page whose generated parts are written anew."""
    return _PART.sub(lambda match: match[1] + GENERATORS[match[2]]() + match[3], text)


def anchors(page: Path) -> set[str]:
    """The anchors of the headings of a page, as forges make them."""
    heads = re.findall(r"^#+ (.*)$", _FENCE.sub("", page.read_text("utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def dead_links(page: Path, text: str) -> Iterator[str]:
    """A fault for each link of a page to a file or heading that is not there."""
    prose = re.sub(r"`[^`\n]*`", "", _FENCE.sub("", text))
    for link in re.findall(r"\]\(([^()\s]+)\)", prose):
        # Addresses of other sites are not looked up.
        if re.match(r"\w+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            yield f"no such place: {link}"


def words_of(text: str) -> int:
    """The number of words of a page, without generated parts and output."""
    by_hand = _PART.sub("", text)
    return len(_FENCE.sub(lambda block: "" if block[2] == "text" else block[0], by_hand).split())


def check() -> int:
    """Print the words of each page with its faults; the number of faults, with one for too many
    words.
    """
    fault_count = 0
    word_count = 0
    for page in PAGES:
        text = page.read_text("utf-8")
        name = page.relative_to(ROOT).as_posix()
        faults = [*dead_links(page, text)]
        if with_generated(text) != text:
            faults.insert(0, "generated parts are out of date: run scripts/docs.py")
        words = words_of(text)
        fault_count += len(faults)
        # Neither README.md nor the page for developers counts.
        if "/" in name and page.stem != "architecture":
            word_count += words
        print(f"{words:6} {name}", *faults, sep="\n       ")
    fault_count += word_count > MOST_WORDS
    print(f"{word_count} words in docs/ of at most {MOST_WORDS}; {fault_count} faults")
    return fault_count


def run(page: Path, folder: Path) -> bool:
    """Run a page in a folder; whether it failed."""
    folder.mkdir(parents=True)
    text = page.read_text("utf-8")
    lines = [""] * (text.count("\n") + 1)
    for block in _FENCE.finditer(text):
        line = text.count("\n", 0, block.start()) + 1
        language = block[2]
        options = block[3].strip()
        code = block[4]
        if "." in options:
            lines[line] = f"open({options!r}, 'w', encoding='utf-8').write({code!r})"
        elif language == "python" and options != "show":
            lines[line : line + code.count("\n")] = code.splitlines()
        elif language == "text":
            lines[line] = f"_text({code!r})"
        elif language == "sh" and options != "show":
            lines[line] = f"_sh({code!r}, {int(options.removeprefix('exit=') or 0)})"
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    command = [sys.executable, "-P", "-c", _RUN, str(page), "\n".join(lines)]
    environment = {**os.environ, "PATH": path}
    process = subprocess.run(command, cwd=folder, env=environment, timeout=PAGE_SECONDS)
    return process.returncode != 0


def run_pages(pages: Sequence[Path], keep: Path | None) -> int:
    """Run pages, each in its folder of `keep` or of a folder that is removed; the number that
    failed.
    """
    failed = []
    with tempfile.TemporaryDirectory() as temporary:
        for page in pages:
            print(f"==== {page.stem}", flush=True)
            folder = (keep or Path(temporary)).resolve() / page.stem
            if run(page.resolve(), folder):
                failed.append(page.stem)
    print(f"{len(pages) - len(failed)} pages ran, failed: {', '.join(failed) or 'none'}")
    return len(failed)


def build_site(folder: Path) -> int:
    """Build the manual as a site; 1 where it has a fault."""
    manual: Any = load_script("manual/build")
    try:
        count = manual.build(folder)
    except manual.SiteError as error:
        print(error)
        return 1
    print(f"{count} pages in {folder}")
    return 0


def main() -> int:
    """Write, check or run as the options say; 1 where something is wrong."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--run", action="store_true")
    parser.add_argument("--keep", type=Path, metavar="DIR")
    parser.add_argument("--site", type=Path, metavar="FOLDER")
    parser.add_argument("pages", nargs="*", type=Path, metavar="PAGE", help="to run (default: all)")
    arguments = parser.parse_args()
    bad = 0
    if arguments.check:
        bad += check()
    if arguments.run:
        bad += run_pages(arguments.pages or PAGES, arguments.keep)
    if arguments.site:
        bad += build_site(arguments.site)
    if not arguments.check and not arguments.run and not arguments.site:
        for page in PAGES:
            page.write_text(with_generated(page.read_text("utf-8")), "utf-8")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
