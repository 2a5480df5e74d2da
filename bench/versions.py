"""Versions of this program and of what its numbers depend on, for the provenance of every row."""

import importlib.metadata
import platform
import subprocess
from functools import cache
from pathlib import Path

PACKAGES = ("d2ea-bench", "numpy", "scipy", "pandas", "xgboost-cpu", "pyserial", "pymodbus", "SQLAlchemy")


@cache
def versions() -> dict[str, str]:
    """Versions by package, Python's, and the revision of this checkout where there is one."""
    found = {"python": platform.python_version(), "revision": _revision()}
    for package in PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def _revision() -> str:
    """The commit that is checked out, with a + when files differ from it; ``unknown`` outside a checkout."""
    folder = Path(__file__).resolve().parents[1]
    command = ["git", "-C", str(folder), "describe", "--always", "--abbrev=12", "--dirty=+"]
    try:
        told = subprocess.run(command, capture_output=True, text=True, timeout=5.0, check=True)
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return told.stdout.strip() or "unknown"
