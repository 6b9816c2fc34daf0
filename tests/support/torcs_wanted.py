"""Whether TORCS is there: where it may be missing its tests are skipped, where it must not be they fail."""

from __future__ import annotations

import os

import pytest

from dpsearch.envs.torcs import Installation, TorcsError


def require_torcs() -> None:
    """For the top of a module: goes on only if TORCS is installed."""
    try:
        Installation.find()
    except TorcsError as error:
        if os.environ.get("DPSEARCH_REQUIRE_TORCS"):
            pytest.fail(str(error), pytrace=False)
        pytest.skip(str(error), allow_module_level=True)
