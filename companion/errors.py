"""What every error that is meant for a person has in common."""


class CompanionError(Exception):
    """What is wrong, where, and what to do, as one line: the `companion` command prints it and ends with code 2."""
