"""A stored fit run again: the same to the last digit, or as far off as its note says; its table is
not needed.
"""

import pytest
from numpy.testing import assert_array_equal

import fitball
from fitball.base.errors import FitballError
from fitball.cli import main
from fitball.saved.files_of_fit import read


def law(v_x1, v_y1, omega_1, ball, cor_10="uniform(0, 1)"):
    """Restitution alone."""
    return v_x1, cor_10 * v_y1, omega_1


def note_of(fit):
    (text,) = (note.text for note in fit.notes if note.code == "run-again")
    return text


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A fit of a table that is gone, with choices of its own."""
    folder = tmp_path_factory.mktemp("again")
    table = fitball.load_table("wang_zero_spin.csv").to_frame()
    table.to_csv(folder / "balls.csv", index=False)
    words = [
        "--model",
        "grip-slip",
        "--prior",
        "mu=normal(0.6, 0.1)",
        "--fix",
        "cor_slope=-0.01",
        "--seed",
        "3",
    ]
    words += ["--out", str(folder / "fit"), "--figures", "none"]
    assert main(["calibrate", str(folder / "balls.csv"), *words]) == 0
    (folder / "balls.csv").unlink()
    return folder / "fit"


def test_a_stored_fit_gives_the_same_again_whatever_the_defaults_are_now(
    folder,
    capsys,
    monkeypatch,
):
    from fitball.inference.problem import build

    stored = read(folder)
    monkeypatch.setattr(build, "VELOCITY_SD", 2.5)
    assert main(["calibrate", str(folder / "fit.json"), "--figures", "none"]) == 0
    assert "last digit" in capsys.readouterr().out
    again = read(folder / "calibrate")
    assert again == stored
    assert again.run.key == stored.run.key
    assert note_of(again)


def test_what_is_given_varies_it_and_the_note_says_how_far_it_moved(folder):
    stored = read(folder)
    other = fitball.calibrate(folder, seed=4, progress=False)
    assert other.run.effort.seed == 4
    assert other.run.choices == stored.run.choices
    moved = other.moved_from(stored)
    name = max(moved, key=moved.get)
    before, after = ({**fit.parameters, **fit.derived}[name] for fit in (stored, other))
    away = abs(after.median - before.median)
    larger_sd = max(after.sd, before.sd)
    assert moved[name] == pytest.approx(away / larger_sd)
    assert 0.0 < moved[name] < 0.5
    assert f" {name} " in note_of(other)
    assert "last digit" not in note_of(other)
    varied = fitball.calibrate(
        folder,
        prior={"cor_slope": "normal(-0.01, 0.02)"},
        point_only=True,
        progress=False,
    )
    assert varied.run.choices.fix == {}
    assert varied.run.choices.prior.keys() == {"mu", "cor_slope"}
    assert varied.run.known["mu"] == stored.run.known["mu"]
    assert varied.status == "point only"
    shares = varied.moved_from(stored)
    after = varied.parameters["cor_slope"].point
    before = stored.parameters["cor_slope"].point
    larger = max(abs(after), abs(before))
    assert shares["cor_slope"] == pytest.approx(abs(after - before) / larger)
    # Another model keeps what it has of choices.
    brody = fitball.calibrate(folder, model="brody", point_only=True, progress=False)
    assert brody.problem.forward.model.name == "brody"
    assert brody.run.choices.fix == {"cor_slope": -0.01}
    assert_array_equal(brody.run.table.values["v_x2"], stored.run.table.values["v_x2"])


def test_a_function_of_ones_own_is_passed_again(tmp_path):
    user_model = fitball.model_from(law)
    stored = fitball.calibrate(
        "wang_zero_spin.csv",
        model=user_model,
        point_only=True,
        progress=False,
    )
    stored.save(tmp_path / "fit", figures=False)
    with pytest.raises(FitballError) as caught:
        fitball.calibrate(tmp_path / "fit", progress=False)
    assert caught.value.code == "own-model"
    again = fitball.calibrate(tmp_path / "fit", model=user_model, progress=False)
    assert "last digit" in note_of(again)


def test_a_stored_table_is_not_read_otherwise(folder, capsys):
    words = ["--flip", "omega_2", "--out", str(folder.parent / "other")]
    assert main(["calibrate", str(folder), *words]) == 2
    assert "flip" in capsys.readouterr().err
    assert not (folder.parent / "other").exists()
    with pytest.raises(FitballError) as caught:
        fitball.calibrate(folder, columns={"v_1": "speed"})
    assert caught.value.code == "stored-table"
