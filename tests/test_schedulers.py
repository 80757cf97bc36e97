"""Tasks on threads, on processes, and on a Dask scheduler: every answer comes, whatever happens to workers."""

import os
import signal
import subprocess
import sys

import pytest

from rodgen.schedulers import SchedulerError, workers

pytestmark = pytest.mark.xdist_group("schedulers")


def double(item, plus):
    return 2 * item + plus


def process_of(item):
    return os.getpid()


def dies_once(item, marker):
    """The task numbered 3 kills its process the first time."""
    if item == 3 and not os.path.exists(marker):
        open(marker, "w").close()
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def dies_at_three(item):
    if item == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return item


def always_dies(item):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.fixture(scope="module")
def processes():
    with workers("processes=2") as found:
        yield found


def test_threads_return_each_answer_with_its_number():
    with workers("threads=2") as some:
        assert some.client is None
        assert sorted(some.each("doubling", double, [3, 4, 5], 1)) == [(0, 7), (1, 9), (2, 11)]
        with workers() as inner:
            assert inner is some


def test_an_error_of_a_task_comes_as_it_is():
    with workers("threads=2") as some, pytest.raises(TypeError):
        list(some.each("doubling", double, [None], 1))


def test_processes_share_the_tasks_and_an_active_client_is_used(processes):
    assert sorted(processes.each("doubling", double, range(5), 1)) == [(k, 2 * k + 1) for k in range(5)]
    with workers() as active:
        assert active.client is processes.client
        assert {pid for _, pid in active.each("where", process_of, range(20))}.isdisjoint({os.getpid()})
    with pytest.raises(TypeError):
        list(processes.each("doubling", double, [None], 1))


@pytest.mark.slow
def test_a_task_of_a_killed_worker_runs_again(processes, tmp_path):
    found = list(processes.each("counting", dies_once, range(8), str(tmp_path / "died")))
    assert sorted(found) == [(k, k) for k in range(8)]
    assert (tmp_path / "died").exists()


@pytest.mark.slow
def test_a_task_that_kills_every_worker_may_have_an_answer_of_its_own(processes):
    found = processes.each("counting", dies_at_three, range(5), of_killed=lambda number: -number)
    assert sorted(found) == [(0, 0), (1, 1), (2, 2), (3, -3), (4, 4)]


@pytest.mark.slow
def test_a_task_that_kills_every_worker_ends_with_a_sentence(refuses, processes):
    refuses(list, processes.each("dying", always_dies, [0]))


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch):
    monkeypatch.setattr("rodgen.schedulers.ANSWERS_WITHIN", 0.3)
    with (
        pytest.raises(SchedulerError, match=r"tcp://127.0.0.1:9: no scheduler answers; expected"),
        workers("tcp://127.0.0.1:9"),
    ):
        pass


@pytest.mark.thorough("thread", "processes=0")
@pytest.mark.parametrize("address", ["thread", "processes=0", "localhost:8786"])
def test_another_word_is_refused(address):
    with (
        pytest.raises(SchedulerError, match=f"scheduler '{address}'; expected threads, processes"),
        workers(address),
    ):
        pass


@pytest.mark.thorough
def test_without_dask_a_sentence_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with (
        pytest.raises(SchedulerError, match=r"not installed; expected .*rodgen\[dask\]"),
        workers("tcp://127.0.0.1:9"),
    ):
        pass


@pytest.mark.thorough
def test_importing_and_threads_import_no_dask():
    code = (
        "import sys, rodgen, rodgen.schedulers as s\n"
        "with s.workers() as w: list(w.each('x', abs, [1]))\n"
        "assert not {'dask', 'distributed'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
