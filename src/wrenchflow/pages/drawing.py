"""A plot as plain values, in the words of plotly's own JSON; its Python objects take as long as a whole page."""

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

# What plotly's script reads as the bytes of an array, by numpy's kind and size.
_TYPED = {"f4": "<f4", "f8": "<f8", "i4": "<i4"}
# No text within a <script> can then end it, nor open a comment in it.
_ESCAPES = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026", "\u2028": "\\u2028", "\u2029": "\\u2029"}


@dataclass(frozen=True, kw_only=True)
class Drawing:
    """What plotly draws.

    Attributes:
        data: Its traces; arrays may be numpy's.
        layout: Its layout.
    """

    data: list[dict[str, Any]] = field(default_factory=list)
    layout: dict[str, Any] = field(default_factory=dict)

    def add_shape(self, **shape: Any) -> None:
        """Add a shape to the layout."""
        self.layout.setdefault("shapes", []).append(shape)

    def add_annotation(self, **annotation: Any) -> None:
        """Add a text to the layout."""
        self.layout.setdefault("annotations", []).append(annotation)

    def to_json(self) -> str:
        """As JSON that may stand within a <script>. What is not finite is a gap."""
        return script_json({"data": self.data, "layout": self.layout})


def script_json(value: Any) -> str:
    """Plain values and numpy arrays as JSON that may stand within a <script>."""
    text = json.dumps(_plain(value), separators=(",", ":"), allow_nan=False, ensure_ascii=False)
    for letter, escape in _ESCAPES.items():
        text = text.replace(letter, escape)
    return text


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, np.ndarray):
        return _array(value)
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _array(values: np.ndarray) -> Any:
    kind = f"{values.dtype.kind}{values.dtype.itemsize}"
    if kind not in _TYPED or values.ndim != 1:
        return _plain(values.tolist())
    return {"dtype": kind, "bdata": base64.b64encode(values.astype(_TYPED[kind]).tobytes()).decode()}
