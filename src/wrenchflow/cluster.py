"""A cluster in place of local worker processes, behind the same `concurrent.futures.Executor`."""

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from wrenchflow.errors import ConfigError, WorkerError

_SCHEME = "dask://"
_PATIENCE_S = 10.0


@contextmanager
def executor_at(address: str | None) -> Iterator[Executor | None]:
    """The executor of a Dask cluster, as long as the block runs.

    Every worker has wrenchflow installed and sees the same files under the same paths. A task whose worker dies is done
    again by another one.

    Args:
        address: `dask://host:port` of its scheduler; None for none, which leaves the work to local processes.

    Raises:
        ConfigError: If the address is of another kind, nobody answers there, or Dask is not installed.
        WorkerError: If workers died again and again.
    """
    if address is None:
        yield None
        return
    place = address.removeprefix(_SCHEME)
    host, colon, port = place.rpartition(":")
    if place == address or not host or not colon or not port.isdecimal():
        raise ConfigError(f"executor is '{address}', expected {_SCHEME}HOST:PORT of a Dask scheduler.")
    try:
        from distributed import Client, KilledWorker
    except ModuleNotFoundError as error:
        raise ConfigError("this needs Dask, which is not installed: install wrenchflow[cluster].") from error
    try:
        client = Client(f"tcp://{place}", timeout=_PATIENCE_S, set_as_default=False)
    except (OSError, TimeoutError) as error:
        raise ConfigError(f"no Dask scheduler answers at '{place}' within {_PATIENCE_S:g} s.") from error
    with client:
        if not client.scheduler_info()["workers"]:
            raise ConfigError(f"the Dask scheduler at '{place}' has no workers. Start some: dask worker tcp://{place}")
        try:
            yield client.get_executor(pure=False)
        except KilledWorker as error:
            raise WorkerError(f"the workers of the Dask cluster at '{place}' died again and again: {error}") from error
