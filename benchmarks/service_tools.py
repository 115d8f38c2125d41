"""What asks the vehicle through the shared link: tools in processes of their own, and mavsdk in the flying one."""

from __future__ import annotations

import json
import os
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

from companion.config import load_config
from companion.flight.readiness.px4_settings import wanted
from companion.mavlink.client import Client
from companion.mavlink.codec import Frame
from companion.mavlink.logs.client import list_logs, newest
from companion.mavlink.logs.protocol import LOG_DATA, LogFetch
from companion.mavlink.services import Attachment, Services
from companion.mavlink.vehicle_report import read_parameters

CONFIG = Path(__file__).resolve().parents[1] / "config" / "paper_quadrotor.yaml"


def ask(client: Client, until_s: float) -> dict[str, float]:
    """What `companion vehicle` asks for, again and again."""
    count = 0
    while time.monotonic() < until_s:
        count += len(read_parameters(client, wanted((1, 17, 0))))
    return {"parameters": count}


def read_log(client: Client, until_s: float) -> dict[str, float]:
    """Our protocol fetches the log, from the beginning again when it has come to its end."""
    entry = newest(list_logs(client).entries)[-1]
    count, began_s = 0, time.monotonic()
    while time.monotonic() < until_s:
        download = LogFetch(*client.vehicle, entry)
        while not download.done and (now_s := time.monotonic()) < until_s:
            for request in download.requests(now_s):
                client.send(request)
            for frame in client.frames():
                if frame.message_id == LOG_DATA.message_id:
                    count += len(download.take(frame, now_s))
    client.send(download.end())
    return {"log_bytes": count, "log_bytes_s": round(count / (time.monotonic() - began_s))}


def read_log_by_mavsdk(client: Client, until_s: float) -> dict[str, float]:
    """mavsdk's plugin fetches it: 46 kB a request, which the tool server spreads."""
    from mavsdk.plugins.log_files import LogFiles  # noqa: PLC0415

    with Services(client) as services, tempfile.TemporaryDirectory() as folder:
        log_files = LogFiles(services.system)
        entry = max(log_files.get_entries(), key=lambda e: e.size_bytes)
        log_files.download_log_file_async(entry, f"{folder}/log", lambda *_: None)
        while time.monotonic() < until_s:
            time.sleep(0.05)
        count = client.heard[LOG_DATA.message_id] * 90
    return {"log_bytes": count}


def read_both(client: Client, until_s: float) -> dict[str, float]:
    """Parameters while a log comes down: two clients of one process."""
    entry = newest(list_logs(client).entries)[-1]
    results: dict[str, float] = {}
    fetch = LogFetch(*client.vehicle, entry)
    frames_of = client.frames

    def frames() -> list[Frame]:
        now_s = time.monotonic()
        for request in fetch.requests(now_s):
            client.send(request)
        heard = frames_of()
        for frame in heard:
            if frame.message_id == LOG_DATA.message_id:
                results["log_bytes"] = results.get("log_bytes", 0) + len(fetch.take(frame, now_s))
        return heard

    client.frames = frames  # type: ignore[method-assign]
    results |= ask(client, until_s)
    client.send(fetch.end())
    return results


TOOLS: dict[str, Callable[[Client, float], dict[str, float]]] = {
    "ours: parameters": ask,
    "ours: log": read_log,
    "both": read_both,
    "mavsdk: log": read_log_by_mavsdk,
}


def tool(kind: str, url: str, seconds: float) -> None:
    """The process of a tool."""
    client = Client(load_config(CONFIG), url)
    client.connect()
    client.give_way()
    print("ready", flush=True)
    done = TOOLS[kind](client, time.monotonic() + seconds)
    client.close()
    print(json.dumps({**done, "through_the_flight": client.shared}), flush=True)


class Inside:
    """In place of the tool server: mavsdk in the flying process, its threads asking for parameters all the while."""

    def __init__(self, *_: object) -> None:
        self.attached = True
        self._attachment = Attachment(1, 192)
        self._busy = Path(os.environ["SERVICES_BUSY"])
        threading.Thread(target=self._ask, daemon=True).start()

    def offer(self, frames: list[Frame]) -> None:
        self._attachment.feed(frames)

    def asked(self, _: float) -> bytes:
        return next(self._attachment.outgoing(), b"")

    def close(self) -> None: ...

    def _ask(self) -> None:
        from mavsdk.plugins.param import Param  # noqa: PLC0415

        param = Param(self._attachment.system(60.0))
        while True:
            time.sleep(0.05)
            while self._busy.exists():
                param.get_param_float("MC_ROLL_P")
