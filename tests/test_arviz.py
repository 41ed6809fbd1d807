"""Draws and data in the layout of ArviZ: what its groups hold, and that the installed ArviZ takes them."""

import shutil
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from arviz_stats.base import array_stats
from scipy.stats import norm

import fitball
from fitball.cli.main import main
from fitball.errors import ParameterError
from fitball.exports import arviz_file
from fitball.inference.comparison.left_out import leave_one_out
from fitball.inference.effort import Effort

GROUPS = {
    "posterior", "sample_stats", "log_likelihood", "log_prior", "posterior_predictive", "prior", "prior_predictive",
    "observed_data", "constant_data",
}  # fmt: skip


def drawn(tree, names):
    """Draws (chains * draws, names)."""
    return np.stack([tree["posterior"][name].to_numpy().ravel() for name in names], axis=1)


@pytest.fixture(scope="module")
def timed_fit():
    """A short fit of the default model, whose scene states a contact time."""
    return fitball.calibrate("wang_zero_spin.csv", seed=4, cores=1, max_steps=100)


@pytest.fixture(scope="module")
def gappy_fit():
    """A short fit of a table that lacks some spins."""
    table = pd.read_csv(fitball.load_table("wang_all").source)
    table.columns = [name.strip() for name in table.columns]
    spin = next(name for name in table if name.startswith("omega_2"))
    table.loc[[2, 5, 11], spin] = np.nan
    return fitball.calibrate(table, model="grip-slip", seed=4, cores=1, max_steps=100)


@pytest.fixture(scope="module")
def of_batch(tmp_path_factory):
    """The small fit of a batch: without its file of draws."""
    out = tmp_path_factory.mktemp("batch") / "out"
    fitball.calibrate_many(["wang_zero_spin"], "grip-slip", out=out, seed=4, cores=1, max_steps=100)
    return fitball.load_fit(out / "wang_zero_spin")


def test_groups_say_what_the_densities_are(short_fit):
    tree = short_fit.to_datatree(draws=50)
    problem = short_fit.problem
    assert set(tree.children) == GROUPS and tree.attrs["notes"] == ""
    assert tree["posterior"].sizes == {"chain": 4, "draw": 50}
    draws = {name: tree["posterior"][name].to_numpy() for name in problem.free_names}
    for chain, draw in ((0, 3), (3, 49)):
        values = {name: float(column[chain, draw]) for name, column in draws.items()}
        rebound = problem.model.rebound({name: values[name] for name in problem.model_names}, problem.impacts)
        for item, noise in zip(problem.table.measurements, ("velocity_sd", "velocity_sd", "spin_sd"), strict=True):
            by_hand = norm.logpdf(item.values, getattr(rebound, item.name), values[noise])
            told = tree["log_likelihood"][item.name].to_numpy()[chain, draw]
            np.testing.assert_allclose(told, by_hand, rtol=1e-10, atol=1e-10)
    whole = short_fit.to_datatree()
    made_up = whole["posterior_predictive"]["v_x2"]
    band = short_fit.predictive.observables[0]
    low, high = made_up.quantile([0.025, 0.975], dim=("chain", "draw")).to_numpy()
    np.testing.assert_allclose(low, band.data_q025, atol=0.15)
    np.testing.assert_allclose(high, band.data_q975, atol=0.15)
    assert made_up.attrs["units"] == "m/s" and list(made_up["impact"].to_numpy()) == list(problem.table.ids)
    # What was expected before the table is wider.
    before = whole["prior_predictive"]["v_x2"].quantile([0.025, 0.975], dim=("chain", "draw")).to_numpy()
    assert (before[1] - before[0] > high - low).all()
    assert whole.identical(short_fit.to_datatree())
    for draws in (0, 10**6):
        with pytest.raises(ParameterError, match="of each chain"):
            short_fit.to_datatree(draws=draws)
    with pytest.raises(ParameterError, match="unit='row': expected 'measurement' or 'impact'"):
        short_fit.to_datatree(unit="row")


@pytest.mark.parametrize("name", ["short_fit", "timed_fit", "gappy_fit"])
def test_prior_and_likelihood_add_up_to_the_posterior(name, request):
    """But for a constant: `lp` is the density of logarithms where the prior is that of a logarithm."""
    fit = request.getfixturevalue(name)
    tree = fit.to_datatree(draws=80)
    free = fit.problem.free
    turned = sum(
        np.log(tree["posterior"][item.name].to_numpy()) for item in free if item.prior.log
    )  # fmt: skip
    prior = sum(column.to_numpy() for column in tree["log_prior"].data_vars.values())
    likelihood = sum(
        column.sum(set(column.dims) - {"chain", "draw"}).to_numpy()
        for column in tree["log_likelihood"].data_vars.values()
    )
    rest = tree["sample_stats"]["lp"].to_numpy() - turned - prior - likelihood
    np.testing.assert_allclose(rest, rest.flat[0], rtol=0.0, atol=1e-9)
    assert ("scene_contact_time" in tree["log_prior"]) == (name == "timed_fit")
    by_impact = fit.to_datatree(draws=80, unit="impact")["log_likelihood"]
    (column,) = by_impact.data_vars.values()
    np.testing.assert_allclose(column.sum("impact").to_numpy(), likelihood, rtol=1e-12)


def test_priors_are_densities_of_the_values(timed_fit):
    """Each integrates to one over the values that `posterior` holds, not over their logarithms."""
    fit = timed_fit
    problem, values, scores = fit.problem, fit.posterior.values[:1, :1], fit.posterior.log_posterior[:1, :1]
    for k, parameter in enumerate(problem.free):
        low, high = parameter.prior.quantile(np.array([0.0005, 0.9995]))
        grid = np.linspace(low, high, 20_001)
        rows = np.repeat(values[0, :, :1], grid.size, axis=1)
        rows[0, :, k] = grid
        made = arviz_file._Made(fit, replace(problem, contact_time=None), fit.posterior, rows, scores)
        density = np.exp(made.log_prior()[parameter.name])
        assert np.trapezoid(density, grid) == pytest.approx(0.999, abs=0.003), parameter.name


def test_columns_with_gaps_have_impacts_of_their_own(gappy_fit):
    tree = gappy_fit.to_datatree(draws=20)
    for group in ("log_likelihood", "posterior_predictive", "prior_predictive", "observed_data"):
        sizes = tree[group].to_dataset().sizes
        assert (sizes["impact"], sizes["omega_2_impact"]) == (21, 18), group
        assert all(np.isfinite(column).all() for column in tree[group].data_vars.values()), group
    seen = tree["observed_data"]["omega_2"]
    ids = gappy_fit.problem.table.ids
    assert list(seen["omega_2_impact"].to_numpy()) == [ids[k] for k in range(21) if k not in (2, 5, 11)]


def test_the_small_fit_of_a_batch_gives_what_it_has(of_batch, tmp_path):
    tree = of_batch.to_datatree()
    assert set(tree.children) == GROUPS
    assert tree["posterior"].sizes == {"chain": 1, "draw": 400}
    assert "posterior.nc is missing: 400 draws of fit.json are one chain" in tree.attrs["notes"]
    problem = of_batch.problem
    np.testing.assert_array_equal(
        drawn(tree, problem.free_names),
        of_batch.fitted.draws[:, [of_batch.fitted.names.index(name) for name in problem.free_names]],
    )
    assert np.isfinite(tree["sample_stats"]["lp"]).all()
    assert tree.identical(of_batch.to_datatree())
    assert of_batch.to_datatree(draws=7)["posterior"].sizes["draw"] == 7
    with pytest.raises(ParameterError, match="expected 1 to 400 of each chain"):
        of_batch.to_datatree(draws=401)
    # The same groups of the whole fit, whose prior draws are other ones of the same priors.
    known = tree["prior"]["mu"].to_numpy()
    assert known.std() == pytest.approx(
        of_batch.problem.free[0].prior.draw(np.random.default_rng(1), 4000).std(), rel=0.2
    )
    place = tmp_path / "small.nc"
    assert main(["export", str(of_batch.place.parent), "--to", "netcdf", "--out", str(place)]) == 0
    with xr.open_datatree(place, engine="h5netcdf") as read:
        assert set(read.children) == GROUPS


def test_without_the_run_there_are_draws_and_data(of_batch, tmp_path):
    for name in ("fit.json", "data.nc"):
        shutil.copy(of_batch.place.with_name(name), tmp_path)
    tree = fitball.load_fit(tmp_path).to_datatree()
    assert set(tree.children) == {"posterior", "observed_data", "constant_data"}
    assert "run.toml is missing: there are no densities and no predictions" in tree.attrs["notes"]
    (tmp_path / "data.nc").unlink()
    tree = fitball.load_fit(tmp_path).to_datatree()
    assert set(tree.children) == {"posterior"} and "data.nc and " in tree.attrs["notes"]


def test_arviz_statistics_are_near_ours(grip_slip_fit):
    """Those of four chains are near ours of all walkers."""
    tree = grip_slip_fit.to_datatree()
    problem, posterior = grip_slip_fit.problem, grip_slip_fit.posterior
    table = grip_slip_fit.summary()
    for name in problem.free_names:
        chains = tree["posterior"][name].to_numpy()
        assert float(array_stats.rhat(chains, chain_axis=0, draw_axis=1)) < 1.03
        assert float(array_stats.ess(chains, chain_axis=0, draw_axis=1)) > 400
        # A thousand effective draws know a mean to 0.03 sd.
        mean = posterior.draws[:, posterior.names.index(name)].mean()
        assert chains.mean() == pytest.approx(mean, abs=0.15 * table.loc[name, "sd"])


@pytest.mark.skipif(not hasattr(array_stats, "loo"), reason="this arviz-stats has no leave-one-out score of arrays")
def test_arviz_leaves_out_one_impact_as_we_do(grip_slip_fit):
    problem, posterior = grip_slip_fit.problem, grip_slip_fit.posterior
    told = grip_slip_fit.to_datatree(unit="impact")["log_likelihood"]["impact_log_likelihood"].to_numpy()
    settings = Effort(cores=1).settings(problem)
    columns = [item.name for item in problem.observables]
    ours = leave_one_out(problem, grip_slip_fit, posterior, columns, settings, exact=False)
    sure = ours.pareto_k < 0.6
    assert np.count_nonzero(sure) > 15
    elpd = [array_stats.loo(told[..., k], chain_axis=0, draw_axis=1)[0] for k in np.flatnonzero(sure)]
    np.testing.assert_allclose(elpd, ours.elpd[sure], atol=0.15)


@pytest.fixture(scope="module")
def az():
    """The installed ArviZ."""
    return pytest.importorskip("arviz")


def test_the_installed_arviz_takes_it(az, grip_slip_fit, of_batch):
    """Its statistics by their plain call; with another major version these are the calls of that version."""
    new = int(az.__version__.split(".")[0]) >= 1
    whole = grip_slip_fit.to_inferencedata(unit="impact")
    assert isinstance(whole, xr.DataTree if new else az.InferenceData)
    loo = az.loo(whole, pointwise=True)
    ours = leave_one_out(
        grip_slip_fit.problem, grip_slip_fit, grip_slip_fit.posterior,
        [item.name for item in grip_slip_fit.problem.observables], Effort(cores=1).settings(grip_slip_fit.problem),
        exact=False,
    )  # fmt: skip
    assert float(loo.elpd if new else loo.elpd_loo) == pytest.approx(float(ours.elpd.sum()), abs=2.0)
    assert len(az.compare({"one": whole, "other": whole})) == 2
    for fit in (grip_slip_fit, of_batch):
        data = fit.to_inferencedata()
        assert np.isfinite(az.summary(data)["mean"].astype(float)).all()
        if new:
            pit = az.loo_pit(data)["v_x2"].to_numpy()
            sense = az.psense(data, group="prior")["mu"]
        else:
            pit = np.asarray(az.loo_pit(data, y="v_x2"))
            sense = az.psens(data, component="prior")["mu"]
        assert ((pit >= 0.0) & (pit <= 1.0)).all() and pit.std() > 0.1
        assert 0.0 <= float(sense) < 1.0
