"""Small plots of a whole set of attempts or of a training run."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from plotly.graph_objects import Bar, Figure, Scatter

from wrenchflow.pages import theme


def peak_force_figure(peaks_n: Sequence[float], limit_n: float) -> Figure:
    """How many attempts peaked in each newton, with the limit as a line.

    Args:
        peaks_n: Peak force of each attempt [N].
        limit_n: What counts as over-force [N].
    """
    # Bar k holds the peaks in (limit + k - 1, limit + k]: none lies on both sides of the limit, and a peak at the limit
    # is under it, as only what exceeds it is over-force.
    bars, counts = np.unique(np.ceil(np.asarray(peaks_n, np.float64) - limit_n), return_counts=True)
    figure = Figure()
    for name, chosen, colour in (
        ("under the limit", bars <= 0.0, theme.ACCENT),
        ("over the limit", bars > 0.0, theme.BAD),
    ):
        figure.add_trace(
            Bar(
                x=limit_n + bars[chosen] - 0.5,
                y=counts[chosen],
                width=1.0,
                name=name,
                marker={"color": colour, "line": {"width": 1, "color": "rgba(128,128,128,0.4)"}},
                showlegend=False,
                hovertemplate="%{y} attempts around %{x:.1f} N<extra></extra>",
            )
        )
    figure.add_vline(
        limit_n,
        line={"color": theme.BAD, "dash": "dash"},
        annotation_text=f"limit {limit_n:g} N",
        annotation_position="top left",
    )
    figure.update_xaxes(
        title_text="peak low-passed force [N]", range=[0, max(max(peaks_n, default=0.0), limit_n) + 2.0]
    )
    figure.update_yaxes(title_text="attempts", rangemode="tozero")
    figure.update_layout(theme.plot_layout(200, barmode="overlay"))
    return figure


def training_figure(training: Mapping[str, Any]) -> Figure:
    """Loss over training steps, on a logarithmic scale.

    Args:
        training: `steps` and `loss`, of one length, and perhaps `validation_loss`.
    """
    figure = Figure()
    for key, name, colour in (
        ("loss", "training", theme.ACCENT),
        ("validation_loss", "validation", theme.AXIS_COLOURS[0]),
    ):
        if training.get(key):
            figure.add_trace(
                Scatter(
                    x=list(training["steps"]),
                    y=list(training[key]),
                    name=name,
                    mode="lines",
                    line={"color": colour, "width": 1.6},
                    connectgaps=True,
                )
            )
    figure.update_xaxes(title_text="training step")
    figure.update_yaxes(title_text="loss", type="log", dtick="D2", tickformat="~g")
    figure.update_layout(
        theme.plot_layout(200, hovermode="x unified", showlegend=True),
        legend={"orientation": "h", "x": 1, "xanchor": "right", "y": 1, "yanchor": "bottom"},
    )
    return figure
