"""What a notebook shows of a fit and of a long run: tables, one quantity, one line."""

import builtins
import contextlib
import io
import pickle
import struct
import sys
import types
from html.parser import HTMLParser

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.base.errors import FitballError
from fitball.base.progress import shown

NASTY = "<b onclick=x>clay</b>"


class Cells(HTMLParser):
    """Rows of the tables of a page, by their first cell, and the elements that it has."""

    def __init__(self, page):
        super().__init__()
        self.rows = []
        self.elements = set()
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.elements.add(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_data(self, data):
        if self.rows and self.rows[-1]:
            self.rows[-1][-1] += data.strip()


@pytest.fixture(scope="module")
def fit():
    return fit_by_hand(table_of(20, surfaces=(NASTY, "hard")))


@pytest.mark.parametrize("name", ["parameters", "derived", "draws", "least_squares"])
def test_a_bare_attribute_is_a_table_of_rounded_numbers(fit, name):
    shown_object = getattr(fit, name)
    page = Cells(shown_object._repr_html_())
    assert "b" not in page.elements
    by_name = {row[0]: row[1:] for row in page.rows if row and row[0]}
    values = {
        "parameters": {key: row.point for key, row in fit.parameters.items()},
        "derived": {key: row.point for key, row in fit.derived.items()},
        "draws": {key: value[0] for key, value in fit.draws.best.items()},
        "least_squares": fit.least_squares.values,
    }[name]
    assert {*by_name} == {*values}
    text = repr(shown_object)
    for key, value in values.items():
        assert float(by_name[key][0]) == pytest.approx(value, rel=1e-3, abs=1e-12)
        assert f"\n{key} " in text
    assert len(text.splitlines()) == len(values) + 2


def test_the_table_of_draws_has_their_moments_and_quantiles(fit):
    head, *rows = Cells(fit.draws._repr_html_()).rows
    cells = dict(zip(head, next(row for row in rows if row[0] == "mu[hard]"), strict=True))
    draws = fit.draws.values["mu[hard]"]
    expected = {
        "mean": draws.mean(),
        "sd": draws.std(),
        "2.5 %": np.quantile(draws, 0.025),
        "97.5 %": np.quantile(draws, 0.975),
    }
    for name, value in expected.items():
        assert float(cells[name]) == pytest.approx(value, rel=2e-3)


def test_a_point_fit_has_tables_without_draws():
    point = fit_by_hand(sampled=False)
    page = Cells(point.parameters._repr_html_())
    assert page.rows[0] == ["", "point", "unit", "verdict"]
    assert len(point.draws.frame) == 0
    assert repr(point.draws).splitlines()[1].split() == ["point"]
    assert point["mu"].draws.size == 0


def test_one_quantity_has_its_draws_and_its_row(fit):
    mu = fit["mu[hard]"]
    assert_array_equal(mu.draws, fit.draws.values["mu[hard]"])
    assert_array_equal(mu.draws, fit.draws.frame["mu[hard]"])
    assert mu.summary["median"] == fit.parameters["mu[hard]"].median
    assert mu.estimate is fit.parameters["mu[hard]"]
    assert np.median(mu.draws) == pytest.approx(mu.summary["median"], rel=0.05)
    assert fit.derived
    for name in fit.derived:
        assert_array_equal(fit[name].draws, fit.quantity(name).rule(fit.draws.values))
    assert "b" not in Cells(fit[f"mu[{NASTY}]"]._repr_html_()).elements
    assert "mu[hard]" in fit._ipython_key_completions_()
    with pytest.raises(FitballError) as caught:
        fit["mo"]
    assert caught.value.code == "unknown-quantity"
    with pytest.raises(TypeError):
        iter(fit)


def test_tables_stay_tables_when_a_fit_is_copied():
    fit = fitball.calibrate("synthetic_drop", point_only=True)
    again = pickle.loads(pickle.dumps(fit))
    assert again == fit
    assert repr(again.parameters) == repr(fit.parameters)


class Output:
    """The only output of a cell, as a notebook keeps it."""

    def __init__(self):
        self.states = []

    def display(self, shown_object, display_id):
        assert display_id
        self.states.append(shown_object)
        return self

    def update(self, shown_object):
        self.states.append(shown_object)


@pytest.mark.parametrize("fails", [False, True])
def test_a_long_run_is_one_output_that_ends_at_100_percent(monkeypatch, fails):
    output = Output()
    module = types.SimpleNamespace(display=output.display, HTML=lambda text: text)
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    shell = types.SimpleNamespace(kernel=object())
    monkeypatch.setattr(builtins, "get_ipython", lambda: shell, raising=False)
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with contextlib.suppress(RuntimeError), shown(None) as show:
        for stage in ("search", "sampling <1>"):
            for share in np.linspace(0.0, 1.0, 1000):
                show(stage, share)
        if fails:
            raise RuntimeError
    assert sys.stderr.getvalue() == ""
    assert ("100 %" in output.states[-1]) is not fails
    assert not any("<1>" in state for state in output.states)
    # A new stage is shown at once, shares of one only after some time.
    assert 4 <= len(output.states) < 100


@pytest.mark.parametrize("name", ["curves", "corner"])
def test_a_figure_is_shown_without_the_inline_backend(fit, name):
    """As a notebook asks for it: matplotlib registers its own way with the backend only."""
    image = fit.plot(name)._repr_png_()
    width, height = struct.unpack(">II", image[16:24])
    figure = fit.plot(name)
    assert image.startswith(b"\x89PNG")
    assert (width, height) == tuple(np.round(figure.get_size_inches() * figure.dpi).astype(int))
