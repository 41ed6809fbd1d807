"""The translator from kernels to C99: what it keeps of Python's meaning, and what it refuses."""

from __future__ import annotations

import ast
import shutil
import subprocess
from dataclasses import replace
from typing import NamedTuple

import pytest

from fitball.exports.port.kernel_source import UnportableError, kernel_source
from fitball.exports.port.languages import C99, CSHARP, JAVASCRIPT
from fitball.exports.port.translate import Program, Struct, signatures, translated

CC = shutil.which("cc") or shutil.which("gcc")
FLAGS = ("-std=c99", "-O0", "-Wall", "-Wextra", "-Wpedantic", "-Werror")

C_OF_P = replace(C99, prefix="p_")
DIALECTS = (C_OF_P, JAVASCRIPT, CSHARP)


def in_language(source, dialect, structs=None):
    """The one function of a source text."""
    function = ast.parse(source).body[0]
    known = structs or {}
    return translated(function, Program(signatures([function], known), {}, known, dialect))


@pytest.mark.parametrize("dialect", DIALECTS, ids=lambda item: item.language)
@pytest.mark.parametrize(
    "body",
    [
        "return x // 2.0",
        "return [x][0]",
        "y = x if x else 1.0\n    return y",
        "return 0.0 < math.exp(x) < 1.0",
        "for y in (1.0, 2.0):\n        x = x + y\n    return x",
        "while x > 0.0:\n        x = x - 1.0\n    else:\n        x = 2.0\n    return x",
        "return math.erf(x)",
        "return x and 1.0",
        "y = True\n    y = x\n    return y",
        "return y",
        "x: float\n    return lambda: x",
    ],
)
def test_the_translator_refuses_what_it_does_not_know(body, dialect):
    with pytest.raises(UnportableError):
        in_language(f"def kernel(x: float) -> float:\n    {body}\n", dialect)


def test_the_translator_keeps_what_python_means(tmp_path):
    """A swap reads the right side first; a chained comparison and a countdown keep their meaning."""
    source = (
        "def kernel(x: float, n: int) -> float:\n"
        "    a, b = x, 2.0 * x\n    a, b = b - a, a\n    total = 0\n"
        "    for k in range(n, -1, -1):\n        if 0 < k <= 2:\n            continue\n        total += k * a\n"
        "    return total / 2 + 1 / 4 - -b if not b < 0.0 else abs(b)\n"
    )
    scope = {}
    exec(source, scope)
    text = in_language(source, C99)
    main = "#include <stdio.h>\n#include <math.h>\n#include <stdint.h>\n#include <stdbool.h>\n#include <stddef.h>\n"
    main += text + '\nint main(void) { printf("%.17g %.17g", kernel(1.3, 5), kernel(-0.7, 3)); return 0; }\n'
    (tmp_path / "main.c").write_text(main)
    if CC is None:
        pytest.skip("no C compiler here: the translation is made but not compiled")
    subprocess.run([CC, *FLAGS, "main.c", "-lm", "-o", "main"], cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    assert [float(item) for item in done.stdout.split()] == [scope["kernel"](1.3, 5), scope["kernel"](-0.7, 3)]


class Inner(NamedTuple):
    a: float
    b: int


class Outer(NamedTuple):
    x: float
    inner: Inner
    flag: bool


ORIGIN = Outer(0.5, Inner(1.5, 2), True)


def turned(outer: Outer, x: float) -> Outer:
    return Outer(x, Inner(outer.x, outer.inner.b + 1), not outer.flag)


def _structured(x: float) -> float:
    outer = ORIGIN
    for _ in range(3):
        outer = turned(outer, x * outer.inner.a)
    return outer.x + 10.0 * outer.inner.a + (100.0 * outer.inner.b if not outer.flag else 0.0)


def test_named_tuples_become_structs_with_the_same_fields(tmp_path):
    source = kernel_source(_structured)
    assert list(source.structs) == ["Inner", "Outer"]
    program = Program.from_source(source, C_OF_P)
    functions = [translated(item, program) for item in source.functions]
    main = "#include <stdio.h>\n#include <stdint.h>\n#include <stdbool.h>\n"
    main += "\n".join(
        [*C_OF_P.structs(program.structs.values()), C_OF_P.constant_definition("ORIGIN", ORIGIN), *functions]
    )
    main += '\nint main(void) { printf("%.17g", p__structured(1.3)); return 0; }\n'
    main = "#define P_MAKE(type, ...) ((type){__VA_ARGS__})\n" + main.replace("@UP@", "P_")
    (tmp_path / "main.c").write_text(main)
    if CC is None:
        pytest.skip("no C compiler here: the translation is made but not compiled")
    subprocess.run([CC, *FLAGS, "main.c", "-lm", "-o", "main"], cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    assert float(done.stdout) == _structured(1.3)


@pytest.mark.parametrize("body", ["x.c", "Inner(x.a)", "Inner(x.a, x.a)", "Inner(a=x.a, b=x.b)", "x + x", "x[0]"])
def test_a_named_tuple_is_refused_what_a_struct_cannot_do(body):
    structs = {"Inner": Struct("Inner", (("a", "d"), ("b", "i")))}
    with pytest.raises(UnportableError):
        in_language(f"def kernel(x: Inner) -> float:\n    y = {body}\n    return y\n", C_OF_P, structs)


@pytest.mark.parametrize("name", ["min", "max"])
def test_least_and_greatest_of_whole_and_real_numbers(name):
    """Two numbers, whole or real, mixed ones as real; nothing else, and of more than two nothing at all."""

    def text(call, kinds):
        listed = ", ".join(f"{letter}: {kind}" for letter, kind in zip("abc", kinds, strict=False))
        return in_language(f"def kernel({listed}) -> float:\n    return 1.0 * {call}\n", C_OF_P)

    assert f"p_{name}_whole(a, b)" in text(f"{name}(a, b)", ["int", "int"])
    for kinds in (["int", "float"], ["float", "int"], ["float", "float"]):
        assert f"p_{name}_real(a, b)" in text(f"{name}(a, b)", kinds)
    for call, kinds in (
        (f"{name}(a, b, c)", ["float"] * 3),
        (f"{name}(a)", ["float"]),
        (f"{name}(a, b)", ["bool"] * 2),
    ):
        with pytest.raises(UnportableError):
            text(call, kinds)


def test_a_kernel_that_uses_an_object_is_refused():
    with pytest.raises(UnportableError, match="_STRANGE"):
        kernel_source(_strange)


_STRANGE = object()


def _strange(x: float) -> float:
    return x if _STRANGE else 0.0


def test_integers_divide_as_real_numbers_in_every_language():
    source = "def kernel(n: int, m: int) -> float:\n    return n / m\n"
    wanted = {
        "C99": "(double)n / (double)m", "C#": "(double)n / (double)m",
        "JavaScript": "n / m",
    }  # fmt: skip
    for dialect in DIALECTS:
        assert wanted[dialect.language] in in_language(source, dialect)


@pytest.mark.skipif(shutil.which("node") is None, reason="no node here: the translation is made but not run")
def test_twenty_phases_are_packed_in_javascript_too():
    """Sixty bits: its own operators see 32, its numbers hold 53."""
    source = "def pack(n: int) -> int:\n    all = 0\n    for k in range(n):\n"
    source += "        all = all | (5 << (3 * k))\n    return all\n"
    script = in_language(source, JAVASCRIPT) + "\nconsole.log(String(pack(20)))"
    done = subprocess.run(["node", "-e", script], capture_output=True, text=True, check=True)
    assert int(done.stdout) == sum(5 << (3 * k) for k in range(20))
