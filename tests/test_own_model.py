"""A model of one's own is a Python function: posterior, derivatives, faults, and what a saved fit keeps of it."""

from __future__ import annotations

import json
import math
import pickle

import emcee
import numba
import numpy as np
import pytest
from samples import search_briefly

import fitball
from fitball.cli.main import main
from fitball.errors import ModelError, ParameterError
from fitball.models import own

# Cross (2002): constant restitutions both ways. And a rigid ball that slides or grips, with a loss of spin.
SUPERBALL = """
import numpy as np

with open(__file__ + ".ran", "a") as file:
    file.write("ran ")

PARAMETERS = {"e_y": "uniform(0, 1)", "e_t": "normal(0.2, 0.3)", "other": "normal(0, 1)"}


def superball(v_x1, v_y1, omega_1, ball, e_y, e_t):
    a = ball.inertia / (ball.mass * ball.radius**2)
    change = a / (1 + a) * (1 + e_t) * (v_x1 - ball.radius * omega_1)
    return v_x1 - change, e_y * v_y1, omega_1 + change / (a * ball.radius)
"""
BALL = fitball.Ball()
ROUNDNESS = BALL.inertia / (BALL.mass * BALL.radius**2)


def superball(v_x1, v_y1, omega_1, ball, e_y="uniform(0, 1)", e_t="normal(0.2, 0.3)"):
    a = ball.inertia / (ball.mass * ball.radius**2)
    change = a / (1 + a) * (1 + e_t) * (v_x1 - ball.radius * omega_1)
    return v_x1 - change, e_y * v_y1, omega_1 + change / (a * ball.radius)


def sliding(v_x1, v_y1, omega_1, ball, mu="lognormal(0.5, 0.5)", e_y="uniform(0, 1)", keep="normal(0.9, 0.1)"):
    a = ball.inertia / (ball.mass * ball.radius**2)
    slip = v_x1 - ball.radius * omega_1
    change = np.sign(slip) * np.minimum(a / (1 + a) * np.abs(slip), mu * (1 + e_y) * v_y1)
    return v_x1 - change, e_y * v_y1, keep * omega_1 + change / (a * ball.radius)


@numba.njit
def looped(v_x1, v_y1, omega_1, ball, e_y="uniform(0, 1)"):
    v_y2 = np.empty_like(v_y1)
    for k in range(len(v_y1)):
        v_y2[k] = e_y[k] * v_y1[k]
    return v_x1 * 0.5, v_y2, omega_1 + 10.0


@pytest.fixture(autouse=True)
def briefly(monkeypatch):
    """A process that knows no function yet, without long searches and figures."""
    search_briefly(monkeypatch)
    monkeypatch.setattr(own, "_KNOWN", {})
    monkeypatch.setattr(own, "_LAST", {})


def measured(function, **values):
    """Fourteen impacts on which a function holds, with noise of 0.3 m/s and 10 rad/s."""
    rng = np.random.default_rng(3)
    count = 14
    given = rng.uniform(6.0, 20.0, count), rng.uniform(5.0, 15.0, count), rng.uniform(-200.0, 200.0, count)
    ball = own.OwnBall(*(np.full(count, item) for item in (BALL.mass, BALL.radius, BALL.inertia)))
    made = function(*given, ball, **{name: np.full(count, value) for name, value in values.items()})
    noise = [sd * rng.standard_normal(count) for sd in (0.3, 0.3, 10.0)]
    columns = ("v_x1", "v_y1", "omega_1", "v_x2", "v_y2", "omega_2")
    return dict(zip(columns, (*given, *(item + more for item, more in zip(made, noise, strict=True))), strict=True))


def log_superball(table, at):
    """Written anew from the balance of momentum: prior and likelihood of `at` (walkers, 2)."""
    e_y, e_t = at.T[:, :, None]
    slip = table["v_x1"] - BALL.radius * table["omega_1"]
    after = -e_t * slip
    v_x2 = table["v_x1"] + ROUNDNESS / (1.0 + ROUNDNESS) * (after - slip)
    omega_2 = (v_x2 - after) / BALL.radius
    prior = np.where((e_y > 0.0) & (e_y < 1.0), -0.5 * ((e_t - 0.2) / 0.3) ** 2, -np.inf)[:, 0]
    return prior + log_normal(table, v_x2, e_y * table["v_y1"], omega_2)


def log_sliding(table, at):
    """The same of the other ball, `at` (walkers, 3)."""
    mu, e_y, keep = at.T[:, :, None]
    positive = np.where(mu > 0.0, mu, 1.0)
    slip = table["v_x1"] - BALL.radius * table["omega_1"]
    limit = positive * (1.0 + e_y) * table["v_y1"]
    change = np.clip(slip * ROUNDNESS / (1.0 + ROUNDNESS), -limit, limit)
    omega_2 = keep * table["omega_1"] + change / (ROUNDNESS * BALL.radius)
    prior = -0.5 * (np.log(positive / 0.5) / 0.5) ** 2 - np.log(positive) - 0.5 * ((keep - 0.9) / 0.1) ** 2
    prior = np.where((mu > 0.0) & (e_y > 0.0) & (e_y < 1.0), prior, -np.inf)[:, 0]
    return prior + log_normal(table, table["v_x1"] - change, e_y * table["v_y1"], omega_2)


def log_normal(table, v_x2, v_y2, omega_2):
    given = ((v_x2, "v_x2", 0.3), (v_y2, "v_y2", 0.3), (omega_2, "omega_2", 10.0))
    return sum(-0.5 * np.sum(((made - table[name]) / sd) ** 2, axis=1) for made, name, sd in given)


@pytest.mark.parametrize(
    ("function", "log_density", "values"),
    [
        (superball, log_superball, {"e_y": 0.75, "e_t": 0.1}),
        (sliding, log_sliding, {"mu": 0.35, "e_y": 0.7, "keep": 0.8}),
    ],
)
def test_its_posterior_is_that_of_an_independent_sampler(function, log_density, values):
    table = measured(function, **values)
    fixed = {"velocity_sd": 0.3, "spin_sd": 10.0}
    fit = fitball.calibrate(table, fitball.model_from(function), fix=fixed, noise="tied", as_read=True, cores=1)
    draws = fit.draws()
    rng = np.random.default_rng(5)
    start = np.array([*values.values()]) * (1.0 + 0.02 * rng.standard_normal((32, len(values))))
    sampler = emcee.EnsembleSampler(32, len(values), lambda at: log_density(table, at), vectorize=True)
    sampler.random_state = np.random.RandomState(7).get_state()
    sampler.run_mcmc(start, 4000)
    other = sampler.get_chain(discard=500, flat=True)
    for k, name in enumerate(values):
        sd = other[:, k].std()
        assert abs(draws[name].mean() - other[:, k].mean()) < 0.2 * sd, name
        assert draws[name].std() == pytest.approx(sd, rel=0.2), name
    # A control: the same draws are far from a posterior of other data.
    moved = {**table, "v_y2": table["v_y2"] * 1.1}
    wrong = fitball.calibrate(moved, fitball.model_from(function), fix=fixed, noise="tied", as_read=True, cores=1)
    e_y = other[:, list(values).index("e_y")]
    assert abs(wrong.draws()["e_y"].mean() - e_y.mean()) > 2.0 * e_y.std()


def test_derivatives_are_complex_steps_only_where_these_agree_with_differences():
    def lying(v_x1, v_y1, omega_1, ball, e_y="uniform(0, 1)"):
        # Loses the imaginary part of one input: a complex step would give no derivative.
        return v_x1, np.real(e_y) * v_y1, omega_1

    stepped = {made.name: made.known.stepped for made in map(fitball.model_from, (superball, sliding, looped, lying))}
    assert stepped == {"superball": True, "sliding": False, "looped": True, "lying": False}
    given = fitball.impacts([10.0, 8.0], [9.0, 12.0], [100.0, -50.0])
    for function, values in ((superball, [[0.7, 0.2]]), (sliding, [[0.3, 0.7, 0.9]])):
        made = fitball.model_from(function)
        names = (*made.parameter_names, "ball_mass", "inertia_ratio")
        at = np.array([[*values[0], BALL.mass, BALL.inertia_ratio]])
        found, differences = made.jacobian(names, at, given), made.differences(names, at, given, names)
        np.testing.assert_allclose(found.parameters[:, :, :3], differences[:, :, :3, 4:], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(found.inputs[:, :, :3], differences[:, :, :3, :3], rtol=1e-6, atol=1e-6)
    # By hand: v_x2 falls by a/(1 + a) slip per unit of e_t.
    steps = fitball.model_from(superball).jacobian(("e_y", "e_t"), np.array([[0.7, 0.2]]), given)
    slip = given.v_x1 - BALL.radius * given.omega_1
    np.testing.assert_allclose(steps.parameters[0, :, 0, 1], -ROUNDNESS / (1.0 + ROUNDNESS) * slip, rtol=1e-12)


def test_at_a_bound_of_its_prior_the_differences_stay_within():
    def rooted(v_x1, v_y1, omega_1, ball, e_y="uniform(0, 1)"):
        return v_x1, np.abs(v_y1) * (1.0 - np.sqrt(1.0 - e_y)), omega_1

    made = fitball.model_from(rooted)
    at = np.array([[1.0], [0.0]])
    slopes = made.jacobian(("e_y",), at, fitball.impacts(10.0, 8.0)).parameters[:, 0, 1, 0]
    assert np.all(np.isfinite(slopes)) and slopes[1] == pytest.approx(4.0, rel=1e-4)


def faulty(body, arguments="e_y='uniform(0, 1)'"):
    """A function of its own file, so that its source can be read."""
    return f"import numpy as np\n\ndef f(v_x1, v_y1, omega_1, ball, {arguments}):\n    {body}\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (faulty("return v_x1, v_y1"), "returns a tuple of 2, expected three arrays"),
        (faulty("return v_x1, v_y1[:-1], omega_1"), r"returns v_y2 of shape \(\d+,\), .* one number for each of the"),
        (faulty("return v_x1, 0.5, omega_1"), r"returns v_y2 of shape \(\), "),
        (faulty("return v_x1, 1j * v_y1, omega_1"), "returns v_y2 of type complex128"),
        (faulty("return v_x1, v_y1 * np.nan, omega_1"), "not finite for every one of .* Impact 1 has v_x1 = "),
        (faulty("return v_x1, v_y1.mean() + 0 * v_y1, omega_1"), "each row must depend on itself alone"),
        (faulty("return v_x1, lost * v_y1, omega_1"), "fails at line 4 of faulty.py with NameError: name 'lost'"),
        (faulty("return (v_x1 if v_x1 > 9 else v_x1), v_y1, omega_1"), "use np.where instead of if"),
        (faulty("return v_x1, v_y1, omega_1", "e_y"), "parameter e_y has no prior: expected a text"),
        (faulty("return v_x1, v_y1, omega_1", "e_y='uniform(1)'"), "expected two finite numbers"),
        (faulty("return v_x1, v_y1, omega_1", "k_y='uniform(0, 1)'"), "with another meaning; rename it"),
        (faulty("return v_x1, v_y1, omega_1", "*rest"), "expected .v_x1, v_y1, omega_1, ball, and its parameters"),
        ("def f(v, e_y='uniform(0, 1)'):\n    return v, v, v\n", "the function takes .v, e_y., expected"),
        ("x = 1\n", "has no function 'f'"),
        ("x = 1\ny = 1 / 0\n", "line 2 of .* fails with ZeroDivisionError"),
        ("def f(:\n", "cannot be read as Python"),
    ],
)
def test_a_fault_of_a_function_is_said_in_words(tmp_path, text, words):
    (tmp_path / "faulty.py").write_text(text, encoding="utf-8")
    with pytest.raises((ModelError, ParameterError), match=words):
        fitball.calibrate("wang_zero_spin", f"{tmp_path / 'faulty.py'}:f", point_only=True)


def test_names_and_priors_that_cannot_be():
    with pytest.raises(ModelError, match="that of a model of fitball"):
        fitball.model_from(superball, name="grip-slip")
    with pytest.raises(ParameterError, match="takes no parameter 'e_z': did you mean"):
        fitball.model_from(superball, {"e_z": "uniform(0, 1)"})
    with pytest.raises(ModelError, match="expected a function written with def"):
        fitball.model_from(np.add)
    assert fitball.model_from(superball, {"e_t": "uniform(-1, 1)"}).specs["e_t"].lower == -1.0
    with pytest.raises(fitball.FitballError, match="unknown model 'nobody'"):
        fitball.calibrate("wang_zero_spin", "nobody")


def test_where_it_has_no_answer_the_density_is_zero():
    def narrow(v_x1, v_y1, omega_1, ball, e_y="uniform(0, 1)"):
        return v_x1, np.where(e_y > 0.72, np.nan, e_y * v_y1), omega_1

    found = fitball.model_from(narrow).evaluate(("e_y",), np.array([[0.8], [0.5]]), fitball.impacts(10.0, 8.0))
    assert found.status[:, 0].tolist() == [12, 0] and math.isnan(found.v_y2[0, 0]) and found.v_y2[1, 0] == 4.0
    with pytest.raises(ParameterError, match="gives a number that is not finite"):
        fitball.model_from(narrow).rebound({"e_y": 0.8}, fitball.impacts(10.0, 8.0))


def test_the_hash_is_of_the_source_and_of_what_it_uses(tmp_path):
    text = SUPERBALL.replace("(1 + e_t)", "share(e_t)") + "\n\nONE = 1\n\n\ndef share(e):\n    return ONE + e\n"

    def source(written):
        (tmp_path / "hashed.py").write_text(written, encoding="utf-8")
        return own_model_of(f"{tmp_path / 'hashed.py'}:superball").options["source"]

    first = source(text)
    assert source(text + "\n# A remark elsewhere.\n") == first
    changed = [text.replace("ONE = 1", "ONE = 2"), text.replace("ONE + e", "e + ONE"), text.replace("1 + a", "a + 1")]
    assert len({first, *map(source, changed)}) == 4
    # Names that only a function inside a function reads, or a comprehension.
    for inner in ("    return sum(ONE for _ in range(1)) + e\n", "    return (lambda: ONE)() + e\n"):
        nested = text.replace("    return ONE + e\n", inner)
        assert nested != text and source(nested) != source(nested.replace("ONE = 1", "ONE = 2"))


def own_model_of(text):
    from fitball.api.own_model import own_model

    return own_model(text)


@pytest.fixture
def saved(tmp_path):
    """A fit at the command line, of a process that has forgotten the function."""
    file = tmp_path / "mine.py"
    file.write_text(SUPERBALL, encoding="utf-8")
    folder = tmp_path / "fit"
    words = ["calibrate", "wang_zero_spin.csv", "--model", f"{file}:superball", "--cores", "1", "--max-steps", "300"]
    assert main([*words, "--quiet", "--no-figures", "--out", str(folder)]) in (0, 1)
    own._KNOWN.clear()
    own._LAST.clear()
    return file, folder


def test_a_saved_fit_names_its_function_and_never_runs_it(saved, capsys):
    file, folder = saved
    ran = file.with_name("mine.py.ran").read_text("utf-8")
    fit = fitball.load_fit(folder)
    assert fit.fitted.model_name == "superball" and set(fit.fitted.options) == {"source", "parameters"}
    assert len(fit.draws()) > 0 and "e_t" in fit.summary().index and "superball" in fit.report()
    assert len(fit.plot.corner().axes) > 0
    assert {"corner", "trace"} <= {*fit.plot} and not {"curves", "predictive", "residuals", "regimes"} & {*fit.plot}
    assert main(["export", str(folder), "--to", "json", "--out", "-"]) == 0
    exported = json.loads(capsys.readouterr().out)["parameters"]
    assert exported["e_t"]["role"] == "model"
    for words in (
        ["predict", str(folder), "--impact", "v=20, theta=30"],
        ["plan", str(folder), "--quiet"],
        ["export", str(folder), "--to", "lookup", "--out", "-"],
        ["plot", str(folder), "predictive"],
        ["repeat", str(folder)],
    ):
        assert main(words) == 2, words
        assert "which a saved fit names but does not contain: give it by --model FILE:NAME" in capsys.readouterr().err
    assert file.with_name("mine.py.ran").read_text("utf-8") == ran


def test_the_function_is_given_again_and_another_is_refused(saved, capsys):
    file, folder = saved
    given = ["--model", f"{file}:superball"]
    assert main(["predict", str(folder), "--impact", "v=20, theta=30, spin=0", "--json", *given]) == 0
    (row,) = json.loads(capsys.readouterr().out)["impacts"]
    e_y = fitball.load_fit(folder).parameters["e_y"].point
    assert row["outputs"]["v_y2"]["point"] == pytest.approx(10.0 * e_y, rel=1e-9) and row["regimes"] == {}
    assert main(["export", str(folder), "--to", "c", "--out", "-", *given]) == 2
    assert "is a Python function of your own, which this format cannot carry" in capsys.readouterr().err
    file.write_text(SUPERBALL.replace("e_y * v_y1", "0.9 * e_y * v_y1"), encoding="utf-8")
    for words in (
        ["predict", str(folder), "--impact", "v=20"],
        ["plan", str(folder)],
        ["export", str(folder), "--to", "json"],
    ):
        assert main([*words, *given]) == 2
        assert "Give the function as it was, or fit again" in capsys.readouterr().err
    # What this process knows now is not taken for the one that was fitted.
    own._KNOWN.clear()
    own._LAST.clear()
    own_model_of(f"{file}:superball")
    with pytest.raises(ModelError, match="Give the function as it was"):
        fitball.load_fit(folder).predict("v=20, theta=30")
    other = fitball.calibrate("wang_zero_spin", "grip-slip", point_only=True).save(folder.with_name("other"))
    with pytest.raises(ModelError, match="the fit is of model grip-slip, which fitball has"):
        fitball.load_fit(other, f"{file}:superball")


def test_compare_and_batch_send_it_to_other_processes(tmp_path):
    made = fitball.model_from(superball)
    compared = fitball.compare("wang_zero_spin", ["brody", made], quick=True, max_steps=100, cores=2)
    assert set(compared.names) == {"brody", "superball"} and compared["superball"].parameters["e_t"].point < 0.5
    tables = {"one": measured(superball, e_y=0.7, e_t=0.2), "two": measured(superball, e_y=0.6, e_t=0.2)}
    batch = fitball.calibrate_many(tables, out=tmp_path / "many", model=made, cores=2, point_only=True, as_read=True)
    assert not batch.failed and batch["two"].parameters["e_y"].point == pytest.approx(0.6, abs=0.03)


def test_a_fit_of_it_can_be_sent_and_read():
    fit = fitball.calibrate("wang_zero_spin", fitball.model_from(superball), point_only=True)
    again = pickle.loads(pickle.dumps(fit))
    assert again.predict("v=20, theta=30").equals(fit.predict("v=20, theta=30"))
