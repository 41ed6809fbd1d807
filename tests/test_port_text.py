"""The text of a port: nothing that a user wrote becomes code, names are free, what has no
translation is refused.
"""

import math
import re
import subprocess
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from support import ports
from support.ports import LANGUAGES

import fitball
from fitball.base.errors import FitballError
from fitball.exports.ports import FILES, dialects, port, python, source, translate

HOSTILE = (
    "*/ #error evil /*",
    '"""\nraise SystemExit(9)\n"""',
    "\n#error evil",
    "\r\nevil();",
    "??/\n#error evil",
    "\\\n#error",
    "</script><script>alert(1)</script>",
    "\u2028evil()\u2029evil()",
    "\u202eevil\u202c",
    "\\u002a/ evil",
    "@functions@",
    "{evil}",
    "${evil}",
    "`evil`",
    "'''\nevil",
    "\x0cevil\x0bevil",
    "\x00\x1a",
    "-->evil<!--",
    "evil\x85evil",
)


@pytest.mark.parametrize("language", LANGUAGES)
def test_a_port_of_hostile_labels_compiles_and_passes(tmp_path, language):
    sets = [
        replace(ports.typical("grip-slip", text), origin=text, sources={"mu": text})
        for text in HOSTILE
    ]
    text = ports.text_of(sets, language)
    # No control, no change of direction, no sign that begins a string or a tag.
    assert not re.search(
        '[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028-\u202e<>`"]',
        text.split("MIT License")[0][5:],
    )
    if language == "python":
        assert ports.module(text).self_test() < 1e-13
        return
    command = ports.compiled(tmp_path, language, text, driver=False)
    subprocess.run(
        command,
        cwd=tmp_path,
        check=True,
        capture_output=True,
        timeout=60,
    )


def test_names_of_labels():
    named = {
        "clay": "CLAY",
        "Clay": "CLAY_2",
        "clay!": "CLAY_3",
        "7 up": "BALL_7_UP",
        "Gras\u00e9 (wet)": "GRASE_WET",
        "\u8349\u5730": "BALL",
        "self test": "SELF_TEST_2",
        "": "BALL_2",
        "x" * 90: "X" * 40,
        "_levels_": "LEVELS",
        "clay, worn": "CLAY_WORN",
    }
    sets = [ports.typical("grip-slip", label, mu=0.01 * k) for k, label in enumerate(named, 1)]
    module = ports.module(port(sets, "python"))
    frictions = [getattr(module, name).mu for name in named.values()]
    assert frictions == pytest.approx([0.01 * k for k in range(1, 12)])


def test_what_cannot_be_ported():
    def elastic(v_x1, v_y1, omega_1, ball, e="uniform(0, 1)"):
        return v_x1, e * v_y1, omega_1

    of_function = replace(
        ports.typical("two-mass"),
        model=fitball.model_from(elastic),
        values={"e": 0.5},
    )
    for sets, code in (
        ([of_function], "own-model"),
        ([ports.typical("two-mass", mass_ratio=0.5)], "no-answer"),
        ([ports.typical("two-mass", mu=-1.0)], "out-of-bounds"),
    ):
        for language in FILES:
            with pytest.raises(FitballError) as caught:
                port(sets, language)
            assert caught.value.code == code


class Pair(NamedTuple):
    first: float
    second: int


@pytest.mark.parametrize(
    "body",
    [
        "return x + len('text')",
        # A function of C has no source.
        "return x + floor(x)",
        "return x or 1.0",
        "return x + n / 2",
        "return 0.0 < abs(x) < 1.0",
        "return x**2.5",
        "return min(x, 1.0, key=abs)",
        "return Pair(x, x)",
        "return n[0]",
        "return x + y",
        "n = 0.5; return n",
        "for k in range(n): n = k\n    return x",
        "while x < 1.0: x = x + later\n    return x",
    ],
)
def test_what_has_no_translation_is_refused(tmp_path, body):
    file = tmp_path / "body.py"
    file.write_text(f"def function(x: float, n: int) -> float:\n    {body}\n")
    names = {"Pair": Pair, "floor": math.floor}
    exec(compile(file.read_text(), file, "exec"), names)
    with pytest.raises(source.UnportableError):
        translate.translated(
            source.source_of((names["function"],), {}, {}, dialects.C.helpers),
            "function",
            dialects.C,
        )


@pytest.mark.parametrize("name", ["exp", "log", "sqrt"])
def test_functions_of_the_port_in_python_are_those_of_ieee_754(name):
    ends = (0.0, -0.5, -1.0, -2.0, 3.0, 709.0, 709.7, 710.0, 1e300, math.inf, -math.inf, math.nan)
    with np.errstate(all="ignore"):
        for x in ends:
            wanted = getattr(np, name)(x)
            assert python.HELPERS[f"math.{name}"](x) == pytest.approx(
                wanted,
                rel=1e-15,
                nan_ok=True,
            )
            for y in ends:
                assert python.over(x, y) == pytest.approx(
                    np.float64(x) / np.float64(y),
                    rel=1e-15,
                    nan_ok=True,
                )
    assert python.whole(-2.7) == -2
    assert isinstance(python.whole(math.nan), int)
