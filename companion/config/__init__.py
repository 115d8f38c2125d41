"""Config files: their schema, and loading one with a one-line complaint when it is bad."""

from companion.config.load import ConfigError, load_config, load_text, parse_override
from companion.config.schema import Config

__all__ = ["Config", "ConfigError", "load_config", "load_text", "parse_override"]
