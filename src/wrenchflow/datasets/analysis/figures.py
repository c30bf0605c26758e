"""What is known of one episode: figures for a table, and what is added up over the data set."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float32, Int64

from wrenchflow.datasets.analysis import trajectory as of
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.distribution import Tally, tally
from wrenchflow.datasets.analysis.trajectory import Labels, Trajectory
from wrenchflow.datasets.analysis.voxels import voxels_of

# A step that comes this many periods after the one before is late.
_LATE = 1.5
_SHAPE = 16  # Postures that an episode is compared by.
# What is not finite there was not told, and is no fault of the data.
_DERIVED = (of.ESTIMATED, of.TIMING)
_FORCES = (of.WRENCH, of.WRENCH_RAW, of.ESTIMATED)


@dataclass(frozen=True, kw_only=True)
class Figure:
    """A figure of an episode.

    Attributes:
        name: Its column in `episodes.parquet`.
        unit: Its unit.
        meaning: What it says, in one sentence.
        whole: Whether it is a whole number.
    """

    name: str
    unit: str
    meaning: str
    whole: bool = False


FIGURES = (
    Figure(name="steps", unit="", meaning="Rows of the trajectory.", whole=True),
    Figure(name="duration_s", unit="s", meaning="From the first step to the last."),
    Figure(name="rate_hz", unit="Hz", meaning="Steps a second, of the median time between two."),
    Figure(name="path_m", unit="m", meaning="Length of the tool's path."),
    Figure(name="contact_rate", unit="", meaning="Share of the samples in contact, by a measured force."),
    Figure(name="estimated_contact_rate", unit="", meaning="Share of the samples in contact, by the estimated force."),
    Figure(name="peak_force_n", unit="N", meaning="Largest norm of the measured force."),
    Figure(name="estimated_peak_force_n", unit="N", meaning="Largest norm of the estimated force."),
    Figure(name="estimated_force_std_n", unit="N", meaning="Median standard uncertainty of the estimated force."),
    Figure(name="peak_joint_torque_nm", unit="N.m", meaning="Largest measured torque of a joint, gravity included."),
    Figure(name="idle_share", unit="", meaning="Share of the steps whose actions are all zero or repeat the last."),
    Figure(name="not_finite", unit="", meaning="Numbers that are no numbers.", whole=True),
    Figure(name="late_steps", unit="", meaning="Steps more than 1.5 periods after the one before.", whole=True),
    Figure(name="longest_pause_s", unit="s", meaning="Longest time between two steps."),
    Figure(name="repeated_stamps", unit="", meaning="Stamps that are not after the one before.", whole=True),
    Figure(name="skipped_actions", unit="", meaning="Steps whose action was not carried out.", whole=True),
    Figure(name="failed_commands", unit="", meaning="Commands that the controller refused.", whole=True),
    Figure(name="step_ms", unit="ms", meaning="95 % of the steps took less, from begin to end."),
    Figure(name="read_ms", unit="ms", meaning="95 % of the robot's readings took less."),
    Figure(name="camera_skew_ms", unit="ms", meaning="95 % of the steps have pictures less far apart."),
    Figure(name="camera_age_ms", unit="ms", meaning="95 % of the newest pictures were younger than that."),
    Figure(name="controller_latency_ms", unit="ms", meaning="95 % of the controller's latencies were less."),
    Figure(name="clock_drift_ms", unit="ms", meaning="How far the robot's clock and the computer's came apart."),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class EpisodeFigures:
    """What is kept of an episode.

    Attributes:
        id: Its name.
        place: Where it is.
        labels: What is said about it.
        values: Figures by name; None or absent where they could not be told.
        missing: What the data set should have of it and has not.
        shape: Postures at evenly spaced times, by which near duplicates are found. Shape (16 k,).
        shape_of: What the shape is made of: `joints`, `position`, or nothing.
    """

    id: str
    place: str
    labels: Labels
    values: Mapping[str, float | int | None]
    missing: tuple[str, ...]
    shape: Float32[np.ndarray, " s"]
    shape_of: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Looked:
    """What a worker sends back of an episode.

    Attributes:
        figures: What is kept of it.
        tallies: What is added up, by table: columns, units, and the tally.
        voxels: Cells of the workspace that the tool was in. Shape (k,).
        visits: Steps in each of them. Shape (k,).
        left_out: Why it could not be looked at; empty if it could.
    """

    figures: EpisodeFigures
    tallies: Mapping[str, tuple[tuple[str, ...], tuple[str, ...], Tally]] = field(default_factory=dict)
    voxels: Int64[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, np.int64))
    visits: Int64[np.ndarray, " k"] = field(default_factory=lambda: np.zeros(0, np.int64))
    left_out: str = ""


def look_at(episode: Trajectory, config: AnalysisConfig) -> Looked:
    """Everything that an analysis needs of an episode."""
    tallies = {name: (each.columns, each.units, tally(each.data)) for name, each in episode.tables.items()}
    values: dict[str, float | int | None] = dict(episode.counts)
    values |= _time(episode) | _space(episode) | _felt(episode) | _health(episode)
    values["not_finite"] = int(
        sum(each.missing.sum() for name, (_, _, each) in tallies.items() if name not in _DERIVED)
    ) + _not_finite(episode)
    if episode.contact is not None and len(episode.contact):
        share = "estimated_contact_rate" if episode.contact_by == of.ESTIMATED else "contact_rate"
        values[share] = float(episode.contact.mean())
    voxels, visits = voxels_of(episode.position_m, config.voxel_m)
    shape, shape_of = _shape(episode)
    return Looked(
        figures=EpisodeFigures(
            id=episode.id,
            place=episode.place,
            labels=episode.labels,
            values=values,
            missing=episode.missing,
            shape=shape,
            shape_of=shape_of,
        ),
        tallies=tallies,
        voxels=voxels,
        visits=visits,
    )


def _time(episode: Trajectory) -> dict[str, float | int | None]:
    t = episode.seconds
    rows = [len(each) for each in (t, episode.position_m, episode.joints_rad) if each is not None]
    if not rows and of.ACTION in episode.tables:
        rows = [len(episode.tables[of.ACTION].data)]
    told: dict[str, float | int | None] = {"steps": rows[0] if rows else None}
    if t is None or len(t) < 2:
        return told
    apart = t[1:] - t[:-1]
    median = float(np.median(apart))
    told |= {"duration_s": float(t[-1] - t[0]), "rate_hz": 1.0 / median if median > 0.0 else None}
    if episode.is_timed:
        period_s = 1.0 / episode.nominal_hz if episode.nominal_hz else median
        told |= {
            "late_steps": int((apart > _LATE * period_s).sum()),
            "longest_pause_s": float(apart.max()),
            "repeated_stamps": int((apart <= 0.0).sum()),
        }
    return told


def _space(episode: Trajectory) -> dict[str, float | int | None]:
    told: dict[str, float | int | None] = {}
    if episode.position_m is not None and len(episode.position_m) > 1:
        moved = np.diff(episode.position_m, axis=0)
        told["path_m"] = float(np.sqrt(np.einsum("ij,ij->i", moved, moved)).sum())
    action = episode.tables.get(of.ACTION)
    if action is not None and len(action.data):
        data = action.data
        idle = (data == 0.0).all(axis=1)
        idle[1:] |= (data[1:] == data[:-1]).all(axis=1)
        told["idle_share"] = float(idle.mean())
    return told


def _felt(episode: Trajectory) -> dict[str, float | int | None]:
    told: dict[str, float | int | None] = {}
    name = next((name for name in _FORCES if name in episode.tables), "")
    if name:
        force = episode.tables[name].data[:, :3]
        squares = np.einsum("ij,ij->i", force, force)
        squares = squares[np.isfinite(squares)]
        peak = "estimated_peak_force_n" if name == of.ESTIMATED else "peak_force_n"
        # A raw reading holds the tool's weight and a bias: its peak would say nothing of contact.
        if len(squares) and name != of.WRENCH_RAW:
            told[peak] = float(np.sqrt(squares.max()))
    if episode.estimate_std is not None:
        std = episode.estimate_std[:, :3]
        std = std[np.isfinite(std[:, 0])]
        told["estimated_force_std_n"] = float(np.median(np.sqrt((std**2).sum(axis=1)))) if len(std) else None
    torque = episode.tables.get(of.JOINT_TORQUE)
    if torque is not None and torque.data.size:
        peak_nm = np.abs(torque.data).max()
        told["peak_joint_torque_nm"] = float(peak_nm) if np.isfinite(peak_nm) else None
    return told


def _health(episode: Trajectory) -> dict[str, float | int | None]:
    timing = episode.tables.get(of.TIMING)
    if timing is None or not len(timing.data):
        return {}
    # Exact enough of a few hundred steps, and many times as fast as a quantile of each column.
    rank = round(0.95 * (len(timing.data) - 1))
    ranked = np.partition(timing.data, rank, axis=0)[rank]
    told: dict[str, float | int | None] = {}
    for column, value in zip(timing.columns, ranked.tolist(), strict=True):
        told[column] = value if np.isfinite(value) else None
    if "robot_clock_ms" in told:
        drift = timing.data[:, timing.columns.index("robot_clock_ms")]
        told["clock_drift_ms"] = float(drift.max() - drift.min())
    names = {figure.name for figure in FIGURES}
    return {name: value for name, value in told.items() if name in names}


def _not_finite(episode: Trajectory) -> int:
    return sum(int((~np.isfinite(each)).sum()) for each in (episode.position_m, episode.joints_rad) if each is not None)


def _shape(episode: Trajectory) -> tuple[Float32[np.ndarray, " s"], str]:
    """Postures at evenly spaced times: two recordings of one demonstration have the same."""
    for name, rows in (("joints", episode.joints_rad), ("position", episode.position_m)):
        if rows is not None and len(rows) >= 2 and np.isfinite(rows).all():
            at = np.rint(np.linspace(0, len(rows) - 1, _SHAPE)).astype(int)
            return rows[at].astype(np.float32).ravel(), name
    return np.zeros(0, np.float32), ""
