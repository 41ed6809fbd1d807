"""Populations from the draws of many tables, held against integrals of the hierarchy itself."""

from __future__ import annotations

import csv
import io
import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from scipy import integrate, stats

import fitball
from fitball.cli.main import main
from fitball.errors import FitballError
from fitball.inference.population.hyper import Before, TableDraws, covering_grid, drawn_new, log_likelihood, log_mass
from fitball.inference.population.levels import population
from fitball.inference.population.quantity import log_density, prior_of, quantity
from fitball.inference.problem.parameters import parse_prior
from fitball.report.batch import populations
from fitball.report.batch.document import write_results
from fitball.report.batch.rows import read_rows, row_of
from fitball.report.saved.fit_file import read_fit

WIDE = (-np.inf, np.inf)
# Interim prior of the tables of a made population, far from it: mean, sd.
INTERIM = (-1.0, 0.6)
SD = 0.3


def drawn(rng, measured, sd=SD, interim=INTERIM, count=400):
    """Draws of the normal posterior of a quantity that was `measured` with sd `sd` under a normal prior."""
    precision = 1.0 / sd**2 + 1.0 / interim[1] ** 2
    mean = (measured / sd**2 + interim[0] / interim[1] ** 2) / precision
    return mean + rng.standard_normal(count) / np.sqrt(precision)


def tables_of(rng, measured, interim=INTERIM, divided=None, count=400):
    """Tables of the same; `divided` is the interim prior that is divided out."""
    prior = stats.norm(*(divided or interim)).logpdf
    return [TableDraws.drawn(str(k), drawn(rng, y, SD, interim, count), prior) for k, y in enumerate(measured)]


def exact(measured, sd=SD):
    """Mean and sd of centre and spread, and mean and sd of the first table, by integrals on a fine grid."""
    m, tau = np.meshgrid(np.linspace(-4.0, 5.0, 700), np.linspace(0.0, 5.0, 1500), indexing="ij")
    variance = tau**2 + sd**2
    log = stats.norm.logpdf(m, 0.0, 2.0) - 0.5 * tau**2
    for y in measured:
        log += -0.5 * np.log(variance) - 0.5 * (y - m) ** 2 / variance
    mass = np.exp(log - log.max())
    mass /= mass.sum()
    first = (measured[0] * tau**2 + m * sd**2) / variance
    around = tau**2 * sd**2 / variance

    def told(values, own=0.0):
        mean = np.sum(mass * values)
        return mean, np.sqrt(np.sum(mass * (values**2 + own)) - mean**2)

    def ends(values, shares):
        return np.interp((0.5, 0.025, 0.975), np.cumsum(shares), values)

    return ends(m[:, 0], mass.sum(1)), ends(tau[0], mass.sum(0)), told(first, around)


def before(log_centre, spread, ends=WIDE):
    """What is known of a population whose spread has a half-normal prior."""
    prior = parse_prior("spread", f"half-normal({spread})", 0.0, np.inf)
    return Before(log_centre, prior, prior, ends)


BEFORE = before(stats.norm(0.0, 2.0).logpdf, 1.0)


@pytest.mark.parametrize(("count", "tau"), [(3, 0.5), (12, 0.6), (25, 0.0)])
def test_centre_spread_and_each_table_are_those_of_the_hierarchy(count, tau):
    """Fails where interim priors are not divided out: they lie far off the population."""
    rng = np.random.default_rng(count)
    measured = 1.0 + np.hypot(tau, SD) * rng.standard_normal(count)
    found = population(tables_of(rng, measured, count=1500), BEFORE)
    centre, spread, (mean, sd) = exact(measured)
    for known, ends in ((found.centre, centre), (found.spread, spread)):
        near = 5.0 * known.error + 0.01 * (ends[2] - ends[1])
        assert [known.median, known.low, known.high] == pytest.approx(ends, abs=near)
        assert known.error < 0.05 * (ends[2] - ends[1])
    assert found.tables[0].known.median == pytest.approx(mean, abs=0.35 * sd)
    assert found.tables[0].sd == pytest.approx(sd, rel=0.15)


def test_with_the_wrong_interim_prior_the_population_is_another():
    """The control: what is not divided out, or divided out wrongly, shows."""
    rng = np.random.default_rng(1)
    measured = 1.0 + np.hypot(0.4, SD) * rng.standard_normal(25)
    right = population(tables_of(rng, measured), BEFORE)
    for wrong in ((0.0, 1e3), (-1.0, 1.2)):
        found = population(tables_of(rng, measured, divided=wrong), BEFORE)
        assert abs(found.centre.median - right.centre.median) > 10.0 * right.centre.error
        assert found.centre.high < right.centre.median


def test_the_error_of_few_draws_is_as_stated():
    rng = np.random.default_rng(2)
    measured = 1.0 + np.hypot(0.3, SD) * rng.standard_normal(8)
    found = [population(tables_of(rng, measured, count=200), BEFORE) for _ in range(16)]
    for name in ("centre", "spread"):
        scatter = np.std([getattr(one, name).median for one in found])
        assert 0.6 < np.mean([getattr(one, name).error for one in found]) / scatter < 1.7
    ends = exact(measured)[1]
    assert np.mean([one.spread.median for one in found]) == pytest.approx(ends[0], abs=0.05 * (ends[2] - ends[1]))


def test_few_draws_do_not_bias_the_likelihood():
    """The mean over many sets of few draws is the logarithm of the integral, which that of their means lies below."""
    rng = np.random.default_rng(4)
    points = np.array([[1.4, 0.3], [1.4, 0.02]])
    drawn_again = [log_likelihood(tables_of(rng, [1.0], (0.0, 5.0), count=30)[0], points) for _ in range(1500)]
    exact_ratio = np.subtract(*stats.norm.logpdf(1.0, 1.4, np.hypot(points[:, 1], SD)))
    # Without the correction the mean is 0.088 off; that of 1,500 sets has a standard error of 0.011.
    assert np.mean(np.subtract(*np.transpose(drawn_again))) == pytest.approx(exact_ratio, abs=0.045)


@pytest.mark.parametrize("interim", [(0.5, 0.2), (-1.0, 0.6), (1.0, 5.0)])
def test_a_normal_prior_is_divided_out_exactly(interim):
    """Draws at the quantiles of a normal posterior leave the normal likelihood, however narrow the prior was."""
    precision = 1.0 / SD**2 + 1.0 / interim[1] ** 2
    posterior = stats.norm((1.0 / SD**2 + interim[0] / interim[1] ** 2) / precision, precision**-0.5)
    table = TableDraws.drawn("t", posterior.ppf((np.arange(20000) + 0.5) / 20000), stats.norm(*interim).logpdf)
    points = np.array([[1.0, 0.05], [0.8, 0.02], [0.9, 0.1], [1.2, 0.05]])
    expected = stats.norm.logpdf(1.0, points[:, 0], np.hypot(points[:, 1], SD))
    assert np.diff(log_likelihood(table, points)) == pytest.approx(np.diff(expected), abs=0.02)


def test_a_second_mode_does_not_blur_the_first():
    """Its draws make the sd fifteen times that of the first; under a flat prior the likelihood is a closed form."""
    shares, modes = np.array([0.9, 0.1]), (stats.norm(0.0, 0.03), stats.norm(1.5, 0.3))
    draws = [
        mode.ppf((np.arange(400 * share) + 0.5) / (400 * share)) for mode, share in zip(modes, shares, strict=True)
    ]
    table = TableDraws.drawn("t", np.concatenate(draws), np.zeros_like)
    points = np.array([[0.0, 0.0], [0.05, 0.0], [0.0, 0.05], [0.1, 0.05], [1.5, 0.1]])
    each = [stats.norm.pdf(points[:, 0], mode.mean(), np.hypot(points[:, 1], mode.std())) for mode in modes]
    assert np.diff(log_likelihood(table, points)) == pytest.approx(np.diff(np.log(shares @ each)), abs=0.25)


def test_draws_that_repeat_each_other_count_for_less():
    """Twice the same draws, known to be worth half as many, are worth what they were."""
    rng = np.random.default_rng(9)
    once = tables_of(rng, [0.8, 1.0, 1.3, 1.1])
    twice = [
        replace(table, places=np.tile(table.places, 2), log_interim=np.tile(table.log_interim, 2), efficiency=0.5)
        for table in once
    ]
    first, second = population(once, BEFORE), population(twice, BEFORE)
    for name in ("centre", "spread"):
        one, other = getattr(first, name), getattr(second, name)
        assert [other.median, other.error] == pytest.approx([one.median, one.error], rel=1e-3)
    assert np.diff(log_likelihood(twice[0], np.array([[1.4, 0.3], [1.4, 0.02]]))) == pytest.approx(
        np.diff(log_likelihood(once[0], np.array([[1.4, 0.3], [1.4, 0.02]]))), rel=0.01
    )


def test_a_population_at_a_bound_is_that_of_a_truncated_distribution():
    """Fails where the share of the population beyond the bound is not divided out."""
    rng, sd, ends = np.random.default_rng(5), 0.1, (-3.0, 1.0)
    true = stats.truncnorm(-np.inf, 0.0, 1.0, 0.3).rvs(30, random_state=rng)
    measured = true + sd * rng.standard_normal(30)
    cut = (-3.0 - measured) / sd, (1.0 - measured) / sd
    flat = stats.uniform(ends[0], ends[1] - ends[0]).logpdf
    tables = [
        TableDraws.drawn(str(k), stats.truncnorm(a, b, y, sd).rvs(1000, random_state=rng), flat)
        for k, (a, b, y) in enumerate(zip(*cut, measured, strict=True))
    ]
    found = population(tables, before(flat, 1.0, ends))
    m, tau = np.meshgrid(np.linspace(-0.5, 1.0, 300, endpoint=False), np.linspace(0.02, 1.5, 400), indexing="ij")
    log = -0.5 * tau**2 - len(measured) * stats.norm.logcdf(1.0, m, tau)
    for y in measured:
        wide = np.hypot(tau, sd)
        log += stats.norm.logpdf(y, m, wide) + stats.norm.logcdf(
            1.0, (y * tau**2 + m * sd**2) / wide**2, tau * sd / wide
        )
    mass = np.exp(log - log.max())
    for known, side, shares in ((found.centre, m[:, 0], mass.sum(1)), (found.spread, tau[0], mass.sum(0))):
        low, middle, high = np.interp((0.025, 0.5, 0.975), np.cumsum(shares) / shares.sum(), side)
        assert known.median == pytest.approx(middle, abs=0.1 * (high - low))
        assert [known.low, known.high] == pytest.approx([low, high], abs=0.15 * (high - low))


def test_a_new_table_lies_within_the_bounds_of_its_population():
    points, law = np.tile([0.1, 0.3], (4000, 1)), stats.truncnorm(-1.0 / 3.0, 4.0 / 3.0, 0.1, 0.3)
    drawn = drawn_new(points, (0.0, 0.5), np.random.default_rng(1))
    assert stats.kstest(drawn, law.cdf).pvalue > 1e-3


def test_tables_that_tell_nothing_say_nothing():
    """Not even a little of their prior, however many they are."""
    rng = np.random.default_rng(7)
    points = np.array([[0.4, 0.3], [1.0, 0.3], [-0.4, 0.3]])
    prior = stats.norm(0.4, 0.6)
    silent = TableDraws.drawn("", prior.ppf((np.arange(4000) + 0.5) / 4000), prior.logpdf)
    assert np.ptp(log_likelihood(silent, points)) < 0.01
    told = tables_of(rng, 1.0 + 0.3 * rng.standard_normal(6))
    alone, together = (population([*told, *[silent] * k], before(BEFORE.log_centre, 0.5)) for k in (0, 40))
    assert together.centre.median == pytest.approx(
        alone.centre.median, abs=0.1 * (alone.centre.high - alone.centre.low)
    )


def test_where_tables_are_alike_each_is_known_as_well_as_all():
    """No wider than that for standing for its neighbourhood."""
    rng = np.random.default_rng(6)
    tables = tables_of(rng, 1.0 + SD * rng.standard_normal(25), (0.0, 5.0), count=2000)
    found = population(tables, before(BEFORE.log_centre, 1e-3))
    known = SD / np.sqrt(25)
    assert np.median([table.sd for table in found.tables]) == pytest.approx(known, rel=0.12)
    assert found.centre.high - found.centre.low == pytest.approx(3.92 * known, rel=0.1)


def test_a_table_that_none_of_its_draws_lets_into_the_population_is_doubted():
    rng = np.random.default_rng(3)
    tables = tables_of(rng, 1.0 + 0.3 * rng.standard_normal(20), (0.0, 5.0))
    far = TableDraws.drawn("far", 2.4 + 0.25 * rng.standard_normal(400), stats.norm(0.0, 5.0).logpdf)
    found = population([*tables, far], before(stats.norm(0.0, 2.0).logpdf, 0.02))
    assert "far" in found.doubtful
    assert len(found.doubtful) < 6


PRIORS = {
    "mu": ("lognormal(0.5, 0.2)", 0.62, 0.1), "cor_10": ("normal(0.9, 0.1)", 0.93, 0.06),
    "mass_ratio": ("uniform(0.3, 1)", 0.93, 0.05), "k_y": ("loguniform(1e4, 4e4)", 3.5e4, 0.3),
}  # fmt: skip


@pytest.mark.parametrize("name", PRIORS)
def test_the_likelihood_of_a_population_is_the_integral_over_it(name):
    """For each kind of prior, at its bounds too: the mean over draws against a quadrature of likelihood times
    population, the population between its ends alone.
    """
    asked = quantity(name)
    prior, (text, measured, sd) = prior_of(asked.parts[0], PRIORS[name][0]), PRIORS[name]
    assert asked.log == (name in ("mu", "k_y"))
    at = np.log(measured) if asked.log else measured
    low, high = asked.ends({name: prior})
    grid = np.linspace(max(low, at - 8.0 * sd), min(high, at + 8.0 * sd), 20001)
    like = stats.norm.pdf(grid, at, sd)
    weight = np.cumsum(like * np.exp(asked.log_prior({name: prior})(grid)))
    draws = np.interp((np.arange(20000) + 0.5) / 20000, weight / weight[-1], grid)
    table = TableDraws.drawn("t", draws, asked.log_prior({name: prior}))
    points = np.array([[at, 2.0 * sd], [at - sd, sd], [at + 0.5 * sd, 0.5 * sd]])
    found = log_likelihood(table, points) - log_mass(points, (low, high))
    expected = []
    for m, tau in points:
        whole = stats.norm.cdf(high, m, tau) - stats.norm.cdf(low, m, tau)
        expected.append(np.log(integrate.trapezoid(like * stats.norm.pdf(grid, m, tau), grid) / whole))
    assert np.diff(found) == pytest.approx(np.diff(expected), abs=0.04), text


def test_a_prior_in_the_other_coordinate_is_the_same_density():
    for name, text in (("mu", "lognormal(0.6, 0.4)"), ("mass_ratio", "uniform(0.3, 1)")):
        prior = prior_of(quantity(name).parts[0], text)
        values = prior.quantile(np.linspace(0.01, 0.99, 4001))
        for log in (False, True):
            places = np.log(values) if log else values
            inside = integrate.trapezoid(np.exp(log_density(prior, places, log)), places)
            assert inside == pytest.approx(0.98, abs=1e-3)


def test_the_prior_of_a_ratio_is_that_of_its_parts():
    """Two lognormal parts in closed form, else by a histogram of draws; a fixed part moves the other's."""
    ratio = quantity("k_theta/k_y")
    priors = {part.name: prior_of(part, part.prior) for part in ratio.parts}
    places = np.linspace(-11.0, -2.0, 9)
    closed = stats.norm(np.log(30.0 / 2e4), np.hypot(1.5, 1.0)).logpdf(places)
    assert ratio.log_prior(priors)(places) == pytest.approx(closed, abs=0.02)
    fixed = ratio.log_prior({**priors, "k_y": 2e4})(places)
    assert fixed == pytest.approx(stats.norm(np.log(30.0 / 2e4), 1.5).logpdf(places))
    fixed = ratio.log_prior({**priors, "k_theta": 30.0})(places)
    assert fixed == pytest.approx(stats.norm(np.log(30.0 / 2e4), 1.0).logpdf(places))
    mixed = quantity("mass_ratio/mu")
    priors = {part.name: prior_of(part, part.prior) for part in mixed.parts}
    rng = np.random.default_rng(5)
    drawn = np.log(priors["mass_ratio"].draw(rng, 200000) / priors["mu"].draw(rng, 200000))
    counts, edges = np.histogram(drawn, np.linspace(-1.0, 1.5, 26), density=False)
    density = np.exp(mixed.log_prior(priors)((edges[1:] + edges[:-1]) / 2.0)) * 0.1 * 200000
    assert np.all(np.abs(counts - density) < 6.0 * np.sqrt(density) + 0.01 * density)


def test_a_narrow_peak_in_a_wide_box_is_found():
    def log(places, _every):
        return -0.5 * np.sum(((places - [0.123, 4.56]) / [1e-4, 1e-3]) ** 2, axis=1)

    grid = covering_grid(log, (-10.0, 0.0), (10.0, 9.0))
    mean = grid.shares.ravel() @ grid.points
    assert mean == pytest.approx([0.123, 4.56], abs=1e-6)
    assert np.sqrt(grid.shares.ravel() @ (grid.points - mean) ** 2) == pytest.approx([1e-4, 1e-3], rel=1e-3)


@pytest.mark.parametrize(
    ("name", "said"),
    [("friction", "no model has a parameter 'friction'"), ("eps_10/k_y", "eps_10 may be zero"),
     ("mu/mu", "ratio of two"), ("k_theta/k_y/mu", "ratio of two")],
)  # fmt: skip
def test_what_is_no_quantity_is_refused(name, said):
    with pytest.raises(FitballError, match=said):
        quantity(name)


@pytest.fixture(scope="module")
def season(small_fit, short_fit, tmp_path_factory):
    """The folder of a batch of four tables alike, as it was left; without its figure from there on."""
    folder = tmp_path_factory.mktemp("season") / "batch"
    names = ("a", "b", "c", "d")
    for name in names:
        (folder / name).mkdir(parents=True)
        shutil.copy(small_fit / "fit.json", folder / name)
    write_results([row_of(name, short_fit, short_fit.problem) for name in names], folder)
    assert (folder / "parameters.png").stat().st_size > 10_000
    picture = (folder / "parameters.png").read_bytes()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fitball.report.batch.figure.batch_figure", lambda *_given, **_others: None)
        patch.setattr("fitball.report.figures.canvas.save_figure", lambda *_given: picture)
        yield folder


def test_the_rows_of_a_batch_are_read_back_as_they_were(season, short_fit):
    row = row_of("a", short_fit, short_fit.problem)
    assert read_rows((season / "batch.csv").read_text("utf-8"))[0] == row
    assert list(fitball.load_batch(season)) == ["a", "b", "c", "d"]


def test_rows_and_draws_that_were_changed_are_not_believed(season, tmp_path):
    shutil.copytree(season, tmp_path / "batch")
    text = (season / "batch.csv").read_text("utf-8")
    value = next(csv.DictReader(io.StringIO(text)))["mu"]
    (tmp_path / "batch" / "batch.csv").write_text(text.replace(f",{value},", ",99.0,", 1), encoding="utf-8")
    with pytest.raises(FitballError, match=f"table 'a': mu is 99.0, but its fit.json says {value}"):
        fitball.load_batch(tmp_path / "batch").population("mu")
    # A draw on its bound of zero has no logarithm.
    (tmp_path / "batch" / "batch.csv").write_text(text, encoding="utf-8")
    content = json.loads((season / "b" / "fit.json").read_text("utf-8"))
    content["fitted"]["draws"][3][content["fitted"]["names"].index("mu")] = 0.0
    (tmp_path / "batch" / "b" / "fit.json").write_text(json.dumps(content), encoding="utf-8")
    of_logarithms = populations._Gathered(replace(quantity("mu"), log=True))
    with pytest.raises(FitballError, match=r"b/fit\.json: .*fitted\.draws of mu: one without a logarithm"):
        populations._gather(of_logarithms, "b", read_fit(tmp_path / "batch" / "b"))


def test_a_batch_that_lies_there_tells_its_population(season, capsys):
    """In Python and on the command line the same, without a fit; files have those that tables determine besides."""
    mu = fitball.load_batch(season).population("mu")["mu"]
    middle, low, high = mu.ends(mu.population.centre)
    assert low < mu.quantity.value(mu.own["a"].median) < high
    code = main(["population", str(season), "--parameters", "spin_sd/velocity_sd", "--json"])
    told = json.loads(capsys.readouterr().out)["quantities"]
    assert code == (1 if any(one["not_trusted"] for one in told.values()) else 0)
    written = json.loads((season / "population.json").read_text("utf-8"))["quantities"]
    assert told == {"spin_sd/velocity_sd": written["spin_sd/velocity_sd"]}
    assert written["mu"]["centre"]["median"] == middle
    assert told["spin_sd/velocity_sd"]["unit"] == "(rad/s)/(m/s)"
    table = (season / "population.csv").read_text("utf-8").splitlines()
    assert sum(line.startswith("mu,") for line in table) == 4 + 3
    page = (season / "batch.html").read_text("utf-8")
    assert "given all" in page and "spin_sd/velocity_sd" in page
    main(["population", str(season)])
    assert "spin_sd/velocity_sd" not in capsys.readouterr().out
    main(["population", str(season), "--parameters", "mu"])
    shown = capsys.readouterr().out
    assert shown.startswith("mu over 4 tables\n") and "cor_10" not in shown


def test_a_population_is_one_object_in_the_unit_of_its_parameter(season):
    """Values, spread and levels by hand from the population in its logarithm."""
    over = {"a": "clay", "b": "clay", "c": "hard", "d": "hard"}
    found = fitball.load_batch(season).population("mu", over=over)
    assert len(repr(found)) < 100 and repr(found).startswith("<Populations: mu 0.")
    own = found["mu"].population
    frame = found.to_frame()
    values = frame.set_index(["kind", "level", "table"])[["median", "q025", "q975"]]
    ends = np.exp([own.levels[1].known.median, own.levels[1].known.low, own.levels[1].known.high])
    assert values.loc[("level", "hard", "")].to_numpy() == pytest.approx(ends)
    s = own.spread.high
    drawn = np.exp(own.centre.median + s * stats.norm.ppf((np.arange(200_000) + 0.5) / 200_000))
    spread = frame[frame["kind"] == "spread"]["q975"].item()
    assert spread == pytest.approx(drawn.std(), rel=0.01 * np.exp(s))
    alone = frame[frame["table"] == "c"]
    assert alone["alone_median"].item() == pytest.approx(np.exp(found["mu"].own["c"].median))
    assert alone["level"].item() == "hard"
    report = found.report()
    assert "mu over 4 tables, by level" in report and "clay" in report and "cor_10" not in report
    (panel,) = found.plot().axes
    names = [text.get_text() for text in panel.get_yticklabels()]
    assert names == ["a", "b", "c", "d", "level clay", "level hard", "mean", "new table"]
    bars = [path.get_segments()[0] for path in panel.collections]
    assert any(np.allclose(bar[:, 0], ends[1:]) for bar in bars)
    with pytest.raises(KeyError, match="mi: known: mu"):
        found["mi"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--parameters", "friction"], "no model has"), (["--parameters", "k_y"], "0 tables have draws"),
        (["nowhere"], "no such file"),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_words(season, capsys, words, said):
    assert main(["population", *([str(season)] if words[0] == "--parameters" else []), *words]) == 2
    assert said in capsys.readouterr().err
