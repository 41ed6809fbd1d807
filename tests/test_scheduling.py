"""Work over processes: everything comes back, whatever happens to a worker."""

import os
import signal
import subprocess
import sys
import time
from functools import partial

import cloudpickle
import pytest

from fitball.base.errors import FitError, MachineError
from fitball.base.scheduling import as_completed

# Workers cannot import this file: its functions travel whole.
cloudpickle.register_pickle_by_value(sys.modules[__name__])
POSIX = pytest.mark.skipif(os.name != "posix", reason="signals of a POSIX system")


def square(case):
    if case == 3:
        raise FitError("three cannot be fitted", "three")
    if case == 6:
        raise MemoryError("2.9 GiB")
    return os.getpid(), case**2


def dying(folder, case):
    """The third dies each time, after the fifth, which dies once: whether one takes the other with
    it does not depend on who is faster.
    """
    mark = folder / "5"
    if case == 3:
        while not mark.exists():
            time.sleep(0.01)
    if case == 3 or (case == 5 and not mark.exists()):
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return case


@pytest.mark.parametrize("cores", [1, 2])
def test_every_case_is_answered_with_its_number_and_faults_are_answers(cores):
    answers = dict(as_completed(square, range(8), cores))
    assert sorted(answers) == list(range(8))
    assert [answers.pop(k).code for k in (3, 6)] == ["three", "memory"]
    assert {number: value for number, (_, value) in answers.items()} == {
        k: k**2 for k in (0, 1, 2, 4, 5, 7)
    }
    here = {pid == os.getpid() for pid, _ in answers.values()}
    assert here == {cores == 1}


@POSIX
def test_a_worker_that_dies_takes_no_other_case_with_it(tmp_path):
    answers = dict(as_completed(partial(dying, tmp_path), range(9), 2))
    error = answers.pop(3)
    assert isinstance(error, MachineError)
    assert error.code == "worker-died"
    assert "SIGKILL(-9)" in str(error)
    # What died once was tried again.
    assert answers == {k: k for k in (0, 1, 2, 4, 5, 6, 7, 8)}


def test_functions_of_a_user_travel_and_their_exceptions_are_raised():
    offset = 10
    assert dict(as_completed(lambda case: case + offset, [1, 2], 2)) == {0: 11, 1: 12}
    for cores in (1, 2):
        with pytest.raises(ZeroDivisionError):
            list(as_completed(lambda case: 1 / case, [1, 0], cores))


def test_what_is_ready_comes_first_and_who_stops_asking_ends_the_rest(tmp_path):
    def slow(case):
        (tmp_path / str(case)).write_text(str(os.getpid()))
        # The first waits for the second, so that only the order of readiness can be right.
        while case == 0 and not (tmp_path / "1").exists():
            time.sleep(0.01)
        time.sleep(600.0 * (case == 0))
        return case

    answers = as_completed(slow, [0, 1], 2)
    assert next(answers) == (1, 1)
    answers.close()
    if os.name == "posix":
        with pytest.raises(ProcessLookupError):
            os.kill(int((tmp_path / "0").read_text()), 0)


WAITING = """import time, fitball.base.scheduling
def wait(k):
    print(k, flush=True)
    time.sleep(300)
list(fitball.base.scheduling.as_completed(wait, [1, 2], 2))"""


@POSIX
def test_workers_end_with_the_process_that_began_them():
    program = subprocess.Popen(
        [sys.executable, "-c", WAITING],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert sorted(program.stdout.readline() for _ in range(2)) == [b"1\n", b"2\n"]
    program.kill()
    # Workers write to the same pipe: it ends with the last of them.
    program.communicate(timeout=120)
