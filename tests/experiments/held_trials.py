"""A run of trials that never ends: each holds a lock for as long as its process lives."""

import fcntl
import sys
import threading
from dataclasses import dataclass
from pathlib import Path

from experiments.harness.journal import Journal, Record
from experiments.harness.settings import Settings
from experiments.harness.trials import perform


@dataclass(frozen=True)
class Held:
    key: str


def hold(trial: Held) -> Record:
    """Lock the file that the trial is named after, say so, and wait for ever."""
    with Path(trial.key).open("r+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        sys.stdout.write("locked\n")
        sys.stdout.flush()
        threading.Event().wait()
    return {}


if __name__ == "__main__":
    lock = Path(sys.argv[1])
    perform(
        hold,
        [Held(str(lock))],
        Journal(path=lock.with_suffix(".jsonl"), code=""),
        Settings(out=lock.parent),
    )
