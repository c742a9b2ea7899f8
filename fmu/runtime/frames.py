"""Frames between two processes, with limits of time and size and a checked format.

The process of an FMU is not trusted. No more bytes are read than announced and allowed. Values are
encoded as JSON and raw numbers, which cannot run code. An answer repeats the token of its request, so
that bytes which an FMU writes into the wrong descriptor are not taken for an answer.
"""

from __future__ import annotations

import json
import socket
import struct
import time
from typing import Any

import numpy as np

MAX_BYTES = 1_000_000_000
"""Maximum size of a frame [B]; the largest frames are saved states."""

MAX_READ_BYTES = 1 << 16
"""Maximum number of bytes of one read [B], so that memory grows with the bytes received."""

TOKEN_BYTES = 8
"""Size of a token [B]."""

_FRAME_HEADER, _TEXT_LENGTH = struct.Struct(f"<{TOKEN_BYTES}sQ"), struct.Struct("<Q")
_ARRAY_TYPES = {"float64": np.float64, "bool": np.bool_}


class FrameError(Exception):
    """The received bytes are not a valid frame."""


def send(end: socket.socket, token: bytes, content: bytes, seconds: float | None = None) -> None:
    """Send a frame.

    Parameters
    ----------
    end : socket.socket
        Socket to write to.
    token : bytes
        Token of the request; its answer has the same token.
    content : bytes
        Content of the frame.
    seconds : float, optional
        Maximum time [s].

    Raises
    ------
    TimeoutError
        If sending takes longer.
    OSError
        If the other end is closed.
    """
    end.settimeout(seconds)
    end.sendall(_FRAME_HEADER.pack(token, len(content)) + content)


def receive(
    end: socket.socket, token: bytes | None = None, seconds: float | None = None
) -> tuple[bytes, bytearray]:
    """Return the token and the content of the next frame.

    Parameters
    ----------
    end : socket.socket
        Socket to read from.
    token : bytes, optional
        Expected token; by default any token.
    seconds : float, optional
        Maximum time for the whole frame [s].

    Raises
    ------
    TimeoutError
        If the frame takes longer.
    EOFError
        If the other end is closed.
    FrameError
        If the frame is invalid, too large, or followed by further bytes.
    """
    deadline = None if seconds is None else time.monotonic() + seconds
    content, size, found = bytearray(), _FRAME_HEADER.size, b""
    while len(content) < size:
        if deadline is not None:
            end.settimeout(max(deadline - time.monotonic(), 1e-6))  # 0 would make the socket non-blocking
        part = end.recv(MAX_READ_BYTES)
        if not part:
            raise EOFError
        content += part
        if not found and len(content) >= size:
            found, announced = _FRAME_HEADER.unpack_from(content)
            if (token is not None and found != token) or announced > MAX_BYTES:
                raise FrameError
            size += announced
    if len(content) > size:
        raise FrameError
    return found, content[_FRAME_HEADER.size :]


def encode(value: Any) -> bytes:
    """Return a value as bytes: numbers, Booleans, text, bytes, arrays, None, and sequences of these.

    Parameters
    ----------
    value : object
        The value; sequences become lists.
    """
    raw: list[bytes] = []

    def apart(item: Any) -> Any:
        if isinstance(item, bytes):
            raw.append(item)
            return {"bytes": len(item)}
        raw.append(item.tobytes())
        return {item.dtype.name: item.shape}

    text = json.dumps(value, default=apart).encode()
    return b"".join([_TEXT_LENGTH.pack(len(text)), text, *raw])


def decode(content: bytearray) -> Any:
    """Return the value that `encode` wrote.

    Parameters
    ----------
    content : bytearray
        Bytes from `encode`.

    Raises
    ------
    FrameError
        If the bytes are not an encoded value.
    """
    place = _TEXT_LENGTH.size

    def restored(item: dict[str, Any]) -> Any:
        nonlocal place
        ((kind, shape),) = item.items()
        if kind == "bytes":
            found: Any = bytes(content[place : place + shape])
            place += shape
        else:
            found = np.ndarray(shape, _ARRAY_TYPES[kind], content, place).copy()
            place += found.nbytes
        return found

    try:
        place += _TEXT_LENGTH.unpack_from(content)[0]
        return json.loads(content[_TEXT_LENGTH.size : place], object_hook=restored)
    except Exception as error:
        raise FrameError from error
