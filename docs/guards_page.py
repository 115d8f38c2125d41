"""Print `docs/guards.md`: every reason to end control and every guard, from the rows in `companion/config/guards`.

python docs/guards_page.py > docs/guards.md
"""

from __future__ import annotations

from companion.config.guards.declaration import Group, Row
from companion.config.guards.rows import GUARDS, Guards, Reason
from companion.config.guards.sections import EventGuardSection

HEAD = """\
# Guards, and what each release means

Written by `python docs/guards_page.py` from `companion/config/guards/rows.py`: do not edit it here.

Control ends for one named reason. It is on the screen, in the flight folder's events, and at the ground station as a
STATUSTEXT `companion: <reason>`. For a fault the companion asks for `release.mode` (Hold by default), believes it when
PX4 reports it, and then is silent; if PX4 does not obey, the silence trips `COM_OF_LOSS_T`.
"""

GUARDS_HEAD = """\
## The guards

Each is `{enabled, limit, timeout_s}` in the section `guards`, with the unit of its limit in its name. It ends control
when its limit has been exceeded for `timeout_s`, less the time in which it was not; 0 means at once. What a file leaves
out of a guard keeps its default, below; a limit that is not given there follows from another section. The log gives the
value that tripped it. The first five stand where it happens; all others are looked at together, 50 times a second, and
heard in this order.

| guard | what its limit is of | limit | timeout | reason |
|---|---|---|---|---|
"""

BLIND_HEAD = """\
## A guard that cannot see

At stand-by the companion says which guards that are on cannot see; they are not missed later. One that goes blind after
that is told on the screen, in the log and to the ground station, once; some end control.

| guard | cannot see | told after | then |
|---|---|---|---|
"""


def table(group: Group) -> str:
    """What the reasons of one group mean."""
    keys = {reason: f"`{guard.key}`" for reason, guard in GUARDS.items()}
    rows = (
        f"| `{reason}` | {keys.get(reason, '')} | {reason.meaning} | {reason.look_at} |\n"
        for reason in Reason
        if reason.group is group
    )
    return f"## {group}\n\n| reason | guard | what happened | look at |\n|---|---|---|---|\n{''.join(rows)}"


def defaults(key: str, row: Row) -> str:
    """A guard's default limit and timeout, as two cells."""
    section = getattr(Guards(), key)
    limit = getattr(section, "limit", None)
    unit = {"deg": "°", "m2": " m²", "hz": " Hz", "m_s": " m/s", "": ""}.get(row.unit, f" {row.unit}")
    text = "" if limit is None else f"{'at least ' if row.least else ''}{limit:g}{unit}"
    if not section.enabled:
        text = f"off; {text}" if text else "off"
    return f"{text} | {'' if isinstance(section, EventGuardSection) else f'{section.timeout_s:g} s'}"


def page() -> str:
    """The whole page."""
    guards = (
        f"| `{key}` | {about} | {defaults(key, row)} | `{reason}` |\n" for reason, (key, about, row) in GUARDS.items()
    )
    blind = (
        f"| `{key}` | {row.blind.why} | {f'{row.blind.age_s:g} s' if row.blind.age_s else 'at stand-by'} | "
        f"{'control ends' if row.blind.ends_control else 'it is flown on'} |\n"
        for key, _, row in GUARDS.values()
        if row.blind is not None
    )
    return "\n".join([HEAD, *map(table, Group), GUARDS_HEAD + "".join(guards), BLIND_HEAD + "".join(blind)])


if __name__ == "__main__":
    print(page(), end="")
