"""A serial line that may be unplugged: two pseudo-terminals back to back are a null-modem cable."""

from __future__ import annotations

import os
import subprocess
import sys
import tty

CABLE = """
import os, select, sys
near, far = int(sys.argv[1]), int(sys.argv[2])
while True:
    for fd in select.select([near, far], [], [])[0]:
        os.write(far if fd == near else near, os.read(fd, 4096))
"""


class Cable:
    """Two pseudo-terminals back to back: the plant has one end, `link` is the other."""

    def __enter__(self) -> Cable:
        self._near, self._near_device = os.openpty()
        self._far, self._far_device = os.openpty()
        for fd in (self._near, self._far):
            tty.setraw(fd)
        self.plant = f"serial://{os.ttyname(self._near_device)}:921600"
        self.link = f"serial://{os.ttyname(self._far_device)}:921600"
        masters = (self._near, self._far)
        self._carrier = subprocess.Popen([sys.executable, "-c", CABLE, *map(str, masters)], pass_fds=masters)
        return self

    def unplug(self) -> None:
        """At the companion's end."""
        self._carrier.kill()
        self._carrier.wait()
        os.close(self._far)
        self._far = -1

    def __exit__(self, *_: object) -> None:
        self._carrier.kill()
        self._carrier.wait()
        for fd in (self._near, self._near_device, self._far, self._far_device):
            if fd >= 0:
                os.close(fd)
