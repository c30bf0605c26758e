"""How fast `process` is on one core, without reading, writing and drawing; and what the filter costs of it.

    python benchmarks/process_speed.py

A demonstration is laid end to end with itself, forward and backward so that nothing jumps, until it lasts a minute.
Both filters run on the same data in the same process, in turns.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
from scipy import signal

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.filtering import zero_phase
from wrenchflow.process.clean import clean_episode
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import look_at

SECONDS = 60.0
RUNS = 7


def main() -> None:
    """Measure and print."""
    config = ProcessConfig()
    for task in ("peg-insertion", "surface-wiping", "connector-insertion"):
        episode = minute_of(demonstrate(0, CollectConfig(task=task, operator="emulated", seed=3)))
        look_at(episode, config)  # Kernels are compiled once.
        whole_s, clean_s = timed(partial(look_at, episode, config)), timed(partial(clean_episode, episode, config))
        print(
            f"{task:20} {episode.duration_s:.0f} s of 1 kHz: {1e3 * whole_s:6.1f} ms "
            f"(cleaning {1e3 * clean_s:.1f}), {episode.duration_s / whole_s:5.0f} times real time (goal 150)"
        )
    data = np.ascontiguousarray(episode["wrench_raw"].data)
    sections = signal.butter(4, 40.0, fs=1000.0, output="sos")
    ours_s, bare_s = timed(lambda: zero_phase(data, 40.0, 1000.0)), timed(lambda: signal.sosfiltfilt(sections, data, 0))
    print(f"zero-phase filter of it: {1e3 * ours_s:.2f} ms; bare sosfiltfilt {1e3 * bare_s:.2f} ms; ", end="")
    print(f"{ours_s / bare_s:.2f} times its time")


def minute_of(episode: Episode) -> Episode:
    """The episode there and back again until it lasts a minute, its events once."""
    start_ns, stop_ns = episode.span_ns
    length_ns = stop_ns - start_ns
    streams = {name: tiled(stream, start_ns, length_ns) for name, stream in episode.streams.items() if len(stream) > 1}
    streams |= {name: stream for name, stream in episode.streams.items() if len(stream) <= 1}
    phases = tuple(Event(e.start_ns, e.stop_ns, e.kind, e.label) for e in episode.events_of("phase"))
    return replace(episode, streams=streams, events=phases, messages={}, attachments={})


def tiled(stream: Stream, start_ns: int, length_ns: int) -> Stream:
    """One stream there and back again."""
    t, data, end_ns = [stream.t], [stream.data], start_ns + round(SECONDS * 1e9)
    turn = 0
    while t[-1][-1] < end_ns:
        turn += 1
        back = turn % 2 == 1
        period_ns = int(np.median(np.diff(stream.t)))
        steps = np.diff(stream.t)[::-1] if back else np.diff(stream.t)
        t.append(t[-1][-1] + period_ns + np.concatenate([[0], np.cumsum(steps)]))
        data.append(stream.data[::-1] if back else stream.data)
    rows, stamps = np.concatenate(data), np.concatenate(t)
    keep = stamps <= end_ns
    return replace(stream, t=stamps[keep], data=rows[keep])


def timed(work: Callable[[], object]) -> float:
    """Median time [s]."""
    seconds = []
    for _ in range(RUNS):
        start = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


if __name__ == "__main__":
    main()
