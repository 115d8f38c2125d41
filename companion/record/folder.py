"""A new flight folder: the config as used beside the logs."""

from __future__ import annotations

import time
from pathlib import Path

import yaml

from companion.config import Config, ConfigError
from companion.record.recorder import Recorder


def new_folder(parent: Path, label: str) -> Path:
    """A folder name that says when and what, and that nobody has used yet."""
    stem = f"{time.strftime('%Y-%m-%dT%H-%M-%S')}-{label}"
    folder, count = parent / stem, 1
    while folder.exists():
        count += 1
        folder = parent / f"{stem}-{count}"
    return folder


def open_folder(folder: Path, config_path: Path, config: Config, *, blocking: bool) -> Recorder:
    """Make the folder, put the config in it and start its writer.

    `config.yaml` is the config as flown, overrides included; its first line names the file it came from. Raises
    `ConfigError` with one line when the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        used = yaml.safe_dump(config.model_dump(mode="json", exclude_none=True), sort_keys=False)
        (folder / "config.yaml").write_text(f"# as flown, from {config_path.name}\n{used}", encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{folder}: cannot write the flight folder: {error.strerror}") from None
    return Recorder(folder, blocking=blocking)
