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
from support.made_fit import made_fit, table_of

import fitball
from fitball.data.scene import Quantity, Scene
from fitball.exports import parameter_set
from fitball.inference.density import log_posterior
from fitball.inference.sampling.convergence import Mixing

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
"""


class Page:
    """What a browser finds: scripts, ids, texts of options."""

    def __init__(self, made):
        (self.text,) = made.contents.values()
        self.scripts = re.findall("(?s)<script>(.*?)</script>", self.text)
        self.ids = re.findall('id="([^"]*)"', self.text)
        self.options = [
            html.unescape(one) for one in re.findall("<option[^>]*>(.*?)</option>", self.text)
        ]


@pytest.fixture(scope="module")
def levelled():
    return made_fit(table_of(30, surfaces=LABELS))


def run(page, *lines):
    """What lines of script print as JSON in the page."""
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node")
    code = "\n".join([f"const PAGE = {json.dumps(page.ids)};", BROWSER, *page.scripts, *lines])
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
    nasty = Page(made_fit(name=SCRIPT).export(to="page"))
    assert page.options == list(LABELS)
    assert "level" not in nasty.ids
    # A column of values for each.
    assert (
        re.search('<th class="left">parameter</th>(.*?)</tr>', page.text)[1].count("<th")
        == len(LABELS) + 1
    )
    for one in (page, nasty):
        assert one.text.count("<script") == 2 == len(one.scripts)
        assert "<img" not in one.text


def test_the_page_computes_the_rebounds_of_the_model(levelled):
    page = Page(levelled.export(to="page", at="v_1=20, theta_1=30, omega_1=10 rev/s"))
    cells = 'place("rebound").rows.map(row => row.cells[2].textContent)'
    shown = f"console.log(JSON.stringify([state, bounce(state), {cells}]))"
    moved = 'place("mu").move("0.3"); place("angle-number").move("12"); place("speed").move("abc");'
    clay, other, _ = parameter_set.of_fit(levelled, {})
    for one, change, lines, degrees in (
        (clay, {}, "", 30.0),
        (other, {}, 'place("level").move("1");', 30.0),
        (clay, {"mu": 0.3}, moved, 12.0),
    ):
        angle = math.radians(degrees)
        impact = fitball.impacts(20.0 * math.cos(angle), 20.0 * math.sin(angle), 20.0 * math.pi)
        true = one.model.rebound({**one.values, **change}, impact)
        state, found, cells = run(page, lines, shown)
        assert (state["speed"], state["angle"], state["spin"]) == (20.0, degrees, 600.0)
        assert found["v_x2"] == pytest.approx(true.v_x2[0], rel=1e-12)
        assert found["omega_2"] == pytest.approx(true.omega_2[0], rel=1e-12)
        assert float(cells[0].replace("\u2212", "-")) == pytest.approx(true.v_x2[0], abs=0.006)


def test_the_page_says_what_it_does_not_rest_on(levelled):
    said = 'console.log(JSON.stringify([place("said").className, place("said").children.length]))'
    usual = Page(levelled.export(to="page"))
    far = Page(levelled.export(to="page", at="v_1=60, theta_1=80"))
    assert run(usual, said) == ["lead", 1]
    assert run(far, said) == run(usual, 'place("mu").move("0.2");', said) == ["lead part", 2]
    assert run(Page(fitball.export(to="page", model="brody")), said) == ["lead part", 2]


@pytest.fixture(scope="module")
def fit():
    return made_fit(table_of(20, surfaces=("clay", "grass/new")), name="balls")


def test_log_likelihood_and_log_prior_add_up_to_the_posterior(fit):
    tree = fit.to_datatree()
    problem = fit.problem
    ensembles, steps, walkers, _ = fit.posterior.values.shape
    draws = tree["posterior"]
    assert draws.sizes["chain"] == ensembles * walkers
    assert draws.sizes["draw"] == steps
    assert draws["ensemble"].values.tolist() == [0] * walkers + [1] * walkers
    assert "cor_10[grass\u2215new]" in draws
    assert draws["offset"].attrs["units"] == "m"
    chain = walkers + 3
    step = 7
    row = fit.posterior.values[1, step, 3]
    for k, name in enumerate(problem.free):
        assert draws[name.replace("/", "\u2215")].values[chain, step] == row[k]
    q = problem.prior.coordinate(row[None])
    total = tree["log_likelihood"]["impacts"].values[chain, step].sum()
    total += sum(one.values[chain, step] for one in tree["log_prior"].data_vars.values())
    assert total == pytest.approx(log_posterior(problem, q)[0], abs=1e-9)
    assert tree["sample_stats"]["lp"].values[chain, step] == pytest.approx(total, abs=1e-9)
    surfaces = tree["constant_data"]["labels"].sel(label="surface").values.tolist()
    assert surfaces == list(fit.run.table.labels["surface"])


def test_a_stated_contact_time_is_evidence_beside_the_impacts(monkeypatch):
    # Five parts of rows.
    monkeypatch.setattr("fitball.inference.density.AT_ONCE", 2000)
    timed = made_fit(scene=Scene(contact_time=Quantity(4.5e-3, 2e-4)), model="two-mass")
    tree = timed.to_datatree()
    row = timed.posterior.values[0, 4, 2]
    total = log_posterior(timed.problem, timed.problem.prior.coordinate(row[None]))[0]
    assert tree["sample_stats"]["lp"].values[2, 4] == pytest.approx(total, abs=1e-9)
    assert set(tree["log_prior"].data_vars) == {"priors", "contact_time"}
    summed = sum(one.values[2, 4] for one in tree["log_prior"].data_vars.values())
    assert summed + tree["log_likelihood"]["impacts"].values[2, 4].sum() == pytest.approx(
        total,
        abs=1e-9,
    )


def test_of_too_many_numbers_every_kth_step_is_kept(fit, monkeypatch):
    monkeypatch.setattr("fitball.exports.arviz.ENTRIES", 3000)
    whole = fit.posterior.values
    thin = fit.to_datatree()["posterior"]
    assert thin.sizes["draw"] == 9
    assert np.array_equal(thin["e_x"].values[1], whole[0, ::3, 1, fit.posterior.names.index("e_x")])


def test_statistics_of_others_are_those_of_the_fit(fit):
    from arviz_stats.base.array import array_stats

    draws = fit.to_datatree()["posterior"]
    mine = Mixing(fit.problem.free, fit.posterior.values)
    for name in ("mu[clay]", "e_x", "v_x_sd"):
        axes = {"chain_axis": 0, "draw_axis": 1}
        assert array_stats.ess(draws[name].values, method="bulk", **axes) == pytest.approx(
            mine.ess_bulk[name]
        )
        nested = array_stats.rhat_nested(
            draws[name].values,
            superchain_ids=draws["ensemble"].values,
            **axes,
        )
        assert nested == pytest.approx(mine.r_hat[name])


def test_replicated_tables_scatter_as_the_noise_says(fit):
    tree = fit.to_datatree()
    problem = fit.problem
    values = {
        name: fit.posterior.values[..., k].transpose(0, 2, 1).ravel()
        for k, name in enumerate(problem.free)
    }
    values |= {
        one.spec.name: np.full(400, one.fixed)
        for one in problem.parameters
        if one.fixed is not None
    }
    true = problem.forward.rebound(values, problem.rows.states, problem.rows.index)
    for column, noise in (("v_x2", "v_x_sd"), ("omega_2", "spin_sd")):
        again = tree["posterior_predictive"][column].values.reshape(400, -1)
        z = (again - true.column(column)) / values[noise][:, None]
        # 8,000 normal numbers: five standard errors.
        assert abs(z.mean()) < 5.0 / math.sqrt(z.size)
        assert abs(z.std() - 1.0) < 5.0 / math.sqrt(2.0 * z.size)
        assert np.array_equal(
            tree["observed_data"][column],
            fit.run.table.values[column],
            equal_nan=True,
        )
    before = tree["prior"]["e_x"].values
    assert abs(before.mean()) < 5.0 * before.std() / math.sqrt(before.size)


def test_the_file_is_the_tree_whatever_columns_and_labels_are_called(tmp_path):
    table = table_of(12, surfaces=("c\x00d", "e"))
    table["court/side"], table["impact"] = ["a\x00b", "/"] * 6, "<b>"
    fit = made_fit(table)
    (file,) = fit.export(to="arviz").save(tmp_path)
    with xarray.open_datatree(file, engine="h5netcdf") as again:
        assert set(again.children) == set(fit.to_datatree().children)
        for name, group in fit.to_datatree().children.items():
            xarray.testing.assert_equal(again[name].to_dataset(), group.to_dataset())
        assert (
            again["constant_data"]["labels"].sel(label="court/side").values.tolist()
            == ["a\\x00b", "/"] * 6
        )
