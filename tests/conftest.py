"""What holds for all tests: properties are tried on the same examples in every run.

``pytest --hypothesis-profile default`` draws new ones, and keeps what fails.
"""

from hypothesis import settings

settings.register_profile("same", derandomize=True, deadline=None)
settings.load_profile("same")
