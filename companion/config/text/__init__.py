"""The text of a config, before anything is built of it."""
