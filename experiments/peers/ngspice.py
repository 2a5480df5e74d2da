"""ngspice as a peer: runs a circuit file in a process of its own and reads what it measured."""

import re
import shutil
import subprocess
import tempfile
from pathlib import Path

_MEASURED = re.compile(r"^(\w+)\s*=\s+([-+.\deE]+)", re.MULTILINE)
_TIMEOUT_S = 300.0


class NgspiceFailed(RuntimeError):
    """ngspice is not there, took too long, or did not come through; the message has its last words."""


def installed() -> bool:
    """Whether there is an ngspice to run."""
    return shutil.which("ngspice") is not None


def run_ngspice(circuit: str) -> dict[str, float]:
    """What the ``meas`` lines of a circuit file say, by name in lower case (ngspice folds it)."""
    if not installed():
        raise NgspiceFailed("no program ngspice on the PATH; Debian has it in the package ngspice")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "point.cir")
        path.write_text(circuit, encoding="utf-8")
        try:
            done = subprocess.run(
                ["ngspice", "-n", "-b", path.name], cwd=folder, capture_output=True, text=True, timeout=_TIMEOUT_S,
                stdin=subprocess.DEVNULL, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired as error:
            raise NgspiceFailed(f"ngspice took longer than {_TIMEOUT_S:.0f} s") from error
    measured = {name: float(value) for name, value in _MEASURED.findall(done.stdout)}
    if "i_l_rms_a" not in measured:
        said = [line for line in done.stderr.splitlines() if line.strip()]
        raise NgspiceFailed(f"ngspice measured nothing: {said[0] if said else 'no message'}")
    return measured
