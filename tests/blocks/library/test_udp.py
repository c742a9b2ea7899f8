"""Packets between two diagrams, and between a diagram and any program."""

import socket
import struct

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from trussflow.blocks import (
    Constant,
    Diagram,
    Ramp,
    Session,
    UdpReceive,
    UdpSend,
    simulate,
)
from trussflow.blocks.errors import SimulationError


@pytest.fixture
def peer():
    """Return a socket of a device on this computer."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        own.settimeout(10.0)
        yield own


@pytest.fixture
def port():
    """Return a port that is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as own:
        own.bind(("127.0.0.1", 0))
        return own.getsockname()[1]


def receiving(port, **settings):
    diagram = Diagram("receiving")
    diagram.expose(
        **{
            p.name: p
            for p in diagram.add(r=UdpReceive(0.1, port, **settings)).outputs()
        }
    )
    return Session(diagram, step=0.1)


def test_a_packet_has_the_time_and_the_elements_row_by_row(peer):
    diagram = Diagram("sending")
    matrix = np.arange(6.0).reshape(2, 3)
    send = UdpSend(0.1, peer.getsockname()[1])
    diagram.add(matrix=Constant(matrix)) >> diagram.add(send=send)
    simulate(diagram, 0.3, step=0.1)
    packets = [struct.unpack("<7d", peer.recv(100)) for _ in range(4)]
    assert [packet[0] for packet in packets] == [0.0, 0.1, 0.2, 0.3]
    assert {packet[1:] for packet in packets} == {(0.0, 1.0, 2.0, 3.0, 4.0, 5.0)}
    peer.setblocking(False)
    with pytest.raises(BlockingIOError):
        peer.recv(100)


def test_the_last_packet_counts_and_is_held(peer, port):
    with receiving(port, shape=2, start_value=[7.0, 8.0]) as session:
        assert_array_equal(session.outputs["y"], [7.0, 8.0])
        session.advance(0.2)
        assert session.outputs["age"] == pytest.approx(0.2)
        for k in range(3):
            peer.sendto(struct.pack("<3d", 5.0 + k, k, -k), ("127.0.0.1", port))
        session.advance(0.3)
        assert_array_equal(session.outputs["y"], [2.0, -2.0])
        assert (session.outputs["sent"], session.outputs["age"]) == (7.0, 0.0)
        session.advance(0.5)
        assert_array_equal(session.outputs["y"], [2.0, -2.0])
        assert session.outputs["age"] == pytest.approx(0.2)


def test_wrong_packets_are_ignored_and_counted(peer, port):
    with receiving(port) as session:
        session.advance(0.1)
        for wrong in (
            b"",
            b"text",
            struct.pack("<3d", 1, 2, 3),
            struct.pack("<2d", 1, np.nan),
        ):
            peer.sendto(wrong, ("127.0.0.1", port))
        session.advance(0.3)
        assert session.outputs["y"] == 0.0
        assert session.messages == {"r": ["ignored 4 packets"]}
        peer.sendto(struct.pack("<2d", 1.0, 4.0), ("127.0.0.1", port))
        session.advance(0.4)
        assert session.outputs["y"] == 4.0


def test_a_sample_waits_for_a_packet_until_its_timeout(peer, port, monkeypatch):
    from trussflow.blocks.library import udp

    waits, select = [], udp.select.select

    def late(sockets, *others):
        waits.append(others[-1])
        if others[-1] and len(waits) < 4:
            peer.sendto(struct.pack("<2d", 0.0, 3.0), ("127.0.0.1", port))
        return select(sockets, *others[:-1], min(0.01, others[-1]))

    monkeypatch.setattr(udp.select, "select", late)
    with receiving(port, timeout=5.0) as session:
        assert session.outputs["y"] == 3.0
        session.advance(0.1)
        assert waits[:2] == [5.0, 0.0]


def test_ports_in_use_and_wrong_addresses_are_named(peer):
    port = peer.getsockname()[1]
    with pytest.raises(
        SimulationError, match=f"cannot receive at 127.0.0.1, port {port}: .* in use"
    ):
        receiving(port).start()
    with pytest.raises(SimulationError, match="cannot receive at"):
        receiving(0, address="192.0.2.1").start()


def test_the_address_of_a_name_is_found_once(peer, monkeypatch):
    names = []

    def found(name):
        names.append(name)
        return "127.0.0.1"

    monkeypatch.setattr(socket, "gethostbyname", found)
    diagram = Diagram("sending")
    send = UdpSend(0.1, peer.getsockname()[1], address="device.invalid")
    diagram.add(ramp=Ramp(2.0)) >> diagram.add(send=send)
    simulate(diagram, 0.3, step=0.1)
    assert [struct.unpack("<2d", peer.recv(100))[0] for _ in range(4)] == [
        0.0,
        0.1,
        0.2,
        0.3,
    ]
    assert names == ["device.invalid"]
