"""The house: what a reader feels has limits, and what counts it counts right."""

import ast
import textwrap
from pathlib import Path

import pytest
from support.scripts import script

ROOT = Path(__file__).resolve().parent.parent


size = script("size")
mutate = script("mutate")


def function_of(code_lines):
    """A function with so many lines of code, and others that are none."""
    body = "".join(f"    x = {k}\n" for k in range(code_lines - 1))
    return f'def long(x):\n    """Says\n\n    a lot.\n    """\n    # Why.\n\n{body}'


@pytest.fixture(scope="module")
def sources():
    """The text of every Python file of the project, by name."""
    return size.sources()


def test_no_function_and_no_file_is_over_its_limit(sources):
    assert [fault for name, text in sources.items() for fault in size.faults(name, text)] == []


def test_the_formatter_leaves_only_tables_of_numbers_alone(sources):
    assert sum(size.unformatted(text) for text in sources.values()) <= size.UNFORMATTED


def test_each_exception_is_a_function_that_is_too_long(sources):
    for exception in size.LONG_FUNCTIONS:
        name, _, function = exception.partition(":")
        counts = [f.code_lines for f in size.functions(sources[name]) if f.name == function]
        assert [count > size.FUNCTION_LINES for count in counts] == [True], exception


def test_a_function_of_61_lines_is_refused():
    assert size.faults("scripts/a.py", function_of(60)) == []
    (fault,) = size.faults("scripts/a.py", function_of(61))
    assert fault.startswith("scripts/a.py:1: long has 61 lines")


def test_a_file_of_601_lines_is_refused():
    assert size.faults("scripts/a.py", "\n" * 600) == []
    (fault,) = size.faults("scripts/a.py", "\n" * 601)
    assert fault.startswith("scripts/a.py: 601 lines")


def test_an_exception_holds_for_its_function_only(monkeypatch):
    monkeypatch.setitem(size.LONG_FUNCTIONS, "scripts/a.py:long", "a test")
    assert size.faults("scripts/a.py", function_of(61)) == []
    assert len(size.faults("scripts/b.py", function_of(61))) == 1


def test_lines_of_code_are_counted_without_words_about_them():
    text = textwrap.dedent(
        '''
        @cached
        def outer(
            a,
        ):
            """Not
            counted."""

            # Not counted.
            def inner():
                return """counted,
                too"""

            return inner  # counted
        '''
    )
    counts = {function.name: function.code_lines for function in size.functions(text)}
    assert counts == {"outer": 7, "inner": 3}


def test_comments_for_the_formatter_are_counted_and_texts_about_them_are_not():
    text = "a = 1  # fmt: skip\n# fmt: off\nb = 2\n# fmt: on\nc = '# fmt: skip'\n"
    assert size.unformatted(text) == 2


def test_density_counts_tokens_vague_words_and_assignments_of_several_things():
    counted = size.Density()
    counted.add('"""Words."""\n\nfound_one, b = 1, 2  # why\nknown = b\n')
    assert (counted.modules, counted.lines, counted.code_lines) == (1, 4, 2)
    # found_one , b = 1 , 2 and known = b.
    assert counted.tokens == 10
    assert (counted.names, counted.vague_names) == (4, 2)
    assert (counted.assignments, counted.tuple_assignments) == (2, 1)


def test_rooms_are_folders_of_the_package_its_top_tests_and_scripts():
    names = ("fitball/cli.py", "fitball/data/read.py", "tests/support/line.py", "scripts/size.py")
    assert [size.room_of(name) for name in names] == ["top", "data", "tests", "scripts"]


def test_mutants_meet_tests_that_exist_of_rooms_that_exist(sources):
    modules = [name.removeprefix("fitball/") for name in sources if name.startswith("fitball/")]
    for room, tests in mutate.TESTS.items():
        assert any(module.startswith(room) for module in modules), room
        for test in tests.split():
            assert f"tests/test_{test}.py" in sources, test


def test_constants_are_numbers_of_the_module_and_of_units():
    tree = ast.parse(
        'A = (1, "x", True)\nB: int = -2\ndef f(): return 3 + Unit("mm", 1e3).factor\n'
    )
    assert [node.value for node in mutate.constants(tree)] == [1, 2, 1e3]
    assert [ast.unparse(mutate.changed(node)) for node in mutate.constants(tree)][:2] == ["2", "3"]
