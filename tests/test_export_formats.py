"""The parameter set as JSON, TOML, CSV, LaTeX, Markdown and netCDF, and the manners of `fitball export`."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from importlib.resources import files

import arviz_base
import jsonschema
import numpy as np
import pytest
import xarray as xr
from headless import find_browser

import fitball
from fitball.cli.main import main
from fitball.exports.formats import FORMATS, KINDS
from fitball.exports.parameters import latex_table, paper_markdown, paper_rows, parameter_content
from fitball.report.form.numbers import decimals, fixed


@pytest.fixture(scope="module")
def saved(small_fit):
    return fitball.load_fit(small_fit)


@pytest.fixture
def point_only(small_fit, tmp_path):
    """The same fit as if nothing had been sampled, with one fixed parameter and one that the prior decides."""
    content = json.loads((small_fit / "fit.json").read_text(encoding="utf-8"))
    content["status"] = "point only"
    content["fitted"]["draws"], content["diagnostics"] = [], None
    content |= {"covariance": None, "correlation": None}
    for item in content["parameters"].values():
        for name in ("median", "sd", "q025", "q05", "q16", "q84", "q95", "q975"):
            item[name] = None
    folder = tmp_path / "point"
    folder.mkdir()
    (folder / "fit.json").write_text(json.dumps(content), encoding="utf-8")
    return folder


def schema():
    place = files("fitball.exports") / "parameters.schema.json"
    return json.loads(place.read_text(encoding="utf-8"))


def test_json_follows_its_schema(small_fit, point_only, capsys):
    jsonschema.Draft202012Validator.check_schema(schema())
    for folder in (small_fit, point_only):
        assert main(["export", str(folder), "--to", "json", "--out", "-"]) == 0
        content = json.loads(capsys.readouterr().out)
        jsonschema.validate(content, schema())
    for spoil in (
        lambda found: found["parameters"]["mu"].update(verdict="certain"),
        lambda found: found["parameters"]["mu"].pop("point"),
        lambda found: found["ball"].update(mass=-1.0),
        lambda found: found.update(surprise=1),
        lambda found: found["golden"]["rebound"].pop("v_y2"),
        lambda found: found["parameters"]["mu"].update(sd=None),
    ):
        broken = json.loads(json.dumps(content))
        spoil(broken)
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(broken, schema())


def test_json_says_what_the_fit_says(small_fit, saved):
    content = parameter_content(saved)
    fit = json.loads((small_fit / "fit.json").read_text(encoding="utf-8"))
    for name, item in content["parameters"].items():
        for key in ("point", "median", "sd", "q025", "q975"):
            assert item[key] == fit["parameters"][name][key]
    assert {name: item["role"] for name, item in content["parameters"].items()} == {
        "mu": "model", "e_x": "model", "offset": "model", "cor_10": "model", "cor_slope": "model",
        "velocity_sd": "noise", "spin_sd": "noise",
    }  # fmt: skip
    assert content["golden"]["rebound"]["v_x2"] == fit["golden"]["rebound"]["v_x2"]


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        # The examples of the Particle Data Group's introduction.
        (0.827, 0.119, "0.83 +- 0.12"),
        (0.827, 0.367, "0.8 +- 0.4"),
        (5.1234, 0.354, "5.12 +- 0.35"),
        (5.1234, 0.355, "5.1 +- 0.4"),
        (5.1234, 0.949, "5.1 +- 0.9"),
        (5.1234, 0.950, "5.1 +- 1.0"),
        (5.1234, 0.999, "5.1 +- 1.0"),
        (18999.6, 4301.6, "19000 +- 4000"),
        (0.01234, 0.00098, "0.0123 +- 0.0010"),
        # Whole powers of ten are where a logarithm may miss.
        *((10.0**k, 10.0**k, f"{10.0**k:.{max(0, 1 - k)}f} +- {10.0**k:.{max(0, 1 - k)}f}") for k in range(-6, 4)),
    ],
)
def test_rounding_follows_the_particle_data_group(value, sd, text):
    places = decimals(sd)
    assert f"{fixed(value, places)} +- {fixed(sd, places)}" == text


def test_latex_is_a_whole_table_rounded_as_the_rows_are(saved):
    text = latex_table(saved)
    assert [text.count(rf"\{end}{{{name}}}") for end in ("begin", "end") for name in ("table", "tabular")] == [1] * 4
    for rule in (r"\toprule", r"\midrule", r"\bottomrule"):
        assert text.count(rule) == 1
    body = text.split(r"\midrule")[1].split(r"\bottomrule")[0].strip().splitlines()
    assert len(body) == len(saved.parameters)
    for line, row in zip(body, paper_rows(saved), strict=True):
        assert line.rstrip().endswith(r"\\")
        cells = [cell.strip() for cell in line.rstrip().removesuffix(r"\\").split(" & ")]
        assert len(cells) == 5
        assert cells[2].startswith(rf"${row.value} \pm {row.sd}$")
        # Value and sd end at the same decimal.
        assert len(row.value.partition(".")[2]) == len(row.sd.partition(".")[2])
        assert line.count("$") % 2 == 0
    assert not re.search(r"(?<!\\)[_%#&]", text.split(r"\caption")[1].split("\n")[0])
    assert r"$\mathrm{10^{-3}\,s/m}$" in text
    assert "did not converge" in text
    rows = [line for line in paper_markdown(saved).splitlines() if line.startswith("| `")]
    assert len(rows) == len(saved.parameters) and all(line.count("|") == 6 for line in rows)


def test_a_number_the_prior_decides_is_marked(small_fit, tmp_path):
    content = json.loads((small_fit / "fit.json").read_text(encoding="utf-8"))
    content["parameters"]["e_x"]["verdict"] = "prior-dominated"
    content["parameters"]["mu"]["verdict"] = "fixed"
    for told in (
        content["identifiability"]["evidence"],
        *map(content["diagnostics"].get, ("ess_bulk", "ess_tail", "r_hat")),
    ):
        del told["mu"]
    content |= {"covariance": None, "correlation": None}
    (tmp_path / "fit.json").write_text(json.dumps(content), encoding="utf-8")
    marked = fitball.load_fit(tmp_path)
    for text in (paper_markdown(marked), latex_table(marked)):
        assert "prior-dominated" in text
    (mu,) = (row for row in paper_rows(marked) if row.name == "mu")
    assert mu.sd == ""
    assert float(mu.value) == pytest.approx(marked.parameters["mu"].point, rel=1e-3)
    assert "prior-dominated" not in paper_markdown(fitball.load_fit(small_fit))


def test_a_number_is_rounded_in_the_unit_it_is_shown_in(saved):
    """The offset in mm: as many digits as its sd in mm supports, not as in metres."""
    (row,) = (row for row in paper_rows(saved) if row.name == "offset")
    item = saved.parameters["offset"]
    assert row.unit == "mm"
    assert len(row.sd.replace(".", "").lstrip("0")) <= 2
    assert float(row.sd) == pytest.approx(1e3 * item.sd, rel=0.15)
    assert abs(float(row.value) - 1e3 * item.median) <= 0.5 * 10.0 ** -decimals(1e3 * item.sd)


def test_labels_of_a_user_keep_tables_whole(saved):
    odd = replace(saved.parameters["mu"], name="mu_place[a|b <c>]", meaning="of a|b\n<c>")
    shown = replace(saved, parameters={odd.name: odd})
    assert "\n| `mu_place[a\\|b <c>]` | of a\\|b <c> |" in paper_markdown(shown)
    assert r"mu\_place[a\textbar{}b \textless{}c\textgreater{}] & \raggedright of a\textbar{}b" in latex_table(shown)


def test_netcdf_holds_the_draws_for_arviz(small_fit, saved, tmp_path):
    place = tmp_path / "draws.nc"
    assert main(["export", str(small_fit), "--to", "netcdf", "--out", str(place)]) == 0
    truth = fitball.load_fit(small_fit).posterior
    with xr.open_datatree(place, engine="h5netcdf") as tree:
        assert set(tree.children) == {
            "posterior", "sample_stats", "prior", "prior_predictive", "log_likelihood", "log_prior",
            "posterior_predictive", "observed_data", "constant_data",
        }  # fmt: skip
        draws = tree["posterior"].to_dataset()
        assert draws.sizes == {"chain": 4, "draw": 1000}
        rows = np.stack([draws[name].to_numpy() for name in truth.names], axis=-1)
        for k, chain in enumerate(rows):
            # Draws of an ensemble of its own, in the order of its steps, each with its own score.
            own = truth.values[k].reshape(-1, len(truth.names))
            where = [int(np.flatnonzero((own == row).all(axis=1))[0]) for row in chain]
            assert np.median(np.diff(where)) > 0
            lp = tree["sample_stats"]["lp"].to_numpy()[k]
            np.testing.assert_array_equal(lp, truth.log_posterior[k].ravel()[where])
        assert draws["mu"].attrs["units"] == saved.parameters["mu"].unit
        np.testing.assert_array_equal(tree["constant_data"]["v_x1"], saved.fitted.impacts.v_x1)
        assert tree.attrs["model"] == "grip-slip"
        sample = arviz_base.extract(tree, var_names=["mu", "e_x"])
        assert sample.sizes == {"sample": 4000}
        spread = truth.draws[:, truth.names.index("mu")]
        assert float(sample["mu"].mean()) == pytest.approx(float(np.mean(spread)), abs=0.2 * float(np.std(spread)))


def test_netcdf_without_or_with_foreign_draws(small_fit, point_only, tmp_path, capsys):
    folder = tmp_path / "moved"
    folder.mkdir()
    shutil.copy(small_fit / "fit.json", folder)
    assert main(["export", str(folder), "--to", "netcdf"]) == 0
    err = capsys.readouterr().err
    assert "posterior.nc is missing" in err and "data.nc and " in err and "run.toml are missing" in err
    with xr.open_datatree(folder / "arviz.nc", engine="h5netcdf") as tree:
        assert tree["posterior"]["mu"].shape == (1, fitball.load_fit(folder).fitted.draws.shape[0])
    with xr.open_datatree(small_fit / "posterior.nc", engine="h5netcdf") as tree:
        other = tree["posterior"].to_dataset() * 1.001
        content = {name: other if name == "posterior" else tree[name].to_dataset().load() for name in tree.children}
        xr.DataTree.from_dict(content).to_netcdf(folder / "posterior.nc", engine="h5netcdf")
    assert main(["export", str(folder), "--to", "netcdf", "--overwrite"]) == 2
    assert "of another fit" in capsys.readouterr().err
    assert main(["export", str(point_only), "--to", "netcdf"]) == 2
    assert "a point fit has no draws" in capsys.readouterr().err


def test_every_format_of_a_point_fit(point_only):
    for name in FORMATS:
        if name not in ("netcdf", "pdf"):
            assert main(["export", str(point_only), "--to", name]) == 0
    assert {path.name for path in point_only.iterdir()} == {
        "fit.json", "bounce.py", "bounce.h", "bounce.js", "bounce.mjs", "bounce.cs",
        "golden.csv", "lookup.csv", "lookup.json", "engine.md", "engine.json",
        "parameters.json", "parameters.tex", "parameters.md", "certificate.html",
    }  # fmt: skip


def test_names_on_the_command_line_are_those_that_exist():
    told = fitball.export.__doc__
    assert [name for name in (*FORMATS, *KINDS) if f"`{name}`" not in told] == []


def test_manners(small_fit, tmp_path, capsys):
    call = ["export", str(small_fit), "--to"]
    place = tmp_path / "p.json"
    assert main([*call, "json", "--out", str(place)]) == 0
    before = place.read_bytes()
    for words, refused in (
        (["jsn"], "did you mean 'json'"),
        (["json", "--out", str(place)], "use --overwrite"),
        (["json", "--out", str(tmp_path / "none" / "p.json")], "create it first"),
        (["json", "--out", str(small_fit / "fit.json"), "--overwrite"], "reserved for results"),
        (["netcdf", "--out", str(small_fit / "posterior.nc"), "--overwrite"], "reserved for results"),
        (["netcdf", "--out", "-"], "not text"),
        (["json", "--range", "v=1"], "--to lookup, not of --to json"),
        (["c", "--prefix", "9-"], "the beginning of a name"),
        (["csharp", "--prefix", "_9"], "the beginning of a name"),
        (["engine", "--engine-inertia", "2"], "at most 1"),
        (["engine", "--engine-inertia", "0"], "above 0"),
    ):
        assert main([*call, *words]) == 2, words
        assert refused in capsys.readouterr().err
    assert place.read_bytes() == before
    assert main([*call, "json", "--out", str(place), "--overwrite"]) == 0
    assert place.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["p.json"]
    assert main([*call, "c", "--prefix", "clay_", "--out", "-"]) == 0
    header = capsys.readouterr().out
    assert "clay_rebound(" in header
    assert main([*call, "engine", "--out", str(tmp_path / "speed-1.5")]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"p.json", "speed-1.5.md", "speed-1.5.json"}
    assert "fitball_" not in header


def test_the_report_is_printed_by_a_browser_that_is_installed(saved, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("FITBALL_BROWSER", "no-such-browser")
    saved.save(tmp_path / "fit", figures=False)
    assert main(["export", str(tmp_path / "fit"), "--to", "pdf"]) == 2
    assert "no-such-browser" in capsys.readouterr().err
    if (found := find_browser()) is None:
        pytest.skip("no browser is installed")
    monkeypatch.setenv("FITBALL_BROWSER", found)
    assert main(["export", str(tmp_path / "fit"), "--to", "pdf", "--out", str(tmp_path / "a.pdf")]) == 0
    assert (tmp_path / "a.pdf").read_bytes().startswith(b"%PDF")
