"""How many tables of a batch pass the drop test, counted by surface and rule."""

import pandas as pd

from fitball.batches.passing import passing_lines

RULE = "type-2, 135 to 147 cm by ITF TB 04/01"


def tables_of(verdicts, rules=RULE, head=""):
    """The table of a batch of tables a, b, c ... with these verdicts."""
    names = pd.Index(list("abcdefghij")[: len(verdicts)], name="table")
    columns = {f"mean_verdict{head}": verdicts, f"mean_rule{head}": rules}
    return pd.DataFrame(columns, index=names)


def test_tables_are_counted_and_those_that_fail_are_named():
    tables = tables_of(["passes", "fails", "undecided", "passes", None])
    (line,) = passing_lines(tables)
    assert "4 tables" in line
    assert RULE in line
    assert "2 pass, 1 fail (b) and 1 undecided" in line
    assert "balls differ" not in line
    assert line.tone == "poor"


def test_each_rule_and_each_surface_has_a_line():
    rules = [RULE, RULE, "stage-1, 120 to 135 cm by ITF TB 04/01"]
    tables = tables_of(["passes", "balls differ", "passes"], rules)
    other = tables_of(["fails", None, None], head="[granite]")
    first, second, third = passing_lines(tables.join(other))
    assert "2 tables as type-2" in first
    assert "1 without a mean" in first
    assert "1 table as stage-1" in second
    assert "on granite" in third
    assert not [*passing_lines(tables[[]])]
