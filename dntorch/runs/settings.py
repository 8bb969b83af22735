"""Settings of a run that a file holds."""

import json
from pathlib import Path
from typing import Any

from dntorch.quantities import shown
from dntorch.runs.config import FIELDS, check_setting

LARGEST = 1 << 20
"""Characters that are read of a file: far more than a run's results, and an end to a device."""


def read_settings(file: Path) -> dict[str, Any]:
    """Values for `Config`, by name: of the ``results.json`` of a run, or of a TOML file.

    A TOML file holds them as they are, ``noise = 5.0``, and as many of them as it likes.

    Raises:
        ValueError: the file cannot be read, holds a name that a config has not, or a value that
            the name may not have.
    """
    try:
        with file.open(encoding="utf-8") as stream:
            text = stream.read(LARGEST)
        content = _toml(text) if file.suffix == ".toml" else _results(text)
    except OSError as error:
        raise ValueError(f"{file} cannot be read ({error.strerror}): name another") from error
    except (ValueError, RecursionError) as error:  # all decoders raise a kind of the first
        raise ValueError(
            f"{file} cannot be used ({error}): give the results.json of a run, or a file .toml"
        ) from error
    return {name: _checked(file, name, value) for name, value in content.items()}


def _results(text: str) -> dict[str, Any]:
    content = json.loads(text)
    if not isinstance(content, dict) or not isinstance(content.get("config"), dict):
        raise ValueError("it has no config")
    return content["config"]


def _toml(text: str) -> dict[str, Any]:
    try:
        import tomllib
    except ImportError:  # Python 3.10
        try:
            import tomli as tomllib
        except ImportError:
            raise ValueError("TOML needs Python 3.11, or pip install tomli") from None
    return tomllib.loads(text)


def _checked(file: Path, name: str, value: Any) -> Any:
    if name not in FIELDS:
        raise ValueError(
            f"{file}: {name}={shown(value)} is no setting of a run: take it out; there are "
            f"{', '.join(FIELDS)}"
        )
    check_setting(name, value, f"{file}: {name}")
    return FIELDS[name].type(value)
