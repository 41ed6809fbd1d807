"""The command line as a user meets it: results, exit codes, and every fault in words."""

from __future__ import annotations

import json
import os

import pytest
from samples import HANG, leave_out_figures

from fitball.cli.main import main
from fitball.cli.options import print_notes

GOOD = """id,v_x1 [m/s],v_y1 [m/s],omega_1 [rpm],v_x2 [m/s],v_y2 [m/s],omega_2 [rpm]
a,16.0,5.0,0,11.5,4.1,2400
b,15.0,7.5,50,8.9,6.0,2700
c,13.0,10.0,0,7.6,7.6,2500
d,10.0,13.0,-30,5.6,9.5,1900
e,6.0,15.0,10,2.9,10.6,1000
"""


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "balls.csv").write_text(GOOD, encoding="utf-8")
    return tmp_path


@pytest.mark.slow
def test_a_users_own_table(here, capsys):
    words = ["calibrate", "balls.csv", "--model", "grip-slip", "--seed", "3"]
    folder = here / "fits" / "balls" / "grip-slip"
    with pytest.MonkeyPatch.context() as patch:
        leave_out_figures(patch)
        assert main([*words, "--max-steps", "100", "--quiet"]) == 1
    assert json.loads((folder / "fit.json").read_text(encoding="utf-8"))["status"] == "not converged"
    capsys.readouterr()
    # More steps, from where it stopped.
    code = main([*words, "--resume"])
    out, err = capsys.readouterr()
    assert code == 0, err
    assert "holds no chain" not in err
    assert "balls: 5 impacts, grip-slip model" in out
    assert "converged" in out
    assert "no scene file" in err
    for name in (
        "fit.json", "posterior.h5", "posterior.nc", "summary.csv", "corner.png", "trace.png", "predictive.png",
        "residuals.png", "report.html", "run.toml",
    ):  # fmt: skip
        assert (folder / name).stat().st_size > 0
    assert json.loads((folder / "fit.json").read_text(encoding="utf-8"))["status"] == "converged"
    assert main(["calibrate", "balls.csv", "--model", "grip-slip"]) == 2
    assert "--overwrite" in capsys.readouterr().err


def test_point_only(here, capsys, brief):
    assert main(["calibrate", "balls.csv", "--point-only", "--out", "point"]) == 0
    assert "Point fit only" in " ".join(capsys.readouterr().out.split())
    assert not (here / "point" / "posterior.h5").exists()
    assert (here / "point" / "fit.json").exists()


def test_a_drop_test_fits_the_vertical_motion_and_nothing_else(here, capsys, brief):
    rows = "\n".join(f"{v},{v * (0.86 - 0.012 * v):.3f}" for v in (3.0, 5.0, 7.0, 9.0, 11.0))
    (here / "drop.csv").write_text(f"v_y1,v_y2\n{rows}\n", encoding="utf-8")
    assert main(["calibrate", "drop.csv", "--json", "--max-steps", "200"]) in (0, 1)
    captured = capsys.readouterr()
    found = json.loads(captured.out)["parameters"]
    assert set(found) == {"k_y", "cor_10", "cor_slope", "velocity_sd"}
    assert found["k_y"]["verdict"] == "fixed"
    assert found["cor_10"]["median"] == pytest.approx(0.74, abs=0.02)
    assert "only the vertical motion is fitted" in captured.err


def test_a_table_without_spin_does_not_fit_torsion(here, capsys, brief):
    text = "\n".join(",".join(line.split(",")[k] for k in (0, 1, 2, 4, 5)) for line in GOOD.splitlines())
    (here / "nospin.csv").write_text(text + "\n", encoding="utf-8")
    assert main(["calibrate", "nospin.csv", "--point-only", "--json", "--out", "o"]) == 0
    captured = capsys.readouterr()
    found = json.loads(captured.out)["parameters"]
    assert "k_theta" not in found
    assert found["eps_10"]["verdict"] == "fixed"
    assert "no spin was measured" in captured.err


# Faults of every kind are those of `test_data_bad_tables`: here that the verb tells them.
TABLES = {
    "missing column": ("v_x1,v_x2\n15,11\n14,9\n", ["v_y1"]),
    "misspelt column": (GOOD.replace("omega_2", "omgea_2"), ["omgea_2", "omega_2"]),
    "one row": ("\n".join(GOOD.splitlines()[:2]) + "\n", ["one", "2"]),
    "empty": ("", ["empty"]),
    "several": (GOOD.replace("8.9", "fast").replace("1900", "1900?"), ["row 2", "v_x2", "fast", "row 4"]),
}


@pytest.mark.parametrize("case", TABLES)
def test_a_bad_table_ends_with_two_and_words(here, capsys, case):
    text, words = TABLES[case]
    (here / "bad.csv").write_text(text, encoding="utf-8")
    assert main(["calibrate", "bad.csv"]) == 2
    err = capsys.readouterr().err
    assert "Traceback" not in err
    for word in ("bad.csv", *words):
        assert word in err, err
    assert not (here / "fits").exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--fix", "mu=9"], ["mu = 9", "outside its bounds [0, 5]"]),
        (["--fix", "mu=much"], ["expected a number"]),
        (["--fix", "mu"], ["expected NAME=VALUE"]),
        (["--fix", "mu=0.5", "--fix", "mu=0.6"], ["given twice"]),
        (["--prior", "mu=normal(50, 1)"], ["no mass within the bounds"]),
        (["--prior", "mass_rato=normal(0.8, 1)"], ["unknown parameter 'mass_rato'", "did you mean 'mass_ratio'"]),
        (["--walkers", "7"], ["walkers = 7"]),
        (["--max-steps", "3"], ["max_steps = 3"]),
        (["--seed", "-1"], ["seed = -1"]),
        (["--config", "nowhere.toml"], ["nowhere.toml"]),
        (["--resume", "--overwrite"], ["--resume", "--overwrite"]),
    ],
)
def test_bad_options_end_with_two_and_words(here, capsys, options, words):
    assert main(["calibrate", "balls.csv", *options]) == 2
    err = capsys.readouterr().err
    for word in words:
        assert word in err, err
    assert not (here / "fits").exists()


def test_unknown_table_and_verb(here, capsys):
    assert main(["calibrate", "wang_zero_spn.csv"]) == 2
    assert "wang_zero_spin" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["calibrat"])
    assert "did you mean 'calibrate'" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_folder_not_writable(here, capsys):
    (here / "closed").mkdir(mode=0o500)
    assert main(["calibrate", "balls.csv", "--out", "closed/x"]) == 2
    assert "closed" in capsys.readouterr().err


def test_out_is_a_file(here, capsys):
    assert main(["calibrate", "balls.csv", "--out", "balls.csv"]) == 2
    assert "is a file" in capsys.readouterr().err


# Ctrl-C at the hundredth step.
AT_STEP_100 = """
import os, signal, sys
from fitball.cli.main import main
from fitball.cli.options import print_notes
from fitball.inference.sampling import ensembles

advance, sent = ensembles.advance, []

def advance_or_interrupt(problem, walking, moves, step, stop):
    if walking[0].steps >= 100 and not sent:
        sent.append(os.kill(os.getpid(), signal.SIGINT))
    advance(problem, walking, moves, step, stop)

ensembles.advance = advance_or_interrupt
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_ctrl_c_keeps_the_chain_and_resume_gives_the_same_bytes(here, start, capsys, without_figures):
    """The real thing: a process, a signal, exit 130, and the same result as without."""
    words = ["calibrate", "balls.csv", "--model", "grip-slip", "--max-steps", "200", "--quiet"]
    process = start("-c", AT_STEP_100, *words, "--out", "a", cwd=here)
    out, err = process.communicate(timeout=HANG)
    assert process.returncode == 130, err
    assert not out
    assert "--resume" in err
    assert "Traceback" not in err
    assert (here / "a" / "posterior.h5").exists()
    assert not (here / "a" / "fit.json").exists()
    for out, more in (("a", ["--resume"]), ("b", [])):
        assert main([*words, "--out", out, *more]) == 1
        # It did go on, and was not begun anew.
        assert "holds no chain" not in capsys.readouterr().err
    for name in ("fit.json", "posterior.h5", "posterior.nc", "summary.csv", "predictions.csv", "run.toml"):
        assert (here / "a" / name).read_bytes() == (here / "b" / name).read_bytes(), name


def test_many_notes_are_three_lines_until_all_are_wanted(capsys):
    notes = [f"fact {k}" for k in range(1, 7)]
    for given, full, lines in ((notes, False, 3), (notes, True, 6), (notes[:3], False, 3), ([], False, 0)):
        print_notes(given, full)
        err = capsys.readouterr().err.splitlines()
        assert len(err) == lines
        # None is lost: what is not printed is counted.
        assert lines == len(given) or "4 more" in err[-1]
