"""Trials are kept one by one, are not run twice, and are not taken from other code."""

import fcntl
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from bench.workers import LOCAL
from experiments.harness.journal import Journal, code_hash
from experiments.harness.settings import Settings, Step
from experiments.harness.trials import perform

done: list[int] = []


@dataclass(frozen=True)
class Square:
    number: int

    @property
    def key(self) -> str:
        return f"number {self.number}"


def square(trial: Square) -> dict[str, Any]:
    done.append(trial.number)
    if trial.number == 13:
        raise RuntimeError("the power went off")
    return {"square": trial.number**2}


def threads(trial: Square) -> dict[str, Any]:
    return {"process": os.getpid(), "threads": os.environ["OMP_NUM_THREADS"]}


@pytest.fixture(autouse=True)
def nothing_done() -> None:
    done.clear()


def journal(folder: Path, code: str = "a") -> Journal:
    return Journal(path=folder / "trials.jsonl", code=code)


def run(folder: Path, *numbers: int, code: str = "a") -> list[dict[str, Any]]:
    settings = Settings(out=folder, processes=1)
    return perform(square, [Square(n) for n in numbers], journal(folder, code), settings)


def test_a_run_that_broke_off_goes_on_where_it_was(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError):
        run(tmp_path, 1, 2, 13, 4)
    done.clear()
    assert run(tmp_path, 4, 2, 1) == [{"square": 16}, {"square": 4}, {"square": 1}]
    assert done == [4]


def test_a_line_cut_off_by_a_crash_is_run_again(tmp_path: Path) -> None:
    run(tmp_path, 1, 2)
    path = journal(tmp_path).path
    path.write_text(path.read_text()[:-9])
    done.clear()
    run(tmp_path, 1, 2, 3)
    assert done == [2, 3]
    assert len(journal(tmp_path).read()) == 3


def test_trials_of_other_code_do_not_count_and_stay(tmp_path: Path) -> None:
    run(tmp_path, 1)
    run(tmp_path, 1, code="b")
    assert done == [1, 1]
    assert journal(tmp_path, "a").read() == journal(tmp_path, "b").read() == {"number 1": {"square": 1}}


def test_the_hash_of_code_is_that_of_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import experiments.blind as package

    before = code_hash(package)
    assert before == code_hash(package)
    (tmp_path / "one.py").write_text("x = 1\n")
    monkeypatch.setattr(package, "__path__", [str(tmp_path)])
    one = code_hash(package)
    (tmp_path / "one.py").write_text("x = 2\n")
    assert len({before, one, code_hash(package)}) == 3


def test_progress_counts_what_was_there_but_takes_no_pace_from_it(tmp_path: Path) -> None:
    run(tmp_path, 1, 2)
    steps: list[Step] = []
    clock = iter([100.0, 103.0, 106.0])
    settings = Settings(out=tmp_path, processes=1, watch=steps.append, now=lambda: next(clock))
    perform(square, [Square(n) for n in (1, 2, 3, 4)], journal(tmp_path), settings)
    assert [(s.done, s.total, s.left_s) for s in steps] == [(2, 4, None), (3, 4, 3.0), (4, 4, 0.0)]
    assert steps[0].said == "begun, 2 kept from before"


def test_processes_of_their_own_use_one_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    trials = [Square(n) for n in range(3)]
    records = perform(threads, trials, journal(tmp_path), Settings(out=tmp_path, processes=2))
    assert {r["threads"] for r in records} == {"1"}
    assert os.getpid() not in {r["process"] for r in records}
    assert os.environ["OMP_NUM_THREADS"] == "7"


@pytest.mark.filterwarnings("ignore")  # of Dask's own start and end
def test_a_cluster_finds_the_same_and_takes_up_what_others_left(tmp_path: Path) -> None:
    cluster = Settings(out=tmp_path, processes=2, dask=LOCAL)
    run(tmp_path, 1, 2)
    done.clear()
    records = perform(square, [Square(n) for n in range(6)], journal(tmp_path), cluster)
    assert records == [{"square": n**2} for n in range(6)]
    assert done == []  # none of them here
    assert perform(square, [Square(4)], journal(tmp_path), cluster) == [{"square": 16}]


def test_a_killed_run_leaves_no_process_behind(tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    lock.touch()
    command = [sys.executable, "-m", "tests.experiments.held_trials", str(lock)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as run:
        assert run.stdout is not None
        assert run.stdout.readline() == "locked\n"
        run.kill()
        with lock.open("r+") as file:
            # returns when the trial's process is gone; else the test times out
            fcntl.flock(file, fcntl.LOCK_EX)


def test_trials_that_follow_find_the_same_processes(tmp_path: Path) -> None:
    """What a process keeps in memory, such as the reach of a design, serves the next part as well."""
    settings, first = Settings(out=tmp_path, processes=2), journal(tmp_path)
    before, after = (
        {r["process"] for r in perform(threads, [Square(n) for n in numbers], first, settings)}
        for numbers in (range(8), range(8, 16))
    )
    assert len(before | after) <= 2


def test_an_error_ends_the_processes_and_the_next_trials_have_others(tmp_path: Path) -> None:
    settings, kept = Settings(out=tmp_path, processes=2), journal(tmp_path)
    before = {r["process"] for r in perform(threads, [Square(1), Square(2)], kept, settings)}
    with pytest.raises(RuntimeError, match="the power went off"):
        perform(square, [Square(13)], kept, settings)
    after = {r["process"] for r in perform(threads, [Square(3), Square(4)], kept, settings)}
    assert not before & after
