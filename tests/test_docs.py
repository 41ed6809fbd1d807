"""Pages in docs/: their code runs, their names are those of the code and none is missing, their links lead on."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import asdict
from importlib.resources import files
from pathlib import Path
from typing import get_args, get_type_hints

import numpy as np
import pytest
import xarray as xr
from samples import TWO_MASS, coordinates_of, problem_of
from scipy.stats import norm
from scipy.stats import t as student
from snippets import pages
from validation.ranks import FAMILY_ERROR, RANKED
from validation.trust import PINNED

import fitball
from fitball.data.columns import BALL_TEMPERATURE, HEIGHTS, LABELS, MEASURED
from fitball.data.scene_keys import KINDS
from fitball.data.units import DEFAULT_UNIT, Dimension, symbols
from fitball.inference import calibrate
from fitball.inference.adequacy import describe, looks, refit
from fitball.inference.adequacy import words as adequacy_words
from fitball.inference.assumptions import constants as constant_ranges
from fitball.inference.assumptions import look as assumptions_look
from fitball.inference.comparison import left_out
from fitball.inference.identifiability import examine, profile, verdict
from fitball.inference.identifiability.examine import PROFILED
from fitball.inference.likelihood import regime_mixture
from fitball.inference.likelihood.posterior import log_posterior
from fitball.inference.population.hyper import SMOOTH
from fitball.inference.population.trend import LEAST_TABLES
from fitball.inference.prediction.reach import SLACK
from fitball.inference.problem import force_records, observables, spreads
from fitball.inference.problem import pooling as levels
from fitball.inference.problem.parameters import NOISE_SPECS
from fitball.inference.results import assumptions as assumption_values
from fitball.inference.results import evidence, fitted_model
from fitball.inference.results.results import TARGET_ESS, TARGET_R_HAT, RunStatus, Verdict
from fitball.inference.results.source import COUNTS, NUMBERS
from fitball.inference.sampling import ensembles as sampling
from fitball.inference.sampling import importance, moves
from fitball.models.registry import MODELS
from fitball.models.specs import RANKED as NAMED
from fitball.models.specs import SPECS
from fitball.models.types import PHASE_SYMBOL, Closures, ThesisClosures
from fitball.observables import NOISE_OF
from fitball.report.figures.registry import FIGURES
from fitball.report.fit.folder import CHAIN_NAME

DOCS = Path(__file__).resolve().parent.parent / "docs"
PAGES = {f"{name}.md": text for name, text in pages().items()}
PHYSICS, INFERENCE, FORMATS = (PAGES.get(f"{name}.md", "") for name in ("physics", "inference", "file-formats"))
FENCE = re.compile(r"^```[^`\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PROSE = {name: FENCE.sub("", text) for name, text in PAGES.items()}
# What a number of the table in inference.md is called in the code.
DECIDING = {
    "ensembles": sampling.ENSEMBLES,
    "warm-up steps": sampling.WARM_UP,
    "effective sample size": TARGET_ESS,
    "R-hat": TARGET_R_HAT,
    "share of independence proposals": moves.INDEPENDENT,
    "drop of a 68 % profile interval": profile.DROP_68,
    "drop of a 95 % profile interval": round(profile.DROP_95, 2),
    "rows beyond which draws are weighted": calibrate.LOOKED_AT,
    "effective weighted draws, at least": calibrate.LEAST_WEIGHED,
    "rows up to which profiles are computed": PROFILED,
    "negligible contraction": verdict.NEGLIGIBLE,
    "contraction without the scene that is not enough": verdict.NOT_ALONE,
    "loss without the scene that counts": verdict.RESTS_ON_SCENE,
    "share of the peak at an open end": verdict.OPEN_SHARE,
    "contraction of a pinned parameter": PINNED,
    "share of the drop kept beyond the end of a search": profile.KEPT,
    "power-scaling sensitivity": verdict.SENSITIVE,
    "degrees of freedom for a noise of its own": observables.FREEDOM,
    "rows spent by parameters": observables.SPENT,
    "reach of a kink in sds": regime_mixture.REACH,
    "width of a part of the mixture": regime_mixture.WIDTH,
    "parts of the mixture": regime_mixture.PARTS,
    "means of a force record": force_records.NODES,
    "correlation length of the misfit": force_records.ALIKE,
    "expected spread between levels": spreads.EXPECTED_SPREAD,
    "expected group offset in noises": levels.EXPECTED,
    "Pareto k": left_out.K_TRUSTED,
    "sure difference in standard errors": assumption_values.SURE_ERRORS,
    "sure difference": assumption_values.SURE_SIZE,
    "effective draws of a quick fit": importance.ENOUGH,
    "effective draws of a quick fit, at least": importance.LEAST,
    "impacts up to which alternatives are drawn": assumptions_look.ROWS,
    "free parameters up to which alternatives are drawn": assumptions_look.DIMENSIONS,
    "sds by which a value depends on a choice": assumption_values.MOVED,
    "sds by which a value depends on a constant": constant_ranges.MOVED,
    "sds of a constant to each side": constant_ranges.REACH,
    "share of information kept without priors of others": examine.VANISHED,
    "degrees of freedom of an undetermined noise": verdict.LEAST_FREEDOM,
    "standard errors between several fits": examine.APART,
    "chance of a false exception": evidence.FALSE_EXCEPT,
    'chance of a false "does not describe"': evidence.FALSE_FAILS,
    "pattern that is too small, in noises": describe.SMALL,
    "share of residual variance that a model may miss": describe.HALF,
    "share of residual variance that must not stay undetected": adequacy_words.BLIND,
    "noise that is an exception, over the expected one": evidence.FAR_FROM_STATED,
    "change of friction to find its effect": refit.FRICTION,
    "rows in which one outlier may hide others": looks.FEWER,
    "sds by which a misfit moves a conditional parameter": evidence.MOVED,
    "rows left out singly": left_out.SINGLY,
    "slack of the hull": SLACK,
    "draws of a prediction": fitted_model.PREDICTING,
    "tables for a population": LEAST_TABLES,
    "width of a draw, in sds of its table": SMOOTH,
    "draws a truth is ranked among": RANKED,
    "family error of the calibration": FAMILY_ERROR,
}


def table(text, *head):
    """Rows of the table with that head, each a list of cells, code marks taken off."""
    lines = iter(text.splitlines())
    wanted = f"| {' | '.join(head)} |"
    assert any(line == wanted for line in lines), f"no table {wanted}"
    next(lines)
    rows = []
    for line in lines:
        if not line.startswith("|"):
            break
        rows.append([cell.strip() for cell in line.strip("|").split(" | ")])
        assert len(rows[-1]) == len(head), line
    return rows


def column(text, *head):
    """What the first column of a table names, each once; a cell may name several."""
    names = [name for row in table(text, *head) for name in re.findall(r"`([^`]+)`", row[0])]
    assert len(set(names)) == len(names)
    return set(names)


def options(kind):
    hints = get_type_hints(kind)
    return {(name, option) for name in kind.__dataclass_fields__ for option in get_args(hints[name])}


def test_formulas_of_the_physics_are_asserted():
    """`tests/test_site.py` runs them; `test_kernel_oracle.py`, `test_laws.py` and others compare the rest."""
    assert PHYSICS.count("\nassert ") >= 5


def test_every_closure_and_option_is_documented_and_exists():
    found = {(closure.strip("`"), option.strip("`")) for closure, option, _ in
             table(PHYSICS, "closure", "option", "meaning")}  # fmt: skip
    known = options(Closures) | options(ThesisClosures)
    assert found == known
    for page, text in PROSE.items():
        for closure, option in re.findall(r"`(\w+) = (\w+)`", text):
            if closure in dict(known):
                assert (closure, option) in known, page


def test_every_model_is_documented_with_its_composition_and_parameters():
    expected = {}
    for name, item in MODELS.items():
        chosen = "algebraic" if item.closures is None else f"`{', '.join(asdict(item.closures).values())}`"
        expected[name] = [chosen, f"`{', '.join(fitball.model(name).parameter_names)}`"]
    assert {row[0].strip("`"): row[1:] for row in table(PHYSICS, "model", "composition", "parameters")} == expected


def test_help_texts_name_the_models_of_the_registry():
    assert tuple(name for name, entry in MODELS.items() if entry.candidates) == NAMED


def test_every_name_has_its_place():
    assert column(PHYSICS, "parameter", "symbol", "meaning") == set(SPECS)
    assert column(INFERENCE, "noise parameter", "of") == set(NOISE_SPECS)
    noise = {row[0].strip("`"): row[1] for row in table(INFERENCE, "noise parameter", "of")}
    assert all(noise[own].startswith(f"`{name}` [") for name, own in NOISE_OF.items())
    phases = {row[0].strip("`"): row[1].strip("`") for row in table(PHYSICS, "phase", "in words", "meaning")}
    assert phases == {phase.name: symbol for phase, symbol in PHASE_SYMBOL.items()}
    assert column(INFERENCE, "verdict", "when") == {str(item) for item in Verdict}
    assert column(PAGES["verdicts.md"], "verdict", "meaning") >= {str(item) for item in Verdict} - {Verdict.GIVEN}
    assert column(PAGES["glossary.md"], "verdict", "sentence") == {str(item) for item in Verdict}
    glossary = {row[0]: row[1] for row in table(PAGES["glossary.md"], "word", "meaning")}
    assert list(glossary) == sorted(glossary, key=str.lower)
    assert all(f"`{item}`" in glossary["verdict"] for item in Verdict)
    assert all(f"`{item}`" in glossary["status"] for item in RunStatus)
    assert all(symbol in glossary["phase"] for symbol in PHASE_SYMBOL.values())


def test_numbers_that_decide_are_those_of_the_code():
    assert {row[0]: float(row[1]) for row in table(INFERENCE, "number", "value")} == DECIDING


def test_columns_units_and_keys_of_a_scene():
    assert column(FORMATS, "column", "meaning") == {*MEASURED, *HEIGHTS, *LABELS, BALL_TEMPERATURE}
    units = {row[0]: tuple(re.findall(r"`([^`]+)`", row[1])) for row in
             table(FORMATS, "dimension", "units", "without a bracket")}  # fmt: skip
    assert units == {item.value: symbols(item) for item in Dimension}
    for name, _, default in table(FORMATS, "dimension", "units", "without a bracket"):
        assert default.strip("`") == DEFAULT_UNIT[Dimension(name)].symbol
    assert column(FORMATS, "key", "holds") == set(KINDS)


def test_result_folder(tmp_path, brief):
    drop = tmp_path / "drop.csv"
    drop.write_text("v_y1,v_y2,group\n4,3.21,a\n6,4.68,a\n8,6.13,b\n10,7.48,b\n", encoding="utf-8")
    fit = fitball.calibrate(drop, max_steps=100, walkers=16, cores=1)
    folder = fit.save(tmp_path / "out")
    written = {path.name for path in folder.iterdir()}
    assert column(FORMATS, "file", "content") == written | {CHAIN_NAME} | {f"{kind}.png" for kind in FIGURES}
    content = json.loads((folder / "fit.json").read_text(encoding="utf-8"))
    schema = json.loads((files("fitball.report") / "fit.schema.json").read_text(encoding="utf-8"))
    described = {row[0].strip("`"): row[1] for row in table(FORMATS, "key", "content")}
    assert column(FORMATS, "key", "content") == set(content) == set(schema["$defs"]["Record"]["properties"])
    assert described["schema_version"] == str(content["schema_version"])
    assert described["kind"] == f"`{content['kind']}`"
    assert all(f"`{item}`" in described["status"] for item in RunStatus)
    *_, data, posterior, run = FORMATS.split("\n### ")
    with xr.open_dataset(folder / "data.nc", engine="h5netcdf") as kept:
        names = {"impact", *map(str, kept.variables)} | {f"force_{name}" for name in (*COUNTS, *NUMBERS, "means")}
    assert "label_0" in names
    assert {name for name in names if f"`{name}`" not in data} <= set(NOISE_OF)
    with xr.open_datatree(folder / "posterior.nc", engine="h5netcdf") as tree:
        assert all(f"`{group}`" in posterior for group in tree.children)
    written_run = tomllib.loads((folder / "run.toml").read_text(encoding="utf-8"))
    sections = {name for name, held in written_run.items() if isinstance(held, dict)}
    sections |= {f"{name}.{key}" for name in sections for key, held in written_run[name].items()
                 if isinstance(held, dict | list)}  # fmt: skip
    assert sections >= {"fitball", "table.files", "model.closures", "scene.ball_sd", "sampler"}
    assert {name for name in sections if f"`{name}`" not in run} == set()


def anchors(text):
    heads = re.findall(r"^#+ (.*)$", FENCE.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", PROSE[page]):
        name, _, anchor = target.partition("#")
        assert not name.startswith("http"), "a page that may move; cite the paper"
        place = (DOCS / page).parent / name if name else DOCS / page
        assert place.is_file(), target
        assert not anchor or anchor in anchors(place.read_text(encoding="utf-8")), target


@pytest.mark.parametrize("page", PAGES)
def test_mathematics_is_written_as_github_reads_it(page):
    for line in PROSE[page].splitlines():
        plain = re.sub(r"`[^`]*`", "", line)
        assert plain.count("$") % 2 == 0, line
        # Markdown takes a backslash before a sign as its own.
        assert not re.search(r"\\[^A-Za-z]", plain), line
        if "$$" in line:
            assert re.fullmatch(r"\$\$ .* \$\$", line), line
        for formula in re.findall(r"\$([^$]+)\$", plain):
            assert formula.count("{") == formula.count("}"), line
            assert not (line.startswith("| ") and "|" in formula), line


@pytest.mark.parametrize("distribution", ["normal", "student-t"])
def test_the_posterior_is_the_sum_that_the_page_says(distribution):
    problem = problem_of("wang_zero_spin.csv", noise=distribution)
    truth = {**TWO_MASS, "degrees_of_freedom": 5.0}
    at = coordinates_of(problem, truth)[None, :]
    rebound = problem.rebound(problem.to_values(at))
    value, sd = problem.contact_time
    total = sum(item.prior.log_density(at[0, k]) for k, item in enumerate(problem.free))
    total += norm.logpdf(rebound.contact_time.mean(), value, sd)
    for name in ("v_x2", "v_y2", "omega_2"):
        scale = truth["spin_sd" if name == "omega_2" else "velocity_sd"]
        z = (problem.table.measurement(name).values - getattr(rebound, name)[0]) / scale
        density = norm.logpdf(z) if distribution == "normal" else student.logpdf(z, truth["degrees_of_freedom"])
        total += np.sum(density - np.log(scale))
    assert log_posterior(problem, at)[0] == pytest.approx(total, rel=1e-12)


def test_the_architecture_names_every_room():
    root = DOCS.parent
    packages = {str(item.parent.relative_to(root)) for item in (root / "fitball").glob("*/**/__init__.py")}
    named = column(PAGES["architecture.md"], "room", "what is in it")
    # A room that only holds rooms needs no row.
    assert packages - named == {"fitball/report"} and named <= packages


def test_files_that_contributors_are_told_of_exist():
    text = (DOCS.parent / "CONTRIBUTING.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:fitball|tests|docs|scripts)/[^`\s]+)`", text))
    missing = {item for item in named if "NAME" not in item and not (DOCS.parent / item).exists()}
    assert len(named) > 25 and not missing
    for word in re.findall(r"`([A-Z][A-Z_]+)`", text):
        if word != "NAME":
            assert any(
                word in item.read_text(encoding="utf-8")
                for room in ("fitball", "tests")
                for item in (DOCS.parent / room).rglob("*.py")
            ), word
