"""A short run of `make fuzz`."""

from __future__ import annotations

import pytest

from tests.system.fuzz import READERS, fuzz


@pytest.mark.parametrize("name", READERS)
def test_made_up_inputs_are_read_or_refused(tmp_path, name):
    count = fuzz(name, tmp_path, 150)
    assert count["read"] > 0 and count["refused"] > 0
