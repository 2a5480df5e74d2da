"""The comparison of pages with what is printed can fail."""

import pytest

from tests.docs.console import Command, mismatch


@pytest.mark.parametrize(
    ("expected", "printed", "same"),
    [
        ("campaign 1 done: ... rows\n", "campaign 1 done: 45 rows\n", True),
        ("campaign 1 done: ... rows\n", "campaign 2 done: 45 rows\n", False),
        ("first\n...\nlast\n", "first\nlast\n", True),
        ("first\n...\nlast\n", "first\nsomething\n", False),
        (" id  name ...\n 1   x\n", " id   name   more\n  1  x \n", True),
        ("all\n", "all\nand more\n", False),
    ],
)
def test_what_does_not_fit_is_seen(expected: str, printed: str, same: bool) -> None:
    assert (mismatch(Command(("d2ea",), expected), printed) == "") is same
