"""A plotly figure as a piece of a page: its data as JSON, drawn by a script of the page, without a network."""

from html import escape

from plotly.graph_objects import Figure
from plotly.io import to_json
from plotly.offline import get_plotlyjs

# A plot in a closed fold has no width yet, so it is drawn when the fold is opened first.
_DRAW = """
const options = {responsive: true, displayModeBar: false};
const draw = plot => {
  const figure = JSON.parse(plot.querySelector("script").textContent);
  plot.textContent = "";
  Plotly.newPlot(plot, figure.data, figure.layout, options);
};
document.querySelectorAll(".plot").forEach(plot => {
  const fold = plot.closest("details:not([open])");
  if (fold) fold.addEventListener("toggle", () => draw(plot), {once: true});
  else draw(plot);
});
"""


def plot_block(figure: Figure, id: str) -> str:
    """A place for a figure in a page that ends with `plot_scripts()`.

    Args:
        figure: What is drawn.
        id: Id of the element; the same at each run, so that the page is too.
    """
    # Plotly writes `<` as an escape in its JSON, so no text can end the <script>.
    data = to_json(figure, validate=False, engine="json")
    height_px = figure.layout.height
    return (
        f'<div class="plot" id="{escape(id)}" style="min-height:{height_px}px">'
        f'<script type="application/json">{data}</script></div>'
    )


def plot_scripts() -> str:
    """The plotting library, once a page, and what draws the figures."""
    return f"<script>{get_plotlyjs()}</script>\n<script>{_DRAW}</script>"
