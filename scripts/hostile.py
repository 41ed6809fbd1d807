"""Hostile input: damaged files, odd words and names, broken surroundings, all held to one rule
(POSIX systems).

    python scripts/hostile.py                   # 3,000 cases; --share 0.1 of them; --seed 2: others
    python scripts/hostile.py scene names:17    # some kinds; or one again, by the seed alone
    python scripts/hostile.py --control         # with a guard removed the rule finds a fault

The rule: exit code 0, 1 or 2 (or a signal's), 2 with words; no traceback, no warning of a library,
no control character shown; of the input nothing executed, nor unescaped in HTML, C, C#, JavaScript,
Python, TeX or CSV; no file outside of --out changed, no older result lost or mixed unless
--overwrite, new ones whole; limits of time and memory.
"""

import argparse
import ast
import csv
import io
import json
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from functools import partial
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from typing import Any, TypeVar
from unittest.mock import patch

from numpy.random import Generator as Rng
from numpy.random import default_rng

from fitball import cli
from fitball.base import files
from fitball.data.bundled import datasets_folder

# CPU seconds of a case, far above those of a fit of these small tables.
MOST_CPU = 60.0
# Growth of the process over a case [kB]: a gigabyte.
MOST_MEMORY = 1_000_000
# Letters of errors that a case prints, some hundred lines.
MOST_LETTERS = 20_000
# Seconds after which a line of the shell has failed.
SHELL_SECONDS = 300
# Cases that a control tries until a fault is found.
CONTROL_CASES = 150
# Bytes that this process may have: what takes all memory must not take that of others.
ADDRESS_SPACE = 2**33
# What is put into files, and the commands of each kind of case.
DATA = json.loads(Path(__file__).with_suffix(".json").read_text("utf-8"))
# Number of cases by kind.
CASES = DATA["cases"]
TABLE = DATA["tables"][0]
# Odd texts, with some that are too long for the file. Whatever is qz7 must stay text: no call,
# element, attribute, command of TeX, formula.
ODD = [*DATA["odd"], "9" * 400, "9" * 5000, "a" * 30_000, "(" * 2000, "../" * 30]
MISTAKES = tomllib.loads(
    (Path(__file__).parents[1] / "tests" / "data" / "mistakes.toml").read_text("utf-8")
)["verb"]
# Lines of commands that users get wrong.
LINES = [f"{verb} {words}" for verb, lines in MISTAKES.items() for words, _ in lines]
# A number or a name in a text, which is replaced.
TOKEN = re.compile(r"[+-]?[0-9][0-9.]*(?:e[+-]?[0-9]+)?|[A-Za-z_][\w .-]*")
# Matches nothing.
NEVER = re.compile("(?!)")
# Comments and texts of C, C# and JavaScript: what is left is code.
QUOTED = re.compile(
    r"""/\*.*?\*/|//(?:(?:\\|\?\?/)\r?\n|[^\n\r\u2028\u2029])*|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'""",
    re.DOTALL,
)
# Last bytes of files that are whole, by ending.
ENDS = {"png": b"\xaeB`\x82", "html": b"</html>", "json": b"}"}
# Files of an older result; the last is no result of fitball, and must stay.
OLDER = ("report.html", "fit.json", "old.png", "mine.txt")
Words = list[str]
Choice = TypeVar("Choice")


@dataclass
class Ending:
    """How a case ended: exit code, output, errors, traceback, warnings, CPU seconds and growth of
    the process [kB].
    """

    code: object = None
    out: str = ""
    err: str = ""
    trace: str = ""
    warned: list[str] = field(default_factory=list)
    cpu: float = 0.0
    growth: int = 0


def pick(rng: Rng, choices: Sequence[Choice]) -> Choice:
    """A random one of the choices."""
    return choices[int(rng.integers(len(choices)))]


def damaged(text: str, rng: Rng) -> str:
    """A text with up to three words, numbers, spans or letters replaced."""
    for _ in range(int(rng.integers(1, 4))):
        start = int(rng.integers(len(text) + 1))
        way = int(rng.integers(6))
        tokens = list(TOKEN.finditer(text))
        if way < 4 and tokens:
            start, end = pick(rng, tokens).span()
        else:
            end = start + int(rng.integers(20))
        new = pick(rng, ODD) if way < 5 else chr(int(rng.integers(0x180)))
        text = text[:start] + new + text[end:]
    return text


def spoil(path: Path, rng: Rng) -> None:
    """Replace, cut off or double bytes of a file, encode them otherwise, or put others."""
    data = path.read_bytes()
    replaced = bytearray(data)
    first, last = sorted(int(rng.integers(len(data) + 1)) for _ in range(2))
    for index in rng.integers(max(len(data), 1), size=5) if data else ():
        replaced[index] = int(rng.integers(256))
    wide = data.decode("utf-8", "replace").encode("utf-16")
    doubled = data[:last] + data[first:]
    ways = (bytes(replaced), data[:first], doubled, b"", wide, rng.bytes(500))
    path.write_bytes(pick(rng, ways))


def put(name: str, text: str, rng: Rng) -> None:
    """Write a damaged text to a file; seldom damaged bytes, or a link to a file without end or to
    itself.
    """
    path = Path(name)
    path.unlink(missing_ok=True)
    way = rng.integers(40)
    if way < 2:
        path.symlink_to(("/dev/zero", name)[way])
    else:
        path.write_bytes(damaged(text, rng).encode("utf-8", "surrogatepass"))
    if 2 <= way < 8:
        spoil(path, rng)


def as_argument(text: str) -> str:
    """A text as a program receives it for an argument: no zero bytes, at most 200 bytes, and those
    that are no UTF-8 as surrogates.
    """
    return (
        text.replace("\0", "")
        .encode("utf-8", "surrogatepass")[:200]
        .decode("utf-8", "surrogateescape")
    )


def put_workbook(rng: Rng) -> None:
    """A workbook with odd cells and sheets; one of three has damaged bytes."""
    book = import_module("openpyxl").Workbook()
    # Letters that openpyxl refuses.
    text = re.sub("[\x00-\x08\x0b-\x1f\ud83d]", "", damaged(TABLE, rng))
    for row in csv.reader(io.StringIO(text)):
        is_number = [bool(re.fullmatch(r"-?[\d.]{0,9}\d", cell)) for cell in row]
        pairs = zip(row, is_number, strict=True)
        book.active.append([float(cell) if number else cell for cell, number in pairs])
    book.active[pick(rng, ("A900", "AZ1048576", "A3", "A4", "A5"))] = pick(rng, (" ", "x", 1.0))
    book.save("t.xlsx")
    if rng.integers(3) == 0:
        spoil(Path("t.xlsx"), rng)


def put_fit(rng: Rng) -> None:
    """Damage a saved fit, or put odd texts into it and sign it again."""
    record = Path("F/fit.json")
    arrays = Path("F/fit.nc")
    if rng.integers(4) == 0:
        spoil(pick(rng, (record, arrays)), rng)
        return
    content = json.loads(record.read_text())
    texts = [pick(rng, ODD).replace("\ud83d", "") for _ in range(5)]
    content["headline"] = texts[3]
    run = content["run"]
    run["table"]["labels"]["id"][0] = texts[0]
    run["table"]["name"] = texts[1]
    run["version"] = texts[2]
    run["scene"] = {
        "source": {"description": texts[3], "citation": texts[4]},
        "laboratory": {texts[3]: texts[4]},
    }
    if rng.integers(4) == 0:
        models: tuple[tuple[str, Mapping[str, str]], ...] = (
            ("evil.py:f", {}),
            ("", {"name": "evil.py:f"}),
        )
        run["choices"]["model"], run["scene"]["model"] = pick(rng, models)
    signed = json.dumps({**content, "digest": ""}, sort_keys=True).encode()
    digest = sha256(signed + arrays.read_bytes()).hexdigest()
    record.write_text(json.dumps({**content, "digest": digest}))


def put_names(rng: Rng) -> tuple[str, str]:
    """Write a table of an odd name with an odd label; its name, and an odd folder for results."""
    pieces = [*ODD, *DATA["names"]]

    def odd_name() -> str:
        """Up to three odd texts in a row."""
        count = int(rng.integers(1, 4))
        return as_argument("".join(pick(rng, pieces)[:60] for _ in range(count)))

    name = odd_name()
    folder = odd_name().replace("/", "_")
    label = as_argument(pick(rng, pieces)).replace('"', '""')
    name = name.replace("/", "_") + pick(rng, (".csv", "", ".toml"))
    name = name if name.strip(".") and name[0] != "-" else f"./{name}x.csv"
    Path(name).write_bytes(TABLE.replace("clay", f'"{label}"').encode("utf-8", "surrogateescape"))
    return name, pick(rng, ("out", folder, f"out/{folder}", "out/../out", "t" * 300))


def command_of(kind: str, rng: Rng) -> Words:
    """Write the files of a case into the current folder; the words of its command."""
    line = pick(rng, DATA["commands"][kind]).split()
    if kind == "words":
        line = shlex.split(pick(rng, LINES))
        # Nothing that would run for minutes.
        damage = line[0] != "compare" and rng.integers(4)
        index = int(rng.integers(len(line))) * int(rng.integers(2)) - 1
        line[index] = as_argument(damaged(line[index], rng) if damage else pick(rng, ODD))
        options = {
            "calibrate": DATA["quick"],
            "batch": DATA["quick"],
            "bench": "--at=x",
            "rederive": "--at=x",
        }
        return [*line, *options.get(line[0], "").split()]
    if kind == "surroundings":
        shell = pick(rng, DATA["shells"]).replace("{s}", f"{rng.uniform(0.3, 6.0):.2f}")
        command = shlex.join([sys.executable, "-P", "-m", "fitball", *line])
        return ["sh", "-c", shell.replace("{}", command)]
    if kind == "names":
        file, out = put_names(rng)
        return [file if word == "FILE" else word.replace("PLACE", out) for word in line]
    if kind == "table":
        put("t.csv", pick(rng, DATA["tables"]), rng)
    elif kind == "scene":
        Path("t.csv").write_text(pick(rng, DATA["tables"]))
        put("t.toml", DATA["scene"], rng)
    elif kind == "film":
        put("p.csv", Path("p.csv").read_text()[: pick(rng, (60, 4000))], rng)
    else:
        {"workbook": put_workbook, "fit": put_fit}[kind](rng)
    return list(line)


def unescaped(kind: str, text: str) -> Words:
    """Places in a `text` where the input is more than text; its `kind` is the ending of a file or
    the format of an export.
    """
    if kind in ("html", "page"):
        scripts = "".join(re.findall(r"<script\b[^>]*>(.*?)</script>", text, re.DOTALL))
        return re.findall("<qz7.{9}", text) + unescaped("js", scripts)
    if kind in ("py", "python"):
        names = [node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)]
        return [name for name in names if "qz7" in name]
    if kind in ("h", "c", "cs", "csharp", "js", "javascript"):
        return re.findall(r".{0,20}qz7 ?[({].{0,9}", QUOTED.sub("", text))
    if kind in ("csv", "golden"):
        cells = [cell for row in csv.reader(io.StringIO(text)) for cell in row]
        formulas = [cell for cell in cells if re.match(r"[=+@\t\r-](?!inf|nan|[\d.]+)", cell)]
        return [f"formula {cell[:40]}" for cell in formulas]
    if kind in ("latex", "tex", "bib"):
        return re.findall(r"\\(?:qz|input).", text)
    if kind in ("md", "markdown"):
        return re.findall(r"(?<!\\)<qz7|<script", text)
    return []


def contents() -> dict[str, bytes]:
    """Bytes of all files as far as three folders above, by path from here; of a link its target."""
    files_here = dict[str, bytes]()
    for path in Path("../../..").rglob("*"):
        if path.is_symlink():
            files_here[os.path.relpath(path)] = bytes(path.readlink())
        elif path.is_file():
            files_here[os.path.relpath(path)] = path.read_bytes()
    return files_here


def run(command: Words) -> Ending:
    """Run a command in this process, its streams as strict as those of a terminal, or a line of the
    shell.
    """
    end = Ending()
    began = resource.getrusage(resource.RUSAGE_SELF)
    if command[:1] == ["sh"]:
        process = subprocess.run(
            command,
            capture_output=True,
            check=False,
            stdin=subprocess.DEVNULL,
            timeout=SHELL_SECONDS,
        )
        end.code = process.returncode
        end.out = process.stdout.decode()
        end.err = process.stderr.decode(errors="replace")
        return end
    streams = [
        io.TextIOWrapper(io.BytesIO(), "utf-8", errors, "", False, True)
        for errors in ("strict", "backslashreplace")
    ]
    with (
        redirect_stdout(streams[0]),
        redirect_stderr(streams[1]),
        warnings.catch_warnings(record=True) as caught,
    ):
        warnings.simplefilter("always")
        try:
            end.code = cli.main(command)
        except SystemExit as stop:
            end.code = stop.code
        except BaseException:
            end.trace = traceback.format_exc()
    now = resource.getrusage(resource.RUSAGE_SELF)
    end.cpu = sum(now[:2]) - sum(began[:2])
    end.growth = now.ru_maxrss - began.ru_maxrss
    for warning in caught:
        end.warned.append(f"warning: {warning.filename}:{warning.lineno}: {warning.message}")
    end.out, end.err = (bytes(stream.detach().getvalue()).decode() for stream in streams)
    return end


def folder_of_results(command: Words) -> str:
    """The folder into which a command may write."""
    stated = [word[len("--out=") :] for word in command if word.startswith("--out=")]
    if stated and stated[0]:
        return os.path.normpath(stated[0])
    line = " ".join(command)
    if not stated and "--out" in line:
        return "out"
    if command[:1] == ["plot"]:
        return "F"
    return f"F/{command[0]}" if "F" in command else "fits"


def faults_of_ending(end: Ending, is_shell: bool) -> Words:
    """What the rule has against the exit code, the words and the costs of a case."""
    printed = end.out + end.err
    control_letters = {
        letter
        for letter in printed
        if (letter < " " and letter not in "\n\t") or "\x7f" <= letter <= "\x9f"
    }
    faults = [*end.warned]
    if end.trace or "Traceback (" in printed or "Exception ignored" in printed:
        faults.append(f"traceback: {(end.trace or printed)[-200:]}")
    # A shell has codes of signals and of `timeout` too.
    codes = (0, 1, 2, 124, 130, 137, 143) if is_shell else (0, 1, 2)
    if end.code not in codes and not end.trace:
        faults.append(f"exit code {end.code}")
    if end.code == 2 and not is_shell and not end.err.strip():
        faults.append("exit code 2 without a word")
    if len(end.err) > MOST_LETTERS:
        faults.append(f"{len(end.err)} letters of errors")
    if control_letters:
        faults.append(f"control characters: {sorted(control_letters)}")
    if end.cpu > MOST_CPU or end.growth > MOST_MEMORY:
        faults.append(f"limits: {end.cpu:.0f} s of CPU, {end.growth} kB")
    return faults


def faults_of_older(
    command: Words,
    before: dict[str, bytes],
    after: dict[str, bytes],
    end: Ending,
) -> Words:
    """What the rule has against what became of an older result in `out`."""
    is_shell = command[:1] == ["sh"]
    line = " ".join(command)
    if "out/mine.txt" not in before or "rm -r out" in line:
        return []
    replaced = "--overwrite" in line and (end.code in (0, 1) or is_shell)
    lost = [name for name in OLDER if after.get(f"out/{name}") != b"old"]
    faults = []
    if "mine.txt" in lost or (lost and not replaced):
        faults.append(f"older result lost: {lost}")
    if replaced and not is_shell and after.get("out/old.png") == b"old":
        faults.append("older result mixed")
    return faults


def faults_of_files(command: Words, before: dict[str, bytes], after: dict[str, bytes]) -> Words:
    """What the rule has against the files that a case changed."""
    is_shell = command[:1] == ["sh"]
    out = folder_of_results(command)
    faults = []
    for name in sorted(name for name in before | after if before.get(name) != after.get(name)):
        data = after.get(name, b"gone")
        kind = name.rpartition(".")[2]
        is_whole = bool(data) and data.rstrip().endswith(ENDS.get(kind, b""))
        may_be_elsewhere = is_shell and name not in ("evil.py", "qz7")
        if not may_be_elsewhere and not name.startswith(f"{out}/"):
            faults.append(f"outside of {out}: {name}" if data else f"executed: {name}")
        elif not is_whole:
            if kind in ("csv", "html", "png", "json", "nc") and name in after:
                faults.append(f"not whole: {name}")
        elif name in after:
            escapes = unescaped(kind, data.decode(errors="replace"))
            faults += [f"{name}: {escape}" for escape in escapes]
    return faults


def faults_of(
    command: Words,
    before: dict[str, bytes],
    after: dict[str, bytes],
    end: Ending,
) -> Words:
    """All that the rule has against how a case ended."""
    faults = faults_of_ending(end, command[:1] == ["sh"])
    faults += faults_of_older(command, before, after, end)
    faults += faults_of_files(command, before, after)
    if end.code == 0 and "--to" in command:
        faults += unescaped(command[command.index("--to") + 1], end.out)
    return faults


def case(kind: str, index: int, seed: int, folder: Path) -> tuple[str, Ending, Words]:
    """Run a case in a new folder: its command, how it ended, and its faults by the rule."""
    rng = default_rng([seed, sum(map(ord, kind)), index])
    shutil.copytree(folder.parent / "prepared", folder / "a" / "b" / "c")
    os.chdir(folder / "a" / "b" / "c")
    tempfile.tempdir = str(Path.cwd())
    older = not rng.integers(3)
    command = command_of(kind, rng)
    if older or kind == "surroundings":
        Path("out").mkdir(exist_ok=True)
        for name in (*OLDER, ".fitball-files"):
            Path("out", name).write_text(
                "old" if name in OLDER else "report.html\nfit.json\nold.png\n"
            )
        overwrite = bool(rng.integers(2))
        if overwrite and command[0] not in ("export", "plot") and "out" in command:
            command.append("--overwrite")
        elif rng.integers(2):
            # What others planted: nothing may be written through it.
            Path("mine.list").write_text("mine\n")
            Path("out", ".fitball-files").unlink()
            Path("out", ".fitball-files").symlink_to("../mine.list")
    before = contents()
    end = run(command)
    faults = faults_of(command, before, contents(), end)
    return ascii(shlex.join(command))[:300], end, faults


def prepare(folder: Path) -> None:
    """Make a folder with a fit and positions to be damaged, and files that must not run."""
    folder.mkdir()
    os.chdir(folder)
    for name, text in DATA["files"].items():
        Path(name).write_text(text)
    film = (datasets_folder() / "tracks" / "table_tennis_topspin.csv").read_text()[:2000]
    Path("p.csv").write_text(film.rpartition("\n")[0] + "\n")
    with redirect_stdout(io.StringIO()):
        cli.main(DATA["prepare"][0].split())
    Path("t.csv").write_text(TABLE)


def unheld_folder(result_folder: Callable[..., Any], path: Path, **options: Any) -> Any:
    """The folder of a result that may always be overwritten."""
    return result_folder(path, **options | {"overwrite": True})


# What a control puts for a guard, by the name in `guards`.
INSTEAD = {
    "never": NEVER,
    "nothing": (),
    "text": str,
    "model": import_module("fitball.models.registry").model,
    "unheld": partial(unheld_folder, files.result_folder),
}


def parsed_arguments() -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("what", nargs="*", help="kinds, or KIND:INDEX")
    parser.add_argument("--share", type=float, default=1.0, help="of the cases of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--control", action="store_true")
    return parser.parse_args()


def fault_without(
    guard: str,
    instead: str,
    kind: str,
    pattern: str,
    seed: int,
    root: Path,
) -> str:
    """The first case in which the rule finds a fault of this `pattern` while a guard is removed,
    with the fault; an empty text without one.
    """
    for index in range(CONTROL_CASES):
        with patch(guard, INSTEAD[instead]):
            _, _, faults = case(kind, index, seed, root / f"{guard}-{index}")
        for fault in faults:
            if re.search(pattern, fault):
                return f"{kind}:{index}: {fault[:90]!a}"
    return ""


def run_controls(seed: int, root: Path) -> int:
    """Remove each guard in turn, and print the fault that the rule finds; the number of guards
    without one.
    """
    bad = 0
    for guard, instead, kind, pattern in DATA["guards"]:
        fault = fault_without(guard, instead, kind, pattern, seed, root)
        print(f"without {guard}: {fault or 'NOTHING FOUND'}", flush=True)
        bad += not fault
    return bad


def single_cases(names: Words) -> list[tuple[str, int]]:
    """The kind and index of each case that is named as KIND:INDEX."""
    pairs = [name.partition(":") for name in names]
    return [(kind, int(index)) for kind, _, index in pairs if index]


def run_cases(cases: list[tuple[str, int]], alone: bool, seed: int, root: Path) -> int:
    """Run cases, print their faults by the rule, exit codes and the slowest; the number of cases
    that broke the rule. Of cases that run `alone` all is printed, and their folders stay.
    """
    bad = 0
    count = Counter[str]()
    slow = list[tuple[float, str]]()
    for kind, index in cases:
        line, end, faults = case(kind, index, seed, root / f"{kind}-{index}")
        slow.append((end.cpu, f"{end.cpu:6.1f} s of CPU: {kind}:{index} {line[:150]}"))
        count[f"{kind} {end.code}"] += 1
        for fault in faults[:4]:
            print(f"{kind}:{index}: {fault[:300]!a}\n    {line}", flush=True)
        bad += bool(faults)
        if alone:
            print(line, end.out, end.err, end.trace, end.code, root, sep="\n")
        elif not faults:
            shutil.rmtree(root / f"{kind}-{index}")
    slowest = [line for _, line in sorted(slow, reverse=True)[:5]]
    print(dict(sorted(count.items())), *slowest, sep="\n")
    return bad


def main() -> int:
    """Run cases or controls; 1 if the rule was broken, or with --control if a fault was not
    found.
    """
    arguments = parsed_arguments()
    root = Path(tempfile.mkdtemp(prefix="hostile-")).resolve()
    resource.setrlimit(resource.RLIMIT_AS, (ADDRESS_SPACE, resource.RLIM_INFINITY))
    prepare(root / "prepared")
    alone = single_cases(arguments.what)
    if arguments.control:
        bad = run_controls(arguments.seed, root)
        verdict = f"{bad} guards not missed"
    else:
        cases = alone
        if not alone:
            kinds = arguments.what or CASES
            cases = [(kind, k) for kind in kinds for k in range(int(arguments.share * CASES[kind]))]
        bad = run_cases(cases, bool(alone), arguments.seed, root)
        verdict = f"{bad} of {len(cases)} cases broke the rule"
    os.chdir("/")
    if arguments.control or not (bad or alone):
        shutil.rmtree(root)
    print(verdict)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
