"""Code comes from where it was installed, never from the directory that a command happens to be started in.

`python -m` and `python -c` put the current directory before everything else, and every child does so again: a folder
`mcap/` in somebody's download folder would be run by whoever starts `companion` there. Imports nothing that is not in
the interpreter already, since it runs before the path can be trusted.

Source: https://docs.python.org/3/using/cmdline.html#cmdoption-P
"""

import os
import sys

_HOME = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))  # where this package lies
_RUN_MODULE = (
    "import sys; home, at, module = sys.argv[1:4]; del sys.argv[1:4]; "
    "home in sys.path or sys.path.insert(int(at), home); "
    "import runpy; runpy.run_module(module, run_name='__main__', alter_sys=True)"
)
_FIRST, _LAST = "0", "99"


def leave_current_directory() -> None:
    """Take the current directory off this process's path, and off that of all its children.

    Where this package itself lies there, as in a checkout, it is what somebody wants to run, and stays; so does what
    PYTHONPATH names in full.
    """
    here = os.getcwd()
    if not sys.flags.safe_path and sys.path and sys.path[0] in ("", here) and here != _HOME:
        del sys.path[0]
    sys.path[:] = [entry for entry in sys.path if os.path.isabs(entry)]
    if _HOME not in sys.path:
        sys.path.append(_HOME)
    os.environ.update(safe_environment())


def python_command(module: str, *arguments: str) -> list[str]:
    """The command line that runs a module of ours in another interpreter. Its environment: `child_environment`."""
    at = _FIRST if sys.path[:1] == [_HOME] else _LAST  # the child is to find the same package as this process did
    return [sys.executable, "-P", "-c", _RUN_MODULE, _HOME, at, module, *arguments]


def safe_environment() -> dict[str, str]:
    """Variables for a child: PYTHONSAFEPATH, and PYTHONPATH without what is relative to wherever a child is started."""
    path = os.environ.get("PYTHONPATH")
    kept = {} if path is None else {"PYTHONPATH": os.pathsep.join(filter(os.path.isabs, path.split(os.pathsep)))}
    return {"PYTHONSAFEPATH": "1", **kept}


def child_environment() -> dict[str, str]:
    """The whole environment for a child."""
    return {**os.environ, **safe_environment()}
