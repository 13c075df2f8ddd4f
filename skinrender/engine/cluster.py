"""Rounds walked by the workers of a dask.distributed cluster; the only module that knows dask.

A worker needs no file system in common with this machine: it gets the volume's bytes once, walks rounds in memory and
sends them back, and they are written here, as if they had been walked here. A worker that dies costs its rounds under
way; the scheduler gives them to another.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from skinrender.engine.identity import machine_identity, program_identity
from skinrender.engine.recipe import VolumeRecipe
from skinrender.engine.work import WalkRound
from skinrender.errors import InputError, RunError

REACH_SECONDS = 5
_OPTION = "--scheduler"


@dataclass(frozen=True, eq=False)
class Cluster:
    """A cluster whose workers compute as this machine does.

    Parameters
    ----------
    client : a `distributed.Client`.
    slots : rounds that it walks at once, a thread of a worker each.
    """

    client: Any
    slots: int

    def open_executor(self) -> RoundExecutor:
        """The executor that `executor.in_order` takes in place of a process pool."""
        return RoundExecutor(self.client, self.slots)


@contextmanager
def connect(address: str) -> Iterator[Cluster]:
    """A cluster by its scheduler's address, such as ``tcp://10.0.0.5:8786``.

    Raises
    ------
    InputError : dask is not installed, the address cannot be reached within seconds, there are no workers, or some of
        them would make other bytes: another program, other versions or another type of processor.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            "a scheduler needs dask, which is not installed", where=_OPTION, remedy="pip install 'skinrender[cluster]'"
        ) from error
    for name in ("distributed", "distributed.client"):  # what it would log is told by the errors raised here
        logging.getLogger(name).setLevel(logging.CRITICAL)
    client = Client.__new__(Client)
    try:
        client.__init__(address, timeout=REACH_SECONDS, set_as_default=False, direct_to_workers=True)
    except (OSError, ValueError, TypeError) as error:
        client.close()  # left to the garbage collector it may close while another takes the lock it needs: a deadlock
        raise InputError(
            f"{address} cannot be reached ({str(error) or type(error).__name__})", where=_OPTION,
            remedy="give the address that `dask scheduler` prints, such as tcp://10.0.0.5:8786",
        ) from error  # fmt: skip
    with client:
        threads = client.nthreads()
        if not threads:
            raise InputError(
                f"the scheduler at {address} has no workers", where=_OPTION, remedy="start some with `dask worker`"
            )
        for worker, found in _identities(client).items():
            refuse_unlike(found, identity(), worker)
        yield Cluster(client, sum(threads.values()))


@cache
def identity() -> Mapping[str, Mapping[str, str]]:
    """What has to be alike for the bytes to be alike."""
    return {"program": program_identity(), "processor": machine_identity()}


def refuse_unlike(found: Mapping[str, Any], wanted: Mapping[str, Any], worker: str) -> None:
    """Raise `InputError` unless a worker's `identity` is that of the machine that planned the run."""
    unlike = [
        f"{part} ({key} {found[part].get(key)}, here {value})"
        for part, values in wanted.items()
        for key, value in values.items()
        if found[part].get(key) != value
    ]
    if unlike:
        raise InputError(
            f"worker {worker} would make other bytes than this machine: it differs in {'; '.join(unlike)}",
            where=_OPTION,
            remedy="start the workers from this very installation on processors of one type, and run this command there",
        )


def _identities(client: Any) -> Mapping[str, Any]:
    try:
        return client.run(identity)
    except ImportError as error:
        raise InputError(
            f"a worker cannot load this program ({error})", where=_OPTION,
            remedy="install the same skinrender where the workers run",
        ) from error  # fmt: skip


class RoundExecutor(ThreadPoolExecutor):
    """Has rounds walked on a cluster and writes them here; a thread here waits for each round that is under way.

    Takes the calls that `executor.in_order` makes: ``submit(call, work, index)`` with `work` a `WalkRound`.
    """

    def __init__(self, client: Any, slots: int) -> None:
        super().__init__(slots + 1, thread_name_prefix="skinrender-round")
        self._client = client
        self._under_way: set[Any] = set()
        self._sent: dict[str, Any] = {}

    def submit(self, _call: Callable, work: WalkRound, index: int) -> Future:
        self._send_volume(work.recipe)
        return super().submit(self._round, work, index)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Drop what is under way, and what was sent; a scheduler that is gone has dropped it already."""
        with suppress(OSError, CancelledError):
            self._client.cancel(list(self._under_way))
        super().shutdown(wait, cancel_futures=cancel_futures)
        with suppress(OSError, CancelledError):
            for name in self._sent:
                self._client.unregister_worker_plugin(name)
        self._sent.clear()

    def _send_volume(self, recipe: Any) -> None:
        """Give every worker, also those that come later, the file that a recipe names."""
        if isinstance(recipe, VolumeRecipe):
            name = _file_name(recipe)
            if name not in self._sent:
                self._sent[name] = _volume_file(recipe)
                with _cluster_errors():
                    self._client.register_plugin(self._sent[name], name=name)

    def _round(self, work: WalkRound, index: int) -> Any:
        finished = work.finished(index)
        if finished is not None:
            return finished
        with _cluster_errors():
            future = self._client.submit(_walk_apart, work, index, identity(), pure=False)
            self._under_way.add(future)
            try:
                walked = future.result()
            finally:
                self._under_way.discard(future)
                future.release()
        return work.keep(walked)


@contextmanager
def _cluster_errors() -> Iterator[None]:
    """Turn what befalls a cluster, within the block, into a `RunError` that says how to go on."""
    from distributed.scheduler import KilledWorker

    try:
        yield
    except KilledWorker as error:
        raise RunError(
            "the cluster's workers keep dying over a round (out of memory?)\n"
            "  give them more; what is finished is kept: go on with --resume"
        ) from error
    except (CancelledError, OSError) as error:
        raise RunError(
            "the connection to the cluster's scheduler was lost\n"
            "  what is finished is kept: go on with --resume"
        ) from error


def _file_name(recipe: VolumeRecipe) -> str:
    return f"skinrender-{recipe.provenance['volume']}.npz"


def _volume_file(recipe: VolumeRecipe) -> Any:
    """A plugin that puts the volume's file where a worker keeps its own, when it starts or now."""
    from distributed import WorkerPlugin

    class _VolumeFile(WorkerPlugin):
        def __init__(self, name: str, data: bytes) -> None:
            self.file, self.data = name, data

        def setup(self, worker: Any) -> None:
            (Path(worker.local_directory) / self.file).write_bytes(self.data)

        def teardown(self, worker: Any) -> None:
            (Path(worker.local_directory) / self.file).unlink(missing_ok=True)

    return _VolumeFile(_file_name(recipe), recipe.volume_path.read_bytes())


def _walk_apart(work: WalkRound, index: int, wanted: Mapping[str, Any]) -> Any:
    """Run by a worker: one round, its photons in memory."""
    from distributed import get_worker

    worker = get_worker()
    refuse_unlike(identity(), wanted, worker.address)
    if isinstance(work.recipe, VolumeRecipe):
        path = Path(worker.local_directory) / _file_name(work.recipe)
        work = replace(work, recipe=replace(work.recipe, volume_path=path))
    return work.walk(index)
