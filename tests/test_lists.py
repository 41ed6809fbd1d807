"""Lists in words are those of the code: what the help of a verb names, and what others say of a
model or a figure.
"""

import re
import runpy
import subprocess
import sys
import tomllib
from inspect import getdoc, isfunction
from pathlib import Path
from typing import get_args

import pytest
from support.fit_by_hand import fit_by_hand

import fitball
from fitball import cli
from fitball.data.scene import _KEYS
from fitball.exports import FORMATS
from fitball.inference.noise import NOISE_KINDS
from fitball.inference.schema import Verdict
from fitball.models.registry import DEFAULT, DEFAULT_DROPS, DEFAULT_SPINLESS, MODELS
from fitball.report import cite, fit_words, style
from fitball.report.figures import FIGURES, Place
from fitball.report.fit_page import report

ROOT = Path(__file__).parent.parent
TIMED = [name for name in MODELS if fitball.model(name).timed]


def listed(verb, option):
    """Names in the help of an option, without what stands in brackets and what comes after."""
    words = cli.help_of(cli.VERBS[verb]).arguments[option][1]
    words = re.sub(r"\([^()]*\)", "", words).partition(", with +NAME")[0]
    words = words.removeprefix("without a fit, ").replace(" or ", ", ")
    return [name.strip() for name in words.split(",")]


@pytest.mark.parametrize(
    ("verb", "option", "names"),
    [
        ("calibrate", "model", MODELS),
        ("calibrate", "noise", NOISE_KINDS),
        ("plot", "figures", FIGURES),
        ("plot", "format", style.FIGURE_FORMATS),
        ("simulate", "model", TIMED),
        ("export", "to", FORMATS),
    ],
)
def test_help_names_what_there_is(verb, option, names):
    assert listed(verb, option) == [*names]
    # In Python too, where help() shows the docstring.
    document = " ".join(getdoc(getattr(fitball, verb)).split())
    assert all(re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", document) for name in names)


def test_help_of_a_model_names_models_and_their_options():
    document = " ".join(getdoc(fitball.model).split())
    assert all(f"`{name}`" in document for name in MODELS if not MODELS[name].choices)
    for name, entry in MODELS.items():
        if entry.choices:
            said = re.search(rf"`{name}` \(([^)]*)\)", document)[1]
            listed_options = dict(part.split() for part in said.split(","))
            options = {key: words.split("|") for key, words in listed_options.items()}
            assert {key: {*values} for key, values in options.items()} == {
                key: {*values} for key, values in entry.choices.items()
            }
            # The first is the default.
            assert {key: values[0] for key, values in options.items()} == entry.options


def test_scenes_take_the_same_kinds_of_noise():
    assert _KEYS["measurement.noise"] == tuple(NOISE_KINDS)


def test_every_verdict_has_words_and_a_tone():
    assert {*fit_words.VERDICT_TONES} == {*fit_words._VERDICT_WORDS} == {*get_args(Verdict)}


def test_a_verb_of_the_recipe_is_reachable(tmp_path):
    # A public function of `verbs`, without another word to the command line.
    program = """import sys
import fitball
from fitball import verbs

def glance(data, *, times: int = 1):
    '''Look at a table.

    Args:
        data (DATA): a table
        times (N): how often
    '''
    raise fitball.FitballError(f"{data} {times}", "seen")

verbs.glance = glance
fitball._HOMES["fitball.verbs"] += " glance"
from fitball import cli
sys.exit(cli.main(["glance", "a.csv", "--times", "3", "--out", sys.argv[1]]))
"""
    done = subprocess.run(
        [sys.executable, "-P", "-c", program, str(tmp_path / "out")],
        capture_output=True,
        text=True,
    )
    assert (done.returncode, "a.csv 3" in done.stderr) == (2, True)


def test_verbs_are_the_public_functions_that_do_not_load():
    modules = (cli.verbs, cli.fit_verbs)
    public = {
        name
        for name in fitball.__all__
        if any(isfunction(getattr(module, name, None)) for module in modules)
    }
    assert {*cli.VERBS} == public - {"load_fit", "load_batch"}


def test_the_page_of_a_fit_has_each_figure_once():
    pictures = report(fit_by_hand(model="two-mass")).pictures(every=True)
    assert sorted(pictures) == sorted(FIGURES)
    assert {figure.place for figure in FIGURES.values()} == {*get_args(Place)}
    fit = fit_by_hand()
    assert all(figure.caption_of(fit).endswith(".") for figure in FIGURES.values())


def test_what_the_registry_says_of_models():
    assert {DEFAULT, DEFAULT_SPINLESS} <= {*MODELS}
    assert DEFAULT_DROPS.partition("+")[0] in MODELS
    assert MODELS[DEFAULT_SPINLESS].spinless
    for name, entry in MODELS.items():
        assert entry.equations
        assert entry.works
        assert {*entry.works} <= {*cite.works()}
        # A mass ratio is what a second mass has.
        parameters = {spec.name for spec in fitball.model(name).parameters}
        assert entry.masses == 1 + ("mass_ratio" in parameters)


def test_the_reference_lists_all_codes():
    """As `scripts/docs.py` writes them; and those of each mistake that tests know."""
    page = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    docs = runpy.run_path(str(ROOT / "scripts" / "docs.py"))
    assert docs["codes_table"]() in page
    text = (ROOT / "tests" / "data" / "mistakes.toml").read_text(encoding="utf-8")
    codes = set()
    for cases in tomllib.loads(text).values():
        for case in cases:
            faults = case.get("faults", ()) if isinstance(case, dict) else ()
            codes |= {fault.split()[0] for fault in faults}
    assert len(codes) > 30
    assert {code for code in codes if f"`{code}`" not in page} == set()


def test_blocks_with_a_name_to_fill_in_are_shown_only():
    """`scripts/docs.py --run` would run `HOST` or `TABLE` as it is written: a scheduler without
    end, as in `dask scheduler`.
    """
    docs = runpy.run_path(str(ROOT / "scripts" / "docs.py"))
    faults = [
        (page.name, block[4])
        for page in docs["PAGES"]
        for block in docs["_FENCE"].finditer(page.read_text(encoding="utf-8"))
        if block[2] == "sh" and block[3].strip() != "show"
        if re.search(r"\b[A-Z]{3,}\b|\bdask scheduler\b", block[4])
    ]
    assert faults == []
