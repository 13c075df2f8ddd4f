"""Failures end in one message and an exit code, never in a traceback."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import time

import click
import pytest
from click.testing import CliRunner
from command_line import call

from skinrender.cli.failures import FailureGroup
from skinrender.errors import InputError, RunError

COMMAND = [sys.executable, "-m", "skinrender.cli"]


def result_of(error: BaseException):
    """What a command that raises `error` ends in."""

    @click.group(cls=FailureGroup)
    def main() -> None:
        """Fail."""

    @main.command()
    def fail() -> None:
        raise error

    return CliRunner().invoke(main, ["fail"])


def caused_by(cause: OSError, error: RunError) -> RunError:
    error.__cause__ = cause
    return error


@pytest.mark.parametrize(
    ("error", "code", "told"),
    [
        (InputError("wrong", where="a.yaml:1:2", remedy="write b"), 2, "error: a.yaml:1:2: wrong\n  write b\n"),
        (RunError("no luck"), 1, "failed: no luck\n"),
        (caused_by(OSError(errno.ENOSPC, "full"), RunError("x: full")), 1, "failed: x: full\n  free some room"),
        (caused_by(OSError(errno.ENOSPC, "full"), RunError("x\n  do y")), 1, "failed: x\n  do y\n"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (KeyboardInterrupt("3 rounds are kept; use --resume"), 130, "3 rounds are kept; use --resume\n"),
        (
            OSError(errno.ENOSPC, "No space left on device", "x.npz"),
            1,
            "x.npz: No space left on device\n  free some room",
        ),
        (PermissionError(errno.EACCES, "Permission denied", "x"), 1, "x: Permission denied\n  make it readable"),
        (MemoryError(), 1, "out of memory"),
    ],
)
def test_failures_have_their_code_and_message(error, code, told):
    result = result_of(error)
    assert result.exit_code == code
    assert told in result.stderr
    assert result.stdout == ""


def test_a_fault_of_the_program_stays_visible():
    assert isinstance(result_of(ZeroDivisionError()).exception, ZeroDivisionError)


@pytest.mark.parametrize("arguments", [
    ("info", "pipe"), ("compare", "pipe", "pipe"), ("check", "--slabs", "pipe"), ("check", "--slabs", "/dev/zero"),
    ("info", "/dev/zero"),
])  # fmt: skip
def test_what_may_never_end_is_not_opened(tmp_path, monkeypatch, arguments):
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.chdir(tmp_path)
    result = call(*arguments)
    assert result.exit_code == 2
    assert "is not a regular file" in result.stderr


def test_a_scene_whose_name_is_no_text_is_rendered(slab, tmp_path, monkeypatch):
    """A file name of another encoding: it stands as ``?`` in what is written."""
    path = tmp_path / "bad\udcff.yaml"
    path.write_bytes(slab.read_bytes())
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["skinrender", "render", str(path)])
    assert call("render", path).exit_code == 0
    assert "bad?.yaml" in (tmp_path / "out" / "bad?" / "index.html").read_text(encoding="utf-8")


def test_a_folder_whose_name_is_no_text_is_2(slab, tmp_path):
    folder = tmp_path / "\udcff"
    result = call("build", slab, "-o", folder)
    assert result.exit_code == 2 and "its name is not UTF-8" in result.stderr and not folder.exists()


def test_a_reader_that_leaves_is_no_fault(repository):
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run([*COMMAND, "schema"], stdout=writer, stderr=subprocess.PIPE, text=True, cwd=repository)
    os.close(writer)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_1(slab, tmp_path):
    folder = tmp_path / "readonly"
    folder.mkdir(mode=0o500)
    result = call("build", slab, "-o", folder)
    assert result.exit_code == 1
    assert "cannot be written" in result.stderr or "Permission denied" in result.stderr


def test_interrupting_a_trace_is_130_and_tells_how_to_go_on(slab, tmp_path, repository):
    assert call("build", slab, "-o", tmp_path).exit_code == 0
    options = ["--photons", "1e8", "-o", str(tmp_path), "--workers", "1"]
    process = subprocess.Popen(
        [*COMMAND, "trace", str(slab), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=repository,
    )
    wait_for_a_round(tmp_path / "rounds")
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=60)
    assert (process.returncode, stdout) == (130, "")
    assert "finished rounds are kept" in stderr and "--resume" in stderr and "Traceback" not in stderr


def wait_for_a_round(folder) -> None:
    until = time.monotonic() + 60
    while not list(folder.glob("0*.npz")) and not list(folder.glob("round*.npz")):
        assert time.monotonic() < until, "no round was finished"
        time.sleep(0.05)
