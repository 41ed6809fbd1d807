"""What fitball says of a table: the codes of its faults, and of its notes."""

import pytest

import fitball
from fitball.base.errors import InputError


def codes_of(columns, **reading):
    with pytest.raises(InputError) as refusal:
        fitball.load_table(columns, **reading)
    return [fault.code for fault in refusal.value.faults]


def notes_of(table):
    return [note.code for note in table.notices]
