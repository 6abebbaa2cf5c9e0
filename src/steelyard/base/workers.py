"""Many independent pieces of work: in this process, on its cores, or on a cluster of Dask.

There is no engine here: the executors are those of Python and of Dask. A piece whose worker dies is
done again by another one; what is done is handed out at once, in the order in which it ends.
"""

import os
import re
import socket
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from time import perf_counter
from typing import Any, TypeVar

from steelyard.base.errors import DataError, require

Item = TypeVar("Item")
Common = TypeVar("Common")
Result = TypeVar("Result")

Work = Callable[[Common, Item], Result]
Done = Iterator[tuple[int, Result]]

HERE = "local:1"  # the cluster that is this process
FEW = 24  # pieces up to which starting processes takes longer than it saves
DEATHS = 3  # workers of this machine that may die on the way
OF_WORKERS = {
    "distributed.nanny.pre-spawn-environ": {"OMP_NUM_THREADS": 1},
    "distributed.worker.profile.enabled": False,
}
"""What workers of Dask start with. Its own choice of memory's thresholds lets every array of some
size be mapped anew: logs then take twice the time."""
TASK_S = 0.5  # time of one task of a cluster: small pieces go together, as each costs 10 ms
AHEAD = 2  # tasks that a worker has, one of them waiting
START_S = 60  # time in which a cluster has to answer


def each(work: Work[Common, Item, Result], common: Common, items: Sequence[Item],
         cluster: str | None, processes: int) -> Done[Result]:  # fmt: skip
    """Number and result of every piece, as they end.

    Args:
        work: A function of a module, called with `common` and one of `items`.
        common: What all pieces share; it is sent to each worker once.
        items: What differs.
        cluster: Address of a Dask scheduler, `tcp://HOST:PORT`, or `local:N` for one with `N`
            workers of this machine, this process if that is one; without, `processes` of this
            machine.
        processes: Processes of this machine, 1 for this one.
    """
    if cluster == HERE or (cluster is None and (processes == 1 or len(items) <= FEW)):
        for number, item in enumerate(items):
            yield number, work(common, item)
    elif cluster is None:
        yield from _on_processes(work, common, items, processes)
    else:
        yield from _on_dask(work, common, items, cluster)


def refuse_odd(cluster: str | None) -> None:
    """Refuse an address of a cluster that is none, or where nobody answers, before the work."""
    if cluster is None or cluster == HERE:
        return
    local = re.fullmatch(r"local:[1-9]\d*", cluster)
    named = re.fullmatch(r"(?:tcp|tls|ucx)://(?P<host>[^/]+?):(?P<port>\d+)/?", cluster)
    if local is None and named is None:
        raise DataError(
            f"'{cluster}' is no cluster",
            where="cluster (--cluster)",
            fix="give local:N, as local:4, or the address of a scheduler: tcp://HOST:8786",
        )
    require("distributed", "cluster", "clusters", f"cluster (--cluster) {cluster}")
    if named is not None:
        try:
            socket.create_connection((named["host"].strip("[]"), int(named["port"])), 5.0).close()
        except (OSError, OverflowError) as error:
            raise _nobody(cluster, error) from error


def _nobody(cluster: str, error: Exception) -> DataError:
    return DataError(
        f"there is no scheduler of Dask that answers ({type(error).__name__})",
        where=f"cluster (--cluster) {cluster}",
        fix="start one: dask scheduler; dask worker tcp://HOST:8786 --nthreads 1",
    )


_common: Any = None


def _start(common: Any) -> None:
    global _common
    _common = common
    one_thread_each()


def one_thread_each() -> None:
    """Processes side by side do not start threads of their own in NumPy and Polars."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "POLARS_MAX_THREADS"):
        os.environ.setdefault(name, "1")


def _with_common(work: Callable[[Any, Any], Any], item: Any) -> Any:
    return work(_common, item)


def _on_processes(
    work: Work[Common, Item, Result], common: Common, items: Sequence[Item], processes: int
) -> Done[Result]:
    left, deaths = dict(enumerate(items)), 0
    while left:
        context = get_context("spawn")
        pool = ProcessPoolExecutor(processes, context, _start, (common,))
        try:
            with _without_script():
                futures: dict[Future[Result], int] = {
                    pool.submit(_with_common, work, item): number for number, item in left.items()
                }
            for future in as_completed(futures):
                result = future.result()
                number = futures.pop(future)
                del left[number]
                yield number, result
        except BrokenProcessPool:
            deaths += 1
            if deaths > DEATHS:
                raise DataError(
                    f"{deaths} worker processes were killed, {len(left)} logs are left",
                    where="processes of this machine",
                    fix="give fewer of them (--processes), as memory may be short; then run it "
                    "again: what is done is remembered",
                ) from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _without_script() -> Iterator[None]:
    """Processes that start meanwhile do not run the user's script again: all work is in modules.

    Otherwise a script without `if __name__ == "__main__"` would run itself in each of them.
    """
    script = sys.modules["__main__"]
    kept = {name: vars(script).pop(name, None) for name in ("__file__", "__spec__")}
    script.__spec__ = None
    try:
        yield
    finally:
        vars(script).update({name: value for name, value in kept.items() if value is not None})


def _on_dask(
    work: Work[Common, Item, Result], common: Common, items: Sequence[Item], cluster: str
) -> Done[Result]:
    from distributed import as_completed as of_dask

    with _client(cluster) as client:
        shared = client.scatter(common, broadcast=True)
        left, sent, size = deque(enumerate(items)), dict[Any, list[int]](), 1
        with _lost_named(cluster):
            ended = of_dask()
            while left or sent:
                workers = max(sum(client.nthreads().values()), 1)
                while left and len(sent) < AHEAD * workers:
                    some = [left.popleft() for _ in range(min(size, len(left)))]
                    pieces = [item for _, item in some]
                    future = client.submit(
                        _several, work, shared, pieces, pure=False, retries=DEATHS
                    )
                    sent[future] = [number for number, _ in some]
                    ended.add(future)
                future = next(ended)
                if future.status == "lost" or future.cancelled():
                    raise ConnectionError("the scheduler forgot the work")
                numbers, (results, seconds) = sent.pop(future), future.result()
                yield from zip(numbers, results, strict=True)
                fair = len(left) // (AHEAD * workers)  # so that all workers end together
                size = max(1, min(fair, int(TASK_S * len(numbers) / max(seconds, 1e-6))))


def _several(
    work: Work[Common, Item, Result], common: Common, items: Sequence[Item]
) -> tuple[list[Result], float]:
    """Results of a few pieces, one task of the cluster, and the time that they took [s]."""
    began = perf_counter()
    return [work(common, item) for item in items], perf_counter() - began


@contextmanager
def _lost_named(cluster: str) -> Iterator[None]:
    """A lost scheduler or worker is an error that says how to go on."""
    from distributed.client import FutureCancelledError
    from distributed.comm.core import CommClosedError
    from distributed.scheduler import KilledWorker

    try:
        yield
    except (FutureCancelledError, CommClosedError, ConnectionError, KilledWorker) as error:
        killed = isinstance(error, KilledWorker)
        raise DataError(
            "a log killed its workers again and again" if killed else "the cluster was lost",
            where=cluster,
            fix="see that workers have memory for a part of a log; then run it again: what is done "
            "is remembered",
        ) from error


@contextmanager
def _client(cluster: str) -> Iterator[Any]:
    import dask
    from distributed import Client, LocalCluster

    kind, _, rest = cluster.partition(":")
    if kind == "local":
        one_thread_each()  # of processes that inherit it
        with _without_script(), dask.config.set(OF_WORKERS):
            local = LocalCluster(
                n_workers=int(rest), threads_per_worker=1, dashboard_address=None, silence_logs=50
            )
        with local, Client(local) as client:
            yield client
        return
    try:
        client = Client(cluster, timeout=START_S)
    except (OSError, ValueError) as error:
        raise _nobody(cluster, error) from error
    with client:
        yield client
