"""A plot as a piece of a page: its data as JSON, drawn by a script of the page, without a network."""

from functools import cache
from html import escape

from wrenchflow.pages.drawing import Drawing

# The library is run only when the page is loaded: a browser needs a second or two to compile it, and a person can read
# meanwhile. A plot in a closed fold has no width yet, so it is drawn when the fold is opened first. A point whose trace
# has `meta: "links"` opens what its customdata says.
DRAW = """
const options = {responsive: true, displayModeBar: false};
const library = document.querySelector("script.library");
let isAwaited = true;
const plots = [...document.querySelectorAll(".plot")];
const draw = plot => {
  const data = plot.querySelector("script[type='application/json']");
  if (!data || isAwaited) return;
  if (typeof Plotly === "undefined") {
    plot.textContent = "This plot is not drawn: the plotting library is not where this page looks for it. " +
      "The tables are complete.";
    plot.style.minHeight = "0";
    return;
  }
  const figure = JSON.parse(data.textContent);
  plot.textContent = "";
  // A finger that moves over a plot moves the page.
  if (matchMedia("(pointer: coarse)").matches) figure.layout.dragmode = false;
  Plotly.newPlot(plot, figure.data, figure.layout, options);
  plot.on("plotly_click", event => {
    const point = event.points[0];
    if (point.data.meta === "links" && point.customdata) location.assign(point.customdata);
  });
};
const waiting = [];
plots.forEach(plot => {
  const fold = plot.closest("details:not([open])");
  if (fold) fold.addEventListener("toggle", () => draw(plot), {once: true});
  else waiting.push(plot);
});
const drawNext = () => {
  if (!waiting.length) return;
  draw(waiting.shift());
  setTimeout(drawNext);
};
const drawAll = () => { isAwaited = false; drawNext(); };
const begin = () => {
  if (!library.isConnected) return;
  library.remove();
  const script = document.createElement("script");
  if (library.dataset.path) {
    script.onload = script.onerror = drawAll;
    script.src = library.dataset.path;
    document.body.append(script);
  } else {
    script.textContent = library.textContent;
    document.body.append(script);
    drawAll();
  }
};
addEventListener("load", () => setTimeout(begin));
const folds = [];
addEventListener("beforeprint", () => {
  begin();
  document.querySelectorAll("details:not([open])").forEach(fold => { fold.open = true; folds.push(fold); });
  plots.forEach(plot => {
    draw(plot);
    if (plot.layout) Plotly.relayout(plot, {width: 660});  // As wide as a sheet of A4 with its margins.
  });
});
addEventListener("afterprint", () => {
  folds.splice(0).forEach(fold => { fold.open = false; });
  plots.forEach(plot => { if (plot.layout) Plotly.relayout(plot, {width: null, autosize: true}); });
});
document.addEventListener("click", event => {
  const place = event.target.closest("[data-from]");
  if (!place) return;
  event.preventDefault();
  const plot = document.getElementById(place.dataset.plot);
  draw(plot);
  plot.scrollIntoView({block: "start"});
  if (plot.layout) Plotly.relayout(plot, {"xaxis.range": [Number(place.dataset.from), Number(place.dataset.to)]});
});
"""


def plot_block(figure: Drawing, id: str) -> str:
    """A place for a plot in a page that ends with `DRAW`.

    Args:
        figure: What is drawn.
        id: Id of the element; the same at each run, so that the page is too.
    """
    return (
        f'<div class="plot" id="{escape(id)}" style="min-height:{figure.layout["height"]}px">'
        f'<script type="application/json">{figure.to_json()}</script></div>'
    )


@cache
def plot_library() -> str:
    """The plotting library's script, as a page carries it or as a file beside several pages."""
    from plotly.offline import get_plotlyjs  # Loads in half a second, and a page of tables needs nothing of it.

    return get_plotlyjs()
