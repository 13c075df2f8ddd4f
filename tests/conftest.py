"""What tests of all packages share."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def repository() -> Path:
    """The folder of the checkout, with the shipped scenes and patterns."""
    return Path(__file__).parents[1]
