"""Who judges wiping: the way is cut into elements, and one counts if all that happened in it was even."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.compiled import kernel
from wrenchflow.control.records import record_dtype
from wrenchflow.sim.tasks.wiping_path import BEGIN_M, END_M, aside, slope
from wrenchflow.spatial import rotation_of

# What an element is, the worse the higher: what was worst in it is what counts.
_UNSEEN, _EVEN, _UNEVEN, _LIFTED, _OFF_PATH = np.int64(0), np.int64(1), np.int64(2), np.int64(3), np.int64(4)
_REASONS = ("uneven", "lifted", "off-path")  # of `_UNEVEN` and up

_SURFACE = record_dtype(
    [
        ("x", "f8", 3),  # of the true goal, in the base frame
        ("R", "f8", (3, 3)),
        ("press_n", "f8"),
        ("band_n", "f8"),
        ("aside_max_m", "f8"),
        ("touch_n", "f8"),
        ("force_max_n", "f8"),
    ]
)
_TALLY = record_dtype(
    [
        ("touched", "i8"),
        ("reached", "i8"),
        ("pressed", "i8"),  # too hard
        ("done_m", "f8"),
        ("spoilt_m", "f8"),
    ]
)


@kernel
def judge(T_base_tcp, wrench, surface, elements, lengths, tally):
    """Take in samples; records `_SURFACE` and `_TALLY`, and what has become of the elements of the way.

    Nothing counts before the first touch, for the tool may come from above any part of the way.
    """
    goal, now = surface[0], tally[0]
    for k in range(T_base_tcp.shape[0]):
        x = y = press = 0.0
        for i in range(3):
            x += goal.R[i, 0] * (T_base_tcp[k, i] - goal.x[i])
            y += goal.R[i, 1] * (T_base_tcp[k, i] - goal.x[i])
            press += goal.R[i, 2] * wrench[k, i]
        if press > goal.touch_n:
            now.touched = 1
        if press > goal.force_max_n:
            now.pressed = 1
        if now.touched == 0:
            continue
        if x >= END_M:
            now.reached = 1
        elif x >= BEGIN_M:
            here = min(int((x - BEGIN_M) / (END_M - BEGIN_M) * elements.shape[0]), elements.shape[0] - 1)
            found = _EVEN
            # How far beside a way that is nearly straight: what is across, less what the swing makes of it.
            if abs(y - aside(x)) / math.sqrt(1.0 + slope(x) ** 2) > goal.aside_max_m:
                found = _OFF_PATH
            elif press < goal.touch_n:
                found = _LIFTED
            elif abs(press - goal.press_n) > goal.band_n:
                found = _UNEVEN
            elements[here] = max(elements[here], found)
    done = spoilt = 0.0
    for i in range(elements.shape[0]):
        if elements[i] > _EVEN:
            spoilt += lengths[i]
        elif elements[i] == _EVEN:
            done += lengths[i]
    now.done_m, now.spoilt_m = done, spoilt


@dataclass(frozen=True, kw_only=True)
class Evenness:
    """What counts as wiped evenly.

    Attributes:
        press_n: Force to be held, normal to the true surface [N].
        band_n: How far off it may be [N].
        aside_max_m: How far beside the way the tool may be [m].
        touch_n: Less than this is no contact [N].
        force_max_n: More than this spoils the surface [N].
        share: Of the way's length that has to be even.
        element_m: Length of an element along x [m].
    """

    press_n: float = 8.0
    band_n: float = 2.0
    aside_max_m: float = 0.005
    touch_n: float = 1.0
    force_max_n: float = 16.0
    share: float = 0.9
    element_m: float = 0.002


class WipingReferee:
    """Counts how much of the way was wiped evenly; what has been spoilt stays so."""

    def __init__(self, T_base_goal: Float[np.ndarray, " 7"], evenness: Evenness) -> None:
        """Judge one attempt at a surface."""
        self._surface, self._tally = np.zeros(1, _SURFACE), np.zeros(1, _TALLY)
        self._surface["x"], self._surface["R"] = T_base_goal[:3], rotation_of(T_base_goal[3:])
        for name in ("press_n", "band_n", "aside_max_m", "touch_n", "force_max_n"):
            self._surface[name] = getattr(evenness, name)
        edges = np.linspace(BEGIN_M, END_M, round((END_M - BEGIN_M) / evenness.element_m) + 1)
        self._lengths = np.hypot(np.diff(edges), np.diff([aside(x) for x in edges]))
        self._elements = np.full(len(self._lengths), _UNSEEN)
        self._whole_m, self._share = float(self._lengths.sum()), evenness.share

    def see(self, T_base_tcp: Float[np.ndarray, "n 7"], wrench: Float[np.ndarray, "n 6"]) -> None:
        """Take in what has happened."""
        judge(T_base_tcp, wrench, self._surface, self._elements, self._lengths, self._tally)

    @property
    def progress(self) -> float:
        """Share of the way's length that has been wiped evenly; 1 when the end is reached and enough of it was."""
        done = float(self._tally[0]["done_m"]) / self._whole_m
        now = self._tally[0]
        return 1.0 if now["reached"] and not now["pressed"] and done >= self._share else min(done, 0.999)

    @property
    def failure(self) -> str:
        """`over-force`; for a way that is lost, what spoilt most of it: `uneven`, `lifted`, `off-path`; or `timeout`.

        What was left out counts as lifted.
        """
        if self._tally[0]["pressed"]:
            return "over-force"
        if not self.is_lost:
            return "timeout"
        spoilt_m = [float(self._lengths[self._elements == _UNEVEN + i].sum()) for i in range(len(_REASONS))]
        spoilt_m[1] += float(self._lengths[self._elements == _UNSEEN].sum()) if self._tally[0]["reached"] else 0.0
        return _REASONS[int(np.argmax(spoilt_m))]

    @property
    def is_lost(self) -> bool:
        """Whether the surface is spoilt, or too much of the way, or its end is reached without having been wiped."""
        now = self._tally[0]
        spoilt = float(now["spoilt_m"]) / self._whole_m > 1.0 - self._share + 1e-9
        return bool(now["pressed"]) or spoilt or (bool(now["reached"]) and self.progress < 1.0)
