"""One take of somebody's hand, emulated or real, and what it is like in figures; used by `operator_realism.py`."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import butter, find_peaks, sosfiltfilt, welch

from wrenchflow.episode import Episode
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_episode

# A hand does nothing on purpose above this, and a path or a speed from noisier positions would be noise's.
MOTION_HZ = 10.0
# A peak of the speed is a submovement if it stands out by so much, of the take's highest speed and at all.
STANDS_OUT, STANDS_OUT_M_S = 0.05, 0.002
TOUCH_N = 1.0
WINDOW_S = 0.5  # Of a spectrum; so long a contact has to last to have one.
BANDS_HZ = {"2 to 8": (2.0, 8.0), "8 to 12": (8.0, 12.0), "12 to 40": (12.0, 40.0)}
TREMOR = "8 to 12"
# Up to where a spectrum is of the hand and the tool. A velocity from measured joints is mostly noise from here on.
FORCE_KNOWN_HZ, MOTION_KNOWN_HZ = 40.0, 15.0
# The real takes have no clock; their velocity against their position gives this rate, if both are in metres.
REAL_HZ = 694.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """Somebody's hand at work.

    Attributes:
        who: A profile, or who recorded it.
        rate_hz: Of the samples.
        position_m: Of the tool. Shape (n, 3).
        force_n: As the sensor reads it, without its bias. Shape (n, 3).
        smooth_n: Low-passed. Shape (n, 3).
        success: Whether it got done; None where nobody said.
    """

    who: str
    rate_hz: float
    position_m: np.ndarray
    force_n: np.ndarray
    smooth_n: np.ndarray
    success: bool | None = None

    @property
    def speed_m_s(self) -> np.ndarray:
        """Of the tool. Shape (n,)."""
        smooth = _lowpass(self.position_m, MOTION_HZ, self.rate_hz)
        return np.linalg.norm(np.gradient(smooth, 1.0 / self.rate_hz, axis=0), axis=1)

    @property
    def submovements(self) -> np.ndarray:
        """Samples at which the speed has a peak that stands out."""
        speed = self.speed_m_s
        return find_peaks(speed, prominence=max(STANDS_OUT * speed.max(), STANDS_OUT_M_S))[0]

    @property
    def touches(self) -> np.ndarray:
        """Whether something is touched, at each sample. Shape (n,)."""
        return np.linalg.norm(self.smooth_n, axis=1) > TOUCH_N

    def figures(self) -> dict[str, float]:
        """What it was like, by name."""
        speed = self.speed_m_s
        duration_s = len(speed) / self.rate_hz
        told = {
            "peak force [N]": float(np.linalg.norm(self.smooth_n, axis=1).max()),
            "duration [s]": duration_s,
            "path [m]": float(speed.sum() / self.rate_hz),
            "submovements": float(len(self.submovements)),
            "submovements / s": len(self.submovements) / duration_s,
            "SPARC": sparc(speed, self.rate_hz),
        }
        force_hz, force = self.force_spectrum()
        speed_hz, motion = self.motion_spectrum()
        for name, band in BANDS_HZ.items():
            told[f"force {name}"] = share(force_hz, force, band, FORCE_KNOWN_HZ)
        told[f"motion {TREMOR}"] = share(speed_hz, motion, BANDS_HZ[TREMOR], MOTION_KNOWN_HZ)
        return told

    def force_spectrum(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the force while something is touched, all axes together [Hz], [N^2/Hz]; NaN if it is never for long."""
        return self._spectrum(self.force_n, self.touches)

    def motion_spectrum(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the tool's velocity [Hz], [(m/s)^2/Hz]."""
        velocity = np.gradient(self.position_m, 1.0 / self.rate_hz, axis=0)
        return self._spectrum(velocity, np.ones(len(velocity), bool))

    def _spectrum(self, values: np.ndarray, of: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        width = round(WINDOW_S * self.rate_hz)
        hz = np.fft.rfftfreq(width, 1.0 / self.rate_hz)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], of.astype(int), [0]])))
        power, weight = np.zeros(len(hz)), 0
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if stop - start >= width:
                # A line is taken out of each window: how hard somebody presses is not how much the hand moves.
                each = welch(values[start:stop], self.rate_hz, nperseg=width, detrend="linear", axis=0)[1].sum(1)
                power, weight = power + (stop - start) * each, weight + stop - start
        return hz, power / weight if weight else np.full(len(hz), np.nan)


def share(hz: np.ndarray, power: np.ndarray, band: tuple[float, float], known_hz: float) -> float:
    """What lies in one band, of the power from what a window can tell up to `known_hz`."""
    inside, all_of_it = (hz >= band[0]) & (hz < band[1]), (hz >= 1.0 / WINDOW_S) & (hz < known_hz)
    return float(power[inside].sum() / power[all_of_it].sum())


def sparc(speed: np.ndarray, rate_hz: float) -> float:
    """Spectral arc length of a speed: the closer to 0, the smoother.

    Source: Balasubramanian and others, *On the analysis of movement smoothness* (2015): up to 10 Hz, cut where the
    spectrum stays below 5 % of its highest, padded by four octaves.
    """
    size = 2 ** (int(np.ceil(np.log2(len(speed)))) + 4)
    hz, spectrum = np.fft.rfftfreq(size, 1.0 / rate_hz), np.abs(np.fft.rfft(speed, size))
    spectrum /= spectrum.max()
    kept = hz <= 10.0
    hz, spectrum = hz[kept], spectrum[kept]
    last = int(np.flatnonzero(spectrum >= 0.05)[-1]) + 1
    hz, spectrum = hz[:last], spectrum[:last]
    return -float(np.hypot(np.diff(hz) / (hz[-1] - hz[0]), np.diff(spectrum)).sum())


def take_of(episode: Episode) -> Take:
    """An emulated demonstration, from where its tare ends."""
    clean = process_episode(episode, ProcessConfig())[0]
    start_ns = max(event.stop_ns for event in episode.events_of("phase") if event.label == "tare")
    wrench, raw = clean["wrench"], episode["wrench_raw"]
    stop_ns = min(int(episode["tcp_pose"].t[-1]), int(wrench.t[-1]), int(raw.t[-1]))

    def part(name: Episode, stream: str) -> np.ndarray:
        of = name[stream]
        return of.data[(of.t >= start_ns) & (of.t <= stop_ns), :3].copy()

    at_rest = raw.data[raw.t < start_ns, :3]
    return Take(
        who=episode.meta["person"]["profile"],
        rate_hz=1000.0,
        position_m=part(episode, "tcp_pose"),
        force_n=part(episode, "wrench_raw") - at_rest[len(at_rest) // 2 :].mean(0),
        smooth_n=part(clean, "wrench"),
        success=bool(episode.meta["result"]["success"]),
    )


def real_takes(path: Path) -> list[Take]:
    """The takes of the hand-guided recording `17_symbol_data.mat`: pos, vel and F, each 3 x T."""
    takes = []
    for each in loadmat(path)["symbol_data"].flat:
        force = np.asarray(each["F"], float).T
        smooth = _lowpass(force, ProcessConfig().filter.cutoff_hz, REAL_HZ)
        takes.append(Take(who="real hand", rate_hz=REAL_HZ, position_m=each["pos"].T, force_n=force, smooth_n=smooth))
    return takes


def _lowpass(values: np.ndarray, cutoff_hz: float, rate_hz: float) -> np.ndarray:
    return np.asarray(sosfiltfilt(butter(2, cutoff_hz, fs=rate_hz, output="sos"), values, axis=0))
