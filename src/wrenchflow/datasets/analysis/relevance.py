"""Which episodes are worth training on for a given task: filter first, train later.

Words decide first (those that few episodes have weigh more), then what came of an episode, what is wrong with it, and
whether it is a copy of another. Each verdict says why, so that a person may overrule it.
"""

import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from wrenchflow.datasets.analysis.figures import EpisodeFigures
from wrenchflow.datasets.analysis.findings import Finding
from wrenchflow.datasets.analysis.twins import Twins

# Words that every instruction has.
_PLAIN = frozenset(
    "a an and at by for from in into it its of off on onto out over the then to up with".split()  # noqa: SIM905
)
_ENDINGS = ("ing", "ion", "es", "ed", "s", "e")
_LEAST_STEM = 3
# An episode is taken whose words come this near to those of the best.
_NEAR = 0.5


@dataclass(frozen=True, kw_only=True)
class Relevance:
    """What is thought of an episode.

    Attributes:
        episode: Its number.
        score: How much of the task's words it shares, from 0 to 1.
        is_taken: Whether it is suggested.
        why: In a few words.
    """

    episode: int
    score: float
    is_taken: bool
    why: str


def words_of(text: str) -> frozenset[str]:
    """Stems of the words that tell one task from another."""
    words = re.findall(r"[^\W\d_]+|\d+", text.lower())
    return frozenset(_stem(word) for word in words if word not in _PLAIN)


def _stem(word: str) -> str:
    for ending in _ENDINGS:
        if word.endswith(ending) and len(word) - len(ending) >= _LEAST_STEM:
            return word[: -len(ending)]
    return word


def rank(
    task: str, episodes: Sequence[EpisodeFigures], findings: Sequence[Finding], twins: Sequence[Twins]
) -> tuple[Relevance, ...]:
    """All episodes, the most relevant first.

    The score is the cosine of the two sets of words, each weighted by how few episodes have it.
    """
    wanted = words_of(task)
    have = [words_of(episode.labels.task) for episode in episodes]
    seen = Counter(word for words in have for word in words)

    def weight(words: frozenset[str]) -> float:
        return sum((math.log1p(len(episodes) / (1 + seen[word])) ** 2 for word in words), start=0.0)

    whole = weight(wanted)
    scores = []
    for words in have:
        size = whole * weight(words)
        scores.append(weight(wanted & words) / math.sqrt(size) if size > 0.0 else 0.0)
    best = max(scores, default=0.0)
    defects = {
        i: finding.kind.name for finding in reversed(findings) if finding.kind.is_defect for i in finding.episodes
    }
    copies = {pair.second: episodes[pair.first].id for pair in reversed(twins)}
    ranked = []
    for i, (episode, score) in enumerate(zip(episodes, scores, strict=True)):
        shared = sorted(wanted & have[i])
        reasons = [f"shares {', '.join(shared)}" if shared else "shares no word"]
        near = score > 0.0 and score >= _NEAR * best
        if shared and not near:
            reasons.append("others share more")
        if episode.labels.success is False:
            reasons.append("a failure")
        if i in defects:
            reasons.append(defects[i])
        if i in copies:
            reasons.append(f"nearly the same as {copies[i]}")
        taken = near and episode.labels.success is not False and i not in defects and i not in copies
        ranked.append(Relevance(episode=i, score=score, is_taken=taken, why="; ".join(reasons)))
    return tuple(sorted(ranked, key=lambda one: (not one.is_taken, -one.score)))
