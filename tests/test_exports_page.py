"""The page with sliders, run by node as by a browser; ArviZ's groups, held against densities of the
fit.
"""

import html
import json
import math
import re
import shutil
import subprocess

import numpy as np
import pytest
import xarray
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.data.scene import Scene, ValueWithSd
from fitball.exports import parameter_set
from fitball.inference.density import log_posterior
from fitball.inference.sampling.convergence import Mixing
from fitball.saved.arrays import as_chains

SCRIPT = "</script><script>alert(1)</script>"
LABELS = ("clay", SCRIPT, '"><img src=x onerror=alert(1)>')
# As much of a browser as the page asks for.
BROWSER = """
class Node {
    constructor(id) {
        Object.assign(this, { id, value: "", children: [], heard: {}, rows: [], cells: [] });
    }
    get firstChild() { return this.children[0]; }
    addEventListener(name, call) { this.heard[name] = call; }
    setAttribute(name, value) { this[name] = value; }
    appendChild(node) { this.children.push(node); return node; }
    replaceChildren(...nodes) { this.children = nodes; this.rows = []; }
    insertRow() { this.rows.push(new Node()); return this.rows.at(-1); }
    insertCell() { this.cells.push(new Node()); return this.cells.at(-1); }
    move(value) { this.value = value; this.heard[this.id === "level" ? "change" : "input"](); }
}
const nodes = {};
const document = {
    getElementById: id => PAGE.includes(id) ? nodes[id] ??= new Node(id) : null,
    createElementNS: () => new Node(), createElement: () => new Node(),
};
const addEventListener = () => {};
"""


class Page:
    """What a browser finds: scripts, ids, texts of options."""

    def __init__(self, exported):
        (self.text,) = exported.contents.values()
        self.scripts = re.findall("(?s)<script>(.*?)</script>", self.text)
        self.ids = re.findall('id="([^"]*)"', self.text)
        options = re.findall("<option[^>]*>(.*?)</option>", self.text)
        self.options = list(map(html.unescape, options))


@pytest.fixture(scope="module")
def levelled():
    return fit_by_hand(table_of(30, surfaces=LABELS))


def run(page, *lines):
    """What lines of script print as JSON in the page."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    ids = f"const PAGE = {json.dumps(page.ids)};"
    code = "\n".join([ids, BROWSER, *page.scripts, *lines])
    done = subprocess.run(
        [node, "-"],
        input=code,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_names_of_others_are_text_on_the_page(levelled):
    page = Page(levelled.export(to="page"))
    nasty = Page(fit_by_hand(name=SCRIPT).export(to="page"))
    assert page.options == list(LABELS)
    assert "level" not in nasty.ids
    # A column of values for each.
    headings = re.search('<th class="left">parameter</th>(.*?)</tr>', page.text)[1]
    assert headings.count("<th") == len(LABELS) + 1
    for each in (page, nasty):
        assert each.text.count("<script") == 2
        assert len(each.scripts) == 2
        assert "<img" not in each.text


def test_the_page_computes_the_rebounds_of_the_model(levelled):
    page = Page(levelled.export(to="page", at="v_1=20, theta_1=30, omega_1=10 rev/s"))
    column = 'place("rebound").rows.map(row => row.cells[2].textContent)'
    print_all = f"console.log(JSON.stringify([state, bounce(state), {column}]))"
    move_level = 'place("level").move("1");'
    move_mu = (
        'place("mu").move("0.3"); place("angle-number").move("12"); place("speed").move("abc");'
    )
    clay, other, _ = parameter_set.sets_of_fit(levelled, {})
    for values_set, change, action, degrees in (
        (clay, {}, "", 30.0),
        (other, {}, move_level, 30.0),
        (clay, {"mu": 0.3}, move_mu, 12.0),
    ):
        angle = math.radians(degrees)
        v_x = 20.0 * math.cos(angle)
        v_y = 20.0 * math.sin(angle)
        values = {**values_set.values, **change}
        exact = values_set.model.rebound(values, fitball.impacts(v_x, v_y, 20.0 * math.pi))
        state, rebound, cells = run(page, action, print_all)
        assert state["speed"] == 20.0
        assert state["angle"] == degrees
        assert state["spin"] == 600.0
        assert rebound["v_x2"] == pytest.approx(exact.v_x2[0], rel=1e-12)
        assert rebound["omega_2"] == pytest.approx(exact.omega_2[0], rel=1e-12)
        shown = float(cells[0].replace("\u2212", "-"))
        assert shown == pytest.approx(exact.v_x2[0], abs=0.006)


def test_the_table_has_the_rebound_of_an_engine_beside_that_of_the_port(levelled):
    page = Page(levelled.export(to="page", at="v_1=20, theta_1=30, omega_1=0"))
    column = 'place("rebound").rows.map(row => row.cells[3].textContent)'
    how, own, cells = run(
        page, f"console.log(JSON.stringify([settings.spheres[0], levels[0], {column}]))"
    )
    v_x1, v_y1 = 20.0 * math.cos(math.radians(30.0)), 10.0
    a = own["inertia_ratio"]
    lost = min(how["mu"] * (1.0 + how["e"]) * v_y1, v_x1 * a / (1.0 + a))
    v_x2, v_y2, _, _, rpm, e = (float(cell.replace("\u2212", "-")) for cell in cells)
    assert v_x2 == pytest.approx(v_x1 - lost, abs=0.006)
    assert v_y2 == pytest.approx(how["e"] * v_y1, abs=0.006)
    assert rpm == pytest.approx(lost / (a * own["ball_radius"]) * 30.0 / math.pi, abs=0.6)
    assert e == pytest.approx(how["e"], abs=6e-4)


def test_the_page_draws_the_way_by_the_port_and_that_of_an_engine(levelled):
    """A ball at rest lies on the court, and of a ball that is an engine's both ways are one."""
    page = Page(levelled.export(to="page"))
    own = "const own = levels[0], down = [0, 6, 0];"
    (first, last), (sphere, rests) = run(
        page,
        own,
        "const how = { e: 0.7, mu: 0.5 };",
        "const two = [wayOfPort(down, own), wayOfSphere(down, own, how)];",
        "console.log(JSON.stringify(two.map(way => [way[0], way.at(-1)])));",
    )
    assert first == pytest.approx(sphere, abs=1e-12)
    assert last[0] == rests[0] == 0.0
    rigid = "{ ...own, e_x: 0, offset: 0, cor_10: 0.7, cor_slope: 0 }"
    port, engine = run(
        page,
        own,
        f"const stiff = {rigid}, how = {{ e: 0.7, mu: stiff.mu }}, hit = [20, 6, 50];",
        "const two = [wayOfPort(hit, stiff), wayOfSphere(hit, stiff, how)];",
        "console.log(JSON.stringify(two.map(way => way.slice(0, 70))));",
    )
    assert np.array(port) == pytest.approx(np.array(engine), abs=1e-9)


def test_the_page_says_what_it_does_not_rest_on(levelled):
    warnings = (
        'console.log(JSON.stringify([place("said").className, place("said").children.length]))'
    )
    usual = Page(levelled.export(to="page"))
    far = Page(levelled.export(to="page", at="v_1=60, theta_1=80"))
    without_fit = Page(fitball.export(to="page", model="brody"))
    assert run(usual, warnings) == ["lead", 1]
    assert run(far, warnings) == ["lead part", 2]
    assert run(usual, 'place("mu").move("0.2");', warnings) == ["lead part", 2]
    assert run(without_fit, warnings) == ["lead part", 2]


@pytest.fixture(scope="module")
def fit():
    return fit_by_hand(table_of(20, surfaces=("clay", "grass/new")), name="balls")


def test_log_likelihood_and_log_prior_add_up_to_the_posterior(fit):
    tree = fit.to_datatree()
    problem = fit.problem
    ensembles, steps, walkers, _ = fit.posterior.values.shape
    draws = tree["posterior"]
    assert draws.sizes["chain"] == ensembles
    assert draws.sizes["draw"] == steps * walkers
    assert draws["walker"].values.tolist() == np.repeat(range(walkers), steps).tolist()
    assert "cor_10[grass\u2215new]" in draws
    assert draws["offset"].attrs["units"] == "m"
    # The fourth walker of the second ensemble.
    draw = (1, 3 * steps + 7)
    row = fit.posterior.values[1, 7, 3]
    for k, name in enumerate(problem.free):
        written = draws[name.replace("/", "\u2215")]
        assert written.values[draw] == row[k]
    q = problem.prior.coordinate(row[None])
    exact = log_posterior(problem, q)[0]
    total = likelihood_and_prior(tree, draw)
    assert total == pytest.approx(exact, abs=1e-9)
    assert tree["sample_stats"]["lp"].values[draw] == pytest.approx(total, abs=1e-9)
    surfaces = tree["constant_data"]["labels"].sel(label="surface")
    assert surfaces.values.tolist() == list(fit.run.table.labels["surface"])


def likelihood_and_prior(tree, draw):
    """The sum of all parts of the log posterior at a draw (chain, step)."""
    total = tree["log_likelihood"]["impacts"].values[draw].sum()
    for density in tree["log_prior"].data_vars.values():
        total += density.values[draw]
    return total


def test_a_stated_contact_time_is_evidence_beside_the_impacts(monkeypatch):
    # Five parts of rows.
    monkeypatch.setattr("fitball.inference.density.STATES_AT_ONCE", 2000)
    timed = fit_by_hand(scene=Scene(contact_time=ValueWithSd(4.5e-3, 2e-4)), model="two-mass")
    tree = timed.to_datatree()
    draw = (0, 2 * timed.posterior.values.shape[1] + 4)
    row = timed.posterior.values[0, 4, 2]
    q = timed.problem.prior.coordinate(row[None])
    exact = log_posterior(timed.problem, q)[0]
    assert tree["sample_stats"]["lp"].values[draw] == pytest.approx(exact, abs=1e-9)
    assert set(tree["log_prior"].data_vars) == {"priors", "contact_time"}
    assert likelihood_and_prior(tree, draw) == pytest.approx(exact, abs=1e-9)


def test_of_too_many_numbers_every_kth_step_is_kept(fit, monkeypatch):
    monkeypatch.setattr("fitball.exports.arviz.MOST_TREE_NUMBERS", 3000)
    thinned = fit.to_datatree()["posterior"]
    walkers = fit.posterior.values.shape[2]
    assert thinned.sizes["draw"] == 9 * walkers
    k = fit.posterior.names.index("e_x")
    every_third = fit.posterior.values[0, ::3, 1, k]
    of_second = thinned["e_x"][0, thinned["walker"].values == 1]
    assert np.array_equal(of_second, every_third)


def test_statistics_of_others_are_those_of_the_fit(fit):
    """Chains of known correlation: each value 0.8 times the last, so that nine draws count as
    one. Walkers of an ensemble have a part in common, as of an ensemble that lies elsewhere.
    """
    from arviz_stats.base.array import array_stats

    names = fit.posterior.names
    rng = np.random.default_rng(5)
    noise = rng.normal(size=(4, 300, 40, len(names)))
    draws = np.empty(noise.shape)
    draws[:, 0] = noise[:, 0]
    for step in range(1, 300):
        draws[:, step] = 0.8 * draws[:, step - 1] + 0.6 * noise[:, step]
    apart = draws + 0.5 * np.arange(4)[:, None, None, None]
    axes = {"chain_axis": 0, "draw_axis": 1}
    for values, agrees in ((draws, True), (apart, False)):
        ours = Mixing(names, values)
        chains = as_chains(values[..., 0])
        r_hat = array_stats.rhat(chains, **axes)
        assert (r_hat < 1.01) == agrees == (ours.r_hat[names[0]] < 1.01)
        if agrees:
            ess = array_stats.ess(chains, method="bulk", **axes)
            assert ess == pytest.approx(chains.size / 9.0, rel=0.1)
            assert ess == pytest.approx(ours.ess_bulk[names[0]], rel=0.1)


def test_replicated_tables_scatter_as_the_noise_says(fit):
    tree = fit.to_datatree()
    problem = fit.problem
    values = {}
    for k, name in enumerate(problem.free):
        values[name] = as_chains(fit.posterior.values[..., k]).ravel()
    for parameter in problem.parameters:
        if parameter.fixed is not None:
            values[parameter.spec.name] = np.full(400, parameter.fixed)
    exact = problem.forward.rebound(values, problem.rows.states, problem.rows.index)
    for column, noise in (("v_x2", "v_x_sd"), ("omega_2", "spin_sd")):
        replicated = tree["posterior_predictive"][column].values.reshape(400, -1)
        z = (replicated - exact.column(column)) / values[noise][:, None]
        # 8,000 normal numbers: five standard errors.
        assert abs(z.mean()) < 5.0 / math.sqrt(z.size)
        assert abs(z.std() - 1.0) < 5.0 / math.sqrt(2.0 * z.size)
        observed = tree["observed_data"][column]
        measured = fit.run.table.values[column]
        assert np.array_equal(observed, measured, equal_nan=True)
    prior_draws = tree["prior"]["e_x"].values
    standard_error = prior_draws.std() / math.sqrt(prior_draws.size)
    assert abs(prior_draws.mean()) < 5.0 * standard_error


def test_the_file_is_the_tree_whatever_columns_and_labels_are_called(tmp_path):
    table = table_of(12, surfaces=("c\x00d", "e"))
    table["court/side"] = ["a\x00b", "/"] * 6
    table["impact"] = "<b>"
    fit = fit_by_hand(table)
    tree = fit.to_datatree()
    (file,) = fit.export(to="arviz").save(tmp_path)
    with xarray.open_datatree(file, engine="h5netcdf") as written:
        assert set(written.children) == set(tree.children)
        for name, group in tree.children.items():
            xarray.testing.assert_equal(written[name].to_dataset(), group.to_dataset())
        labels = written["constant_data"]["labels"].sel(label="court/side")
        assert labels.values.tolist() == ["a\\x00b", "/"] * 6
