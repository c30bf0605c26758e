"""How well a payload is told from six poses of the simulated arm: mass, centre of mass, and what the covariance covers.

Run it as `python benchmarks/payload_identification.py [RUNS]`. Each run draws a payload of 0.5 to 2 kg, a sensor (bias,
drift, noise) and an arm whose orientation is off by a milliradian, goes through the calibration motion, and identifies.
"""

import sys

import numpy as np

from wrenchflow.collect.calibration_motion import run_motion
from wrenchflow.process.identify import identify
from wrenchflow.process.payload import UNLIKELY
from wrenchflow.rig import Payload, Rig, load_rig

RUNS = 400
NAMES = ("mass", "x", "y", "z", "bias fx", "bias fy", "bias fz", "bias tx", "bias ty", "bias tz")
MASS_SHARE, COM_M, COVERAGE = 0.01, 0.002, 0.95


def truth_of(rng: np.random.Generator) -> Payload:
    """A payload of 0.5 to 2 kg, up to 30 mm aside and 30 to 100 mm ahead of the sensor."""
    x, y, z = (*rng.uniform(-0.03, 0.03, 2).tolist(), float(rng.uniform(0.03, 0.10)))
    return Payload(mass_kg=float(rng.uniform(0.5, 2.0)), com_sensor_m=(x, y, z))


def run(rig: Rig, seed: int) -> tuple[float, float, np.ndarray, float]:
    """Errors of mass (share) and centre of mass [m]; those in standard deviations; the chance."""
    truth = truth_of(np.random.default_rng(seed))
    episode = run_motion(rig, truth, seed=seed)
    found = identify([episode], rig).estimate
    mass_kg, com_m = truth.mass_kg, np.array(truth.com_sensor_m)
    error_m = np.array(found.payload.com_sensor_m) - com_m
    # The drift of this sensor is known, so what its bias was amid the rests is.
    sensor = episode.meta["simulator"]["sensor"]
    rests = [event for event in episode.events_of("phase") if event.label.startswith("rest")]
    middle_ns = np.mean([(rest.start_ns + rest.stop_ns) // 2 - rests[0].start_ns for rest in rests]) + rests[0].start_ns
    minutes = (episode["wrench_raw"].t[-1] - middle_ns) / 60e9
    bias = np.array(sensor["bias_end"]) - minutes * np.array(sensor["drift_per_min"])
    sigmas = np.concatenate(
        [
            [(found.payload.mass_kg - mass_kg) / found.mass_std_kg],
            error_m / found.com_std_m,
            (found.bias - bias) / np.sqrt(np.diag(found.covariance)[4:]),
        ]
    )
    return abs(found.payload.mass_kg / mass_kg - 1.0), float(np.linalg.norm(error_m)), sigmas, found.chance


def main() -> None:
    """Print goals and what was measured."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    rig = load_rig("panda_peg")
    results = [run(rig, seed) for seed in range(runs)]
    mass, off_m, sigmas, chance = (np.array(column) for column in zip(*results, strict=True))
    off_mm = 1e3 * off_m
    print(f"{runs} runs, payloads of 0.5 to 2 kg, 6 poses, noise {rig.sensor.noise_force_n} N a sample")
    print(f"mass             goal {MASS_SHARE:.0%} or less; median {np.median(mass):.3%}, largest {mass.max():.3%}")
    print(
        f"centre of mass   goal {1e3 * COM_M:g} mm or less; median {np.median(off_mm):.3f}, largest {off_mm.max():.3f}"
    )
    inside = np.abs(sigmas) <= 1.96
    margin = 1.96 * np.sqrt(COVERAGE * (1 - COVERAGE) / runs)
    print(f"truth within 1.96 standard deviations: goal {COVERAGE:.0%}, which chance makes {margin:.1%} more or less")
    for name, column, spread in zip(NAMES, inside.T, sigmas.std(axis=0), strict=True):
        print(f"  {name:<8} {column.mean():6.1%}   errors scatter by {spread:.2f} standard deviations")
    print(f"  all four of the payload {inside[:, :4].mean():.1%}; variances raised in {(chance < UNLIKELY).mean():.1%}")


if __name__ == "__main__":
    main()
