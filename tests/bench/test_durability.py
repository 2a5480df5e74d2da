"""That a commit reaches the disk: the calls that put it there are counted."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

GCC = shutil.which("gcc")
COUNTER = """
#define _GNU_SOURCE
#include <dlfcn.h>
static int calls = 0;
int synced(void) { return calls; }
int fdatasync(int fd) { calls++; return ((int (*)(int)) dlsym(RTLD_NEXT, "fdatasync"))(fd); }
int fsync(int fd) { calls++; return ((int (*)(int)) dlsym(RTLD_NEXT, "fsync"))(fd); }
"""
STEPS = 10
PROGRAM = f"""
import ctypes
from bench.store import Moment, Provenance, Store
synced = ctypes.CDLL(None).synced
with Store("sqlite:///x.sqlite") as store:
    campaign = store.create_campaign("c", Provenance(config={{}}, config_hash="", virtual=True), [])
    before = synced()
    for k in range({STEPS}):
        store.note(campaign, "step", time_s=float(k))
    durable = synced()
    for k in range({STEPS}):
        store.live.write(campaign, Moment(phase="settling", time_s=float(k)))
    print(durable - before, synced() - durable)
"""


@pytest.mark.skipif(GCC is None, reason="missing program: gcc")
def test_every_step_is_forced_to_the_disk_and_a_live_moment_is_not(tmp_path: Path) -> None:
    assert GCC is not None
    (tmp_path / "counter.c").write_text(COUNTER)
    subprocess.run(
        [GCC, "-shared", "-fPIC", "-o", "counter.so", "counter.c", "-ldl"], cwd=tmp_path, check=True
    )
    root = str(Path(__file__).resolve().parents[2])
    surroundings = {**os.environ, "LD_PRELOAD": str(tmp_path / "counter.so"), "PYTHONPATH": root}
    told = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=tmp_path,
        env=surroundings,
        check=True,
        capture_output=True,
        text=True,
    )
    durable, passing = map(int, told.stdout.split())
    assert durable >= STEPS
    assert passing == 0
