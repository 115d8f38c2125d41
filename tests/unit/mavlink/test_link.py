"""Links over real sockets and pseudo-terminals: who is heard, who is answered, and what a dead link says."""

from __future__ import annotations

import os
import select
import socket
import time
from collections.abc import Iterator
from contextlib import closing

import pytest
from harness.ports import free_port
from harness.processes import PATIENCE_S

from companion.mavlink.codec import Encoder, FrameParser, Layout
from companion.mavlink.link import Link, LinkError, open_link

ANY_BYTES = bytes(range(256))


class Peer:
    """The other end of a UDP link."""

    def __init__(self) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(PATIENCE_S)
        self.port: int = self.socket.getsockname()[1]

    def send(self, data: bytes, port: int) -> None:
        self.socket.sendto(data, ("127.0.0.1", port))

    def hears(self) -> bytes:
        return self.socket.recv(2048)

    def hears_nothing(self) -> bool:
        return not select.select([self.socket], [], [], 0.05)[0]

    def close(self) -> None:
        self.socket.close()


def complaint(url: str) -> str:
    """What a link that cannot be opened says: one line that names the link."""
    with pytest.raises(LinkError) as caught:
        open_link(url).close()
    text = str(caught.value)
    assert len(text.splitlines()) == 1
    assert text.startswith(f"link {url}: ")
    return text.removeprefix(f"link {url}: ")


@pytest.fixture
def vehicle() -> Iterator[Peer]:
    with closing(Peer()) as peer:
        yield peer


@pytest.fixture
def stranger() -> Iterator[Peer]:
    with closing(Peer()) as peer:
        yield peer


# --- udpin ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def listening() -> Iterator[tuple[Link, int]]:
    port = free_port()
    with closing(open_link(f"udpin://127.0.0.1:{port}", timeout_s=1.0)) as link:
        yield link, port


def test_udpin_answers_whoever_spoke_last_until_it_is_locked(
    listening: tuple[Link, int], vehicle: Peer, stranger: Peer
) -> None:
    link, port = listening
    assert not link.stream
    link.send(b"to nobody")
    for peer in (stranger, vehicle, stranger, vehicle):
        peer.send(ANY_BYTES, port)
        assert link.receive() == ANY_BYTES
        link.send(b"answer")
        assert peer.hears() == b"answer"
    assert stranger.hears_nothing()


def test_udpin_hears_and_answers_the_locked_peer_alone(
    listening: tuple[Link, int], vehicle: Peer, stranger: Peer
) -> None:
    link, port = listening
    vehicle.send(b"heartbeat", port)
    assert link.receive() == b"heartbeat"
    link.lock()
    for n in range(3):
        stranger.send(b"mine!", port)
        vehicle.send(b"odometry %d" % n, port)
        assert link.receive() == b"odometry %d" % n
        link.send(b"set-point %d" % n)
        assert vehicle.hears() == b"set-point %d" % n
    assert stranger.hears_nothing()
    link.lock()
    vehicle.send(b"still you", port)
    assert link.receive() == b"still you"


def test_what_a_stranger_had_queued_before_the_lock_is_not_heard_after_it(
    listening: tuple[Link, int], vehicle: Peer, stranger: Peer
) -> None:
    """The kernel sorts datagrams when they arrive, so connecting a socket does not empty its queue."""
    link, port = listening
    vehicle.send(b"heartbeat", port)
    for n in range(5):
        stranger.send(b"forged %d" % n, port)
        vehicle.send(b"odometry %d" % n, port)
    assert link.receive() == b"heartbeat"
    link.lock()
    vehicle.send(b"last", port)
    heard = [link.receive() for _ in range(6)]
    assert heard == [*(b"odometry %d" % n for n in range(5)), b"last"]


def test_a_lock_before_anybody_was_heard_changes_nothing(listening: tuple[Link, int], vehicle: Peer) -> None:
    link, port = listening
    link.lock()
    vehicle.send(b"first", port)
    assert link.receive() == b"first"


def test_a_locked_peer_that_has_gone_is_silence_and_may_come_back(listening: tuple[Link, int]) -> None:
    link, port = listening
    with closing(Peer()) as first:
        first.send(b"hello", port)
        assert link.receive() == b"hello"
        link.lock()
        place = first.port
    for _ in range(5):
        link.send(b"anybody?")  # refused by the system each time
        time.sleep(0.01)
    assert link.receive() == b""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as again:
        again.bind(("127.0.0.1", place))
        again.sendto(b"back", ("127.0.0.1", port))
        assert b"back" in (link.receive(), link.receive())


def test_a_busy_port_is_one_line(vehicle: Peer) -> None:
    text = complaint(f"udpin://127.0.0.1:{vehicle.port}")
    assert text == "the port is in use: stop the other listener"


def test_a_second_listener_cannot_steal_the_port(listening: tuple[Link, int]) -> None:
    _, port = listening
    assert "in use" in complaint(f"udpin://127.0.0.1:{port}")
    assert "in use" in complaint(f"udpin://0.0.0.0:{port}")


def test_a_closed_link_frees_its_port() -> None:
    port = free_port()
    for _ in range(2):
        open_link(f"udpin://127.0.0.1:{port}").close()


# --- udpout ---------------------------------------------------------------------------------------------------------


def test_udpout_talks_to_its_address_alone(vehicle: Peer, stranger: Peer) -> None:
    with closing(open_link(f"udpout://localhost:{vehicle.port}", timeout_s=1.0)) as link:
        link.send(ANY_BYTES)
        data, sender = vehicle.socket.recvfrom(2048)
        assert data == ANY_BYTES
        stranger.send(b"mine!", sender[1])
        vehicle.send(b"odometry", sender[1])
        assert link.receive() == b"odometry"
        link.lock()
        link.send(b"more")
        assert vehicle.hears() == b"more"


def test_udpout_to_nobody_is_silence() -> None:
    with closing(open_link(f"udpout://127.0.0.1:{free_port()}")) as link:
        for _ in range(10):
            link.send(b"anybody?")
            assert link.receive() == b""


# --- both -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["udpin", "udpout", "serial"])
def test_receive_gives_up_after_its_timeout(kind: str, vehicle: Peer) -> None:
    ours, theirs = os.openpty()
    place = {
        "udpin": f"127.0.0.1:{free_port()}",
        "udpout": f"127.0.0.1:{vehicle.port}",
        "serial": f"{os.ttyname(theirs)}:921600",
    }[kind]
    try:
        with closing(open_link(f"{kind}://{place}", timeout_s=0.1)) as link:
            began = time.monotonic()
            assert link.receive() == b""
            assert 0.08 < time.monotonic() - began < PATIENCE_S
    finally:
        os.close(ours)
        os.close(theirs)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "udpin",
        "udpin://",
        "udpin://0.0.0.0",
        "udpin://0.0.0.0:",
        "udpin://0.0.0.0:port",
        "udpin://:14540",
        "udp://0.0.0.0:14540",
        "tcp://127.0.0.1:5760",
        "UDPIN://0.0.0.0:14540",
        "serial:///dev/ttyAMA0",
        "/dev/ttyAMA0:921600",
        " udpin://0.0.0.0:14540",
    ],
)
def test_what_is_no_link_url_is_told_what_one_looks_like(url: str) -> None:
    text = complaint(url)
    assert text.startswith("not a link URL (udpin://")
    assert "udpout://" in text
    assert "serial://" in text


@pytest.mark.parametrize("number", [0, 65536, 999999])
@pytest.mark.parametrize("kind", ["udpin", "udpout"])
def test_a_number_that_is_no_port_is_named(kind: str, number: int) -> None:
    assert complaint(f"{kind}://127.0.0.1:{number}") == f"{number} is not a UDP port"


def test_a_host_that_cannot_be_had_is_named() -> None:
    assert complaint("udpout://no such host:14580") == "no such host no such host"
    assert complaint("udpin://192.0.2.1:14540") == "Cannot assign requested address"


# --- serial ---------------------------------------------------------------------------------------------------------


@pytest.fixture
def terminal() -> Iterator[tuple[int, str]]:
    """A pseudo-terminal: our end as a descriptor, the other as a device."""
    ours, theirs = os.openpty()
    name = os.ttyname(theirs)
    os.close(theirs)
    try:
        yield ours, name
    finally:
        os.close(ours)


def test_a_serial_line_carries_every_byte_both_ways(terminal: tuple[int, str]) -> None:
    ours, name = terminal
    with closing(open_link(f"serial://{name}:921600", timeout_s=1.0)) as link:
        assert link.stream
        link.lock()
        os.write(ours, ANY_BYTES)
        heard = b""
        while len(heard) < len(ANY_BYTES):
            received = link.receive()
            assert received, f"only {len(heard)} bytes came"
            heard += received
        assert heard == ANY_BYTES, "nothing on the line may be taken for control characters"
        link.send(ANY_BYTES)
        answer = b""
        while len(answer) < len(ANY_BYTES):
            assert select.select([ours], [], [], 1.0)[0], f"only {len(answer)} bytes came"
            answer += os.read(ours, 4096)
        assert answer == ANY_BYTES


def test_a_serial_line_whose_far_end_closes_has_gone() -> None:
    ours, theirs = os.openpty()
    name = os.ttyname(theirs)
    os.close(theirs)
    with closing(open_link(f"serial://{name}:57600", timeout_s=1.0)) as link:
        os.write(ours, b"last words")
        assert link.receive() == b"last words"
        os.close(ours)
        for use in (link.receive, lambda: link.send(b"anybody?")):
            with pytest.raises(LinkError, match=f"link serial://{name}:57600: ") as caught:
                use()
            assert len(str(caught.value).splitlines()) == 1


def fill(link: Link, frames: int) -> None:
    """Far more than the line takes while nobody reads."""
    encode = Encoder(Layout("HEARTBEAT"), 1, 191).encode
    for n in range(frames):
        link.send(encode(n, 1 << 24, 18, 8, 0, 4, 3))


def test_a_full_serial_line_loses_frames_instead_of_waiting(terminal: tuple[int, str]) -> None:
    _, name = terminal
    with closing(open_link(f"serial://{name}:921600")) as link:
        began = time.monotonic()
        fill(link, 20_000)
        assert time.monotonic() - began < PATIENCE_S  # nobody reads: to wait would be to wait for ever


def test_a_full_serial_line_carries_whole_frames_only(terminal: tuple[int, str]) -> None:
    ours, name = terminal
    parser, heard = FrameParser(stream=True), 0
    with closing(open_link(f"serial://{name}:921600")) as link:
        for _ in range(3):
            fill(link, 2000)
            while select.select([ours], [], [], 0.05)[0]:
                heard += len(parser.feed(os.read(ours, 65536)))
    assert heard > 100
    assert parser.dropped_bytes == 0


def test_one_serial_line_has_one_owner(terminal: tuple[int, str]) -> None:
    _, name = terminal
    with closing(open_link(f"serial://{name}:921600")):
        assert complaint(f"serial://{name}:921600").startswith(f"cannot open {name}: ")
    open_link(f"serial://{name}:921600").close()


@pytest.mark.parametrize(
    ("device", "reason"),
    [
        ("/dev/no_such_device", "No such file or directory"),
        ("/dev", "Is a directory"),
        ("/dev/null", "Inappropriate ioctl for device"),
    ],
)
def test_a_device_that_is_no_serial_line_is_named(device: str, reason: str) -> None:
    text = complaint(f"serial://{device}:921600")
    assert text.startswith(f"cannot open {device}: ")
    assert reason in text


# --- known gaps -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("host", ["vehicle..local", ".local", "x" * 64 + ".local"])
def test_a_host_name_that_cannot_be_one_is_named(host: str) -> None:
    assert "no such host" in complaint(f"udpout://{host}:14580")


def test_an_impossible_baud_rate_is_named(terminal: tuple[int, str]) -> None:
    _, name = terminal
    assert "cannot open" in complaint(f"serial://{name}:99999999999")


def test_a_baud_rate_of_zero_is_refused(terminal: tuple[int, str]) -> None:
    _, name = terminal
    assert "0" in complaint(f"serial://{name}:0")


def test_a_url_with_a_line_break_is_refused() -> None:
    with pytest.raises(LinkError, match="not a link URL"):
        open_link("udpout://127.0.0.1:14580\n").close()
