"""Kills and signals at random moments: real processes of the command line, and a tally of what they lost.

``python -m tests.system.kills --tries 300`` runs a campaign and prints the tally.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from click.testing import CliRunner

from benchmarks.processes import children_of
from skinrender.cli import main
from skinrender.photonmap.photon_map import open_map
from skinrender.photonmap.store import read_header, read_round, round_files

COMMAND = (sys.executable, "-m", "skinrender.cli")
SCENE = """\
patch: {size_mm: [1, 1], columns: [1, 1]}
bands_nm: [550]
slab:
  layers:
    - {thickness_mm: 1, mu_a_per_mm: 1, mu_s_per_mm: 5, g: 0.5, refractive_index: 1.4}
light: {kind: collimated}
camera: {pixels: [16, 16]}
photons: {stored: 2e6}
"""
MOMENTS = ("anywhere", "walking", "writing the map")
PATIENCE_S = 120.0
SPARED = 0.2


@dataclass
class Tally:
    """What a campaign came to."""

    tries: int = 0
    struck: int = 0
    workers_struck: int = 0
    by_moment: dict[str, int] = field(default_factory=dict)
    finished_rounds_seen: int = 0
    bytes_seen: int = 0
    bytes_lost: int = 0
    runs_compared: int = 0
    semaphores_left: int = 0


@dataclass(frozen=True)
class Stage:
    """A small scene with its volume built, and the map that an undisturbed run makes of it."""

    scene: Path
    volume: Path
    expected: str

    def begin(self, folder: Path) -> None:
        """A folder ready to be traced in."""
        folder.mkdir()
        (folder / "volume.npz").write_bytes(self.volume.read_bytes())


def set_stage(folder: Path) -> Stage:
    """Build and trace the scene once, undisturbed; also compiles the kernels."""
    scene, out = folder / "slab.yaml", folder / "undisturbed"
    scene.write_text(SCENE, encoding="utf-8")
    for command in ("build", "trace"):
        done = CliRunner().invoke(main, [command, str(scene), "-o", str(out), "-q"])
        assert done.exit_code == 0, done.stderr
    return Stage(scene, out / "volume.npz", digest(out / "photons.npz"))


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def start(command: str, stage: Stage, out: Path, *options: str) -> subprocess.Popen:
    """A process of the command line in a group of its own."""
    return subprocess.Popen(
        [*COMMAND, command, str(stage.scene), "-o", str(out), *options],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
    )  # fmt: skip


def wait_for(condition, process: subprocess.Popen) -> bool:
    """Wait until the condition holds; False if the process ended before."""
    until = time.monotonic() + PATIENCE_S
    while not condition():
        if process.poll() is not None:
            return False
        assert time.monotonic() < until, "nothing happens"
        time.sleep(0.002)
    return True


def hears_sigterm(process: subprocess.Popen) -> bool:
    """Whether the process has begun its command: from then on it answers to signals."""
    with contextlib.suppress(OSError):
        for line in Path(f"/proc/{process.pid}/status").read_text().splitlines():
            if line.startswith("SigCgt:"):
                return bool(int(line.split()[1], 16) >> (signal.SIGTERM - 1) & 1)
    return False


def wait_for_moment(moment: str, process: subprocess.Popen, out: Path, chance: random.Random) -> bool:
    """Wait for a random moment of a kind; False if the process ended before."""
    rounds = len(round_files(out / "rounds"))
    if moment == "walking":
        more = rounds + chance.randrange(1, 12)
        if not wait_for(lambda: len(round_files(out / "rounds")) >= more or _map_begun(out), process):
            return False
        time.sleep(chance.uniform(0, 0.03))
    elif moment == "writing the map":
        if not wait_for(lambda: _map_begun(out), process):
            return False
        time.sleep(chance.uniform(0, 0.05))
    else:
        time.sleep(chance.uniform(0, 2.5))
    return process.poll() is None


def _map_begun(out: Path) -> bool:
    return any(out.glob(".photons.*.part.npz"))


def workers_of(pid: int) -> list[int]:
    """Worker processes that a run has started."""
    found = []
    for child in sorted(children_of(pid)):
        with contextlib.suppress(OSError):
            if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(child)
    return found


def group_of(session: int) -> list[int]:
    """Living processes of a session."""
    alive = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            fields = stat.read_text().rpartition(")")[2].split()
            if int(fields[3]) == session and fields[0] != "Z":
                alive.append(int(stat.parent.name))
    return alive


def semaphores() -> set[str]:
    """Named semaphores of multiprocessing."""
    return {path.name for path in Path("/dev/shm").glob("sem.mp-*")}


def abandoned_semaphores(before: set[str]) -> int:
    """Named semaphores made since that no living process maps and that do not go away (other programs make some too).

    A process pool makes some; killed between making one and telling its tracker of it, it leaves the 32 bytes behind.
    """
    until = time.monotonic() + 5
    while new := semaphores() - before:
        mapped = ""
        for maps in Path("/proc").glob("[0-9]*/maps"):
            with contextlib.suppress(OSError):
                mapped += maps.read_text()
        abandoned = sum(name not in mapped for name in new)
        if not abandoned or time.monotonic() > until:
            return abandoned
        time.sleep(0.05)
    return 0


def look_over(out: Path, expected: str) -> dict[str, tuple[int, int]]:
    """Every file that has its name must be whole; (inode, bytes) of the rounds."""
    found = {}
    if (out / "photons.npz").exists():
        open_map(out / "photons.npz", verify=True, check_photons=True)
        assert digest(out / "photons.npz") == expected
        return found  # what there is of the rounds was being deleted
    rounds = out / "rounds"
    if files := round_files(rounds):
        key = read_header(rounds / "run.npz").key
        for index, path in files.items():
            assert read_round(path, key, verify=True).index == index
            found[path.name] = (path.stat().st_ino, path.stat().st_size)
    return found


def lost_bytes(before: dict[str, tuple[int, int]], after: dict[str, tuple[int, int]], out: Path) -> int:
    """Bytes of finished rounds that are gone or were made again, unless the map that took them in is there."""
    if not after and (out / "photons.npz").exists():
        return 0
    return sum(size for name, (inode, size) in before.items() if after.get(name, (0, 0))[0] != inode)


def campaign(stage: Stage, folder: Path, tries: int, seed: int, tally: Tally, *, workers: int = 1) -> None:
    """Kill runs with SIGKILL at random moments and resume them, until so many tries are made; every finished map is
    compared.

    With several workers a worker is killed in every second try, the parent in the others.
    """
    chance, wanted, life = random.Random(seed), tally.tries + tries, 0
    while tally.tries < wanted:
        out = folder / f"life-{workers}-{life}"
        stage.begin(out)
        live(stage, out, chance, tally, wanted, workers)
        life += 1


def live(stage: Stage, out: Path, chance: random.Random, tally: Tally, wanted: int, workers: int) -> None:
    """One run, killed again and again until it is spared: one try in five, and once there were enough."""
    rounds: dict[str, tuple[int, int]] = {}
    done = False
    while not done:
        semaphores_before = semaphores()
        spared = tally.tries >= wanted or chance.random() < SPARED
        process = start("trace", stage, out, "--resume", "-q", "--workers", str(workers))
        of_worker = workers > 1 and tally.tries % 2
        moment = "walking" if of_worker else MOMENTS[tally.tries % len(MOMENTS)]
        if not spared and wait_for_moment(moment, process, out, chance):
            victims = workers_of(process.pid) if of_worker else [process.pid]
            if victims:  # a run whose rounds are all there needs no workers
                strike(chance.choice(victims), moment, tally)
                tally.workers_struck += bool(of_worker)
        told = process.communicate(timeout=PATIENCE_S)[1]
        assert process.returncode in (0, -signal.SIGKILL), told
        gone(process.pid)
        tally.semaphores_left += abandoned_semaphores(semaphores_before) if workers > 1 else 0
        now = look_over(out, stage.expected)
        tally.bytes_lost += lost_bytes(rounds, now, out)
        tally.finished_rounds_seen += len(now.keys() - rounds.keys())
        tally.bytes_seen += sum(size for name, (_, size) in now.items() if name not in rounds)
        rounds, done = now, process.returncode == 0
    assert digest(out / "photons.npz") == stage.expected
    assert {path.name for path in out.iterdir()} == {"volume.npz", "photons.npz", "timing.csv"}
    tally.runs_compared += 1
    for path in out.iterdir():
        path.unlink()


def strike(victim: int, moment: str, tally: Tally) -> None:
    """Kill a process, if it is still there."""
    tally.tries += 1
    tally.by_moment[moment] = tally.by_moment.get(moment, 0) + 1
    with contextlib.suppress(ProcessLookupError):
        os.kill(victim, signal.SIGKILL)
        tally.struck += 1


def gone(session: int) -> None:
    """No process of the session is left, if not at once then soon."""
    until = time.monotonic() + 10
    while left := group_of(session):
        assert time.monotonic() < until, f"processes are left: {left}"
        time.sleep(0.01)


def report() -> int:
    """Run a campaign as the command line asks and print its tally; 1 if bytes were lost."""
    parser = argparse.ArgumentParser(description="Kill traces at random moments and count what is lost.")
    parser.add_argument("--tries", type=int, default=300)
    parser.add_argument("--workers", type=int, default=1, help="with 2 and more, every second try kills one of them")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    tally, began = Tally(), time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        stage = set_stage(Path(folder))
        try:
            campaign(stage, Path(folder), options.tries, options.seed, tally, workers=options.workers)
        finally:
            for name, value in vars(tally).items():
                print(f"{name:>20}  {value}")
    print(f"{'seconds':>20}  {time.monotonic() - began:.0f}")
    return int(tally.bytes_lost > 0)


if __name__ == "__main__":
    sys.exit(report())
