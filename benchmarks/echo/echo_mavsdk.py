"""Odometry in, set-point out, by mavsdk 4's callback and its offboard plugin. Usage: echo_mavsdk.py PORT

The thrust repeats the position's x, so that the answer to each sample is not taken for one of the plugin's own resends.
"""

from __future__ import annotations

import sys
import threading

from mavsdk import ComponentType, Configuration, ConnectionResult, Mavsdk
from mavsdk.plugins.offboard import Attitude, Offboard
from mavsdk.plugins.telemetry import Odometry, Telemetry


def main(port: int) -> None:
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.COMPANION_COMPUTER))
    if mavsdk.add_any_connection(f"udpin://127.0.0.1:{port}") is not ConnectionResult.SUCCESS:
        sys.exit("mavsdk: the port is in use")
    system = mavsdk.first_autopilot(10.0)
    if system is None:
        sys.exit("mavsdk: no autopilot")
    telemetry, offboard = Telemetry(system), Offboard(system)

    def answer(sample: Odometry, _: object) -> None:
        offboard.set_attitude(Attitude(0.0, 0.0, 0.0, sample.position_body.x_m))

    telemetry.subscribe_odometry(answer)
    offboard.set_attitude(Attitude(0.0, 0.0, 0.0, 0.0))
    offboard.start()
    print("ready", flush=True)
    threading.Event().wait()


if __name__ == "__main__":
    main(int(sys.argv[1]))
