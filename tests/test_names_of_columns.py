"""Columns by names that users give, or that are proposed to them."""

import pytest
from numpy.testing import assert_allclose

from fitball.base.errors import InputError
from fitball.data.read import load_table


@pytest.mark.parametrize("form", ["{q} (cm) (tennis ball)", "{q} [cm] tennis", "{q} (cm), court 2"])
def test_a_unit_within_a_name_of_the_user_counts(form):
    rows = {form.format(q="Drop"): [100.0, 150.0], form.format(q="Bounce"): [55.0, 81.0]}
    columns = {"drop_height": form.format(q="Drop"), "rebound_height": form.format(q="Bounce")}
    ours = load_table({"drop_height [m]": [1.0, 1.5], "rebound_height [m]": [0.55, 0.81]})
    table = load_table(rows, columns=columns)
    for name, values in ours.values.items():
        assert_allclose(table.values[name], values)


@pytest.mark.parametrize("rebound", ["Rücksprunghöhe", "Rueckprall Hoehe"])
def test_german_heights_of_a_drop_are_proposed(rebound):
    rows = {"Fallhöhe [cm]": [100.0, 150.0], f"{rebound} [cm]": [55.0, 81.0]}
    with pytest.raises(InputError) as caught:
        load_table(rows)
    (fault,) = caught.value.faults
    assert f"drop_height=Fallhöhe [cm],rebound_height={rebound} [cm]" in fault.message
