"""TOML to frozen dataclasses and back to plain values; a key that does not exist is refused with the nearest name."""

import dataclasses
import math
import tomllib
import types
import typing
from collections.abc import Mapping, Sequence
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from wrenchflow.errors import ConfigError, unknown


def read_toml(path: Path | Traversable) -> dict[str, Any]:
    """Read a TOML file, or say in one line why it cannot be read."""
    try:
        return tomllib.loads(path.read_text())
    except FileNotFoundError as error:
        raise ConfigError(f"config file '{path}' does not exist.") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        raise ConfigError(f"config file '{path}' cannot be read as TOML: {error}") from error


def from_mapping[T](cls: type[T], values: Mapping[str, Any], where: str = "config") -> T:
    """Build a frozen dataclass, nested ones included, from plain values.

    Args:
        cls: The dataclass.
        values: What TOML or JSON gives.
        where: Name of the place, for messages.

    Raises:
        ConfigError: For an unknown key (with the nearest one), a missing key, or a value of the wrong type.
    """
    if not isinstance(values, Mapping):
        raise ConfigError(f"{where}: expected a table of {cls.__name__}, got {values!r}.")
    hints = typing.get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cls) if f.init}  # type: ignore[arg-type]
    for key in values:
        if key not in fields:
            raise ConfigError(f"{where}: {unknown('key', key, fields)}")
    made = {key: _convert(hints[key], value, f"{where}.{key}") for key, value in values.items()}
    for name, field in fields.items():
        optional = field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING
        if name not in made and not optional:
            raise ConfigError(f"{where}: key '{name}' is missing. Expected: {', '.join(fields)}.")
    return cls(**made)


def _convert(hint: Any, value: Any, where: str) -> Any:
    origin, args = typing.get_origin(hint), typing.get_args(hint)
    if dataclasses.is_dataclass(hint):
        return from_mapping(typing.cast(type, hint), value, where)
    if origin in (typing.Union, types.UnionType):
        if value is None and type(None) in args:
            return None
        return _convert(next(a for a in args if a is not type(None)), value, where)
    if origin is typing.Literal:
        if value not in args:
            raise ConfigError(f"{where}: {unknown('value', str(value), map(str, args))}")
        return value
    if origin is tuple:
        if not isinstance(value, list | tuple):
            raise ConfigError(f"{where}: expected a list, got {value!r}.")
        inner = args[:1] * len(value) if len(args) == 2 and args[1] is Ellipsis else args
        if len(inner) != len(value):
            raise ConfigError(f"{where}: expected {len(inner)} values, got {len(value)}.")
        return tuple(_convert(a, v, f"{where}[{i}]") for i, (a, v) in enumerate(zip(inner, value, strict=True)))
    if origin is dict:
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where}: expected a table, got {value!r}.")
        return {key: _convert(args[1], v, f"{where}.{key}") for key, v in value.items()}
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if hint is Path and isinstance(value, str):
        return Path(value)
    if isinstance(hint, type) and (not isinstance(value, hint) or (isinstance(value, bool) and hint is not bool)):
        raise ConfigError(f"{where}: expected {hint.__name__}, got {value!r}.")
    return value


def load[T](cls: type[T], path: Path) -> T:
    """Read a TOML file into a frozen dataclass."""
    return from_mapping(cls, read_toml(path), where=path.name)


def require_at_least(least: float, **values: float) -> None:
    """Refuse values below `least`, and those that are no number; each is given by its name."""
    for name, value in values.items():
        if not value >= least:
            raise ConfigError(f"{name} is {value:g}, expected at least {least:g}.")


def require_between(low: float, high: float, **values: float) -> None:
    """Refuse values outside of `low` to `high`, both of which are allowed; each is given by its name."""
    for name, value in values.items():
        if not low <= value <= high:
            raise ConfigError(f"{name} is {value:g}, expected from {low:g} to {high:g}.")


def require_positive(**values: float) -> None:
    """Refuse values that are not above 0; each is given by its name."""
    for name, value in values.items():
        if not value > 0.0:
            raise ConfigError(f"{name} is {value:g}, expected more than 0.")


def require_finite(name: str, values: Sequence[float], *, positive: bool = False) -> None:
    """Refuse values that are not finite, or not above 0 where they have to be: limits that are no limits."""
    for value in values:
        if not math.isfinite(value) or (positive and value <= 0.0):
            raise ConfigError(
                f"{name} holds {value:g}, expected {'numbers above 0' if positive else 'finite numbers'}."
            )


def require_order(name: str, low: Sequence[float], high: Sequence[float]) -> None:
    """Refuse ranges whose lower end is not below the upper one."""
    for a, b in zip(low, high, strict=True):
        if not a < b:
            raise ConfigError(f"{name} reaches from {a:g} to {b:g}, expected a lower end below the upper one.")


def to_mapping(config: Any) -> Any:
    """Plain values (dicts, lists, numbers, text) of a config, as JSON takes them."""
    if dataclasses.is_dataclass(config) and not isinstance(config, type):
        return {f.name: to_mapping(getattr(config, f.name)) for f in dataclasses.fields(config) if f.init}
    if isinstance(config, Mapping):
        return {str(key): to_mapping(value) for key, value in config.items()}
    if isinstance(config, list | tuple):
        return [to_mapping(value) for value in config]
    return str(config) if isinstance(config, Path) else config
