"""Signals to and from other programs and devices, by UDP.

A packet has numbers of 8 bytes (IEEE 754, little-endian): the time of the sender [s], then the elements of
the signal, row by row.
"""

from __future__ import annotations

import select
import socket
from math import prod
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from trussflow.blocks.errors import BlockError, SimulationError
from trussflow.blocks.framework.block import Block, Values
from trussflow.blocks.framework.declarations import Parameter, Signals
from trussflow.blocks.framework.port import INFERRED, Input, Output
from trussflow.blocks.framework.run_state import Running
from trussflow.blocks.framework.symbol import Symbol
from trussflow.blocks.library.signals import Shaped, ShapeLike
from trussflow.blocks.support.types import Array
from trussflow.blocks.support.validation import as_shape

MAX_PACKET_SIZE = 65_507
"""Largest size of a UDP packet [B]."""

MAX_ELEMENTS = MAX_PACKET_SIZE // 8 - 1
"""Largest number of elements in a packet [-]."""


class UdpSend(Shaped):
    """Send a signal in a UDP packet at each sample.

    Parameters
    ----------
    sample_time : float
        Time between packets [s].
    port : int
        Port of the receiver [-].
    address : str
        Name or IPv4 address of its computer.
    shape : int, tuple of int or None
        Shape of the signal [-]; None takes it from the wires.
    """

    traced: ClassVar[bool] = False
    u = Input(INFERRED, meaning="signal to send")
    _symbol = Symbol("UDP →")

    def __init__(
        self,
        sample_time: float,
        port: int,
        *,
        address: str = "127.0.0.1",
        shape: ShapeLike = None,
    ) -> None:
        self.port_number, self.address = port, address
        super().__init__(shape)
        self.sampled(sample_time)

    def open(self, p: Signals) -> Running:
        """Return the socket of a run."""
        return _Sender(self)


class UdpReceive(Block):
    """Receive a signal in UDP packets; at each sample, the last packet counts, and its values are held.

    Packets of another size, or with numbers that are not finite, are ignored and counted in the messages of the
    result.

    Parameters
    ----------
    sample_time : float
        Time between samples [s].
    port : int
        Port at which packets arrive [-]; 0 takes a free one.
    shape : int or tuple of int
        Shape of the signal [-].
    start_value : array_like
        Values until the first packet [any].
    timeout : float
        Wall time to wait for a packet at each sample, if none has arrived since the last one [s].
    address : str
        Address of this computer at which packets arrive; ``"0.0.0.0"`` for those from other computers.

    Raises
    ------
    BlockError
        If the shape is invalid, or the signal does not fit into a packet.
    """

    traced: ClassVar[bool] = False
    start_value = Parameter(0.0, "shape", meaning="values until the first packet")
    y = Output("shape", meaning="values of the last packet")
    sent = Output(unit="s", meaning="time of the sender in the last packet")
    age = Output(unit="s", meaning="time since the last packet, or since the start")
    _symbol = Symbol("→ UDP")

    def __init__(
        self,
        sample_time: float,
        port: int,
        shape: ShapeLike = (),
        *,
        start_value: npt.ArrayLike = 0.0,
        timeout: float = 0.0,
        address: str = "127.0.0.1",
    ) -> None:
        self.shape = as_shape("UdpReceive", shape)
        if prod(self.shape) > MAX_ELEMENTS:
            raise BlockError(
                f"UdpReceive cannot have shape {self.shape}: a packet has at most {MAX_ELEMENTS:,} elements; "
                "use several blocks"
            )
        self.port_number, self.address, self.timeout = port, address, timeout
        super().__init__(start_value=start_value)
        self.sampled(sample_time)

    def open(self, p: Signals) -> Running:
        """Return the socket of a run."""
        return _Receiver(self, p)


class _Socket(Running):
    """Socket of a UDP block in one run."""

    stuck = "it exchanges packets with others"

    def __init__(self, block: Any) -> None:
        self._block = block
        # once, as finding the address of a name may take seconds
        self._place = socket.gethostbyname(block.address), block.port_number
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class _Sender(_Socket):
    def update(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Send the signal."""
        packet = np.append(t, u.u).astype("<f8").tobytes()
        self._socket.sendto(packet, self._place)
        return {}


class _Receiver(_Socket):
    def __init__(self, block: UdpReceive, p: Signals) -> None:
        super().__init__(block)
        self._time = self._since = np.nan
        self._numbers = np.append(0.0, p.start_value)
        self._ignored = 0
        try:
            self._socket.bind(self._place)
        except OSError as error:
            self.close()
            where = f"cannot receive at {block.address}, port {block.port_number}"
            raise SimulationError(f"{where}: {error}; choose another one") from error

    @property
    def messages(self) -> tuple[str, ...]:
        """Number of packets that were ignored."""
        return (f"ignored {self._ignored} packets",) if self._ignored else ()

    def output(self, t: Array, x: Signals, u: Signals, p: Signals) -> Values:
        """Return the values of the last packet."""
        if t != self._time:  # an instant may be evaluated more than once
            self._since = t if np.isnan(self._time) else self._since
            self._time = t
            self._receive(self._block.timeout)
        return {
            "y": self._numbers[1:].reshape(self._block.shape),
            "sent": self._numbers[0],
            "age": self._time - self._since,
        }

    def _receive(self, timeout: float) -> None:
        """Take all packets that are there; wait for one."""
        while select.select([self._socket], [], [], timeout)[0]:
            timeout = 0.0
            packet = self._socket.recv(MAX_PACKET_SIZE)
            # not a number, which is ignored, for packets of another size
            numbers = np.full(self._numbers.size, np.nan)
            if len(packet) == numbers.nbytes:
                numbers = np.frombuffer(packet, "<f8").astype(float)
            if np.isfinite(numbers).all():
                self._numbers, self._since = numbers, self._time
            else:
                self._ignored += 1
