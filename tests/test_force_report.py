"""Force records through a whole fit: verdicts with and without them, files, figures, and the contact_time column."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from dataclasses import replace
from hashlib import sha256
from importlib.resources import files

import jsonschema
import numpy as np
import pytest
from samples import leave_out_figures, problem_of
from synthetic_drop import COR, K_Y, force_at, write_case

import fitball
from fitball.cli.main import main
from fitball.data.bundled import bundled_folder, bundled_names
from fitball.data.read import load_table
from fitball.data.scene import NO_CONTACT_TIME, Scene
from fitball.exports.parameters import latex_table
from fitball.inference.calibrate import fingerprint, run
from fitball.inference.effort import Effort
from fitball.inference.identifiability.information import information_evidence
from fitball.inference.likelihood.posterior import impact_terms
from fitball.inference.problem.build import Choices, build_problem
from fitball.inference.results.results import Verdict
from fitball.report.figures.predictions import force_panels
from fitball.report.figures.registry import drawable_kinds

# Enough to settle a verdict on six parameters, not to converge.
SHORT = {"walkers": 14, "max_steps": 150, "cores": 1, "seed": 2}
FREE = {"k_y": "lognormal(2.0e4, 1.0)"}


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    return write_case(tmp_path_factory.mktemp("case"), 4)


@pytest.fixture(scope="module")
def fit(table):
    return fitball.calibrate(table, **SHORT)


@pytest.fixture(scope="module")
def folder(fit, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        leave_out_figures(patch, but=["force"])
        return fit.save(tmp_path_factory.mktemp("force") / "fit")


@pytest.fixture(scope="module")
def without(table):
    return run(problem_of(table, force="none", priors=FREE), Effort(**SHORT))


def test_the_record_identifies_k_y(fit, without):
    known, unknown = fit.parameters["k_y"], without.parameters["k_y"]
    assert unknown.verdict is Verdict.PRIOR_DOMINATED and unknown.contraction < 0.2
    # A force gives a stiffness in the measure of the ball's mass.
    assert (known.verdict, known.given) == (Verdict.GIVEN, ("ball_mass",)) and known.contraction > 0.99
    assert known.q025 < K_Y < known.q975
    assert known.q975 - known.q025 < 0.1 * K_Y < unknown.q975 - unknown.q025
    assert fit.parameters["cor_10"].q025 < COR < fit.parameters["cor_10"].q975
    # Chi-square is that of the means of the records too, each of which gives one degree of freedom.
    means = int(fit.problem.force.mask.sum())
    assert fit.least_squares.degrees_of_freedom == without.least_squares.degrees_of_freedom + means


def test_every_look_counts_the_records(fit, without):
    evidence, other = fit.identifiability.evidence["k_y"], without.identifiability.evidence["k_y"]
    assert evidence.profile.open_sides == (False, False) and other.profile.open_sides == (True, True)
    assert evidence.information.error < 0.05 and other.information.error is None
    assert evidence.power.likelihood > 0.05 > evidence.power.own_prior
    assert evidence.active_impacts.impacts == fit.problem.table.ids and other.active_impacts.impacts == ()
    # The profile, at its own best noise held, and the posterior agree on what they know.
    low, high = evidence.profile.interval_95
    known = fit.parameters["k_y"]
    assert (high - low) == pytest.approx(known.q975 - known.q025, rel=0.35)
    assert {"force_sd", "force_misfit"} & set(fit.problem.free_names) and evidence.profile.unsettled == 0


def test_the_notes_say_what_was_done(fit):
    notes = " ".join(fit.notes)
    assert "drops_force.csv" in notes
    assert "count as" in notes and "nuisance parameter" in notes
    assert NO_CONTACT_TIME not in notes and "MISFIT" not in notes


def test_files_hold_the_records(table, fit, folder):
    content = json.loads((folder / "fit.json").read_text())
    schema = json.loads((files("fitball.report") / "fit.schema.json").read_text(encoding="utf-8"))
    jsonschema.validate(content, schema)
    digest = sha256(table.with_name("drops_force.csv").read_bytes()).hexdigest()
    assert content["source"]["force"]["sha256"] == digest
    named = tomllib.loads((folder / "run.toml").read_text())["force"]
    assert named["sha256"] == digest and (folder / named["file"]).resolve().samefile(
        table.with_name("drops_force.csv")
    )
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "Force records (points" in page and "count as" in page
    assert (folder / "force.png").stat().st_size > 10_000


def test_a_unit_of_per_cent_does_not_comment_out_its_line(folder):
    """Force records bring a parameter in per cent."""
    text = latex_table(fitball.load_fit(folder))
    assert r"$\mathrm{\%}$" in text
    assert not re.search(r"(?<!\\)%", text.removeprefix("% needs"))


def test_what_the_figure_shows(fit):
    panels = force_panels(fit)
    assert panels[0].title == "drop 1: 4 m/s"
    panel = panels[-1]
    truth = force_at(1e-3 * panel.along, 12.0)
    inside = (panel.along > 0.5) & (panel.along < 4.0)
    assert np.abs(panel.course[1] - truth)[inside].max() < 0.05 * truth.max()
    within = (panel.means > panel.expected[0]) & (panel.means < panel.expected[1])
    assert within.mean() > 0.7


def test_another_record_is_another_run(table, tmp_path):
    effort = Effort(cores=1)
    mark = fingerprint(problem_of(table), effort)
    assert mark == fingerprint(problem_of(table), effort)
    assert mark != fingerprint(problem_of(write_case(tmp_path, 5)), effort)
    assert mark != fingerprint(problem_of(table, scene=Scene(force_start_sd=1e-3)), effort)


def test_records_that_were_moved_or_changed(table, tmp_path, capsys, brief):
    folder = fitball.calibrate(table, point_only=True, cores=1).save(tmp_path / "fit")
    moved = tmp_path / "moved.csv"
    shutil.copyfile(table.with_name("drops_force.csv"), moved)
    assert main(["repeat", str(folder), "--quiet", "--force-records", str(moved)]) == 0
    moved.write_text(moved.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert main(["repeat", str(folder), "--quiet", "--force-records", str(moved)]) == 2
    assert "changed since the fit" in capsys.readouterr().err


def test_no_record_no_figure(tmp_path, capsys, brief):
    table = write_case(tmp_path, 4, records=False)
    fit = fitball.calibrate(table, point_only=True, cores=1)
    folder = fit.save(tmp_path / "fit")
    assert "force" not in drawable_kinds(fit)
    assert json.loads((folder / "fit.json").read_text())["source"]["force"] is None
    assert main(["plot", str(folder), "force"]) == 2
    assert "there are no force records" in capsys.readouterr().err


def test_models_without_a_course_say_so(table):
    problem = problem_of(table, model="brody")
    assert problem.force is None and "force_sd" not in [item.name for item in problem.parameters]
    assert any("has no force-time course" in note for note in problem.notes)


def test_records_beside_a_table_with_spin(tmp_path):
    """The default two-mass ball, shell and all, with the record of one impact of Wang's: k_y leaves its prior."""
    place = tmp_path / "wang.csv"
    place.write_bytes(load_bytes("wang_zero_spin.csv"))
    table = load_table(place)
    v = float(table.impacts.v_y1[2])
    times = np.arange(0.0, 1e-2, 5e-5)
    rng = np.random.default_rng(3)
    forces = force_at(times - 2e-3, v, e=0.8, mass=0.95 * 0.0576) + 2.0 * rng.standard_normal(times.size)
    rows = [f"{table.ids[2]},{t:.6f},{f:.4f}" for t, f in zip(times, forces, strict=True)]
    (tmp_path / "wang_force.csv").write_text("\n".join(["id,t,F", *rows]) + "\n")
    problem = problem_of(place, scene=Scene(), force=place.with_name("wang_force.csv"))
    assert any("impulse that stops the shell" in note for note in problem.notes)
    truth = {"k_y": K_Y, "mass_ratio": 0.95, "k_theta": 20.0, "mu": 0.55, "eps_10": 2e-3, "eps_slope": 1e-6}
    truth |= {"cor_10": 0.76, "cor_slope": -1e-3, "velocity_sd": 0.3, "spin_sd": 12.0}
    at = [{**truth, "force_sd": 2.0, "force_misfit": 0.02}[name] for name in problem.free_names]
    known = information_evidence(problem, problem.to_coordinates(np.array([at]))[0])["k_y"]
    alone = replace(problem, force=None)
    unknown = information_evidence(alone, alone.to_coordinates(np.array([at]))[0])["k_y"]
    # Without the record only priors and k_theta/k_y stand between k_y and its prior.
    assert known.error < 0.1 and unknown.error is None and unknown.contraction < 0.5


def load_bytes(name):
    from fitball.data.bundled import resolve_table

    return resolve_table(name).read_bytes()


@pytest.mark.parametrize("horizontal", [False, True])
def test_a_contact_time_column_identifies_k_y(tmp_path, horizontal):
    """For drop tests and for tables with motion along the court; the negative control has no such column."""
    rng = np.random.default_rng(8)
    speeds = np.linspace(4.0, 12.0, 8)
    damping = np.array([[K_Y, COR, 0.0]])
    ball = fitball.model("two-mass", normal="total", torsion="rigid")
    names = dict(zip(("k_y", "cor_10", "cor_slope"), damping[0], strict=True))
    impacts = fitball.impacts(speeds + 2.0, speeds, 0.0 * speeds)
    found = ball.rebound({"mu": 0.5, "eps_10": 0.0, "eps_slope": 0.0, **names}, impacts)
    columns = {
        "v_y1": speeds,
        "v_y2": found.v_y2 + 0.05 * rng.standard_normal(8),
        "contact_time": found.contact_time + 5e-5 * rng.standard_normal(8),
    }
    if horizontal:
        columns |= {"v_x1": speeds + 2.0, "v_x2": found.v_x2 + 0.05 * rng.standard_normal(8)}
    for timed in (True, False):
        kept = {name: column for name, column in columns.items() if timed or name != "contact_time"}
        rows = [",".join(f"{value:.7f}" for value in row) for row in zip(*kept.values(), strict=True)]
        place = tmp_path / f"{timed}.csv"
        place.write_text("\n".join([",".join(kept), *rows]) + "\n")
        fit = run(build_problem(load_table(place), Scene(), Choices()), Effort(point_only=True, cores=1))
        judged = fit.parameters["k_y"]
        assert (NO_CONTACT_TIME in fit.problem.scene.assumed) is False or not timed
        if timed:
            assert judged.verdict is Verdict.IDENTIFIED, judged.reason
            assert judged.point == pytest.approx(K_Y, rel=0.03)
            assert "contact_time_sd" in fit.problem.free_names
            values = np.array([[fit.point.values[name] for name in fit.problem.free_names]])
            terms = impact_terms(fit.problem, values, fit.problem.rebound(values))
            assert terms["contact_time"].shape == (1, 8)
        else:
            assert judged.verdict is Verdict.FIXED


def test_the_scene_sentence_goes_when_time_was_measured(tmp_path):
    table = write_case(tmp_path, 4)
    silent = Scene(assumed=(NO_CONTACT_TIME,))
    assert NO_CONTACT_TIME not in problem_of(table, scene=silent).notes
    assert NO_CONTACT_TIME in problem_of(table, force="none", scene=silent).notes
    unused = replace(silent, force_file="drops_force.csv")
    assert any("are not used here" in note for note in problem_of(table, force="none", scene=unused).notes)


def test_the_bundled_drop_is_what_its_script_writes(tmp_path):
    made = write_case(tmp_path, 1, name="synthetic_drop")
    for name in ("synthetic_drop.csv", "synthetic_drop_force.csv"):
        kept = np.genfromtxt(bundled_folder() / name, delimiter=",", skip_header=1)
        # The last printed digit may differ with the library of linear algebra.
        np.testing.assert_allclose(np.genfromtxt(made.with_name(name), delimiter=",", skip_header=1), kept, atol=2e-4)
    assert "synthetic_drop_force.csv" not in bundled_names() and "synthetic_drop.csv" in bundled_names()


def test_the_bundled_drop_tells_its_stiffness_and_without_records_does_not():
    """A point fit judges by its profile."""
    fit = fitball.calibrate("synthetic_drop", point_only=True, cores=1)
    k_y = fit.parameters["k_y"]
    assert (k_y.verdict, k_y.given) == (Verdict.GIVEN, ("ball_mass",))
    low, high = fit.identifiability.evidence["k_y"].profile.interval_95
    assert 0.97 * K_Y < low < K_Y < high < 1.03 * K_Y
    left_out = fitball.calibrate("synthetic_drop", force="none", point_only=True, cores=1)
    assert left_out.parameters["k_y"].verdict is Verdict.FIXED
    assert "force records are ignored, on request" in left_out.notes
    # No note about what takes no part.
    assert not any("friction" in note or "spins" in note for note in left_out.notes)
