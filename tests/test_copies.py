"""What verbs return can be pickled and copied, and read at a prompt; names can be imported."""

import copy
import pickle

import pytest

import fitball

WAYS = {
    "pickle": lambda thing: pickle.loads(pickle.dumps(thing)),
    "copy": copy.copy,
    "deepcopy": copy.deepcopy,
}


@pytest.fixture(scope="module")
def fit():
    return fitball.calibrate("wang_zero_spin", model="brody", point_only=True)


@pytest.fixture(scope="module")
def batch(tmp_path_factory):
    table = fitball.load_table("wang_zero_spin").to_frame()
    # One impact is too few to fit.
    tables = {"seven": table, "one": table.iloc[:1]}
    folder = tmp_path_factory.mktemp("batch")
    return fitball.batch(tables, out=folder, model="brody", point_only=True)


@pytest.fixture(scope="module")
def results(fit, batch):
    """A result of each class, by name, after its report was made."""
    by_name = {
        "Fit": fit,
        "Frames": fit.predict(impact="v_1=17, theta_1=20 deg"),
        "Film": fitball.track("table_tennis_topspin"),
        "Batch": batch,
        "Drawn": fitball.plot(fit, "curves"),
        "Exported": fitball.export(model="two-mass", to="json"),
    }
    for result in by_name.values():
        result.report()
    return by_name


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", ["Fit", "Frames", "Film", "Batch", "Drawn", "Exported"])
def test_a_copy_says_the_same(results, name, way):
    result = results[name]
    other = WAYS[way](result)
    assert type(other) is getattr(fitball, name)
    assert other is not result
    assert repr(other) == repr(result)
    assert other.report() == result.report()
    assert other.json() == result.json()


def test_a_batch_is_a_mapping_of_the_tables_that_could_be_fitted(batch):
    assert {*batch.failed} == {"one"}
    assert [*batch] == [*batch.keys()] == ["seven"]
    assert len(batch) == 1
    assert ("seven" in batch, "one" in batch, 0 in batch) == (True, False, False)
    (found,) = batch.values()
    assert found == batch["seven"]
    with pytest.raises(KeyError, match="one"):
        batch["one"]


def test_every_public_name_can_be_imported_by_a_star():
    names = {}
    exec("from fitball import *", names)
    assert {*names} - {"__builtins__"} == {*fitball.__all__}
