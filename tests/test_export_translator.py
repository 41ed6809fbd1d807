"""The translator from kernels to C99: what it keeps of Python's meaning, and what it refuses."""

from __future__ import annotations

import ast
import shutil
import subprocess
from typing import NamedTuple

import pytest

from fitball.export.port.c import c_constant
from fitball.export.port.c_statements import c_function, signature
from fitball.export.port.c_types import Struct, struct_definitions, structs_of
from fitball.export.port.kernel_source import UnportableError, kernel_source
from fitball.export.port.python import check_self_contained

CC = shutil.which("cc") or shutil.which("gcc")
FLAGS = ("-std=c99", "-O0", "-Wall", "-Wextra", "-Wpedantic", "-Werror")


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
def test_the_translator_refuses_what_it_does_not_know(body):
    function = ast.parse(f"def kernel(x: float) -> float:\n    {body}\n").body[0]
    signatures = {"kernel": signature(function, {})}
    with pytest.raises(UnportableError):
        c_function(function, signatures, {}, {}, "fitball_")


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
    function = ast.parse(source).body[0]
    text = c_function(function, {"kernel": signature(function, {})}, {}, {}, "")
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
    structs = structs_of(source.structs)
    signatures = {item.name: signature(item, structs) for item in source.functions}
    functions = [c_function(item, signatures, source.constants, structs, "p_") for item in source.functions]
    main = "#include <stdio.h>\n#include <stdint.h>\n#include <stdbool.h>\n"
    main += "\n".join([*struct_definitions(structs.values(), "p_"), c_constant("ORIGIN", ORIGIN, "p_"), *functions])
    main += '\nint main(void) { printf("%.17g", p__structured(1.3)); return 0; }\n'
    (tmp_path / "main.c").write_text(main)
    if CC is None:
        pytest.skip("no C compiler here: the translation is made but not compiled")
    subprocess.run([CC, *FLAGS, "main.c", "-lm", "-o", "main"], cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    assert float(done.stdout) == _structured(1.3)


@pytest.mark.parametrize("body", ["x.c", "Inner(x.a)", "Inner(x.a, x.a)", "Inner(a=x.a, b=x.b)", "x + x", "x[0]"])
def test_a_named_tuple_is_refused_what_a_struct_cannot_do(body):
    structs = {"Inner": Struct("Inner", (("a", "d"), ("b", "i")))}
    function = ast.parse(f"def kernel(x: Inner) -> float:\n    y = {body}\n    return y\n").body[0]
    with pytest.raises(UnportableError):
        c_function(function, {"kernel": signature(function, structs)}, {}, structs, "p_")


@pytest.mark.parametrize("name", ["min", "max"])
def test_least_and_greatest_of_whole_and_real_numbers(name):
    """Two numbers, whole or real, mixed ones as real; nothing else, and of more than two nothing at all."""

    def translated(call, kinds):
        listed = ", ".join(f"{letter}: {kind}" for letter, kind in zip("abc", kinds, strict=False))
        source = f"def kernel({listed}) -> float:\n    return 1.0 * {call}\n"
        function = ast.parse(source).body[0]
        return c_function(function, {"kernel": signature(function, {})}, {}, {}, "p_")

    assert f"p_{name}_whole(a, b)" in translated(f"{name}(a, b)", ["int", "int"])
    for kinds in (["int", "float"], ["float", "int"], ["float", "float"]):
        assert f"p_{name}_real(a, b)" in translated(f"{name}(a, b)", kinds)
    for call, kinds in (
        (f"{name}(a, b, c)", ["float"] * 3),
        (f"{name}(a)", ["float"]),
        (f"{name}(a, b)", ["bool"] * 2),
    ):
        with pytest.raises(UnportableError):
            translated(call, kinds)


def test_a_module_that_needs_more_than_math_is_refused():
    with pytest.raises(UnportableError, match="imports more than math"):
        check_self_contained("import numpy\n")
    with pytest.raises(UnportableError, match="uses np"):
        check_self_contained("import math\n\ndef f(x):\n    return np.sin(x)\n")


def test_a_kernel_that_uses_an_object_is_refused():
    with pytest.raises(UnportableError, match="_STRANGE"):
        kernel_source(_strange)


_STRANGE = object()


def _strange(x: float) -> float:
    return x if _STRANGE else 0.0
