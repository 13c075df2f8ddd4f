"""What the shell and the terminal see: colors on a terminal only, completion by the Tab key."""

from __future__ import annotations

import os
import pty
import subprocess
import sys

import pytest

COMMAND = [sys.executable, "-m", "skinrender.cli"]
FAILING = [*COMMAND, "build", "none.yaml"]
RED = b"\x1b[31m"


def on_a_terminal(command: list[str], **environment: str) -> bytes:
    """What a command writes to a terminal."""
    leader, follower = pty.openpty()
    plain = {key: value for key, value in os.environ.items() if key != "NO_COLOR"}
    with subprocess.Popen(command, stdout=follower, stderr=follower, env=plain | environment) as process:
        os.close(follower)
        said = b""
        while process.poll() is None or said == b"":
            try:
                said += os.read(leader, 4096)
            except OSError:  # how Linux tells that the last writer has closed it
                break
    os.close(leader)
    return said


def test_errors_are_red_on_a_terminal():
    assert RED in on_a_terminal(FAILING) and b"no such scene file" in on_a_terminal(FAILING)


def test_no_color_is_heeded():
    said = on_a_terminal(FAILING, NO_COLOR="1")
    assert b"error: none.yaml: no such scene file" in said and b"\x1b" not in said


def test_pipes_get_no_colors():
    done = subprocess.run(FAILING, capture_output=True)
    assert done.stderr.startswith(b"error: none.yaml: ") and b"\x1b" not in done.stdout + done.stderr


def completed(words: str) -> list[str]:
    """What the Tab key offers in bash after these words, the last of which may be unfinished."""
    told = {"_SKINRENDER_COMPLETE": "bash_complete", "COMP_WORDS": words, "COMP_CWORD": str(words.count(" "))}
    program = "from skinrender.cli import main; main(prog_name='skinrender')"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=os.environ | told)
    return [line.partition(",")[2] for line in done.stdout.splitlines()]


@pytest.mark.parametrize(("words", "offered"), [
    ("skinrender re", ["render", "report"]),
    ("skinrender estimate --meth", ["--method"]),
    ("skinrender estimate x.yaml --method ", ["beam", "point", "reference"]),
    ("skinrender export x.yaml --to m", ["mitsuba", "mcx"]),
])  # fmt: skip
def test_the_tab_key_completes(words, offered):
    assert completed(words) == offered


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_documented_line_gives_a_script(shell):
    done = subprocess.run(
        [sys.executable, "-c", "from skinrender.cli import main; main(prog_name='skinrender')"], capture_output=True,
        text=True, env=os.environ | {"_SKINRENDER_COMPLETE": f"{shell}_source"},
    )  # fmt: skip
    assert done.returncode == 0 and f"_SKINRENDER_COMPLETE={shell}_complete" in done.stdout
