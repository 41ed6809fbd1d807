"""Running out of memory is told in words, and is an error of fitball's."""

from __future__ import annotations

import numpy as np
import pytest

import fitball
from fitball.cli.main import main
from fitball.errors import MemoryShortageError


@pytest.mark.parametrize("place", ["fitball.inference.calibrate.point_fit", "fitball.data.tables.load_table"])
def test_running_out_of_memory_is_said_in_words(place, tmp_path, monkeypatch, capsys):
    def full(*_arguments, **_named):
        raise MemoryError("Unable to allocate 2.9 GiB")

    monkeypatch.setattr(place, full)
    command = ["calibrate", "wang_zero_spin.csv", "--point-only", "--out", str(tmp_path / "fit"), "--quiet"]
    assert main(command) == 2
    err = capsys.readouterr().err
    assert "memory on this machine (Unable to allocate 2.9 GiB)" in err
    assert "Traceback" not in err
    assert not list((tmp_path / "fit").glob("fit.json"))


def test_running_out_of_memory_is_an_error_of_fitball_in_python(monkeypatch):
    monkeypatch.setattr("fitball.inference.calibrate.point_fit", lambda *_: np.empty(2**50))
    with pytest.raises(MemoryShortageError, match="Unable to allocate"):
        fitball.calibrate("wang_zero_spin.csv", point_only=True)
