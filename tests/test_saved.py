"""A fit as two files: all that it is comes back, other libraries read the draws, a changed file is
refused.
"""

import dataclasses
import io
import json
import unicodedata
from pathlib import Path

import h5netcdf
import msgspec
import numpy as np
import pytest
import xarray
from numpy.testing import assert_array_equal, assert_equal
from support.fit_by_hand import fit_by_hand, table_of

import fitball
from fitball.base.errors import FolderError
from fitball.inference.schema import Posterior
from fitball.saved import files_of_fit
from fitball.saved.arrays import packed, unpacked, variable_name


def written(fit, folder):
    for name, content in files_of_fit.files(fit).items():
        (folder / name).write_bytes(content())
    return folder


def plain(fit):
    """Fields as dictionaries, lists and numbers."""

    def hook(value):
        return value.tolist() if isinstance(value, np.ndarray | np.generic) else dict(value)

    return {
        field.name: msgspec.to_builtins(getattr(fit, field.name), enc_hook=hook)
        for field in dataclasses.fields(fit)
    }


@pytest.mark.parametrize(
    ("table", "options"),
    [
        (None, {}),
        (None, {"sampled": False}),
        (table_of(600, surfaces=("clay", "grass/new")), {}),
        (table_of(12, drop=True), {"model": "two-mass+normal=total"}),
    ],
)
def test_all_that_a_fit_is_comes_back(tmp_path, table, options):
    fit = fit_by_hand(table, **options)
    again = files_of_fit.read(written(fit, tmp_path) / "fit.json")
    assert_equal(plain(again), plain(fit))
    assert files_of_fit.key_of(tmp_path) == fit.run.key
    # A point fit has no intervals, which are NaN, not null.
    text = json.loads((tmp_path / "fit.json").read_text())["parameters"]["v_y_sd"]["median"]
    assert text == ("nan" if options.get("sampled") is False else fit.parameters["v_y_sd"].median)


def test_other_libraries_read_draws_and_measurements(tmp_path):
    fit = fit_by_hand()
    path = written(fit, tmp_path) / "fit.nc"
    values = fit.posterior.values
    ensembles, steps, walkers, _ = values.shape
    with xarray.open_dataset(path, group="posterior", engine="h5netcdf") as draws:
        assert draws["mu"].dims == ("chain", "draw")
        assert draws.coords["chain"].values.tolist() == list(range(ensembles))
        assert draws.coords["draw"].values.tolist() == list(range(steps * walkers))
        of_third = draws["mu"][1, draws.coords["walker"].values == 3]
        assert_array_equal(of_third, values[1, :, 3, fit.posterior.names.index("mu")])
    with xarray.open_dataset(path, group="observed_data", engine="h5netcdf") as seen:
        assert_array_equal(seen["v_x2"], fit.run.table.values["v_x2"])


@pytest.mark.parametrize(
    ("name", "before", "after", "code"),
    [
        ("fit.json", b'"point": 0.56', b'"point": 0.57', "changed"),
        ("fit.json", b'"version": 1', b'"version": 2', "other-version"),
        ("fit.json", b'"version": 1', b'"schema_version": 8', "other-version"),
        ("fit.json", b'"kind": "fitball fit"', b'"kind": "other"', "no-fit"),
        ("fit.json", b"{", b"", "no-fit"),
        ("fit.json", b"{", b"[" * 100_000, "no-fit"),
        ("fit.nc", b"HDF", b"hdf", "changed"),
    ],
)
def test_a_changed_file_is_refused(tmp_path, name, before, after, code):
    path = written(fit_by_hand(), tmp_path) / name
    assert before in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(before, after, 1))
    with pytest.raises(FolderError) as caught:
        files_of_fit.read(tmp_path)
    assert caught.value.code == code
    assert code == "changed" or files_of_fit.key_of(tmp_path) == code * (code == "other-version")


@pytest.mark.parametrize("field", ["status", "adequacy"])
def test_a_fit_with_other_fields_is_refused_too(tmp_path, field):
    path = written(fit_by_hand(), tmp_path)
    content = json.loads((path / "fit.json").read_text()) | {field: [1]}
    content["digest"] = files_of_fit._digest(content, (path / "fit.nc").read_bytes())
    (path / "fit.json").write_text(json.dumps(content))
    with pytest.raises(FolderError) as caught:
        files_of_fit.read(path)
    assert caught.value.code == "no-fit"


def test_what_is_no_fit_says_so(tmp_path):
    (tmp_path / "of a table/fit.json").mkdir(parents=True)
    with pytest.raises(FolderError) as caught:
        files_of_fit.read(tmp_path)
    assert caught.value.code == "no-fit"
    assert files_of_fit.key_of(tmp_path) == ""
    assert "of a table" in str(caught.value)


# Fits that 3.0.dev0 wrote, and what it predicted at their best values: rebound v_x2, v_y2 [m/s],
# spin [rad/s]. Of the chains of `grip_slip` four steps in a hundred were kept.
STORED = Path(__file__).parent / "data" / "stored"
AT = {"impact": "v_x1=20, v_y1=8, omega_1=50", "level": {"surface": "clay"}}
WRITTEN = {
    "grip_slip": {"v_x2": 11.879396, "v_y2": 6.552996, "omega_2": 440.186651},
    "two_mass_point": {"v_x2": 12.953827, "v_y2": 6.546864, "omega_2": 376.797567},
}


@pytest.mark.parametrize("name", WRITTEN)
def test_a_fit_of_3_0_dev0_is_read_used_and_written_again(tmp_path, name):
    fit = fitball.load_fit(STORED / name)
    record = json.loads((STORED / name / "fit.json").read_text())
    assert fit.headline == record["headline"]
    for parameter, stored in record["parameters"].items():
        assert fit.parameters[parameter].point == stored["point"]
        assert str(fit.parameters[parameter].verdict) == stored["verdict"]
    predicted = fitball.predict(fit, **AT).frames["predictions"].set_index("column")
    for column, value in WRITTEN[name].items():
        assert predicted.loc[column, "point"] == pytest.approx(value, rel=1e-6)
    if fit.posterior is not None:
        assert fit.posterior.values.shape == (4, 4, 40, 10)
        mean = fit.posterior.values[..., fit.posterior.names.index("e_x")].mean()
        assert mean == pytest.approx(0.1446, abs=1e-3)
    assert fit.report()
    fit.save(tmp_path / "again", figures=False)
    assert fitball.load_fit(tmp_path / "again") == fit


NAMES = (
    "mu[" + "\u00e9" * 200 + "a]",
    "mu[" + "\u00e9" * 200 + "b]",
    "mu[caf\u00e9]",
    "mu[cafe\u0301]",
    "mu[new\nline]",
)


def test_names_are_those_that_netcdf_reads():
    # The netCDF library reads 256 bytes, and composes letters (NFC).
    written = [variable_name(name) for name in NAMES]
    assert len({*written}) == len(NAMES)
    assert written[2] == NAMES[2]
    for name in written:
        assert len(name.encode()) <= 250
        assert unicodedata.is_normalized("NFC", name)
        assert name.isprintable()
    draws = np.random.default_rng(1).normal(size=(2, 6, 4, len(NAMES)))
    posterior = Posterior(NAMES, draws, draws[..., 0])
    _, again = unpacked(packed({}, fitball.load_table("wang_all"), posterior), NAMES)
    assert_array_equal(again.values, draws)
    assert_array_equal(again.log_density, draws[..., 0])


def test_chains_of_earlier_builds_are_walkers():
    draws = np.random.default_rng(2).normal(size=(2, 6, 4, 1))
    posterior = Posterior(("mu",), draws, draws[..., 0])
    new = io.BytesIO(packed({}, fitball.load_table("wang_all"), posterior))
    old = io.BytesIO()
    with h5netcdf.File(new, "r") as source, h5netcdf.File(old, "w") as file:
        file.dimensions.update({"chain": 8, "draw": 6})
        file.attrs["ensembles"] = 2
        for group, name in (("posterior", "mu"), ("sample_stats", "lp")):
            by_walker = source[group][name][...].reshape(8, 6)
            file.create_variable(f"/{group}/{name}", ("chain", "draw"), data=by_walker)
    _, again = unpacked(old.getvalue(), ("mu",))
    assert_array_equal(again.values, draws)
    assert_array_equal(again.log_density, draws[..., 0])
