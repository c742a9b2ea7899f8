"""A live page whose runs are computed by this process, for diagrams that a browser cannot run."""

from __future__ import annotations

import base64
import contextlib
import json
import secrets
import sys
import webbrowser
from collections.abc import Iterator, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import numpy as np

from trussflow.blocks.errors import SimulationError
from trussflow.blocks.simulation.prepared import Prepared
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.support.types import Vector


class LiveServer(ThreadingHTTPServer):
    """Server of one live page, for browsers of this computer.

    The page and its runs are found only under an address with a secret token. Each page has runs of its own; a
    run ends when its page is closed.

    Parameters
    ----------
    prepared : Prepared
        The prepared diagram, whose channels are the outputs.
    page : bytes
        The page.
    logged : range
        Ticks of the logged instants [-].
    pace : float, optional
        Simulated seconds in a second of wall time [-]; by default runs are as fast as possible.
    """

    daemon_threads = True

    def __init__(
        self,
        prepared: Prepared,
        page: bytes,
        logged: range,
        *,
        pace: float | None = None,
    ) -> None:
        # port 0: any free one
        super().__init__(("127.0.0.1", 0), _Handler)
        self.prepared = prepared
        self.page = page
        self.logged = logged
        self.pace = pace
        self.token = secrets.token_urlsafe(16)
        self.changes: dict[str, Vector] = {}
        """New parameters of a running run, by its name."""

    @property
    def address(self) -> str:
        """Address of the page."""
        return f"http://127.0.0.1:{self.server_port}/{self.token}/"

    def until_interrupted(self) -> None:
        """Print the address, open it in the browser, and serve until Ctrl-C."""
        with self:
            # not to standard output, which is only JSON with --json
            line = f"live page of '{self.prepared.plan.name}': {self.address} (Ctrl-C ends it)"
            print(line, file=sys.stderr)  # noqa: T201
            webbrowser.open(self.address)
            with contextlib.suppress(KeyboardInterrupt):
                self.serve_forever()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Print the traceback of an error in a `request` of `client_address`; not if the connection broke."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)

    def tune(self, p: Vector, name: str) -> Sequence[Vector]:
        """Change the parameters `p` [as declared] of the run `name` at its next logged instant; return no rows."""
        self.changes[name] = p
        return ()

    def run(self, p: Vector, name: str) -> Iterator[Vector]:
        """Yield time and outputs at the logged instants of a run.

        Parameters
        ----------
        p : Vector
            Parameters [as declared].
        name : str
            Name of the run, for `tune`.

        Raises
        ------
        SimulationError
            If the run fails.
        """
        self.changes.pop(name, None)
        session, named = Session.of(self.prepared), self.prepared.plan.p.named
        session.start(parameters=named(p), pace=self.pace)
        with session:
            for k in self.logged:
                now = float(k * self.prepared.tick)
                if k:
                    if name in self.changes:
                        session.tune(named(self.changes.pop(name)))
                    session.advance(now)
                yield np.concatenate([[now], session.row()])


class _Handler(BaseHTTPRequestHandler):
    """Answer of one request."""

    server: LiveServer
    timeout = 60
    """Time after which a client that neither sends nor reads is left [s]."""

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing."""

    def do_GET(self) -> None:
        """Send the page."""
        if self._place("") is not None:
            self._begin("text/html; charset=utf-8")
            self.wfile.write(self.server.page)

    def do_POST(self) -> None:
        """Send the rows of a run, or change the parameters of one that is running.

        The answer has a line in base64 for each row, and one of JSON with a message, empty if all is well.
        """
        if (place := self._place("run", "tune")) is None:
            return
        self._begin("application/x-ndjson")
        fault = ""
        try:
            action = getattr(self.server, place[0])
            for row in action(self._parameters(), *place[1:]):
                self.wfile.write(base64.b64encode(row.astype("<f8").tobytes()) + b"\n")
        # If the connection is broken, sending the message fails again.
        except Exception as error:  # noqa: BLE001 - the page shows it
            fault = str(error) or type(error).__name__
        self.wfile.write(json.dumps({"fault": fault}).encode() + b"\n")

    def _place(self, *known: str) -> list[str] | None:
        """Return the parts of the address after the token; send an error if the first one is not known.

        A foreign page cannot know the token. The host is checked since a foreign name may lead to this
        computer.
        """
        port = self.server.server_port
        is_here = self.headers.get("Host") in (f"127.0.0.1:{port}", f"localhost:{port}")
        token, *place = self.path.removeprefix("/").split("/")
        if not is_here or not secrets.compare_digest(
            token.encode(), self.server.token.encode()
        ):
            self.send_error(HTTPStatus.FORBIDDEN)
        elif not place or place[0] not in known:
            self.send_error(HTTPStatus.NOT_FOUND)
        else:
            return place
        return None

    def _begin(self, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.end_headers()

    def _parameters(self) -> Vector:
        """Return the parameters in the request."""
        number = self.server.prepared.plan.p.size
        if self.headers.get("Content-Length") != str(8 * number):
            raise SimulationError(
                f"the page does not send {number} parameters; load it again"
            )
        return np.frombuffer(self.rfile.read(8 * number), dtype="<f8").astype(float)
