"""A section of episode plots: one fold an episode, the first one open."""

from collections.abc import Sequence
from html import escape

from wrenchflow.episode import Episode
from wrenchflow.pages.episode_plot import episode_figure
from wrenchflow.pages.page import link, section
from wrenchflow.pages.plot_block import plot_block
from wrenchflow.pages.time_plot import POINTS

# Points that the lines of one page may have together, a share for each of its episodes, and the fewest that still show
# a shape. An episode of 25 lines then takes about 0.26 MB for a thousand points a line.
_POINTS_A_PAGE, _FEWEST_POINTS = 14_000, 200

WHAT_IS_DRAWN = (
    "A causal filter uses only what was measured until then, as a running robot must, so it lags a little (the thick "
    "line, and what the policy gets); a zero-phase filter runs forward and backward over the whole recording, so its "
    "peaks stand where they happened (the thin line, for labels and plots only). Below are the safety layer's ledger "
    "(energy in its tank, in the spring and of the moving arm, and work since the start by kind), its modes, and a "
    "lane for each safeguard that intervened."
)
_HOW_TO_READ = (
    "Drag to zoom, double-click to go back. For drawing, lines are thinned to the smallest and the largest sample of "
    "each short stretch, so that no peak is lost; the file has every sample."
)


def attempts_section(
    title: str, attempts: Sequence[tuple[Episode, str]], *, name: str, text: str, points: int = POINTS
) -> str:
    """Plots of some episodes.

    Args:
        title: Heading.
        attempts: Each episode, and the relative path of its file.
        name: Start of the ids of the plots; differs between the sections of one page.
        text: What the reader should look for, plain.
        points: About how many points a line is drawn with.

    Returns:
        HTML; empty without episodes.
    """
    if not attempts:
        return ""
    folds = "\n".join(
        _fold(episode, path, f"{name}-{number}", points, is_open=number == 0 or number == _first_failure(attempts))
        for number, (episode, path) in enumerate(attempts)
    )
    return section(title, f"<p>{escape(text)}</p>", f"<p><small>{_HOW_TO_READ}</small></p>", folds)


def points_for(*sections: Sequence[tuple[Episode, str]]) -> int:
    """How many points a line may have, so that a page with all these episodes stays small."""
    episodes = sum(len(each) for each in sections)
    return max(min(POINTS, _POINTS_A_PAGE // max(episodes, 1)), _FEWEST_POINTS)


def succeeded(episode: Episode) -> bool | None:
    """Whether the attempt succeeded, as its metadata says, or else its events; None where neither does."""
    said = episode.meta.get("result", {}).get("success")
    if said is not None:
        return bool(said)
    if episode.events_of("failure"):
        return False
    return True if episode.events_of("success") else None


def _first_failure(attempts: Sequence[tuple[Episode, str]]) -> int | None:
    return next((number for number, (episode, _) in enumerate(attempts) if succeeded(episode) is False), None)


def _fold(episode: Episode, path: str, id: str, points: int, *, is_open: bool) -> str:
    plot = plot_block(episode_figure(episode, "", points=points), id)
    file = f"<p><small>{link(path, path)}</small></p>"
    return (
        f"<details{' open' if is_open else ''}><summary>{_outcome(episode)} <span class='soft'>{escape(episode.id)}"
        f"</span></summary><div>{plot}</div>{file}</details>"
    )


def _outcome(episode: Episode) -> str:
    result = episode.meta.get("result", {})
    duration_s = result.get("duration_s", episode.duration_s)
    done = succeeded(episode)
    if done is None:
        return f"outcome not recorded, {duration_s:.2f} s"
    if done:
        return f'<span class="good">success</span> after {duration_s:.2f} s'
    labels = [event.label for event in episode.events_of("failure") if event.label]
    why = result.get("failure") or ", ".join(labels) or "no reason recorded"
    return f'<span class="bad">failure: {escape(why)}</span> after {duration_s:.2f} s'
