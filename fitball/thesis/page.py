"""The report of `fitball rederive` on a terminal, its page and files, `report.html` last; and its figures, in the
manner of the thesis: measured, printed and recomputed values together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from fitball.data.published import SPINS, fraction, measured, thesis_table
from fitball.data.scene import load_scene
from fitball.files import all_or_none
from fitball.inference.thesis.published_cases import C1, C2, INCH, STIFFNESS, TORSION, case_parameters, printed_model
from fitball.models.specs import SPECS
from fitball.models.thesis import ThesisCourse
from fitball.report.figures.canvas import log_scale, new_figure, own_style, save_figure
from fitball.report.form.document import Document, Section, Table, Words, figure_html, render_template, term
from fitball.report.form.files import write_text
from fitball.report.form.folders import make_folder
from fitball.report.form.palette import MARKERS, SERIES
from fitball.thesis import judgement, recalibration
from fitball.thesis.appendices import CASE_IN_APPENDIX_C, percentage_errors
from fitball.thesis.chapter_five import ChapterFive
from fitball.thesis.printed_tables import INPUT_HEADS, USED_IN_EXAMPLE_2, examples, figures_36_to_44
from fitball.thesis.recalibration import Recalibration, offset_constants
from fitball.values import FloatArray, impacts


def rederive_document(chapter: ChapterFive, folder: Path | None = None) -> Document:
    """The report on a terminal: does Table 9 hold, the ranking, what has changed; in full every finding."""
    brief = judgement.in_brief(chapter.rankings)
    changed = [term(check.name, check.finding) for check in chapter.checks if not check.holds]
    findings = [
        term(f"{check.name}, {'unchanged' if check.holds else 'CHANGED'}", check.finding) for check in chapter.checks
    ]
    verdicts = {name: text for name, text in chapter.verdicts.items() if name != "Table 9"}
    return Document(
        TITLE,
        [
            Words([chapter.verdicts["Table 9"], chapter.verdicts["Ranking"]], "lead", rank="first"),
            Words([SCORES], rank="first"),
            Table(
                "Score of each set", [list(brief.columns), *brief.to_numpy().tolist()], rank="first",
                brief=(judgement.PRINTED, judgement.RECOMPUTED, judgement.EXACT),
            ),
            Words([chapter.summary], rank="first"),
        ],
        [
            Section("changed", "Comparisons that have changed", [Words(changed, "list", rank="first")]),
            Section("checks", "Comparisons with print", [Words(findings, "list")]),
            Section("verdicts", "Verdicts", [
                Words([term(name, text) for name, text in verdicts.items() if name != "Ranking"], "list"),
            ]),
            Section("", "", [Words([f"Report: {folder / 'report.html'}"] if folder else [], rank="first")]),
        ],
    )  # fmt: skip


@all_or_none()
def write(chapter: ChapterFive, folder: Path) -> None:
    """Write CSV files, figures and the page, each whole or not at all. Raises ResultFolderError."""
    make_folder(folder)
    for name, frame in chapter.tables.items():
        write_text(folder / f"{name}.csv", frame.to_csv(index=False, float_format="%.6g", lineterminator="\n"))
    images = {name: save_figure(draw(), folder / f"{name}.png") for name, draw in draw_all(chapter).items()}
    write_text(folder / "report.html", page(chapter, images))


TITLE = "Chapter V and Appendices C and D of Jafri (2004), recomputed"
SCORES = (
    "Score of each set: rms error over the 21 impacts, velocity and spin weighted by their noise. In brackets: share "
    "of bootstrap samples in which the set is first."
)


def page(chapter: ChapterFive, images: Mapping[str, bytes]) -> str:
    """The page as text."""
    off = chapter.appendix_c.exceptions
    beyond = off[off["column"].isin(("v_x2", "omega_2")) & (off["error [%]"].abs() > 1.0)]
    return render_template(
        "fitball.thesis",
        "chapter_five.html.j2",
        found=chapter,
        figures={name: figure_html(images[name], text, text) for name, text in CAPTIONS.items() if name in images},
        tables=chapter.tables,
        text=_text,
        brief=(brief := judgement.in_brief(chapter.rankings)),
        short=brief[["set", judgement.RECOMPUTED, judgement.EXACT]],
        scene=load_scene(recalibration.TABLE),
        scales=judgement.SCALE,
        resamples=judgement.RESAMPLES,
        beyond=beyond,
        inertia_shares=", ".join(f"{name} {100.0 * share:.0f} %" for name, share in chapter.inertia.shares.items()),
    )


def _text(value: object) -> str:
    """A cell, numbers to four significant digits."""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return "" if np.isnan(value) else f"{value:.4g}"
    return str(value)


CAPTIONS: Mapping[str, str] = {
    "glance": (
        "Values of the thesis beside free fits. Left and middle: posterior draws of three free fits to Wang's 21 "
        "impacts and the cases of Table 9 (crosses, numbered). Right: the offset that each impact shows without any "
        "model, with its standard deviation, and the lines: Eq. (53) dashed, the fits with their 95 % bands."
    ),
    "chapter_v": (
        "Figs 36 to 44: rebound against incidence, three spins by three cases. Filled: Wang. Lines: recomputed with "
        "the c_y and the mean restitution of Chapter V. Open marks: what Appendix C prints for the same sets, with "
        "another c_y."
    ),
    "transition": (
        "Figs 25, 27 and 28: centre and surface velocity during contact for the two examples of Chapter III. The "
        "second has the inputs of its rebound. Open marks: printed rebounds; dotted: printed transition."
    ),
    "offset": (
        "Fig. 20: spin of the shell while rolling, for three offsets of the normal force, from the second example's "
        "transition on."
    ),
    "errors": (
        "Appendix D before and after: percentage errors of the three cases, and of the two-mass ball fitted freely. "
        "The fit is the posterior median of the default model for all 21 impacts."
    ),
}
NAMES: Mapping[str, tuple[str, str]] = {
    "theta_2": ("rebound angle", "deg"),
    "v_x2": ("horizontal velocity", "m/s"),
    "omega_2": ("spin", "rad/s"),
}
K_THETA = "k_theta [lb in/rad]"


def draw_all(chapter: ChapterFive) -> dict[str, Callable[[], Figure]]:
    """Every figure by name."""
    return {
        "glance": lambda: glance_figure(chapter.fits),
        "chapter_v": chapter_v_figure,
        "transition": transition_figure,
        "offset": offset_figure,
        "errors": lambda: error_figure(chapter),
    }


@own_style()
def glance_figure(fits: Mapping[str, Recalibration]) -> Figure:
    """Posteriors of three models with Table 9 in them, and offsets with Eq. (53)."""
    figure = new_figure(13.0, 4.8)
    left, middle, right = figure.subplots(1, 3)
    speeds = np.linspace(4.0, 17.0, 60)
    rng = np.random.default_rng(0)
    for colour, (name, item) in zip(SERIES, fits.items(), strict=False):
        draws = rng.choice(item.column("k_y").size, 1500, replace=False)
        k_theta = item.column("k_theta")[draws] / TORSION
        for axis, across in (
            (left, item.column("k_y")[draws] / STIFFNESS),
            (middle, item.column("mass_ratio")[draws]),
        ):
            axis.plot(across, k_theta, ".", color=colour, markersize=2, alpha=0.35, rasterized=True)
        c1, c2 = offset_constants(item)
        band = np.quantile(np.outer(c1, speeds) + c2[:, None], (0.025, 0.5, 0.975), axis=0)
        right.fill_between(speeds, band[0], band[2], color=colour, alpha=0.2, linewidth=0)
        right.plot(speeds, band[1], color=colour, linewidth=1.3, label=name)
    for axis, column in ((left, "k_y [lb/in]"), (middle, "mass_ratio")):
        for value, rows in thesis_table("table_9").groupby(column):
            cases, place = ", ".join(rows["case"].astype(str)), (fraction(str(value)), rows[K_THETA].iloc[0])
            axis.plot(*place, "kx", markersize=8, markeredgewidth=1.6)
            axis.annotate(cases, place, textcoords="offset points", xytext=(0, 7), ha="center", fontsize=9)
    for axis, label in ((left, f"{SPECS['k_y'].label} [lb/in]"), (middle, SPECS["mass_ratio"].label)):
        log_scale(axis, 20.0, 2500.0, "y")
        axis.set_ylabel(f"{SPECS['k_theta'].label} [lb in/rad]")
        axis.set_xlabel(label)
        axis.grid(alpha=0.3)
    log_scale(left, *left.get_xlim())
    first = next(iter(fits.values()))
    balance = first.offset
    groups = first.problem.table.labels["group"]
    for marker, group in zip(MARKERS, sorted(set(groups)), strict=False):
        mine = np.array([label == group for label in groups])
        right.errorbar(
            first.problem.impacts.v_y1[mine], balance.values[mine] / INCH, balance.sd[mine] / INCH,
            fmt=marker, color="black", markersize=4, linewidth=0.8, capsize=2, label=f"model-free, {group}",
        )  # fmt: skip
    right.plot(speeds, C1 * speeds + C2, "k--", linewidth=1.3, label="Eq. (53)")
    right.set_xlabel("incident vertical velocity [m/s]")
    right.set_ylabel("offset of the normal force [in]")
    right.set_ylim(-0.1, 0.75)
    right.grid(alpha=0.3)
    handles, labels = right.get_legend_handles_labels()
    cross = Line2D([], [], color="black", marker="x", linestyle="none", markersize=8)
    figure.legend(
        [*handles, cross], [*labels, "Table 9"], loc="outside lower center", ncols=8, frameon=False, fontsize=9
    )
    figure.suptitle("Table 9 and Eq. (53) beside free fits to Wang's impacts")
    return figure


def _nine_panels(
    title: str, heads: Mapping[str, str], draw: Callable[[Axes, str, str], None], grid: Literal["both", "y"] = "both",
    **shape: Any,
) -> Figure:  # fmt: skip
    """Angle, velocity and spin by spin of incidence, drawn by `draw(axis, spin, output)`; `heads` by output."""
    figure = new_figure(12.0, shape.pop("height"))
    panels = figure.subplots(3, 3, **shape)
    for column, spin in enumerate(SPINS):
        for row, output in enumerate(NAMES):
            axis: Axes = panels[row][column]
            draw(axis, spin, output)
            axis.grid(alpha=0.3, axis=grid)
            if row == 0:
                axis.set_title({"zero": "zero spin"}.get(spin, spin))
            if row == 2:
                axis.set_xlabel("incidence angle [deg]")
            if column == 0:
                axis.set_ylabel(heads[output])
    handles, labels = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)
    figure.suptitle(title)
    return figure


@own_style()
def chapter_v_figure() -> Figure:
    """Rebounds measured, recomputed and printed."""
    points = figures_36_to_44()

    def draw(axis: Axes, spin: str, output: str) -> None:
        unit = NAMES[output][1]
        for case in CASE_IN_APPENDIX_C:
            mine = points[(points["spin"] == spin) & (points["case"] == case)]
            angle, colour, first = mine["theta_1 [deg]"], SERIES[case - 1], case == 1
            axis.plot(
                angle, mine[f"{output}, recomputed [{unit}]"], color=colour, linewidth=3.5 if first else 1.3,
                alpha=0.6 if first else 1.0, label=f"case {case}, recomputed",
            )  # fmt: skip
            axis.plot(
                angle, mine[f"{output}, Appendix C [{unit}]"], MARKERS[case - 1], color=colour,
                markerfacecolor="none", markersize=5, label=f"case {case}, printed in Appendix C",
            )  # fmt: skip
        axis.plot(angle, mine[f"{output}, measured [{unit}]"], "ko", markersize=4, label="measured (Wang)")

    heads = {output: f"{name} [{unit}]" for output, (name, unit) in NAMES.items()}
    return _nine_panels("Figs 36 to 44 of the thesis, regenerated", heads, draw, height=10.0)


def _example(
    v_x1: float, v_y1: float, omega_1: float, c_y: float, **changed: float
) -> tuple[FloatArray, ThesisCourse]:
    values = {**case_parameters("2/3", 80.0, 0.532, c_y), **changed}
    chosen = printed_model()
    impact = impacts(v_x1, v_y1, omega_1, 0.76)
    contact = float(chosen.rebound(values, impact).contact_time[0])
    share = np.linspace(0.0, 1.0, 400)
    return share, chosen.course(values, impact, share * contact)


@own_style()
def transition_figure() -> Figure:
    """Velocities of centre and surface for the two examples of Chapter III."""
    printed = thesis_table("chapter_three_examples").to_dict("records")
    figure = new_figure(11.0, 4.4)
    recomputed = examples()
    used = recomputed[recomputed["inputs"] == "used"][INPUT_HEADS].to_numpy()
    for axis, inputs, row in zip(figure.subplots(1, 2), used, printed, strict=True):
        share, course = _example(*inputs)
        axis.plot(share, course.v_x, color=SERIES[0], label="$V_x$ of the centre")
        axis.plot(share, course.surface, color=SERIES[1], linestyle="--", label=r"$R\,\omega_2$ of the surface")
        axis.plot(1.0, row["v_x2 [m/s]"], "o", color=SERIES[0], markerfacecolor="none", clip_on=False)
        axis.plot(
            1.0, row["omega_2 [rad/s]"] * 1.3 * INCH, "s", color=SERIES[1], markerfacecolor="none", clip_on=False
        )
        if row["transition"]:
            axis.axvline(float(row["transition"]), color="0.3", linestyle=":", linewidth=1.0)
        axis.set_xlabel("share of contact time, n")
        axis.set_ylabel("velocity [m/s]")
        axis.set_title(
            f"example {row['example']}: {inputs[0]:g}, {inputs[1]:g} m/s, {inputs[2]:g} rad/s", fontsize=11
        )
        axis.grid(alpha=0.3)
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    return figure


@own_style()
def offset_figure() -> Figure:
    """Effect of the offset on rolling."""
    figure = new_figure(6.5, 4.2)
    axis = figure.subplots()
    for colour, offset in zip(SERIES, (0.0, 0.25, 0.5), strict=False):
        share, course = _example(*USED_IN_EXAMPLE_2, eps_10=offset * INCH, eps_slope=0.0)
        rolling = share * course.contact_time >= course.transition
        axis.plot(share[rolling], course.omega_2[rolling], color=colour, label=f"offset {offset:g} in")
    axis.set_xlabel("share of contact time, n")
    axis.set_ylabel("spin of the shell [rad/s]")
    axis.grid(alpha=0.3)
    axis.legend(frameon=False)
    return figure


@own_style()
def error_figure(chapter: ChapterFive) -> Figure:
    """Percentage errors of the three cases and of the recalibrated default model, impact by impact."""
    printed, fit = thesis_table("appendix_c"), chapter.fits["two-mass"]
    medians = fit.medians()
    medians["theta_2"] = np.degrees(np.arctan2(medians["v_y2"], medians["v_x2"]))
    groups = np.array(fit.problem.table.labels["group"])
    bars = {
        spin: {
            f"case {case}": percentage_errors(spin, printed[(printed["spin"] == spin) & (printed["case"] == index)])
            for case, index in CASE_IN_APPENDIX_C.items()
        }
        for spin in SPINS
    }
    for spin, listed in bars.items():
        wang = measured(spin)
        fitted = {name: 100.0 * (medians[name][groups == spin] / wang[name] - 1.0) for name in NAMES}
        listed["two-mass, fitted"] = fitted

    def draw(axis: Axes, spin: str, output: str) -> None:
        for k, (label, errors) in enumerate(bars[spin].items()):
            colour = "black" if k == 3 else SERIES[k]
            axis.bar(np.arange(7) + 0.2 * (k - 1.5), errors[output], 0.2, color=colour, label=label)
        axis.axhline(0.0, color="0.3", linewidth=0.8)
        wang = measured(spin)
        angles = np.degrees(np.arctan2(wang["v_y1"], wang["v_x1"]))
        axis.set_xticks(np.arange(7), [f"{angle:.0f}" for angle in angles])

    heads = {output: f"error of {name} [%]" for output, (name, _unit) in NAMES.items()}
    title = "Errors of Appendix D, and after recalibration"
    return _nine_panels(title, heads, draw, "y", height=9.0, sharey="row")
