"""What a fit says would help most: commands that run on its table and change something."""

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from msgspec import structs

import fitball
from fitball import cli
from fitball.report import advice, fit_page
from fitball.report.render import to_text

DATA = Path(__file__).parent / "data"


def write(path, columns):
    """A table of these columns, as a file."""
    names = list(columns)
    rows = zip(*(np.broadcast_to(columns[name], 24).tolist() for name in names), strict=True)
    lines = [",".join(names), *(",".join(map(str, row)) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def drops_of_two_balls():
    """Two balls that differ by a tenth in their restitution."""
    speed = np.tile([4.0, 5.0, 6.0, 7.0], 6)
    cor = np.repeat([0.7, 0.8], 12)
    noise = 0.01 * np.random.default_rng(3).standard_normal(24)
    return {"v_y1": speed, "v_y2": cor * speed + noise, "make": np.repeat(["a", "b"], 12)}


def drops_that_curve():
    """A restitution that rises and falls with the speed, as no law of ours does."""
    speed = np.linspace(2.0, 5.0, 24)
    noise = 0.004 * np.random.default_rng(4).standard_normal(24)
    cor = 0.39 + 0.257 * speed - 0.044 * speed**2
    return {"v_y1": speed, "v_y2": cor * speed + noise}


def impacts_with_friction_by_speed():
    """Balls that slide, with a friction that falls with their speed."""
    rng = np.random.default_rng(5)
    speed = np.tile([12.0, 18.0, 24.0, 30.0], 6)
    angle = np.repeat([12.0, 14.0, 16.0], 8)
    v_x1 = speed * np.cos(np.radians(angle))
    v_y1 = speed * np.sin(np.radians(angle))
    mu = 0.7 - 0.015 * (speed - 20.0)
    v_y2 = 0.75 * v_y1
    lost = mu * (v_y1 + v_y2)
    omega_2 = lost * 0.0576 * 0.033 / (0.56 * 0.0576 * 0.033**2)
    return {
        "v_x1": v_x1,
        "v_y1": v_y1,
        "v_x2": v_x1 - lost + 0.05 * rng.standard_normal(24),
        "v_y2": v_y2 + 0.05 * rng.standard_normal(24),
        "omega_2": omega_2 + 2.0 * rng.standard_normal(24),
    }


def commands_in(text):
    """The commands that a text names in backticks, as words."""
    return [shlex.split(command)[1:] for command in re.findall(r"`(fitball [^`]+)`", text)]


def texts_of(fit):
    """All advice of a fit: the sentence, and remedies of patterns."""
    found = [advice.remedy(fit, test) for test in fit.adequacy.tests if test.found]
    return [advice.useful_next(fit), *found]


@pytest.mark.parametrize(
    ("make", "model", "verbs"),
    [
        (drops_of_two_balls, "", {"calibrate"}),
        (drops_that_curve, "", set()),
        (impacts_with_friction_by_speed, "brody", {"compare"}),
    ],
)
def test_commands_run_on_the_table(tmp_path, monkeypatch, make, model, verbs):
    monkeypatch.chdir(tmp_path)
    table = write(tmp_path / "my balls.csv", make())
    fit = fitball.calibrate("my balls.csv", model=model, point_only=True, cores=1)
    assert fit.adequacy.answer in ("does not describe", "describes except")
    commands = [words for text in texts_of(fit) for words in commands_in(text)]
    assert {words[0] for words in commands} == verbs
    # Sentences of words with a meaning: no name is left to be filled in.
    assert not re.search(r"PARAMETER|COLUMN\b|TABLE\b", " ".join(texts_of(fit)))
    for words in {tuple(words) for words in commands}:
        assert words[1] == table.name
        quick = ["--point-only"]
        if words[0] == "compare":
            quick = ["--models", "brody,grip-slip"] if model else []
        assert cli.main([*words, *quick, "--figures", "none", "--out", "again"]) == 0


def test_a_level_is_named_with_its_parameter_and_column(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "balls.csv", drops_of_two_balls())
    fit = fitball.calibrate("balls.csv", point_only=True, cores=1)
    assert "--pool cor_10=make" in advice.useful_next(fit)
    again = fitball.calibrate("balls.csv", pool={"cor_10": "make"}, point_only=True, cores=1)
    assert "--pool" not in advice.useful_next(again)
    low, high = (again.summary.loc[f"cor_10[{label}]", "point"] for label in "ab")
    assert (low, high) == pytest.approx((0.7, 0.8), abs=0.02)


def test_a_table_keeps_its_reading(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    columns = impacts_with_friction_by_speed()
    columns["spin after"] = -columns.pop("omega_2")
    write(tmp_path / "t.csv", columns)
    reading = {"columns": {"omega_2": "spin after"}, "flip": "omega_2"}
    fit = fitball.calibrate("t.csv", model="brody", point_only=True, cores=1, **reading)
    words = commands_in(advice.useful_next(fit))[0]
    assert words[:2] == ["compare", "t.csv"]
    assert words[words.index("--columns") + 1] == "omega_2=spin after"
    assert words[words.index("--flip") + 1] == "omega_2"


def test_models_are_compared_before_a_parameter_is_fitted_to_each_label():
    """A rigid ball on two surfaces: its mass ratio is none that differs."""
    fit = fitball.calibrate(DATA / "rigid_on_two_surfaces.csv", point_only=True, cores=1)
    assert any(test.found and test.kind == "parameter" for test in fit.adequacy.tests)
    first, *others = commands_in(advice.useful_next(fit))
    assert first[0] == "compare"
    assert all("mass_ratio=surface" not in words for words in others)
    assert "--pool mass_ratio" not in fit.adequacy.sentence


def by_a_power():
    """Drops whose restitution is a power of their speed."""
    speed = np.geomspace(2.0, 30.0, 24)
    noise = 0.02 * np.random.default_rng(2).standard_normal(24)
    return {"v_y1": speed, "v_y2": 0.76 * (speed / 10.0) ** -0.158 * speed + noise}


def with_outliers():
    """A restitution with noise, of which each eighth is ten times as large."""
    rng = np.random.default_rng(6)
    speed = np.tile([4.0, 5.0, 6.0, 7.0], 6)
    noise = 0.02 * rng.standard_normal(24)
    noise[::8] += [0.3, -0.3, 0.3]
    return {"v_y1": speed, "v_y2": 0.75 * speed + noise}


@pytest.mark.parametrize(
    ("make", "choice", "option"),
    [
        (by_a_power, "cor=power", ["--model", "two-mass+normal=total+cor=power"]),
        (with_outliers, "noise=student-t", ["--noise", "student-t"]),
    ],
)
def test_a_variant_that_predicts_better_is_named_with_its_command(
    tmp_path, monkeypatch, make, choice, option
):
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "drops.csv", make())
    fit = fitball.calibrate("drops.csv", point_only=True, cores=1)
    for variant in fit.alternatives:
        least = max(2.0 * variant.error, 4.0)
        assert variant.better == (variant.score is not None and variant.score > least)
    assert choice in {variant.choice for variant in fit.alternatives if variant.better}
    sentence = advice.better_variants(fit)
    (words,) = commands_in(sentence)
    assert words == ["calibrate", "drops.csv", *option]
    # On the first screen.
    screen = to_text(fit_page.report(fit), full=False)
    assert shlex.join(words) in " ".join(screen.split())
    marks = fit.variants.loc[fit.variants["choice"] == choice, "better"]
    assert marks.all()
    assert cli.main([*words, "--point-only", "--figures", "none", "--out", "again"]) == 0
    better = [
        variant.choice for variant in fitball.load_fit("again").alternatives if variant.better
    ]
    assert not {"cor=saturating", "noise=normal"} & {*better}


def test_nothing_is_better_than_the_truth(tmp_path):
    """Drops of our own law."""
    model = fitball.model("two-mass+normal=total", tangential=False)
    parameters = {"k_y": 2e4, "cor_10": 0.76, "cor_slope": -0.013}
    speed = np.linspace(3.0, 16.0, 24)
    impacts = fitball.impacts(np.zeros(24), speed)
    rebound = model.rebound(parameters, impacts)
    noise = 0.05 * np.random.default_rng(8).standard_normal(24)
    table = write(tmp_path / "own.csv", {"v_y1": speed, "v_y2": rebound.v_y2 + noise})
    fit = fitball.calibrate(table, point_only=True, cores=1)
    assert not any(variant.better for variant in fit.alternatives)
    assert advice.better_variants(fit) == ""
    # Of several better ones the best is the one whose command is told.
    better = [
        structs.replace(fit.alternatives[0], choice=choice, better=True, score=score)
        for choice, score in (("cor=power", 5.0), ("noise=student-t", 9.0))
    ]
    sentence = advice.better_variants(replace(fit, alternatives=tuple(better)))
    (words,) = commands_in(sentence)
    assert words[-2:] == ["--noise", "student-t"]
    assert "cor=power" in sentence
    # Of other spins there is no option: columns say them.
    spins = structs.replace(better[0], choice="omega_1_sd=300", score=11.0)
    sentence = advice.better_variants(replace(fit, alternatives=(spins,)))
    assert not commands_in(sentence)
    assert "omega_1_sd = 300 rad/s" in sentence


def test_a_prior_that_excludes_the_data_is_at_fault():
    prior = {"mu": "uniform(0.62, 0.9)"}
    fit = fitball.calibrate("wang_all", model="grip-slip", prior=prior, point_only=True, cores=1)
    text = advice.useful_next(fit)
    assert "0.62" in text
    assert "prior" in text
    free = fitball.calibrate("wang_all", model="grip-slip", point_only=True, cores=1)
    assert "bound" not in advice.useful_next(free)


FEW_DROPS = {"v_y1": [6.9, 6.9, 6.88, 6.91], "v_y2": [5.31, 5.35, 5.35, 5.36]}


def few_drops(tmp_path, monkeypatch):
    """Four drops from one height, which say nothing of the slope of the restitution."""
    monkeypatch.chdir(tmp_path)
    rows = zip(*FEW_DROPS.values(), strict=True)
    lines = [",".join(FEW_DROPS), *(",".join(map(str, row)) for row in rows)]
    Path("few.csv").write_text("\n".join(lines) + "\n")


def test_a_fit_without_posterior_names_the_command_that_makes_one(tmp_path, monkeypatch):
    few_drops(tmp_path, monkeypatch)
    prior = {"cor_slope": "normal(0, 0.01)"}
    fit = fitball.calibrate("few.csv", model="grip-slip", prior=prior, point_only=True, cores=1)
    words = commands_in(advice.useful_next(fit))[0]
    assert words[:4] == ["calibrate", "few.csv", "--model", "grip-slip"]
    assert words[words.index("--prior") + 1] == "cor_slope=normal(0, 0.01)"


def test_the_folder_of_a_fit_is_filled_in(tmp_path, monkeypatch, capsys):
    few_drops(tmp_path, monkeypatch)
    short = ["--model", "grip-slip", "--max-steps", "400", "--figures", "none"]
    # As paths of Windows have it, and templates of regular expressions have not.
    folder = r"my \wang fit"
    cli.main(["calibrate", "few.csv", *short, "--out", folder])
    printed = " ".join(capsys.readouterr().out.split())
    assert f"fitball plan '{folder}' --target" in printed
    assert "fitball plan . --target" in Path(folder, "report.html").read_text(encoding="utf-8")
    targets = re.search(r"' --target ([\w,]+)", printed)[1]
    plan = ["plan", folder, "--target", targets, "--count", "1", "--figures", "none"]
    assert cli.main(plan) == 0
