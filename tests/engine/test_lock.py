"""Two runs in one folder: the second says so; the dead do not count."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

from skinrender.engine.lock import LOCK_NAME, folder_lock
from skinrender.errors import InputError

HOLDER = """
import sys, time
sys.path[:0] = {path!r}
from pathlib import Path
from skinrender.engine.lock import folder_lock
with folder_lock(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def holder(tmp_path):
    process = subprocess.Popen(
        [sys.executable, "-c", HOLDER.format(path=sys.path), str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout.readline() == "held\n"
    yield process
    process.kill()
    process.wait()
    process.stdout.close()


def test_second_run_is_refused_with_the_first_ones_number(tmp_path, holder):
    with pytest.raises(InputError, match=f"process {holder.pid}"), folder_lock(tmp_path):
        pass


def test_lock_of_a_killed_run_is_taken_over(tmp_path, holder):
    holder.kill()
    holder.wait()
    assert (tmp_path / LOCK_NAME).exists()
    with folder_lock(tmp_path):
        pass


def test_lock_of_another_host_is_respected(tmp_path):
    (tmp_path / LOCK_NAME).write_text(json.dumps({"host": "elsewhere", "pid": 1}))
    with pytest.raises(InputError, match="host elsewhere"), folder_lock(tmp_path):
        pass


@pytest.mark.parametrize("content", ["", "{", "[1]", '{"pid": 7}'])
def test_damaged_lock_is_taken_over(tmp_path, content):
    (tmp_path / LOCK_NAME).write_text(content)
    with folder_lock(tmp_path):
        pass


def test_lock_is_gone_after_use_and_after_failure(tmp_path):
    with pytest.raises(ValueError), folder_lock(tmp_path):
        raise ValueError
    assert list(tmp_path.iterdir()) == []
