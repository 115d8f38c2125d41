"""A small plant for tests: a quadrotor or a rig behind the autopilot, served from a thread."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from types import TracebackType

from companion.attitude_response.kind import LinearResponse
from companion.attitude_response.kinds import FirstOrder
from harness.processes import PATIENCE_S
from sitl.autopilot.autopilot import Autopilot
from sitl.autopilot.parameters import Parameters
from sitl.messages.log_card import LogFile
from sitl.vehicles.attitude_loop import AngleGains, RateGains
from sitl.vehicles.quadrotor import QuadrotorParams
from sitl.vehicles.rig import RigParams
from sitl.vehicles.vehicle import Quadrotor, Rig, Vehicle
from sitl.wire.ports import NOBODY, Endpoint, UdpEndpoint
from sitl.wire.server import ServeResult, serve

NO_RATES = RateGains(0.0, 0.0, 0.0, 1.0, 0.0)
HOVER_THRUST = 0.5


def response(bandwidth_rad_s: float) -> LinearResponse:
    return LinearResponse(FirstOrder, (bandwidth_rad_s,))


def quadrotor(bandwidth_rad_s: float = 6.0) -> Quadrotor:
    """1 kg, little drag, attitude of first order."""
    loop = response(bandwidth_rad_s)
    gains = AngleGains(0.0, 0.0, 0.0)
    params = QuadrotorParams(
        1.0, 0.1, 0.01, 0.01, 0.02, False, loop, loop, loop, gains, NO_RATES, NO_RATES, NO_RATES
    )  # fmt: skip
    return Quadrotor(params, HOVER_THRUST)


def rig(bandwidth_rad_s: float = 3.0) -> Rig:
    """A guide with some friction, pitch of first order."""
    return Rig(RigParams(1.2, 0.25, 0.005, False, response(bandwidth_rad_s), 0.0, NO_RATES), HOVER_THRUST)


def autopilot(vehicle: Vehicle, **parameters: float) -> Autopilot:
    """An autopilot with PX4's defaults but for the given parameters."""
    return Autopilot(vehicle, Parameters({"MPC_THR_HOVER": vehicle.hover_thrust, **parameters}))


class RunningPlant:
    """A plant served from a thread, for the length of a `with`."""

    def __init__(
        self,
        pilot: Autopilot,
        *,
        lockstep: bool = False,
        endpoints: Sequence[Endpoint] = (),
        logs: Sequence[LogFile] = (),
    ) -> None:
        self.autopilot = pilot
        self.port = 0
        self.result: ServeResult | None = None
        self.error: Exception | None = None
        self._lockstep = lockstep
        self._endpoints = endpoints or [UdpEndpoint(0, NOBODY)]
        self._logs = logs
        self._stop = threading.Event()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def _run(self) -> None:
        try:
            self.result = serve(
                self.autopilot,
                self._endpoints,
                lockstep=self._lockstep,
                stop=self._stop.is_set,
                on_ready=self._on_ready,
                logs=self._logs,
            )
        except Exception as error:
            self.error = error
        finally:
            self._ready.set()

    def _on_ready(self, port: int) -> None:
        self.port = port
        self._ready.set()

    def __enter__(self) -> RunningPlant:
        self._thread.start()
        assert self._ready.wait(PATIENCE_S)
        if self.error is not None:
            raise self.error
        return self

    def join(self) -> None:
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()

    def __exit__(self, kind: type[BaseException] | None, value: object, trace: TracebackType | None) -> None:
        self._stop.set()
        self.join()
