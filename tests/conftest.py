"""Settings of all tests."""

from hypothesis import settings

# Shared machines stall, and kernels compile at their first call: no time limit on one example.
settings.register_profile("project", deadline=None, derandomize=True)
settings.load_profile("project")
