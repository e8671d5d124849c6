"""Executors of concurrent.futures for parallel work: processes on this machine, or a Dask cluster."""

import os
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import active_children, get_context

from .errors import ConfigError

# One thread for matrices and one for images per worker: the workers share the cores, and sums keep one order.
ONE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1"
)
_ANSWER_S = 10  # a running scheduler answers in milliseconds
_WORKER_S = 30  # workers that have just been started need some seconds


@contextmanager
def processes(workers: int) -> Iterator[Executor]:
    """Start new processes on this machine; what is submitted must be picklable.

    If an exception such as Ctrl-C ends the context, the processes are killed at once.
    """
    others = set(active_children())
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)  # inherited, and read when NumPy and OpenCV are loaded there
    try:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            try:
                yield pool
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                for worker in set(active_children()) - others:
                    worker.kill()  # a run defers SIGTERM, and each worker has one more task queued
                raise
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """Use the workers of the Dask scheduler at `address`, such as tcp://host:8786; they need this package too.

    Work that is not done when the context ends is cancelled. Raises ConfigError where no worker can be reached.
    """
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port
    except ImportError:
        raise ConfigError("a cluster needs Dask: pip install 'stream-sfm[cluster]'") from None
    try:
        get_address_host_port(address, strict=True)
    except ValueError as error:
        raise ConfigError(
            f"{address} is not the address of a Dask scheduler ({error}); write it as in tcp://127.0.0.1:8786"
        ) from None
    try:
        client = Client(address, timeout=_ANSWER_S, set_as_default=False)
    except OSError as error:
        raise ConfigError(
            f"no Dask scheduler answers at {address} ({error}): start one with `dask scheduler`"
        ) from None
    with client:
        try:
            client.wait_for_workers(1, timeout=_WORKER_S)
        except TimeoutError:
            raise ConfigError(
                f"the Dask scheduler at {address} has no worker: start some with `dask worker {address}`"
            ) from None
        executor = client.get_executor(pure=False)  # the same call again is new work, not a cached result
        try:
            yield executor
        finally:
            executor.shutdown(wait=False)
