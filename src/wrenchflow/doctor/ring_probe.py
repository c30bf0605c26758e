"""Sends rows to another process and back, through rings in shared memory; `wrenchflow doctor` runs it as a program."""

import json
import multiprocessing
import statistics
import sys
import time

import numpy as np

from wrenchflow.recording.ring import Ring

_ROW = np.dtype([("number", "i8"), ("values", "f8", (90,))], align=True)  # About what the control loop stores.
_ROWS, _CAPACITY, _LIMIT_S = 2000, 4096, 20.0


def probe() -> dict[str, float]:
    """Send rows there and back.

    Returns:
        `rows`, how many came back in order, and `push_s`, the median time that storing one took [s].

    Raises:
        RuntimeError: If a row is lost, changed or out of order, or if they do not come in time.
    """
    there, back = Ring.create(_ROW, _CAPACITY), Ring.create(_ROW, _CAPACITY)
    peer = multiprocessing.get_context("spawn").Process(target=_echo, args=(there.name, back.name), daemon=True)
    try:
        peer.start()
        row, pushed_s = np.zeros(1, _ROW), []
        for number in range(_ROWS):
            row["number"], row["values"] = number, number / 8
            start_s = time.perf_counter()
            there.push(row)
            pushed_s.append(time.perf_counter() - start_s)
        returned = _take(back)
        if not (returned["number"] == np.arange(_ROWS)).all():
            raise RuntimeError("rows came back out of order")
        if not (returned["values"] == np.arange(_ROWS)[:, None] / 8).all():
            raise RuntimeError("rows came back changed")
        peer.join(_LIMIT_S)
    finally:
        if peer.is_alive():
            peer.terminate()
        for ring in (there, back):
            ring.close()
            ring.unlink()
    return {"rows": _ROWS, "push_s": statistics.median(pushed_s)}


def _take(ring: Ring) -> np.ndarray:
    """All rows, once they are there."""
    parts, count, stop_s = [], 0, time.monotonic() + _LIMIT_S
    while count < _ROWS:
        if time.monotonic() > stop_s:
            raise RuntimeError(f"{count} of {_ROWS} rows came within {_LIMIT_S:g} s")
        parts.append(ring.take())
        count += len(parts[-1])
        time.sleep(1e-3)
    return np.concatenate(parts)


def _echo(there: str, back: str) -> None:
    source, sink = Ring.attach(there, _ROW, _CAPACITY), Ring.attach(back, _ROW, _CAPACITY)
    rows = _take(source)
    for number in range(len(rows)):
        sink.push(rows[number : number + 1])
    source.close()
    sink.close()


if __name__ == "__main__":
    sys.stdout.write(json.dumps(probe()) + "\n")
