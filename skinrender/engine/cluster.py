"""Work done by the workers of a dask.distributed cluster; the only module that knows dask.

A worker needs no file system in common with this machine. It gets the volume's bytes once; it walks rounds in memory
and sends them back, and they are written here, as if they had been walked here; or it gets the photons of some bands
and sends back what they show. A worker that dies costs what it had under way; the scheduler gives that to another.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from skinrender.engine.identity import ESTIMATE_SOURCES, machine_identity, program_identity
from skinrender.engine.recipe import VolumeFile
from skinrender.errors import InputError, RunError
from skinrender.sources import sources_hash

REACH_SECONDS = 5
_OPTION = "--scheduler"


class Work(Protocol):
    """What a cluster can take: pieces by number, each an errand that is sent to a worker."""

    @property
    def volume_file(self) -> VolumeFile | None:
        """The file that workers need."""

    def finished(self, index: int) -> Any:
        """What an earlier run has left of a piece, None if nothing."""

    def errand(self, index: int) -> Callable[[Path | None], Any]:
        """Picklable; called by a worker with the place of its volume file."""

    def keep(self, done: Any) -> Any:
        """What becomes, here, of what an errand returned."""


@dataclass(frozen=True, eq=False)
class Cluster:
    """A cluster whose workers compute as this machine does.

    Parameters
    ----------
    client : a `distributed.Client`.
    slots : pieces of work that it does at once, a thread of a worker each.
    """

    client: Any
    slots: int

    def open_executor(self) -> ClusterExecutor:
        """The executor that `executor.in_order` takes in place of a process pool."""
        return ClusterExecutor(self.client, self.slots)


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
    with ThreadPoolExecutor(1) as thread:  # an event loop of its own, wherever this is called from
        try:
            thread.submit(asyncio.run, _greet(address)).result()
        except (OSError, ValueError, TypeError) as error:
            raise _unreachable(address, error) from error
    client = Client.__new__(Client)
    try:
        client.__init__(address, timeout=REACH_SECONDS, set_as_default=False, direct_to_workers=True)
    except (OSError, ValueError, TypeError) as error:
        client.close()  # left to the garbage collector it may close while another takes the lock it needs: a deadlock
        raise _unreachable(address, error) from error
    with client:
        threads = client.nthreads()
        if not threads:
            raise InputError(
                f"the scheduler at {address} has no workers", where=_OPTION, remedy="start some with `dask worker`"
            )
        for worker, found in _identities(client).items():
            refuse_unlike(found, identity(), worker)
        yield Cluster(client, sum(threads.values()))


async def _greet(address: str) -> None:
    """Greet a scheduler; `Client` would wait for ever for the answer of another service that listens there."""
    from distributed.comm import connect as open_comm

    try:
        comm = await asyncio.wait_for(open_comm(address, timeout=REACH_SECONDS), REACH_SECONDS + 1)
    except TimeoutError as error:
        raise OSError("what listens there does not answer") from error
    except MemoryError as error:  # another protocol's words, read as a length
        raise OSError("what answers there is no dask scheduler") from error
    comm.abort()


def _unreachable(address: str, error: BaseException) -> InputError:
    return InputError(
        f"{address} cannot be reached ({str(error) or type(error).__name__})", where=_OPTION,
        remedy="give the address that `dask scheduler` prints, such as tcp://10.0.0.5:8786",
    )  # fmt: skip


@cache
def identity() -> Mapping[str, Mapping[str, str]]:
    """What has to be alike for the bytes to be alike."""
    return {
        "program": program_identity() | {"estimate": sources_hash(ESTIMATE_SOURCES)},
        "processor": machine_identity(),
    }


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
            remedy="start the workers from this very installation on processors of one type, and run this command "
            "there",
        )


def _identities(client: Any) -> Mapping[str, Any]:
    try:
        return client.run(identity)
    except ImportError as error:
        raise InputError(
            f"a worker cannot load this program ({error})", where=_OPTION,
            remedy="install the same skinrender where the workers run",
        ) from error  # fmt: skip


class ClusterExecutor(ThreadPoolExecutor):
    """Has work done on a cluster; a thread here waits for each piece that is under way, and keeps what comes back.

    Takes the calls that `executor.in_order` makes: ``submit(call, work, index)`` with `work` a `WalkRound` or
    `ShowBands`, whose ``errand(index)`` is what travels.
    """

    def __init__(self, client: Any, slots: int) -> None:
        super().__init__(slots + 1, thread_name_prefix="skinrender-errand")
        self._client = client
        self._under_way: set[Any] = set()
        self._sent: dict[str, Any] = {}

    def submit(self, _call: Callable, work: Work, index: int) -> Future:
        self._send_volume(work.volume_file)
        return super().submit(self._run, work, index)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Drop what is under way, and what was sent; a scheduler that is gone has dropped it already."""
        with suppress(OSError, CancelledError):
            self._client.cancel(list(self._under_way))
        super().shutdown(wait, cancel_futures=cancel_futures)
        with suppress(OSError, CancelledError):
            for name in self._sent:
                self._client.unregister_worker_plugin(name)
        self._sent.clear()

    def _send_volume(self, file: VolumeFile | None) -> None:
        """Give every worker, also those that come later, the file that the work needs."""
        if file is not None and (name := _file_name(file.digest)) not in self._sent:
            self._sent[name] = _volume_plugin(name, file.path.read_bytes())
            with _cluster_errors():
                self._client.register_plugin(self._sent[name], name=name)

    def _run(self, work: Work, index: int) -> Any:
        finished = work.finished(index)
        if finished is not None:
            return finished
        file_name = None if work.volume_file is None else _file_name(work.volume_file.digest)
        with _cluster_errors():
            future = self._client.submit(_run_there, work.errand(index), file_name, identity(), pure=False)
            self._under_way.add(future)
            try:
                done = future.result()
            finally:
                self._under_way.discard(future)
                future.release()
        return work.keep(done)


@contextmanager
def _cluster_errors() -> Iterator[None]:
    """Turn what befalls a cluster, within the block, into a `RunError` that says how to go on."""
    from distributed.scheduler import KilledWorker

    try:
        yield
    except KilledWorker as error:
        raise RunError(
            "the cluster's workers keep dying over one piece of work (out of memory?)\n"
            "  give them more; what is finished is kept: go on with --resume"
        ) from error
    except (CancelledError, OSError) as error:
        raise RunError(
            "the connection to the cluster's scheduler was lost\n"
            "  what is finished is kept: go on with --resume"
        ) from error


def _file_name(digest: str) -> str:
    return f"skinrender-{digest}.npz"


def _volume_plugin(name: str, data: bytes) -> Any:
    """Puts the volume's file where a worker keeps its own, when it starts or now."""
    from distributed import WorkerPlugin

    class _VolumeFile(WorkerPlugin):
        def __init__(self, name: str, data: bytes) -> None:
            self.file, self.data = name, data

        def setup(self, worker: Any) -> None:
            (Path(worker.local_directory) / self.file).write_bytes(self.data)

        def teardown(self, worker: Any) -> None:
            (Path(worker.local_directory) / self.file).unlink(missing_ok=True)

    return _VolumeFile(name, data)


def _run_there(errand: Callable[[Path | None], Any], file_name: str | None, wanted: Mapping[str, Any]) -> Any:
    """Run by a worker."""
    from distributed import get_worker

    worker = get_worker()
    refuse_unlike(identity(), wanted, worker.address)
    return errand(None if file_name is None else Path(worker.local_directory) / file_name)
