"""The figures that say what an episode's force is worth: name, unit and meaning of each, stated once.

`quality.parquet`, `quality.json` and the report take names, units and meanings from here.
"""

from dataclasses import dataclass
from typing import Literal

from wrenchflow.errors import unknown

type Value = float | int | bool | None
type Type = type[float] | type[int] | type[bool]

Group = Literal["force", "contact", "sensor", "timing", "motion", "energy"]


@dataclass(frozen=True, kw_only=True)
class Metric:
    """One figure of an episode.

    Attributes:
        name: Column of `quality.parquet`.
        title: For a person.
        unit: Of the value; empty for a count or a share.
        group: What it is about.
        meaning: One or two sentences: how it is found, and how to read it.
        type: Of its value.
        digits: That a person is shown.
        decides: Whether it is among those that a report shows first.
    """

    name: str
    title: str
    unit: str
    group: Group
    meaning: str
    type: Type = float
    digits: int = 2
    decides: bool = False


METRICS: tuple[Metric, ...] = (
    Metric(
        name="snr_force_db",
        title="SNR, force",
        unit="dB",
        group="force",
        meaning="Root mean square in contact over that in free motion, of the three forces of wrench_zero_phase "
        "together. Forces and moments are never averaged together; `snr` has every axis by itself.",
        digits=1,
        decides=True,
    ),
    Metric(
        name="snr_torque_db",
        title="SNR, moment",
        unit="dB",
        group="force",
        meaning="The same of the three moments.",
        digits=1,
    ),
    Metric(
        name="max_force",
        title="largest force",
        unit="N",
        group="force",
        meaning="Largest norm of the force in `wrench`: without bias and weight, through the causal low-pass that "
        "deployment runs. It is the figure that a force limit sees.",
        digits=1,
        decides=True,
    ),
    Metric(
        name="max_torque",
        title="largest moment",
        unit="N.m",
        group="force",
        meaning="The same of the moment about the tcp.",
        digits=2,
    ),
    Metric(
        name="max_force_raw",
        title="largest force, unfiltered",
        unit="N",
        group="force",
        meaning="Largest norm of the reading less its median, without any filter: what the sensor and the tool bear.",
        digits=1,
    ),
    Metric(
        name="smoothness",
        title="force step",
        unit="N",
        group="force",
        meaning="Mean norm of the change of the force from one sample of wrench_zero_phase to the next; lower is "
        "smoother. It depends on the sample rate.",
        digits=4,
        decides=True,
    ),
    Metric(
        name="force_rate_rms",
        title="force rate in contact",
        unit="N/s",
        group="force",
        meaning="Root mean square of dF/dt in contact, from wrench_zero_phase; lower is smoother, at any sample rate.",
        digits=1,
    ),
    Metric(
        name="max_force_rate",
        title="fastest force",
        unit="N/s",
        group="force",
        meaning="Largest norm of dF/dt of wrench_zero_phase: how hard the hardest touch began.",
        digits=0,
    ),
    Metric(
        name="impact_peak",
        title="impact peak",
        unit="N",
        group="contact",
        meaning="Largest force within 50 ms of the start of a contact, of wrench_zero_phase.",
        digits=1,
    ),
    Metric(
        name="has_contact",
        title="contact",
        unit="",
        group="contact",
        meaning="Whether there is any contact.",
        type=bool,
    ),
    Metric(name="contacts", title="contacts", unit="", group="contact", meaning="How many.", type=int, digits=0),
    Metric(
        name="contact_fraction",
        title="share in contact",
        unit="",
        group="contact",
        meaning="Share of the samples that lie in a contact.",
        digits=3,
        decides=True,
    ),
    Metric(
        name="contact_onset_s",
        title="first contact",
        unit="s",
        group="contact",
        meaning="From the end of the tare, or else from the first sample, to the start of the first contact.",
        decides=True,
    ),
    Metric(
        name="free_residual",
        title="left in free motion",
        unit="N",
        group="sensor",
        meaning="Root mean square of the force of wrench_zero_phase in free motion: what bias, payload and the tool's "
        "inertia leave over.",
        digits=3,
    ),
    Metric(
        name="bias_drift",
        title="bias drift",
        unit="N/min",
        group="sensor",
        meaning="Largest change of the unloaded reading of a force axis from the rest at the start to one at the "
        "end, a minute; a recording that ends in contact cannot tell it.",
        digits=3,
        decides=True,
    ),
    Metric(
        name="saturated",
        title="saturated",
        unit="",
        group="sensor",
        meaning="Share of the samples with a channel at the end of its range.",
        digits=4,
        decides=True,
    ),
    Metric(
        name="noise",
        title="noise",
        unit="N",
        group="sensor",
        meaning="Largest standard deviation of one raw sample among the forces, in the bias window.",
        digits=3,
    ),
    Metric(
        name="quantisation",
        title="quantisation step",
        unit="N",
        group="sensor",
        meaning="Largest step between neighbouring values among the forces, where readings repeat values at all.",
        digits=4,
    ),
    Metric(name="samples", title="samples", unit="", group="timing", meaning="Of wrench_raw.", type=int, digits=0),
    Metric(
        name="duration_s",
        title="duration",
        unit="s",
        group="timing",
        meaning="From the first to the last stamp of all streams.",
    ),
    Metric(
        name="rate_hz",
        title="effective rate",
        unit="Hz",
        group="timing",
        meaning="New readings of wrench_raw a second: samples that repeat the one before do not count.",
        digits=1,
        decides=True,
    ),
    Metric(
        name="gaps",
        title="gaps",
        unit="",
        group="timing",
        meaning="Steps of wrench_raw longer than one and a half periods.",
        type=int,
        digits=0,
        decides=True,
    ),
    Metric(
        name="longest_gap_s",
        title="longest step",
        unit="s",
        group="timing",
        meaning="Longest time between two samples of wrench_raw.",
        digits=4,
    ),
    Metric(
        name="sparc",
        title="SPARC of motion",
        unit="",
        group="motion",
        meaning="Spectral arc length of the tcp's speed (Balasubramanian and others, 2015; up to 10 Hz, amplitude "
        "0.05); nearer to 0 is smoother.",
        decides=True,
    ),
    Metric(
        name="ldlj",
        title="LDLJ of motion",
        unit="",
        group="motion",
        meaning="Log dimensionless jerk of the tcp's velocity, low-passed at 10 Hz; nearer to 0 is smoother.",
    ),
    Metric(
        name="path_length_m",
        title="path",
        unit="m",
        group="motion",
        meaning="How far the tcp moved.",
        digits=3,
    ),
    Metric(
        name="idle_fraction",
        title="share at rest",
        unit="",
        group="motion",
        meaning="Share of the time in which the tcp is slower than 2 mm/s.",
    ),
    Metric(
        name="work_wrench_j",
        title="work by the sensor",
        unit="J",
        group="energy",
        meaning="What the robot did on its environment: integral of force times velocity and of moment times angular "
        "velocity, of wrench_zero_phase and the tcp.",
        digits=3,
    ),
    Metric(
        name="work_joints_j",
        title="work by the joints",
        unit="J",
        group="energy",
        meaning="The same, by the joints: integral of external torque times joint velocity.",
        digits=3,
    ),
    Metric(
        name="energy_gap",
        title="energy gap",
        unit="",
        group="energy",
        meaning="Difference of the two works as a share of all energy that was exchanged to and fro; large where "
        "sensor, sign, frame or clock are wrong.",
        digits=3,
        decides=True,
    ),
)
NAMES = tuple(metric.name for metric in METRICS)


def metric_of(name: str) -> Metric:
    """The metric of a name.

    Raises:
        KeyError: If there is none.
    """
    for metric in METRICS:
        if metric.name == name:
            return metric
    raise KeyError(unknown("metric", name, NAMES))
