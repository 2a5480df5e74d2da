"""What holds for all tests: properties are tried on the same examples in every run, and no verb slows those after it.

``pytest --hypothesis-profile default`` draws new ones, and keeps what fails.
"""

import pytest
from hypothesis import settings

import bench  # noqa: F401  before any test brings numpy: one thread of linear algebra a process, as commands have

settings.register_profile("same", derandomize=True, deadline=None)
settings.load_profile("same")


@pytest.fixture(autouse=True)
def given_way(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """How often, and by how much, a verb has let others go first: told only, or all tests after it would run so."""
    asked: list[int] = []
    monkeypatch.setattr("os.nice", asked.append)
    return asked
