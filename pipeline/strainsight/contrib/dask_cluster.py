"""Sweeps on a Dask cluster. Clients, scheduler and workers trust each other."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import time
import uuid
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import strainsight
from strainsight.errors import StrainsightError, UserError
from strainsight.parallel import Captured, P, Progress, R, S, Sweep, captured, ignore_progress, repeated

PATIENCE = 5.0
"""[s] for the scheduler to answer, and for a first worker."""
LOOK = 0.2
"""[s] between two checks for results."""
DESERTED = 60.0
"""[s] without any worker after which a sweep is aborted."""
SAME = ("strainsight", "numpy", "scipy", "numba", "dask", "distributed", "cloudpickle")
"""Packages that need the same version everywhere: the first four determine the results, the rest transports them."""
CODE = "checksum of the source code of strainsight"
SILENT = 30.0
"""[s] for the scheduler to answer during a sweep, when it may be busy."""
CARRYING = 10
"""Factor on that for the transfer of results."""


FROZEN = 360.0
"""[s] without heartbeat after which a worker counts as frozen. Dask reassigns its tasks after 300 s. Heartbeats of a computing
worker come from another thread."""
ANSWER = 60.0
"""[s] for all workers to report their versions, before a computation."""
EVERY = 1.0
"""[s] between two checks of the workers."""


class _SilentError(Exception):
    """The scheduler exists, but does not answer."""


@dataclass
class _Watch:
    """Time of the last check and of the last known worker [s]; worker → its last heartbeat, and when it changed."""

    looked: float
    last_worker: float
    heartbeats: dict[str, tuple[float, float]] = field(default_factory=dict)


@contextmanager
def on_cluster(address: str) -> Iterator[Sweep]:
    """Sweeps on the workers of a scheduler, as in "tcp://127.0.0.1:8786". Raises UserError if `distributed` is missing, no
    scheduler answers, no worker exists, or versions differ."""
    try:
        from distributed import Client
    except ImportError:
        raise UserError(
            "the package distributed is not installed", key="--dask", remedy="pip install 'strainsight[dask]'"
        ) from None
    # The errors below report broken connections.
    logging.getLogger("distributed").setLevel(logging.CRITICAL)
    _require_scheduler(address)
    client = Client(address, timeout=PATIENCE, set_as_default=False)
    try:
        _require_workers(client, address)
        yield partial(_sweep, client)
    finally:
        client.close(timeout=PATIENCE)


def _require_scheduler(address: str) -> None:
    """Check the scheduler before a client is created: a client that fails to connect keeps trying."""
    from distributed.core import rpc
    from distributed.security import Security

    async def who() -> str:
        async with rpc(address, connection_args=Security().get_connection_args("client")) as scheduler:
            return str((await scheduler.identity())["type"])

    try:
        kind = asyncio.run(asyncio.wait_for(who(), PATIENCE))
    # of a socket, an address, a name, a certificate, or of reading what another program sent
    except Exception as error:
        why = str(error).splitlines()[0] if isinstance(error, ValueError | TypeError) else "no answer"
        raise UserError(
            f"no Dask scheduler at {address}: {why or type(error).__name__}",
            key="--dask",
            remedy="start a scheduler (`dask scheduler`) and pass the address that it prints; "
            f"the scheduler must answer within {PATIENCE:g} s",
        ) from None
    if kind != "Scheduler":
        raise UserError(
            f"{address} is a Dask {kind.lower()}, not a scheduler",
            key="--dask",
            remedy="pass the address of the scheduler",
        )


def _require_workers(client: Any, address: str) -> None:
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise UserError(
            f"the Dask scheduler at {address} has no workers",
            key="--dask",
            remedy=f"start a worker: dask worker {address}",
        ) from None

    async def collect_versions() -> tuple[Any, Any]:
        scheduler = await client.scheduler.versions(packages=SAME)
        return scheduler, await client.scheduler.broadcast(msg={"op": "versions", "packages": SAME}, on_error="ignore")

    try:
        scheduler, workers = client.sync(collect_versions, callback_timeout=ANSWER)
    except TimeoutError:
        raise _frozen(f"a worker of the Dask scheduler at {address} has not answered for {ANSWER:g} s") from None
    _refuse_others(scheduler["packages"], "scheduler")
    for worker, report in workers.items():
        _refuse_others(report["packages"], f"worker {worker}")


def _refuse_others(theirs: Mapping[str, str | None], who: str, ours: Mapping[str, str | None] | None = None) -> None:
    """Raise UserError if a package has another version there."""
    other = [
        f"{package} {_format_version(remote)} ({_format_version(local)} on this computer)"
        for package, local in (ours or versions()).items()
        if (remote := theirs.get(package)) != local
    ]
    if other:
        raise UserError(
            f"the Dask {who} has a different installation: {', '.join(other)}",
            key="--dask",
            remedy="install the same versions on all machines: results must not depend on the machine",
        )


@cache
def versions() -> dict[str, str | None]:
    """Versions of Python and the packages that must agree."""
    from distributed.versions import get_package_info

    info: dict[str, str | None] = get_package_info(SAME)
    return {name: info[name] for name in ("python", *SAME)}


@cache
def sources() -> str:
    """Sixteen digits of sha256 over all modules of this package, to distinguish checkouts of one version."""
    root, sha = Path(strainsight.__file__).parent, hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        sha.update(path.relative_to(root).as_posix().encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return sha.hexdigest()[:16]


def _format_version(version: str | None) -> str:
    return "missing" if version is None else version.removesuffix(".final.0")


def _sweep(
    client: Any, task: Callable[[S, P], R], points: Sequence[P], shared: S, progress: Progress = ignore_progress
) -> list[R]:
    import dask
    from distributed import CancelledError
    from distributed.comm import CommClosedError

    if not points:
        return []
    # Not scattered: scattered data die with the workers that hold them. The scheduler keeps how this came about, the data
    # themselves, and gives them to another worker; so it does with the tasks. Workers fetch them from each other.
    run = f"{task.__name__}-{uuid.uuid4().hex}"
    # Pairs of name and place: the scheduler treats them as one group, and spreads them over all workers.
    keys = [(run, place) for place in range(len(points))]
    ours = versions() | {CODE: sources()}
    with dask.config.set({"distributed.admin.large-graph-warning-threshold": "1 TiB"}):
        future = client.submit(_identity, shared, key=f"shared-{run}")
        futures = client.map(_run_task, list(points), key=keys, task=task, shared=future, ours=ours, pure=False)
    try:
        return _collect(client, futures, progress)
    except _SilentError:
        why = f"the Dask scheduler has not answered for {SILENT:g} s"
        raise _lost(why, "check the machine of the scheduler, or restart the scheduler") from None
    except BaseException as error:
        # The client may still be trying to connect again when the first future tells that the connection is lost.
        if client.status != "running" or isinstance(error, CommClosedError | CancelledError):
            raise _lost(
                "the connection to the Dask scheduler was lost", "restart the scheduler and its workers"
            ) from error
        client.cancel(futures, force=True)
        raise


def _identity(shared: Any) -> Any:
    return shared


def _run_task(point: Any, *, task: Callable[[Any, Any], Any], shared: Any, ours: Mapping[str, str | None]) -> Captured:
    """Run a task on a worker, after checking its versions: it may have joined late."""
    from distributed import get_worker

    _refuse_others(versions() | {CODE: sources()}, f"worker {get_worker().address}", ours)
    return captured(task, shared, point)


def _collect(client: Any, futures: Sequence[Any], progress: Progress) -> list[Any]:
    """The results in order; the error of a task ends the sweep."""
    from distributed import wait

    results: dict[Any, Captured] = {}
    waiting, watch = set(futures), _Watch(time.monotonic(), time.monotonic())
    while waiting:
        try:
            with client.as_current():
                done = wait(waiting, timeout=LOOK, return_when="FIRST_COMPLETED").done
        except TimeoutError:
            _look_for_workers(client, watch)
            continue
        results |= _results(client, done)
        waiting -= done
        progress(len(results) / len(futures))
    return [repeated(results[future.key]) for future in futures]


def _results(client: Any, done: Collection[Any]) -> dict[Any, Captured]:
    from distributed import KilledWorker

    async def gathered() -> list[Captured]:
        return await client.gather(list(done), asynchronous=True)

    try:
        values = client.sync(gathered, callback_timeout=CARRYING * SILENT)
        return dict(zip((future.key for future in done), values, strict=True))
    except TimeoutError:
        _identities(client)
        raise _frozen(f"a Dask worker has not sent its results for {CARRYING * SILENT:g} s") from None
    except KilledWorker:
        raise StrainsightError(
            "several workers of the cluster were killed by the same task, probably because memory ran out",
            remedy="start workers with more memory (dask worker --memory-limit) or fewer threads (--nthreads 1)",
        ) from None


def _identities(client: Any) -> dict[str, Any]:
    """Worker → its description by the scheduler; raises _SilentError without an answer."""
    try:
        return client.sync(client.scheduler.identity, n_workers=-1, callback_timeout=SILENT)["workers"]
    except TimeoutError:
        raise _SilentError from None


def _look_for_workers(client: Any, watch: _Watch) -> None:
    """Raise UserError if there was no worker, or one sent no heartbeat, for too long; _SilentError as above."""
    if time.monotonic() - watch.looked < EVERY:
        return
    workers = _identities(client)
    now = watch.looked = time.monotonic()
    if workers:
        watch.last_worker = now
    elif now - watch.last_worker > DESERTED:
        raise _lost(f"the Dask cluster has had no worker for {DESERTED:g} s", "start workers")
    beats = {worker: identity["last_seen"] for worker, identity in workers.items()}
    before = watch.heartbeats
    watch.heartbeats = {
        w: (beat, before[w][1] if before.get(w, (0, 0))[0] == beat else now) for w, beat in beats.items()
    }
    for worker, (_, since) in watch.heartbeats.items():
        if now - since > FROZEN:
            raise _frozen(f"the Dask worker {worker} has not answered for {FROZEN:g} s")


def _frozen(what: str) -> UserError:
    return _lost(what, "check that the machine of the worker is running, and restart the worker")


def _lost(what: str, remedy: str) -> UserError:
    return UserError(what, key="--dask", remedy=f"{remedy}, then run the command again: finished stages are reused")
