"""What the safety layer did in an episode, as its stream `governor` tells: modes, interventions, and energy by kind.

A recording names modes and safeguards itself, in `meta["governor"]`, so that it can be read by who has other ones.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from wrenchflow.episode import Episode, Event, Stream

STREAM = "governor"
EVENT_KIND = "safety"
# Energy there is at a tick, and work that was done since the start, as columns of the stream [J].
ENERGIES = ("tank", "spring", "budget", "kinetic")
WORK = ("damped", "fed", "posed", "saturated", "exerted", "filled")

_RUN, _WAITING = 0, "waiting"
_REFUSES = "gate-request"
_LEASHES = ("leash", "leash-rotation")
# What a safeguard does again within this time is one intervention to who reads of it.
_MERGED_NS = 100_000_000


class Stretch(NamedTuple):
    """From `start_ns` to `stop_ns`, and what was so; `ticks` is how many."""

    start_ns: int
    stop_ns: int
    ticks: int
    label: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Ledger:
    """The safety layer's account of an episode.

    Attributes:
        governor: Its stream, of signal `GOVERNOR`.
        modes: Names, by number; the first is the ordinary one.
        safeguards: Names, by number.
        refusals: When plans were refused [ns], and why; what was refused besides is a segment. None where nobody knows.
    """

    governor: Stream
    modes: Sequence[str]
    safeguards: Sequence[str]
    refusals: Sequence[tuple[int, str]] | None = None

    @classmethod
    def of(cls, episode: Episode) -> "Ledger | None":
        """The ledger of an episode; None where nothing recorded one, or nobody knows what its numbers mean."""
        names = episode.meta.get(STREAM)
        if STREAM not in episode or not len(episode[STREAM]) or not isinstance(names, Mapping):
            return None
        return cls(governor=episode[STREAM], modes=tuple(names["modes"]), safeguards=tuple(names["safeguards"]))

    @property
    def names(self) -> dict[str, list[str]]:
        """What a recording says of its numbers, as `meta["governor"]`."""
        return {"modes": list(self.modes), "safeguards": list(self.safeguards)}

    @property
    def ordinary(self) -> tuple[str, str]:
        """Labels of what needs no telling: that it runs, and that nothing was asked yet."""
        return self.modes[_RUN], _WAITING

    @property
    def mode_stretches(self) -> tuple[Stretch, ...]:
        """The modes one after the other, as `run`, `hold: silence`, or `waiting` before anything was asked."""
        mode, cause = (self.governor.column(name).astype(np.int64) for name in ("mode", "cause"))
        cause[mode == _RUN] = -1  # Why it runs again is no news.
        edges = np.flatnonzero((np.diff(mode) != 0) | (np.diff(cause) != 0)) + 1
        return tuple(
            self._stretch(first, stop, stop - first, self._mode_label(int(mode[first]), int(cause[first])))
            for first, stop in zip([0, *edges.tolist()], [*edges.tolist(), len(mode)], strict=True)
        )

    def acted(self, safeguard: str) -> Bool[np.ndarray, " n"]:
        """At which ticks a safeguard intervened. Shape (n,)."""
        bits = self.governor.column("acting").astype(np.int64)
        return (bits >> self.safeguards.index(safeguard) & 1).astype(bool)

    def interventions(self, gap_ns: int = _MERGED_NS) -> dict[str, tuple[Stretch, ...]]:
        """When each safeguard that did anything intervened; what is less than `gap_ns` [ns] apart is one stretch."""
        return {name: found for name in self.safeguards if (found := self._merged(name, self.acted(name), gap_ns))}

    @property
    def events(self) -> tuple[Event, ...]:
        """What a person wants to be told: every mode but the ordinary one, and what was refused.

        Safeguards that limit act in thousands of ticks; they are counted in `summary`.
        """
        told = [stretch for stretch in self.mode_stretches if stretch.label not in self.ordinary]
        told += [self._refused(stretch) for stretch in self.interventions().get(_REFUSES, ())]
        return tuple(sorted(Event(of.start_ns, of.stop_ns, EVENT_KIND, of.label) for of in told))

    def _refused(self, stretch: Stretch) -> Stretch:
        """A stretch in which requests were refused, and why they were."""
        if self.refusals is None:
            return stretch._replace(label="refused")
        why = [reason for t_ns, reason in self.refusals if stretch.start_ns <= t_ns <= stretch.stop_ns]
        return stretch._replace(label=f"refused: {', '.join(dict.fromkeys(why)) or 'segment'}")

    def summary(self) -> dict[str, Any]:
        """Plain figures.

        Returns:
            `ticks` in each mode; `entered`, how often a mode other than the ordinary one was, and why; `interventions`,
            in how many ticks each safeguard intervened; `leash_share`, in which share of the ticks since something was
            asked the leash did; `energy_j` and `work_j` at the end; the lowest tank [J], and the largest force, moment
            and impact that the safety layer felt [N, N.m, N]. A number that is not finite is passed over.
        """
        stretches = self.mode_stretches
        ticks = Counter[str]()
        for stretch in stretches:
            ticks[stretch.label.partition(":")[0]] += stretch.ticks
        entered = Counter(stretch.label for stretch in stretches if stretch.label not in self.ordinary)
        interventions = {name: int(self.acted(name).sum()) for name in self.safeguards}
        is_leashed = np.any([self.acted(name) for name in _LEASHES if name in self.safeguards], axis=0)
        asked = len(self.governor) - ticks[_WAITING]
        return {
            "ticks": dict(ticks),
            "entered": dict(entered),
            "interventions": {name: count for name, count in interventions.items() if count},
            "leash_share": float(is_leashed.sum() / asked) if asked else 0.0,
            "energy_j": {name: float(self._finite(name)[-1]) for name in ENERGIES},
            "work_j": {name: float(self._finite(name)[-1]) for name in WORK},
            "tank_min_j": float(self._finite("tank").min()),
            "peak_force_n": float(self._finite("force").max()),
            "peak_moment_nm": float(self._finite("moment").max()),
            "peak_impact_n": float(self._finite("impact").max()),
        }

    def _finite(self, column: str) -> Float[np.ndarray, " n"]:
        """The finite values of a column, for JSON has no others; a 0 where there are none."""
        values = self.governor.column(column)
        finite = values[np.isfinite(values)]
        return finite if len(finite) else np.zeros(1)

    def _mode_label(self, mode: int, cause: int) -> str:
        if mode == _RUN:
            return self.modes[_RUN]
        return f"{self.modes[mode]}: {self.safeguards[cause]}" if cause >= 0 else _WAITING

    def _merged(self, label: str, acted: Bool[np.ndarray, " n"], gap_ns: int) -> tuple[Stretch, ...]:
        at = np.flatnonzero(acted)
        if not len(at):
            return ()
        edges = np.flatnonzero(np.diff(self.governor.t[at]) > gap_ns) + 1
        return tuple(self._stretch(int(part[0]), int(part[-1]) + 1, len(part), label) for part in np.split(at, edges))

    def _stretch(self, first: int, stop: int, ticks: int, label: str) -> Stretch:
        """From a row on, until the row at which it is over, or the last there is."""
        t = self.governor.t
        return Stretch(int(t[first]), int(t[min(stop, len(t) - 1)]), ticks, label)
