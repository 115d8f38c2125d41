"""Make logs: a real ULog with its data changed, a tlog from given messages, and flights of a vehicle that is known."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pyulog import ULog

from companion.attitude_response.kind import LinearResponse
from companion.identify.series import OURS, Recording, Track
from companion.mavlink.codec import Encoder, Layout
from companion.mavlink.px4 import Mode
from sitl.vehicles.attitude_loop import respond

Change = Callable[[dict[str, dict[str, Any]]], None]
VEHICLE, COMPANION = (1, 1), (1, 191)
G = 9.81


def mutated_ulog(source: Path, target: Path, change: Change) -> Path:
    """A copy whose topics, by name and field, went through `change`; a topic emptied is left out."""
    log = ULog(str(source))
    topics = {topic.name: topic.data for topic in log.data_list}
    change(topics)
    for topic in list(log.data_list):
        topic.data = topics.get(topic.name, {})
        if not topic.data or not len(topic.data["timestamp"]):
            log.data_list.remove(topic)
    log.write_ulog(str(target))
    return target


def only(data: dict[str, Any], keep: Any) -> None:
    """Keep these samples of a topic."""
    for field in data:
        data[field] = data[field][keep]


def frame(name: str, ids: tuple[int, int], **fields: Any) -> bytes:
    """One MAVLink frame; fields left out are zero."""
    layout = Layout(name)
    values: list[float] = [0.0] * len(layout.unpack(b""))
    for i, zero in enumerate(layout.unpack(b"")):
        values[i] = zero
    for field, value in fields.items():
        values[layout.place(field)] = value  # type: ignore[call-overload]
    return Encoder(layout, *ids).encode(0, *values)


def tlog(records: Iterable[tuple[float, bytes]]) -> bytes:
    """A tlog of (time in s, frame)."""
    return b"".join(struct.pack(">Q", round(1e6 * time_s)) + raw for time_s, raw in sorted(records))


class Known(NamedTuple):
    """A vehicle whose response is known: one axis, first or second order, and where its delay is spent."""

    response: LinearResponse
    up_s: float = 0.01  # set-point sent to in force
    down_s: float = 0.01  # attitude to received
    noise_rad: float = math.radians(0.2)
    drift_rad: float = math.radians(0.01)  # a step of a random walk, each sample
    friction_1_s: float = 1.2  # of the guide, as in config/antx_rig.yaml
    coulomb_m_s2: float = 0.25


class Flown(NamedTuple):
    """What was sent and measured, in s and rad."""

    sent_s: np.ndarray
    setpoint_rad: np.ndarray
    stamp_s: np.ndarray
    received_s: np.ndarray
    attitude_rad: np.ndarray


def doublet(time_s: float, amplitude_rad: float = math.radians(8.0)) -> float | None:
    """Set-point of a doublet of 3.2 s at the start of every 6 s, from the third second on; None between them."""
    at = (time_s - 3.0) % 6.0
    if time_s < 3.0 or at >= 3.2:
        return None
    return amplitude_rad if at < 0.8 or at >= 2.4 else -amplitude_rad


def fly(
    known: Known,
    seed: int,
    setpoint_rate_hz: float = 100.0,
    attitude_rate_hz: float = 100.0,
    manoeuvres: int = 4,
) -> Flown:
    """Doublets along a guide with friction, position held between them; exact from event to event."""
    random = np.random.default_rng(seed)
    end_s = 3.0 + 6.0 * manoeuvres
    sent_s = np.arange(0.0, end_s, 1.0 / setpoint_rate_hz)
    sent_s = sent_s + random.uniform(0.0, 0.1 / setpoint_rate_hz, len(sent_s))
    stamp_s = np.arange(0.0, end_s, 1.0 / attitude_rate_hz) + random.uniform(0.0, 1.0 / attitude_rate_hz)
    order = np.argsort(np.concatenate([sent_s, sent_s + known.up_s, stamp_s]), kind="stable")
    times = np.concatenate([sent_s, sent_s + known.up_s, stamp_s])[order].tolist()
    n = len(sent_s)
    setpoints, measured = np.zeros(n), np.zeros(len(stamp_s))
    now = angle = rate = wanted = position = velocity = 0.0
    for time_s, index in zip(times, order.tolist(), strict=True):
        angle, rate, _ = respond(known.response, angle, rate, (), wanted, time_s - now)
        dt, now = time_s - now, time_s
        friction = known.friction_1_s * velocity + known.coulomb_m_s2 * math.tanh(velocity / 0.05)
        velocity += dt * (-G * math.sin(angle) - friction)
        position += dt * velocity
        if index < n:
            given = doublet(time_s)
            held = math.copysign(min(abs(u := 0.1 * position + 0.12 * velocity), 0.3), u)
            setpoints[index] = held if given is None else given
        elif index < 2 * n:
            wanted = setpoints[index - n]
        else:
            measured[index - 2 * n] = angle
    noise = random.normal(0.0, known.noise_rad, len(measured))
    drift = np.cumsum(random.normal(0.0, known.drift_rad, len(measured))) + random.normal(0.0, math.radians(0.5))
    return Flown(sent_s, setpoints, stamp_s, stamp_s + known.down_s, measured + noise + drift)


def recording(flown: Flown) -> Recording:
    """A flight as read from a tlog, pitch alone, without the vehicle's own view."""
    both = [np.stack([np.zeros_like(a), a], axis=1) for a in (flown.setpoint_rad, flown.attitude_rad)]
    track = Track(OURS, flown.sent_s, both[0], flown.received_s, both[1])
    following = np.array([[0.0, flown.sent_s[-1]]])
    q = np.zeros((len(flown.sent_s), 4), dtype=np.float32)
    return Recording(Path("flown"), "tlog", 1, track, following, q, 0.0, np.empty(0), flown.stamp_s, None, {})


def flown_tlog(
    flown: Flown, roll: Flown | None = None, boot_s: float = 7.0, speed: float = 1.01, up_s: float = 0.01
) -> bytes:
    """The traffic of a flight: the vehicle's clock began `boot_s` before ours and runs `speed` times as fast."""

    def quaternion(roll_rad: float, pitch_rad: float) -> dict[int, float]:
        cr, sr, cp, sp = (f(v / 2) for v in (roll_rad, pitch_rad) for f in (math.cos, math.sin))
        return dict(enumerate((cr * cp, sr * cp, cr * sp, -sr * sp)))

    def vehicle_s(ours_s: float) -> float:
        return boot_s + speed * ours_s

    other = roll or flown._replace(setpoint_rad=0 * flown.setpoint_rad, attitude_rad=0 * flown.attitude_rad)
    records: list[tuple[float, bytes]] = []
    armed = {"base_mode": 0x81, "custom_mode": int(Mode.OFFBOARD), "autopilot": 12, "type": 2}
    records += [(t, frame("HEARTBEAT", VEHICLE, **armed)) for t in np.arange(0.0, flown.sent_s[-1], 1.0)]
    for i, t in enumerate(flown.sent_s):
        q = tuple(quaternion(other.setpoint_rad[i], flown.setpoint_rad[i]).values())
        fields = {"q": q, "target_system": 1, "target_component": 1, "type_mask": 7, "thrust": 0.5}
        records.append((t, frame("SET_ATTITUDE_TARGET", COMPANION, **fields)))
        if i % 5 == 0:
            stamp = round(1e3 * vehicle_s(t + up_s))
            records.append((t + 0.02, frame("ATTITUDE_TARGET", VEHICLE, q=q, time_boot_ms=stamp)))
    for i, t in enumerate(flown.stamp_s):
        q1, q2, q3, q4 = quaternion(other.attitude_rad[i], flown.attitude_rad[i]).values()
        stamp = round(1e3 * vehicle_s(t))
        fields = {"q1": q1, "q2": q2, "q3": q3, "q4": q4, "time_boot_ms": stamp}
        records.append((float(flown.received_s[i]), frame("ATTITUDE_QUATERNION", VEHICLE, **fields)))
    return tlog(records)
