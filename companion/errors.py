"""What every error that is meant for a person has in common, and how text of others is shown to one."""


class CompanionError(Exception):
    """What is wrong, where, and what to do, as one line: the `companion` command prints it and ends with code 2."""


def printable(text: str) -> str:
    """Text as one line that a terminal shows and does not obey.

    Whatever is not a letter, a sign or a space is written as its escape: a vehicle's text, the name of a file or a key
    of a config may hold what clears a screen, retitles a window or looks like a line of ours.
    """
    return text if text.isprintable() else "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
