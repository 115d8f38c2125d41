"""A new flight folder: the config as used beside the logs."""

from __future__ import annotations

import itertools
import time
from pathlib import Path

import yaml

from companion.config import Config, ConfigError
from companion.config.mission.identifying import as_flown
from companion.record.recorder import Recorder


def new_folder(parent: Path, label: str) -> Path:
    """Make a folder whose name says when and what, and that nobody else has. Raises `ConfigError`."""
    stem = f"{time.strftime('%Y-%m-%dT%H-%M-%S')}-{label}"
    for count in itertools.count(1):
        folder = parent / (stem if count == 1 else f"{stem}-{count}")
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            if parent.is_dir():
                continue
            raise _cannot_write(folder, "a file is in the way") from None
        except OSError as error:
            raise _cannot_write(folder, error.strerror) from None
        break
    return folder


def _cannot_write(folder: Path, reason: str | None) -> ConfigError:
    return ConfigError(f"{folder}: cannot write the flight folder: {reason}")


def open_folder(folder: Path, config_path: Path, config: Config, *, blocking: bool, direct: bool = False) -> Recorder:
    """Make the folder, put the config in it and start its writer.

    `config.yaml` is the config as flown, overrides included; its first line names the file it came from. `direct`: no
    process of its own writes the log, but this one, when the recorder is closed. Raises `ConfigError` with one line
    when the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        used = yaml.safe_dump(as_flown(config).model_dump(mode="json", exclude_none=True), sort_keys=False)
        (folder / "config.yaml").write_text(f"# as flown, from {config_path.name}\n{used}", encoding="utf-8")
    except OSError as error:
        raise _cannot_write(folder, error.strerror) from None
    if direct:
        from companion.record.direct import DirectRecorder  # noqa: PLC0415 - a real flight leaves mcap to its writer

        return DirectRecorder(folder)
    limits = round(1e9 * config.log.quota_gb), round(1e9 * config.log.free_gb)
    return Recorder(folder, blocking=blocking, limits=limits)
