"""The command line as a person calls it."""

import pytest

from bench import cli


def d2ea(*arguments: str) -> int:
    """Run one command; its exit code."""
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    return int(ended.value.code or 0)
