"""Small plots of a whole set of attempts or of a training run."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wrenchflow.pages import theme
from wrenchflow.pages.drawing import Drawing


def peak_force_figure(peaks_n: Sequence[float], limit_n: float) -> Drawing:
    """How many attempts peaked in each newton, with the limit as a line.

    Args:
        peaks_n: Peak force of each attempt [N].
        limit_n: What counts as over-force [N].
    """
    # Bar k holds the peaks in (limit + k - 1, limit + k]: none lies on both sides of the limit, and a peak at the limit
    # is under it, as only what exceeds it is over-force.
    bars, counts = np.unique(np.ceil(np.asarray(peaks_n, np.float64) - limit_n), return_counts=True)
    figure = Drawing(layout=theme.plot_layout(200, barmode="overlay"))
    for name, chosen, colour in (
        ("under the limit", bars <= 0.0, theme.ACCENT),
        ("over the limit", bars > 0.0, theme.BAD),
    ):
        figure.data.append(
            {
                "type": "bar",
                "x": limit_n + bars[chosen] - 0.5,
                "y": counts[chosen],
                "width": 1.0,
                "name": name,
                "marker": {"color": colour, "line": {"width": 1, "color": "rgba(128,128,128,0.4)"}},
                "showlegend": False,
                "hovertemplate": "%{y} attempts around %{x:.1f} N<extra></extra>",
            }
        )
    ends = {"x0": limit_n, "x1": limit_n, "y0": 0, "y1": 1, "xref": "x", "yref": "y domain"}
    figure.add_shape(type="line", **ends, line={"color": theme.BAD, "dash": "dash"})
    place = {"x": limit_n, "xref": "x", "xanchor": "right", "y": 1, "yref": "y domain", "yanchor": "top"}
    figure.add_annotation(text=f"limit {limit_n:g} N", showarrow=False, **place)
    figure.layout["xaxis"] = {
        "title": {"text": "peak low-passed force [N]"},
        "range": [0, max(max(peaks_n, default=0.0), limit_n) + 2.0],
    }
    figure.layout["yaxis"] = {"title": {"text": "attempts"}, "rangemode": "tozero"}
    return figure


def training_figure(training: Mapping[str, Any]) -> Drawing:
    """Loss over training steps, on a logarithmic scale.

    Args:
        training: `steps` and `loss`, of one length, and perhaps `validation_loss`.
    """
    figure = Drawing(layout=theme.plot_layout(200, hovermode="x unified", showlegend=True))
    for key, name, colour in (
        ("loss", "training", theme.ACCENT),
        ("validation_loss", "validation", theme.AXIS_COLOURS[0]),
    ):
        if training.get(key):
            figure.data.append(
                {
                    "type": "scatter",
                    "x": list(training["steps"]),
                    "y": list(training[key]),
                    "name": name,
                    "mode": "lines",
                    "line": {"color": colour, "width": 1.6},
                    "connectgaps": True,
                }
            )
    figure.layout["xaxis"] = {"title": {"text": "training step"}}
    figure.layout["yaxis"] = {"title": {"text": "loss"}, "type": "log", "dtick": "D2", "tickformat": "~g"}
    figure.layout["legend"] = {"orientation": "h", "x": 1, "xanchor": "right", "y": 1, "yanchor": "bottom"}
    return figure
