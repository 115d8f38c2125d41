"""The commands: each parses its own arguments to a typed record, calls what does the work, and prints."""
