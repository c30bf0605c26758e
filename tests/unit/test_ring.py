"""A ring gives back what was stored, in order, once, and counts what it could not take."""

import multiprocessing
import subprocess
import sys

import numpy as np
import pytest

from wrenchflow.errors import StreamError
from wrenchflow.recording.ring import Ring

ROW = np.dtype([("number", "i8"), ("values", "f8", (5,))], align=True)


@pytest.fixture
def ring():
    made = Ring.create(ROW, 8)
    yield made
    made.close()
    made.unlink()


def row(number: int) -> np.ndarray:
    made = np.zeros(1, ROW)
    made["number"], made["values"] = number, number + np.arange(5) / 10
    return made


def test_any_mix_of_storing_and_taking_gives_every_row_once_and_in_order(ring):
    rng, stored, taken, refused = np.random.default_rng(0), [], [], 0
    for number in range(2000):
        if ring.push(row(number)):
            stored.append(number)
        else:
            refused += 1
        if rng.random() < 0.15:
            rows = ring.take()
            np.testing.assert_array_equal(rows["values"], rows["number"][:, None] + np.arange(5) / 10)
            taken += rows["number"].tolist()
    taken += ring.take()["number"].tolist()
    assert taken == stored
    assert ring.dropped == refused > 0


def test_a_full_ring_keeps_what_it_has(ring):
    assert [ring.push(row(number)) for number in range(10)] == [True] * 8 + [False] * 2
    assert ring.take()["number"].tolist() == list(range(8))
    assert len(ring.take()) == 0
    assert ring.dropped == 2


def test_what_was_taken_is_not_changed_by_what_comes_after(ring):
    ring.push(row(1))
    taken = ring.take()
    for number in range(20):
        ring.push(row(number))
        ring.take()
    assert taken["number"].tolist() == [1]


def test_a_ring_without_room_is_refused():
    with pytest.raises(StreamError, match="at least 1 row, got 0"):
        Ring.create(ROW, 0)


def _produce(name: str, capacity: int, count: int) -> None:
    ring = Ring.attach(name, ROW, capacity)
    made = np.zeros(1, ROW)
    for number in range(count):
        made["number"], made["values"] = number, number + np.arange(5) / 10
        ring.push(made)
    ring.close()


def _consume(capacity: int, count: int) -> None:
    ring = Ring.create(ROW, capacity)
    producer = multiprocessing.get_context("spawn").Process(target=_produce, args=(ring.name, capacity, count))
    producer.start()
    numbers: list[np.ndarray] = []
    going_on = True
    while going_on:
        going_on = producer.is_alive()  # Looked at first, so that the last look at the ring comes after its end.
        rows = ring.take()
        np.testing.assert_array_equal(rows["values"], rows["number"][:, None] + np.arange(5) / 10)
        numbers.append(rows["number"])
    taken = np.concatenate(numbers)
    assert (np.diff(taken) > 0).all()
    assert len(taken) + ring.dropped == count
    if capacity > count:
        assert ring.dropped == 0
    producer.join()
    ring.close()
    ring.unlink()


@pytest.mark.parametrize("capacity", [64, pytest.param(1 << 17, marks=pytest.mark.slow)])
def test_between_processes_no_row_is_torn_doubled_or_out_of_order(capacity):
    # A script of its own, because what is spawned has to be imported by name, and tests are not.
    ran = subprocess.run(
        [sys.executable, __file__, str(capacity), "60000"], capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stderr) == (0, "")


if __name__ == "__main__":
    _consume(int(sys.argv[1]), int(sys.argv[2]))
