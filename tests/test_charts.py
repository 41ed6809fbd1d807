"""Control charts: constants, counts and run lengths of published rules; what changed, and where."""

import numpy as np
import pandas as pd
import pytest

from fitball.base.errors import ParameterError
from fitball.base.numbers import Unit
from fitball.base.priors import ParameterSpec, parse_prior
from fitball.batches import charts
from fitball.batches.control import (
    Charting,
    control_charts,
    control_frame,
    in_order,
    why_no_chart,
)
from fitball.batches.control_page import control_figure, control_lines
from fitball.batches.many import batch_of
from fitball.batches.page import figures
from fitball.batches.rows import TableQuantity, TableRecord
from fitball.uses.hierarchy import measured_group

NELSON = dict(enumerate(charts.NELSON, 1))
# Distances from the centre that break a rule, and not before the last of them.
BREAKING = {
    1: [3.1],
    2: [0.5, 0.2] * 4 + [0.1],
    3: [-1.2, -0.7, -0.1, 0.4, 0.6, 1.1],
    4: [0.3, -0.4] * 7,
    5: [2.1, -0.3, 2.2],
    6: [1.1, 1.2, -0.2, 1.3, 1.4],
    7: [0.5, -0.5, 0.2] * 5,
    8: [1.5, -1.5, 1.2, -1.1] * 2,
}
# Mean number of values to the first alarm of a stable process: R package spc for the EWMA, and for
# the rules simulations of 4,000 runs, to 1.5 %.
RUN_LENGTHS = {1: 370.0, 2: 520.0, 3: 410.0, 4: 600.0, 5: 500.0, 6: 290.0}


@pytest.mark.parametrize("number", NELSON)
def test_a_rule_is_broken_at_the_last_of_its_values(number):
    z = np.array(BREAKING[number])
    broken = NELSON[number].test(z)
    assert broken.tolist() == [False] * (z.size - 1) + [True]
    assert len(BREAKING[number]) == NELSON[number].span
    # Mirrored, and with stable values before it, in a series of series.
    both = np.stack([np.concatenate([[-0.9, 0.8, 0.9], side]) for side in (z, -z)])
    assert NELSON[number].test(both)[:, -1].all()


def test_western_electric_counts_eight_on_a_side():
    rule = charts.WESTERN_ELECTRIC[3]
    assert rule.test(np.full(8, 0.4)).tolist() == [False] * 7 + [True]
    assert not NELSON[2].test(np.full(8, 0.4)).any()


def test_constants_of_moving_ranges():
    # E2, D4 and d2 of two values, as tables of constants have them.
    assert pytest.approx(1.128379, abs=1e-6) == charts.RANGE_MEAN
    assert pytest.approx(2.658681, abs=1e-6) == charts.LIMIT / charts.RANGE_MEAN
    most = 1.0 + charts.LIMIT * charts.RANGE_SD / charts.RANGE_MEAN
    assert most == pytest.approx(3.266532, abs=1e-6)
    centre, sd = charts.limits(np.array([1.0, 2.0, 4.0, 3.0]))
    assert centre == pytest.approx(2.5)
    assert sd == pytest.approx(4.0 / 3.0 / 1.128379, rel=1e-6)


def _run_length(broken):
    """Mean number of values to the first alarm, and its standard error, if all series have one."""
    assert broken.any(axis=-1).all()
    first = broken.argmax(axis=-1) + 1.0
    return first.mean(), first.std() / np.sqrt(first.size)


def test_run_lengths_are_those_published():
    z = np.random.default_rng(2).standard_normal((250, 8000))
    tests = {NELSON[k].name: (NELSON[k].test(z), length) for k, length in RUN_LENGTHS.items()}
    means, limit = charts.ewma_of(z)
    tests["EWMA"] = (np.abs(means) > limit, 500.0)
    for rules, length in ((charts.NELSON, 74.0), (charts.WESTERN_ELECTRIC, 93.0)):
        tests[rules[0].name + " all"] = (np.any([rule.test(z) for rule in rules], axis=0), length)
    for name, (broken, length) in tests.items():
        mean, error = _run_length(broken)
        assert abs(mean - length) < 4.0 * error + 0.02 * length, name


def test_limits_of_few_values_raise_more_alarms():
    rng = np.random.default_rng(3)
    rules = charts.rules_named("nelson-1")
    shares = [charts.false_alarms(100, baseline, rules, rng) for baseline in (10, 30, 100)]
    assert shares[0] > shares[1] > shares[2]


@pytest.mark.parametrize("text", ["nelson-9", "nelson-", "shewhart", "western electric"])
def test_other_rules_are_refused(text):
    with pytest.raises(ParameterError) as caught:
        charts.rules_named(text)
    assert caught.value.code == "rules"


def _values(count=40):
    """Stable values, a little rugged, without an alarm."""
    return 140.0 + np.resize([0.4, -0.9, 0.2, 0.8, -0.5, 0.1, -0.3, 0.6, -0.4], count)


def _changes(values, rules="nelson-1-2"):
    chart = charts.chart_of(np.asarray(values), 20, charts.rules_named(rules))
    return chart, chart.changes


def test_stable_values_are_in_control():
    chart, changes = _changes(_values())
    assert changes == ()
    assert not any(chart.broken)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_shift_lasts_from_where_it_begins(sign):
    values = _values()
    values[30:] += 2.5 * sign
    chart, (change,) = _changes(values)
    assert (change.kind, change.first, change.last) == ("shift", 30, 39)
    assert abs(change.size - 2.5 * sign) < 3.0 * change.sd
    assert change.sd == pytest.approx(chart.sd * np.sqrt(1.0 / 10 + 1.0 / 20))


def test_a_shift_may_end():
    values = _values()
    values[24:32] += 4.0
    (change,) = _changes(values)[1]
    assert (change.kind, change.first, change.last) == ("shift", 24, 31)


def test_one_value_out_is_no_shift():
    values = _values()
    values[33] += 9.0
    chart, (change,) = _changes(values)
    assert (change.kind, change.first, change.last) == ("value", 33, 33)
    assert "Nelson 1" in change.rules
    assert "Nelson 1" in chart.broken[33]


def test_a_trend_is_its_values():
    values = _values()
    values[30:36] = 140.0 + np.linspace(-0.5, 0.5, 6)
    (change,) = _changes(values, "nelson-3")[1]
    assert change.kind == "pattern"
    assert change.first <= 30
    assert change.last == 35


def test_values_that_do_not_vary_have_no_chart():
    assert charts.chart_of(np.full(30, 1.4), 20, charts.NELSON) is None


def _tables(values, dates=None):
    """A frame of tables as a batch has it, with their quantities."""
    names = [f"lot {k}" for k in range(1, len(values) + 1)]
    columns = {"outcome": "done", "rebound_measured [m]": values}
    if dates is not None:
        columns["label:when"] = dates
    frame = pd.DataFrame(columns, index=pd.Index(names, name="table"))
    group = measured_group(1.4, 0.01)
    spread = parse_prior(ParameterSpec("rebound", "", 0.0, np.inf, "half-t(0.02, 4)", "", ""))
    quantity = TableQuantity(group, True, spread, False, "m", Unit("cm", 100.0), "rebound")
    return frame, {name: {"rebound_measured": quantity} for name in names}


def test_tables_are_in_the_order_of_dates_else_of_numbers():
    frame = _tables(_values(12))[0]
    ordered = in_order(frame.sort_index())
    assert (ordered.by, ordered.repeated) == ("", None)
    assert ordered.tables.index.tolist() == frame.index.tolist()
    days = [f"2026-05-{day:02}" for day in range(12, 0, -1)]
    ordered = in_order(_tables(_values(12), days)[0])
    assert ordered.by == "when"
    assert ordered.tables.index.tolist() == frame.index[::-1].tolist()
    days[3] = "a Monday"
    assert in_order(_tables(_values(12), days)[0]).by == ""


def test_dates_that_repeat_order_neighbours_alone():
    days = [f"2026-05-{day:02}" for day in (1, 1, 2, 2, 3, 4, 5, 6, 6, 6, 7, 8)]
    ordered = in_order(_tables(_values(12), days)[0])
    assert (ordered.by, ordered.repeated) == ("when", None)
    days[10:] = days[:2]
    ordered = in_order(_tables(_values(12), days)[0])
    assert (ordered.by, ordered.repeated) == ("", ("when", "lot 2", "lot 11"))
    assert ordered.tables.index[-1] == "lot 12"


def test_tables_that_failed_are_left_out_of_a_chart():
    values = _values(30) / 100.0
    frame, quantities = _tables(values)
    frame.loc["lot 7", "outcome"] = "failed"
    frame.loc["lot 9", "rebound_measured [m]"] = np.nan
    (control,) = control_charts(frame, quantities, Charting())
    assert len(control.tables) == 28
    assert control.chart.baseline == 20
    assert {"lot 7", "lot 9"}.isdisjoint(control.tables)
    (key,) = control_figure([control]).legends
    named = {text.get_text() for text in key.get_texts()}
    assert {"baseline", "centre", "EWMA", "limits, 3 sd", "table"} <= named
    rows = control_frame([control])
    assert rows["baseline"].sum() == 20
    assert rows["value"].to_numpy() == pytest.approx(np.delete(values, [6, 8]))


def test_few_tables_have_no_chart():
    few = _tables(_values(9))
    assert control_charts(*few, Charting()) == ()
    assert " 9 tables have " in why_no_chart(*few)
    assert why_no_chart(*_tables(_values(1))) == ""


@pytest.mark.parametrize("baseline", [-1, 4, 31])
def test_a_baseline_that_cannot_be_is_refused(baseline):
    with pytest.raises(ParameterError) as caught:
        Charting(baseline).checked(30)
    assert caught.value.code == "baseline"


def test_a_batch_has_its_charts(tmp_path):
    values = _values(15) / 100.0
    values[10:] += 0.05
    frame, quantities = _tables(values)
    records = []
    for name, row in frame.iterrows():
        cells = {"table": name, "impacts": 12, "model": "brody", "status": "point only"}
        records.append(TableRecord({**row, **cells}, quantities[name]))
    batch = batch_of(tmp_path, records, None, None, charting=Charting(10))
    rows = batch.frames["control"]
    assert rows["table"].tolist() == list(frame.index)
    assert rows["change"].tolist() == [""] * 10 + ["shift"] * 5
    assert set(figures(batch)) >= {"control"}
    (line,) = control_lines(batch.control)
    assert "lot 11" in line
    assert line.tone == "part"
