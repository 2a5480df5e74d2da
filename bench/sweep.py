"""Sweeps of any size: chunk after chunk through the simulator, on this machine's cores or on a Dask cluster.

Every finished chunk is a Parquet file in a folder beside the result, written in one step; when all are there, they
become the result and the folder goes. A sweep that was killed goes on with the chunks that are missing, if it is the
same sweep: same inputs, same model, same simulator. What is in memory at any time is a few chunks, however many points
there are.
"""

import hashlib
import io
import json
import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from bench.errors import InputError
from bench.table_file import check_ending
from bench.whole_file import replacing, told_of, write_whole
from bench.workers import Workers, on_dask, on_processes
from sim.model import Model
from sim.space import Columns, Space, solve_rows

if TYPE_CHECKING:
    import pandas as pd

CHUNK_ROWS = 50_000  # share the last rounds of a few slow points; 0.3 GiB for each worker
_JOB = "sweep.json"

Watch = Callable[[int, int], None]


class Rows(Protocol):
    """Where the inputs come from; a :class:`sim.space.Space` is one."""

    def __len__(self) -> int:
        """How many rows."""
        ...

    def rows(self, start: int, stop: int) -> Columns:
        """Columns of a stretch of the rows."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class TableRows:
    """The rows of a table that is in memory."""

    table: "pd.DataFrame"

    def __len__(self) -> int:
        return len(self.table)

    def rows(self, start: int, stop: int) -> Columns:
        """Columns of a stretch of the rows."""
        part = self.table.iloc[start:stop]
        return {str(name): part[name].to_numpy() for name in part.columns}


@dataclass(frozen=True, slots=True, kw_only=True)
class Sweep:
    """A model, its inputs, and the file that will hold the result; ``passed_on`` are columns that are no inputs."""

    model: Model
    inputs: Rows
    out: Path
    chunk_rows: int = CHUNK_ROWS
    passed_on: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        check_ending(self.out)
        if self.chunk_rows < 1:
            raise InputError.of("command line", "--chunk", self.chunk_rows, "at least 1 row")

    def __len__(self) -> int:
        return -(-len(self.inputs) // self.chunk_rows)

    def chunk(self, number: int) -> Columns:
        """Inputs of a chunk."""
        start = number * self.chunk_rows
        return self.inputs.rows(start, start + self.chunk_rows)

    @property
    def folder(self) -> Path:
        """Where finished chunks wait."""
        return self.out.with_name(self.out.name + ".parts")

    def part(self, number: int) -> Path:
        """The file of a chunk."""
        return self.folder / f"{number:06d}.parquet"

    def identity(self) -> dict[str, object]:
        """What two runs of one sweep have in common."""
        return {
            "rows": len(self.inputs),
            "chunk_rows": self.chunk_rows,
            "inputs": self._inputs_hash(),
            "model": json.loads(json.dumps(self.model.as_plain())),
            "simulator": _simulator_hash(),
        }

    def _inputs_hash(self) -> str:
        """SHA-256, shortened, of a space's axes or of a table's columns."""
        if isinstance(self.inputs, Space):
            named = {axis.name: axis.values for axis in self.inputs.axes}
        else:
            named = self.inputs.rows(0, len(self.inputs))
        digest = hashlib.sha256()
        for name, values in named.items():
            digest.update(f"{name} {values.tolist()}".encode())
        return digest.hexdigest()[:16]


@dataclass(frozen=True, slots=True, kw_only=True)
class Swept:
    """What a sweep found: points, how many run, why the others do not, and how many were there before."""

    points: int
    feasible: int
    reasons: Counter[str]
    resumed: int


def run_sweep(sweep: Sweep, workers: Workers, watch: Watch) -> Swept:
    """Simulate what is missing, and put the result together; ``watch(points done, all points)``.

    Raises
    ------
    InputError
        When the folder of unfinished chunks belongs to another sweep.
    """
    _claim(sweep)
    missing = [k for k in range(len(sweep)) if not sweep.part(k).exists()]
    resumed = len(sweep) - len(missing)
    done = min(resumed * sweep.chunk_rows, len(sweep.inputs))
    watch(done, len(sweep.inputs))
    for k, content in _solved(sweep, missing, workers):
        with replacing(sweep.part(k)) as file:
            file.write_bytes(content)
        done += min(sweep.chunk_rows, len(sweep.inputs) - k * sweep.chunk_rows)
        watch(min(done, len(sweep.inputs)), len(sweep.inputs))
    return _put_together(sweep, resumed)


def solve_chunk(model: Model, columns: Columns, passed_on: Sequence[str] = (), processes: int = 1) -> bytes:
    """Simulated rows as the content of a Parquet file; runs wherever the workers are."""
    inputs = {name: values for name, values in columns.items() if name not in passed_on}
    kept = {name: columns[name] for name in passed_on}
    solved = solve_rows(model, inputs, processes)
    table = pa.table({name: pa.array(values) for name, values in {**kept, **solved}.items()})
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd")
    return buffer.getvalue()


def _claim(sweep: Sweep) -> None:
    """Make the folder of this sweep's chunks, or see that it is this sweep's."""
    job, identity = sweep.folder / _JOB, sweep.identity()
    if not job.exists():
        sweep.folder.mkdir(parents=True, exist_ok=True)
        write_whole(job, json.dumps(identity, indent=1))
        return
    found = json.loads(job.read_text(encoding="utf-8"))
    differs = [key for key in identity if found.get(key) != identity[key]]
    if differs:
        allowed = (
            f"holds chunks of another sweep ({', '.join(differs)} differ): remove it, or choose another --out"
        )
        raise InputError.of(sweep.folder, _JOB, None, allowed)


def _solved(sweep: Sweep, missing: list[int], workers: Workers) -> Iterator[tuple[int, bytes]]:
    tasks = ((k, (sweep.model, sweep.chunk(k), sweep.passed_on)) for k in missing)
    if workers.dask is not None:
        return on_dask(solve_chunk, tasks, workers)
    if workers.processes == 1 or len(missing) < 2:
        return ((k, solve_chunk(*arguments, processes=workers.processes)) for k, arguments in tasks)
    return on_processes(solve_chunk, tasks, workers)


def _put_together(sweep: Sweep, resumed: int) -> Swept:
    """One file from all chunks, in their order, chunk by chunk; then the folder goes."""
    feasible, reasons = 0, Counter[str]()
    beside = sweep.out.with_name(sweep.out.name + ".part")
    with told_of(sweep.out):
        with _Output(beside, sweep.out.suffix) as output:
            for k in range(len(sweep)):
                table = pq.read_table(sweep.part(k))
                flags = np.asarray(table["feasible"])
                feasible += int(flags.sum())
                reasons.update(table["reason"].filter(pa.array(~flags)).to_pylist())
                output.append(table)
        os.chmod(beside, 0o644)
        os.replace(beside, sweep.out)
    shutil.rmtree(sweep.folder)
    return Swept(points=len(sweep.inputs), feasible=feasible, reasons=reasons, resumed=resumed)


class _Output:
    """A CSV or Parquet file that grows by tables."""

    def __init__(self, path: Path, ending: str) -> None:
        self._path, self._ending = path, ending
        self._writer: pq.ParquetWriter | None = None
        self._started = False

    def __enter__(self) -> "_Output":
        return self

    def append(self, table: pa.Table) -> None:
        """Add rows."""
        if self._ending == ".csv":
            table.to_pandas().to_csv(
                self._path, index=False, header=not self._started, mode="a" if self._started else "w"
            )
        else:
            self._writer = self._writer or pq.ParquetWriter(self._path, table.schema, compression="zstd")
            self._writer.write_table(table.cast(self._writer.schema))
        self._started = True

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is not None:
            self._path.unlink(missing_ok=True)  # it may be what fills the disk
        if self._writer is not None:
            self._writer.close()


def _simulator_hash() -> str:
    """SHA-256, shortened, of the simulator's own files."""
    digest = hashlib.sha256()
    root = Path(str(files("sim")))
    for path in sorted(p for p in root.rglob("*") if p.suffix in (".py", ".toml")):
        digest.update(path.relative_to(root).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
