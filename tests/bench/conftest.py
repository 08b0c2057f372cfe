"""The router and the runs of the service tests, for this folder too."""

from tests.services.conftest import endpoint, make_run, run_info, serve  # noqa: F401
