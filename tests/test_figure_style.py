"""What figures and pages have in common: symbols, the sketch of the ball, colours and what they mean."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.lines import Line2D

from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results.results import Verdict
from fitball.models.registry import model
from fitball.models.specs import SPECS
from fitball.report.batch.figure import batch_figure
from fitball.report.batch.rows import row_of
from fitball.report.batch.series import all_series
from fitball.report.figures.canvas import (
    UNNAMED,
    Margins,
    group_handles,
    group_styles,
    legend_below,
    log_scale,
    log_ticks,
    new_figure,
    panels,
)
from fitball.report.figures.quantities import parameter_axis
from fitball.report.figures.registry import draw
from fitball.report.figures.sketch import ball_sketch
from fitball.report.fit.document import page
from fitball.report.form.numbers import symbol_html
from fitball.report.form.palette import (
    MEASURED,
    MODEL,
    NOISE,
    PRIOR,
    SERIES,
    TREND,
    VERDICTS,
    pale,
    series_style,
    style_rules,
    verdict_mark,
)  # fmt: skip
from fitball.wording import in_formula, short


@pytest.mark.parametrize(
    ("low", "high", "named"),
    [
        (0.8, 1500.0, [1.0, 10.0, 100.0, 1000.0]),
        (11.0, 33.0, [15.0, 20.0, 30.0]),
        (2.0, 70.0, [2.0, 5.0, 10.0, 20.0, 50.0]),
        (18.9, 20.3, [19.0, 19.4, 19.8, 20.2]),
    ],
)
def test_log_ticks_are_round_few_and_unevenly_spaced(low, high, named):
    found, unnamed = log_ticks(low, high)
    assert found == pytest.approx(named)
    assert all(low <= tick <= high for tick in unnamed)
    assert not set(found) & set(unnamed)
    assert len(found) < len(unnamed) < 60 or high / low < 1.2


@pytest.mark.parametrize("ends", [(22.28, 22.79), (22.41, 22.43), (25.8, 26.0), (0.10011, 0.10012)])
def test_a_narrow_logarithmic_axis_has_ticks_and_a_layout(ends):
    """Without finer ticks there is no artist of them: its empty box would reach to the corner of the figure, and the
    layout of several panels then has no end.
    """
    named, unnamed = log_ticks(*ends)
    assert 2 <= len(named) <= 5 and named == sorted(named)
    figure = new_figure(4.0, 6.0)
    upper, _lower = figure.subplots(2, 1)
    log_scale(upper, *ends, "y")
    assert [line.get_gid() for line in upper.get_lines()] == [UNNAMED] * bool(unnamed)
    figure.canvas.draw()
    box, window = upper.get_tightbbox(), upper.get_window_extent()
    assert box.ymin > window.ymin - 60.0 and window.height > 100.0


def test_a_scale_depends_on_the_parameter_alone():
    logs = {name for name, spec in {**SPECS, **NOISE_SPECS}.items() if parameter_axis(spec).logarithmic}
    assert logs == {"k_y", "k_theta", "c_y", "zeta_theta", "degrees_of_freedom"}
    for name in logs:
        assert {**SPECS, **NOISE_SPECS}[name].lower >= 0.0


def test_profiles_and_walkers_have_the_same_logarithmic_axes(point_fit):
    figure = draw("profiles", point_fit)
    by_name = {axis.get_title(): axis for axis in figure.axes if axis.get_title()}
    for name, axis in by_name.items():
        spec = {**SPECS, **NOISE_SPECS}[name]
        assert axis.get_xscale() == ("log" if spec.logarithmic else "linear")
        assert axis.get_xlabel().startswith(spec.label)
        if spec.logarithmic:
            (unnamed,) = (line for line in axis.get_lines() if line.get_gid() == UNNAMED)
            assert len(unnamed.get_xdata()) > len(axis.get_xticks())


def test_every_symbol_is_one_parameters_and_reads_on_a_page():
    both = {**SPECS, **NOISE_SPECS}
    shown = {name: symbol_html(spec.label) for name, spec in both.items()}
    assert all(text and not re.search(r"[\\${}^_]", text) for text in shown.values())
    twice = {text for text in shown.values() if list(shown.values()).count(text) > 1}
    assert twice == set()
    assert shown["k_theta"] == "K<sub>\u03b8</sub>" and shown["inertia_ratio"] == "I/MR<sup>2</sup>"
    assert shown["v_x_sd"] == "\u03c3<sub>v<sub>x</sub></sub>" and shown["cor_slope"] == "COR\u2032"
    assert all(spec.meaning for spec in both.values())
    for wrong in (r"$\nonsense$", "$a}b$"):
        with pytest.raises(ValueError, match=r"no such letter|brace too many"):
            symbol_html(wrong)


def test_the_table_of_parameters_says_what_they_mean(point_fit):
    text = page(point_fit, {})
    assert f'<td class="text">\u03bc</td><td class="text"></td><td class="words">{SPECS["mu"].meaning}</td>' in text
    assert '<td class="words">vertical stiffness, between core and shell</td>' in text
    assert "K<sub>y</sub>" in text


@pytest.mark.parametrize("name", ["two-mass", "grip-slip", "brody"])
def test_the_sketch_names_what_the_model_has(name):
    specs = model(name).specs
    words = " ".join(text.get_text() for text in ball_sketch(specs, name).axes[0].texts)
    cored = name == "two-mass"
    assert (SPECS["k_y"].label in words) is cored and ("core" in words) is cored
    assert (SPECS["offset"].label in words) is (name != "brody")
    assert (SPECS["e_x"].label in words) is (name == "grip-slip")
    assert "topspin" in words and r"\mu" in words


def contrast(one, other):
    """Ratio of luminances (WCAG 2.2)."""

    def luminance(colour):
        parts = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
        return float(
            np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]
        )

    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_every_colour_means_one_thing():
    alone = [MEASURED, MODEL, NOISE, PRIOR, TREND, *SERIES]
    assert len(set(alone)) == len(alone)
    apart = [
        sum(abs(int(one[k : k + 2], 16) - int(other[k : k + 2], 16)) for k in (1, 3, 5))
        for one in alone
        for other in alone
        if one < other
    ]
    assert min(apart) > 60
    assert len({series_style(k) for k in range(42)}) == 42
    assert group_styles(("", "")) == {"": (MEASURED, "o")}
    assert pale("#000000", 0.5) == "#808080"


def test_every_verdict_has_a_colour_that_can_be_read(grip_slip_fit):
    fit = grip_slip_fit
    assert set(VERDICTS) == set(Verdict)
    assert VERDICTS[Verdict.GIVEN] == VERDICTS[Verdict.CONDITIONAL] == VERDICTS[Verdict.ONE_SIDED]
    for tone in VERDICTS.values():
        assert contrast(tone.light, "#ffffff") > 4.5 and contrast(tone.dark, "#15181c") > 4.5
    given = [
        replace(item, verdict=Verdict.GIVEN, given=("offset=contact",)) if item.name == "mu" else item
        for item in fit.estimates
    ]
    text = page(replace(fit, parameters={item.name: item for item in given}), {})
    used = set(re.findall(r'class="(?:text )?v-([^"]*)"', text))
    assert "given" in used
    assert used <= {verdict_mark(verdict) for verdict in Verdict}
    rules = style_rules()
    assert all(f".v-{mark} {{ color: " in rules and rules.count(f".v-{mark} ") == 2 for mark in used)
    assert "identified, given offset=contact</span></td>" in text


def test_dollars_of_the_user_begin_no_formula(grip_slip_fit):
    """In names of tables, in groups, surfaces and names of impacts: a formula of theirs may be none."""
    odd, result = "a$^$b", grip_slip_fit
    table = result.problem.table
    labels = {name: tuple(f"{odd}{cell}" for cell in column) for name, column in table.labels.items()}
    table = replace(table, name=odd, labels=labels, ids=tuple(f"{odd}{name}" for name in table.ids))
    fit = replace(result, problem=replace(result.problem, table=table))
    figures = [draw(name, fit) for name in ("regimes", "curves", "residuals", "corner")]
    for figure in (*figures, batch_figure(all_series([row_of(odd, fit, fit.problem)])[:1], [odd])):
        figure.draw_without_rendering()


def test_long_names_stay_within_the_figure_and_off_the_panels():
    figure, axes = panels(2, 2, (3.1, 1.65), Margins(bottom=1.15))
    axes[-1, 0].set_xticks([0, 1], ["acrylic hall", "clay"], rotation=60)
    axes[-1, 0].set_xlabel("surface")
    before = [axis.get_window_extent().height for axis in axes.ravel()]
    handles = {f"measured: cushioned layer of the new hall, court {k}": Line2D([], []) for k in range(7)}
    legend_below(figure, handles, 3)
    legend = figure.legends[0].get_window_extent()
    assert figure.bbox.x0 <= legend.x0
    assert legend.x1 <= figure.bbox.x1
    assert legend.y1 <= axes[-1, 0].xaxis.get_tightbbox().y0
    assert [axis.get_window_extent().height for axis in axes.ravel()] == pytest.approx(before)


def test_a_legend_says_how_many_groups_it_leaves_out():
    assert [*group_handles(group_styles([f"{k:02d}" for k in range(40)]))][-2:] == ["11", "28 others"]
    assert [*group_handles(group_styles(["clay", "grass"]))] == ["clay", "grass"]


def test_long_names_keep_both_ends():
    assert short("clay") == "clay"
    assert short("court 07 of the club Rot-Weiss", 14) == "court 07…eiss"
    assert in_formula("Škoda_x^2$y$") == r"\mathrm{Škodax2y}"
