"""Executors of concurrent.futures for parallel work: processes on this machine, or a Dask cluster."""

import logging
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager, suppress
from inspect import signature
from multiprocessing import active_children, get_context
from threading import Event, Thread
from typing import Any, TypeVar

from ..errors import ConfigError

# One thread for matrices and one for images per worker: the workers share the cores, and sums keep one order.
ONE_THREAD = dict.fromkeys(
    ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1"
)
# Dask itself may wait forever, for a scheduler that takes connections and is silent, and for workers that have died.
_ANSWER_S = 8.0  # a running scheduler answers in milliseconds
_WORKER_S = 20.0  # new workers need some seconds to start
_LOST_S = 15.0  # without a sign of any worker, which sends one per second: one that is started again needs as long
T = TypeVar("T")


@contextmanager
def processes(workers: int) -> Iterator[Executor]:
    """Start new processes on this machine; submitted work must be picklable.

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
                pool.shutdown(wait=False)
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
def _silent(*packages: str) -> Iterator[None]:
    """Log nothing of these packages: a scheduler that dies is reported in one line, not in forty."""
    loggers = [logging.getLogger(name) for name in (*packages, *logging.root.manager.loggerDict)]
    silenced = [logger for logger in loggers if logger.name.split(".")[0] in packages and not logger.disabled]
    for logger in silenced:
        logger.disabled = True
    try:
        yield
    finally:
        for logger in silenced:
            logger.disabled = False


@contextmanager
def cluster(address: str) -> Iterator[tuple[Executor, Callable[[], bool]]]:
    """Use the workers of the Dask scheduler at `address`, such as tcp://host:8786; they need this package too.

    Yields the executor, and a function that returns whether scheduler and workers have been silent for `_LOST_S`
    because they are gone or stopped, as Dask itself would wait. Work that is not done when the context ends is
    cancelled. Raises ConfigError if no worker can be reached.
    """
    client = _client(address)
    executor, ended, heard_s = client.get_executor(pure=False), Event(), time.monotonic()  # nothing is cached
    everyone = {"n_workers": -1} if "n_workers" in signature(client.scheduler_info).parameters else {}

    def watch() -> None:
        nonlocal heard_s
        last: float | None = None  # the last sign of any worker, by the scheduler's clock
        while not ended.wait(1.0):
            with suppress(Exception):  # waits, perhaps forever, for the scheduler's answer
                workers = client.scheduler_info(**everyone)["workers"].values()
                before, last = last, max((worker["last_seen"] for worker in workers), default=last)
                if last != before:
                    heard_s = time.monotonic()

    def close() -> None:
        executor.shutdown(wait=False)
        client.close()

    try:
        try:
            _within(_WORKER_S, lambda: client.wait_for_workers(1, timeout=_WORKER_S))
        except TimeoutError:
            cure = f"start some with `dask worker {address}`"
            raise ConfigError(f"the Dask scheduler at {address} has no worker: {cure}") from None
        Thread(target=watch, daemon=True).start()
        with _silent("distributed", "tornado", "asyncio"):
            yield executor, lambda: time.monotonic() - heard_s > _LOST_S
    finally:
        ended.set()
        with suppress(Exception), _silent("distributed", "tornado", "asyncio"):
            _within(5.0, close)


def _client(address: str) -> Any:
    """Return a Dask client of the scheduler at an address. Raises ConfigError if none answers."""
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port
    except ImportError:
        raise ConfigError("a cluster needs Dask: pip install 'stream-sfm[cluster]'") from None
    try:
        get_address_host_port(address, strict=True)
    except ValueError as error:
        problem = f"{address} is not the address of a Dask scheduler ({error})"
        raise ConfigError(f"{problem}; write it as in tcp://127.0.0.1:8786") from None
    try:
        return _within(_ANSWER_S, lambda: Client(address, timeout=_ANSWER_S, set_as_default=False))
    except OSError as error:
        problem = f"no Dask scheduler answers at {address} ({str(error) or f'not within {_ANSWER_S:g} s'})"
        raise ConfigError(f"{problem}: start one with `dask scheduler`") from None


def _within(seconds: float, call: Callable[[], T]) -> T:
    """Return the result of a call; raise TimeoutError if it takes longer, and leave it running in its thread."""
    future: Future[T] = Future()

    def run() -> None:
        try:
            future.set_result(call())
        except BaseException as error:
            future.set_exception(error)

    Thread(target=run, daemon=True).start()
    return future.result(seconds)
