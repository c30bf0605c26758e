"""One episode with its force cleaned, or the reason why that cannot be."""

from dataclasses import dataclass, replace
from typing import Any

from wrenchflow.config import to_mapping
from wrenchflow.episode import Episode
from wrenchflow.errors import WrenchflowError
from wrenchflow.process.calibrated import with_calibration
from wrenchflow.process.calibration import Bias, bias_window, estimate_bias
from wrenchflow.process.compensation import WrenchPipeline
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.contact import CONTACT, find_contacts
from wrenchflow.process.contact_modes import CONTACT_MODE, contact_modes
from wrenchflow.process.filters import causal_wrench, zero_phase_wrench
from wrenchflow.process.onset import refine_onsets
from wrenchflow.process.resample import resampled
from wrenchflow.process.stamps import check_even, segments
from wrenchflow.process.thresholds import Thresholds
from wrenchflow.rig import rig_of


@dataclass(frozen=True, kw_only=True, eq=False)
class Cleaned:
    """A clean episode, and what was taken out of it.

    Attributes:
        episode: With `wrench`, `wrench_zero_phase`, its contacts and their modes, and `meta["process"]`.
        bias: The sensor's.
        rate_hz: Of the clean streams [Hz].
        thresholds: From which contact counts.
    """

    episode: Episode
    bias: Bias
    rate_hz: float
    thresholds: Thresholds


def clean_episode(episode: Episode, config: ProcessConfig) -> Cleaned:
    """Clean the force of one episode.

    Args:
        episode: With `wrench_raw` (wrench or force), `tcp_pose` and the rig in its metadata. A phase `tare` says where
            the arm rested without contact; without it that is the start.
        config: How.

    Raises:
        WrenchflowError: If a stream or the rig is missing, the sampling is uneven, or the bias cannot be told. The
            message begins with the episode.
    """
    try:
        return _clean(episode, config)
    except WrenchflowError as error:
        raise type(error)(f"episode {episode.id}: {error}") from error


def _clean(episode: Episode, config: ProcessConfig) -> Cleaned:
    episode = with_calibration(episode, config.calibration)
    rig = rig_of(episode.meta, "its metadata")
    raw, tcp_pose = episode["wrench_raw"], episode["tcp_pose"]
    notes: dict[str, Any] = {"config": to_mapping(config)}
    if config.filter.resample_hz is not None:
        notes["resampled"] = {"from_samples": len(raw), "from_hz": raw.rate_hz if len(raw) > 1 else None}
        raw = resampled(raw, config.filter.resample_hz, "wrench_raw")
        rig = replace(rig, sensor=replace(rig.sensor, rate_hz=config.filter.resample_hz))
    start_ns, stop_ns = bias_window(episode, config.bias)
    joints = episode.streams.get("joint_states")
    # Sampling first: whether a window is at rest cannot be told of a stream whose stamps are wrong.
    check_even(raw, rig.sensor.rate_hz, "wrench_raw")
    bias = estimate_bias(raw, tcp_pose, joints, rig, start_ns=start_ns, stop_ns=stop_ns, config=config.bias)
    wrench = causal_wrench(raw, tcp_pose, rig, bias, config.filter)
    twist = episode.streams.get("tcp_twist")
    zero_phase = zero_phase_wrench(raw, tcp_pose, twist, rig, bias, config.filter, config.inertia)
    labels = zero_phase.wrench
    thresholds = Thresholds.of(labels, rig, bias, config.contact, zero_phase.inertia_left_in)
    rate_hz = rig.sensor.rate_hz
    found = find_contacts(labels, rate_hz, thresholds)
    contacts = refine_onsets(found, zero_phase.unfiltered, labels, thresholds, rate_hz, rig.sensor.delay_s)
    notes |= {
        "bias": bias.to_mapping(),
        "group_delay_s": WrenchPipeline(rig, bias, config.filter).group_delay_s,
        "inertia_left_in": zero_phase.inertia_left_in,
        "contact": to_mapping(thresholds),
        "left_out_samples": len(raw) - len(wrench),
        "gaps": max(len(segments(wrench.t, rate_hz)) - 1, 0),
    }
    others = tuple(event for event in episode.events if event.kind not in (CONTACT, CONTACT_MODE))
    clean = (
        replace(episode, events=others)
        .with_stream("wrench", wrench)
        .with_stream("wrench_zero_phase", labels)
        .with_events(*contacts)
        .with_meta(process=notes)
    )
    clean = clean.with_events(*contact_modes(clean, rate_hz))
    return Cleaned(episode=clean, bias=bias, rate_hz=rate_hz, thresholds=thresholds)
