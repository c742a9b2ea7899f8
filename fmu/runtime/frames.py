"""What a process sends to another, in frames: read within a time, a size and a form, or refused.

The process of an FMU can hold anything, so nothing from there is trusted: no more is read than announced
and allowed, and values come as JSON and raw numbers, which run no code. A frame has the token of what
it answers: what an FMU writes into a descriptor that is not its own is told from an answer.
"""

from __future__ import annotations

import json
import socket
import struct
import time
from typing import Any

import numpy as np

MAX_BYTES = 1_000_000_000
"""Size of a frame [B] above which it is refused; the largest are saved states."""

CHUNK = 1 << 16
"""Most that is read at once [B]: memory is taken for what came, not for what was announced."""

TOKEN = 8
"""Size of a token [B]."""

_HEAD, _TEXT = struct.Struct(f"<{TOKEN}sQ"), struct.Struct("<Q")
_TYPES = {"float64": np.float64, "bool": np.bool_}


class FrameError(Exception):
    """What came is no frame of ours."""


def send(end: socket.socket, token: bytes, content: bytes, seconds: float | None = None) -> None:
    """Send a frame.

    Parameters
    ----------
    end : socket.socket
        Where to.
    token : bytes
        What the answer shall have, or what is answered.
    content : bytes
        The frame.
    seconds : float, optional
        Time that it may take [s].

    Raises
    ------
    TimeoutError
        If it takes longer.
    OSError
        If the other end is closed.
    """
    end.settimeout(seconds)
    end.sendall(_HEAD.pack(token, len(content)) + content)


def receive(
    end: socket.socket, token: bytes | None = None, seconds: float | None = None
) -> tuple[bytes, bytearray]:
    """Return the token and the content of the next frame.

    Parameters
    ----------
    end : socket.socket
        Where from.
    token : bytes, optional
        The only one allowed.
    seconds : float, optional
        Time that the whole frame may take [s].

    Raises
    ------
    TimeoutError
        If it takes longer.
    EOFError
        If the other end is closed.
    FrameError
        If it is no frame, too large, or followed by something.
    """
    deadline = None if seconds is None else time.monotonic() + seconds
    content, size, found = bytearray(), _HEAD.size, b""
    while len(content) < size:
        if deadline is not None:
            end.settimeout(max(deadline - time.monotonic(), 1e-6))  # 0 would mean not to wait at all
        part = end.recv(CHUNK)
        if not part:
            raise EOFError
        content += part
        if not found and len(content) >= size:
            found, announced = _HEAD.unpack_from(content)
            if (token is not None and found != token) or announced > MAX_BYTES:
                raise FrameError
            size += announced
    if len(content) > size:
        raise FrameError
    return found, content[_HEAD.size :]


def encode(value: Any) -> bytes:
    """Return a value as bytes: numbers, truth values, text, bytes, arrays, None, and sequences of these.

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
    return b"".join([_TEXT.pack(len(text)), text, *raw])


def decode(content: bytearray) -> Any:
    """Return what `encode` was given.

    Parameters
    ----------
    content : bytearray
        What it returned.

    Raises
    ------
    FrameError
        If it is nothing of the kind.
    """
    place = _TEXT.size

    def restored(item: dict[str, Any]) -> Any:
        nonlocal place
        ((kind, shape),) = item.items()
        if kind == "bytes":
            found: Any = bytes(content[place : place + shape])
            place += shape
        else:
            found = np.ndarray(shape, _TYPES[kind], content, place).copy()
            place += found.nbytes
        return found

    try:
        place += _TEXT.unpack_from(content)[0]
        return json.loads(content[_TEXT.size : place], object_hook=restored)
    except Exception as error:
        raise FrameError from error
