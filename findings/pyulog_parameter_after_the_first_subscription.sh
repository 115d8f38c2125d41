#!/usr/bin/env bash
# A ULog may carry a parameter message anywhere. pyulog puts it into `initial_parameters` only while no topic has been
# subscribed; one that stands behind the first subscription is a change, even where the log has no data yet and no earlier
# value of it. Who reads `initial_parameters` alone takes the parameter for absent.
set -euo pipefail
work=$(mktemp -d); trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install -q pyulog==1.3.0
"$work/venv/bin/python" - "$work/log.ulg" <<'PYTHON'
import struct
import sys
from importlib.metadata import version

from pyulog import ULog


def message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def parameter(name, value):
    key = f"float {name}".encode()
    return message("P", bytes([len(key)]) + key + struct.pack("<f", value))


header = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000)
layout = message("F", b"attitude:uint64_t timestamp;float roll;")
subscription = message("A", struct.pack("<BH", 0, 0) + b"attitude")
sample = message("D", struct.pack("<HQf", 0, 2000, 0.1))
with open(sys.argv[1], "wb") as log:
    log.write(header + message("B", bytes(40)) + layout + parameter("MC_PITCH_P", 4.0))
    log.write(subscription + parameter("MC_ROLL_P", 6.5) + sample)
read = ULog(sys.argv[1])
print(f"pyulog {version('pyulog')}: initial {read.initial_parameters}, changed {read.changed_parameters}")
assert read.initial_parameters == {"MC_PITCH_P": 4.0}
assert [(name, value) for _, name, value in read.changed_parameters] == [("MC_ROLL_P", 6.5)]
PYTHON
