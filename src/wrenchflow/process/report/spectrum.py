"""What frequencies the force of an episode holds, in free motion and in contact, with the filter's cut-off."""

import numpy as np
from jaxtyping import Bool, Float

from wrenchflow.episode import Episode
from wrenchflow.pages import theme
from wrenchflow.pages.drawing import Drawing
from wrenchflow.process.contact import CONTACT, in_contact
from wrenchflow.process.metrics.figure import GUARD_NS
from wrenchflow.process.stamps import finite

_WINDOW_S = 0.25
_HIGHEST = 1e30  # Its power would be no number any more.
_FEWEST = 32  # Samples of a window.


def spectrum_figure(raw: Episode, clean: Episode | None, cutoff_hz: float) -> tuple[Drawing | None, list[str]]:
    """Amplitude density of the raw force, its three axes together [N/sqrt(Hz)].

    Args:
        raw: As it was recorded, with `wrench_raw`.
        clean: Tells what is contact; without it the whole recording is one.
        cutoff_hz: Of the low-pass [Hz].

    Returns:
        The plot, None if there is nothing to draw; and what could not be told, as sentences.
    """
    if "wrench_raw" not in raw:
        return None, ["there is no stream 'wrench_raw'"]
    stream = finite(raw["wrench_raw"])
    if (np.abs(stream.data) > _HIGHEST).any():
        return None, [f"the reading exceeds {_HIGHEST:g}"]
    if len(stream) < _FEWEST:
        return None, [f"{len(stream)} samples, {_FEWEST} needed"]
    rate_hz = 1e9 / float(np.median(np.diff(stream.t)))
    # A stretch ends where samples are missing.
    whole = np.append(np.diff(stream.t) * 1e-9 * rate_hz < 1.5, True)
    if clean is None:
        parts = {"the whole recording": whole}
    else:
        contacts = clean.events_of(CONTACT)
        parts = {
            "free motion": ~in_contact(stream, contacts, GUARD_NS) & whole,
            "contact": in_contact(stream, contacts) & whole,
        }
    count = max(int(_WINDOW_S * rate_hz), _FEWEST)
    figure, lacking = Drawing(layout=theme.plot_layout(230, hovermode="x unified", showlegend=True)), []
    figure.layout["margin"]["l"] = 70
    styles = zip(parts.items(), (theme.ACCENT, theme.COLOURS[1]), ("solid", "6px,3px"), strict=False)
    for (name, rows), colour, dash in styles:
        density = amplitude_density(stream.data[:, :3], rows, count, rate_hz)
        if density is None:
            lacking.append(f"{name}: no stretch of {count / rate_hz:.2g} s in a row")
            continue
        figure.data.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": (np.arange(1, len(density)) * rate_hz / count).astype(np.float32),
                "y": density[1:].astype(np.float32),
                "name": name,
                "line": {"color": colour, "width": 1.6, "dash": dash},
                "hovertemplate": "%{y:.3g} N/√Hz",
            }
        )
    if not figure.data:
        return None, lacking
    figure.add_shape(
        type="line", x0=cutoff_hz, x1=cutoff_hz, y0=0, y1=1, yref="paper", line={"color": theme.BAD, "dash": "dot"}
    )
    figure.add_annotation(
        text=f"cut-off {cutoff_hz:g} Hz",
        x=float(np.log10(cutoff_hz)),
        xanchor="left",
        y=1,
        yref="paper",
        yanchor="top",
        showarrow=False,
    )
    figure.layout["xaxis"] = {"type": "log", "title": {"text": "frequency [Hz]"}, "dtick": "D2", "tickformat": "~g"}
    figure.layout["yaxis"] = {"type": "log", "title": {"text": "force [N/√Hz]"}, "dtick": "D2", "tickformat": "~g"}
    figure.layout["legend"] = {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"}
    return figure, lacking


def amplitude_density(
    data: Float[np.ndarray, "n d"], rows: Bool[np.ndarray, " n"], count: int, rate_hz: float
) -> Float[np.ndarray, " f"] | None:
    """Root of the power density of all columns together, by Welch's method, of stretches that are long enough.

    Args:
        data: Evenly spaced samples.
        rows: Which of them are looked at.
        count: Samples of a window; windows overlap by half of it.
        rate_hz: Of the samples [Hz].

    Returns:
        From 0 Hz up in steps of `rate_hz / count`, in the data's unit for a root of a Hz; None if no stretch is as long
        as a window. Shape (count // 2 + 1,).
    """
    edges = np.diff(np.concatenate([[False], rows, [False]]).astype(np.int8))
    starts = [
        np.arange(first, last - count + 1, count // 2)
        for first, last in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)
    ]
    first = np.concatenate(starts) if starts else np.zeros(0, np.int64)
    if not len(first):
        return None
    windows = data[first[:, None] + np.arange(count)]  # (windows, count, d)
    hann = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(count) / count)
    windows = (windows - windows.mean(axis=1, keepdims=True)) * hann[:, None]
    power = (np.abs(np.fft.rfft(windows, axis=1)) ** 2).sum(axis=2).mean(axis=0)
    return np.sqrt(2.0 * power / (rate_hz * (hann**2).sum()))
