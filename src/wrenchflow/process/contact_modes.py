"""What kind of contact it is, where that can be told: free, touch, sliding, seated.

- free: between contacts.
- sliding: in contact, and the tcp moves across the force faster than a rest can look.
- touch: in contact, without that: a blow, a press, or a stop on the way.
- seated: the tool is in what it was put into, as deep as when success was told. It is told where there is a success,
  and the tool went straight along the goal's z, held to the side, well below where it first touched: a wiper never is.

Nothing is said where it cannot be told: in a gap of the force, in contact while the tcp's motion is not known.
"""

from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.process.contact import CONTACT, hysteresis, in_contact, runs_of, without_short
from wrenchflow.process.metrics.motion import velocity
from wrenchflow.process.stamps import segments
from wrenchflow.spatial import rotation_of

CONTACT_MODE = "contact_mode"
MODES = FREE, TOUCH, SLIDING, SEATED = ("free", "touch", "sliding", "seated")

# Noise of a resting Panda's joints is 0.2 mm/s at the tcp after the velocity's low-pass of 10 Hz, 1 mm/s at times.
SLIDING_M_S, STOPPED_M_S = 0.003, 0.0015
DWELL_S = 0.05  # A shorter slide, or stop, is none.
# To be seated, the tool went so deep below the first touch, strayed no farther to the side on the last part of it, and
# is this near to where it was at the success.
DEEP_M, STRAIGHT_M, STRAY_M, SEAT_M = 0.004, 0.003, 0.001, 0.0005


def contact_modes(clean: Episode, rate_hz: float) -> tuple[Event, ...]:
    """The modes of an episode, in order, none over another.

    Args:
        clean: With `wrench_zero_phase` and its contacts.
        rate_hz: Of that wrench [Hz].
    """
    labels, contacts = clean["wrench_zero_phase"], clean.events_of(CONTACT)
    touching = in_contact(labels, contacts)
    number = np.full(len(labels), -1)  # Of `MODES`; -1 for what cannot be told.
    number[~touching] = MODES.index(FREE)
    across = _speed_across(clean, labels)
    seated = _seated(clean, labels)
    if across is not None:
        for event in contacts:
            first, last = np.searchsorted(labels.t, [event.start_ns, event.stop_ns])
            slides = hysteresis(across[first:last] >= SLIDING_M_S, across[first:last] < STOPPED_M_S)
            slides = without_short(without_short(slides, True, DWELL_S * rate_hz), False, DWELL_S * rate_hz)
            number[first:last] = np.where(slides, MODES.index(SLIDING), MODES.index(TOUCH))
    number[touching & seated] = MODES.index(SEATED)
    return tuple(event for run in segments(labels.t, rate_hz) for event in _events(labels, number, run, rate_hz))


def _events(labels: Stream, number: np.ndarray, run: slice, rate_hz: float) -> list[Event]:
    t, mode = labels.t[run], number[run]
    edges = [0, *(np.flatnonzero(np.diff(mode)) + 1).tolist(), len(mode)]
    end_ns = int(t[-1]) + round(1e9 / rate_hz)
    spans = [(int(t[a]), int(t[b]) if b < len(t) else end_ns, int(mode[a])) for a, b in pairwise(edges)]
    return [Event(start_ns, stop_ns, CONTACT_MODE, MODES[each]) for start_ns, stop_ns, each in spans if each >= 0]


def _speed_across(clean: Episode, labels: Stream) -> Float[np.ndarray, " n"] | None:
    """Speed of the tcp across the force at each stamp [m/s]; None where the motion is not known."""
    moved = velocity(clean)
    if isinstance(moved, str):
        return None
    t, rows = moved
    first = int(t[0])
    v = np.stack([np.interp(labels.t - first, t - first, column) for column in rows.T], axis=1)
    force = labels.data[:, :3]
    direction = force / np.maximum(np.linalg.norm(force, axis=1, keepdims=True), 1e-9)
    along = np.einsum("ij,ij->i", v, direction)[:, None] * direction
    return np.linalg.norm(v - along, axis=1)


def _seated(clean: Episode, labels: Stream) -> Bool[np.ndarray, " n"]:
    """Where the tool is in its seat. Shape (n,)."""
    nowhere = np.zeros(len(labels), bool)
    contacts, success = clean.events_of(CONTACT), clean.events_of("success")
    pose, goal = clean["tcp_pose"], clean.streams.get("goal_pose")
    if not contacts or not success or goal is None or not len(goal) or goal.frame != pose.frame:
        return nowhere
    in_goal = (pose.data[:, :3] - goal.data[-1, :3]) @ rotation_of(goal.data[-1, 3:])
    depth, aside = in_goal[:, 2], in_goal[:, :2]
    first = int(np.searchsorted(pose.t, contacts[0].start_ns))
    last = min(int(np.searchsorted(pose.t, success[0].start_ns)), len(pose) - 1)
    if last <= first or depth[last] - depth[first] < DEEP_M:
        return nowhere
    above = np.flatnonzero(depth[first:last] < depth[last] - STRAIGHT_M)
    begun = first + int(above[-1]) if len(above) else first
    if np.linalg.norm(aside[begun : last + 1] - aside[last], axis=1).max() > STRAY_M:
        return nowhere
    near = np.abs(depth - depth[last]) <= SEAT_M
    if not near[last]:  # Of a pose that is not finite nothing is near.
        return nowhere
    since = runs_of(near[: last + 1], True)[-1][0]
    left = np.flatnonzero(~near[last:])
    until_ns = int(pose.t[last + int(left[0])]) if len(left) else int(labels.t[-1]) + 1
    return (labels.t >= pose.t[since]) & (labels.t < until_ns)
