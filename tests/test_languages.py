"""Names of columns in other languages are proposed for what they mean."""

import pandas
import pytest

from fitball.data.header import Naming, read_header
from fitball.data.proposals import with_proposals
from fitball.data.sources import read_cells


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("Fallhöhe [cm]", "Rücksprunghöhe [cm]"),
        ("Hauteur de chute (cm)", "Hauteur de rebond (cm)"),
        ("altura de caída (cm)", "altura de rebote (cm)"),
        ("altezza di caduta", "altezza del rimbalzo"),
        ("vitesse balle avant (cm/s)", "vitesse balle après (cm/s)"),
        ("velocidad antes (cm/s)", "velocidad después (cm/s)"),
        ("velocità prima (cm/s)", "velocità dopo (cm/s)"),
    ],
)
def test_heights_and_speeds_in_other_languages_are_proposed(before, after):
    table = {before: [100.0, 150.0, 254.0], after: [57.0, 84.0, 139.0]}
    naming = Naming({})
    cells = read_cells(pandas.DataFrame(table), naming.worth)
    guesses = with_proposals(cells, read_header(cells, naming), naming).guesses
    read = {their.partition(" [")[0]: ours for ours, their in guesses.items()}
    ends = {before.partition(" [")[0]: "1", after.partition(" [")[0]: "2"}
    ends_of_ours = {"drop_height": "1", "rebound_height": "2", "v_y1": "1", "v_y2": "2"}
    assert {their: ends_of_ours[ours] for their, ours in read.items()} == ends


@pytest.mark.parametrize("name", ["Zeitintervall (ms)", "intervalle de temps [ms]"])
def test_intervals_in_other_languages_are_proposed(name):
    naming = Naming({})
    table = {"bounce": [1.0, 2.0, 3.0, 4.0], name: [552.0, 415.0, 318.0, 241.0]}
    cells = read_cells(pandas.DataFrame(table), naming.worth)
    guesses = with_proposals(cells, read_header(cells, naming), naming).guesses
    assert guesses == {"bounce_interval": name}
