"""A live page whose runs are computed by this process, for diagrams that a browser cannot run."""

from __future__ import annotations

import base64
import contextlib
import json
import secrets
import time
import webbrowser
from collections.abc import Callable, Iterator
from fractions import Fraction
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlsplit

import numpy as np

from trussflow.blocks.errors import SimulationError, TrussflowError
from trussflow.blocks.simulation.session import Session
from trussflow.blocks.support.types import Vector

FLUSH_SECONDS = 0.05
"""Wall time between two parts of an answer [s]."""

MAX_RUN_ROWS = 1_000_000
"""Largest number of logged rows of a run that a page may ask for [-]."""


class LiveServer(ThreadingHTTPServer):
    """Server of one live page, for browsers of this computer.

    The page and its runs are found only under an address with a secret token. Each page has runs of its own; a
    run ends when its page is closed.

    Parameters
    ----------
    session : Session
        Session whose twins compute the runs.
    page : bytes
        The page.
    log_step : fractions.Fraction
        Time between logged instants [s].
    pace : float, optional
        Simulated seconds in a second of wall time [-]; by default runs are as fast as possible.
    """

    daemon_threads = True

    def __init__(
        self,
        session: Session,
        page: bytes,
        log_step: Fraction,
        *,
        pace: float | None = None,
    ) -> None:
        # port 0: any free one
        super().__init__(("127.0.0.1", 0), _Handler)
        self.session = session
        self.page = page
        self.log_step = log_step
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
            name = self.session.prepared.plan.name
            print(f"live page of '{name}': {self.address} (Ctrl-C ends it)")  # noqa: T201
            webbrowser.open(self.address)
            with contextlib.suppress(KeyboardInterrupt):
                self.serve_forever()

    def named(self, p: Vector) -> dict[str, Any]:
        """Return parameters `p` [as declared] by name."""
        layout = self.session.prepared.plan.p
        if p.size != layout.size:
            raise SimulationError(
                f"the page sent {p.size} parameters instead of {layout.size}; load it again"
            )
        return dict(layout.named(p))

    def rows(self, name: str, p: Vector, duration: float) -> Iterator[Vector]:
        """Yield time and outputs at the logged instants of a run.

        Parameters
        ----------
        name : str
            Name of the run, for `changes`.
        p : Vector
            Parameters [as declared].
        duration : float
            Duration [s].

        Raises
        ------
        SimulationError
            If the duration or the number of parameters is wrong, or the run fails.
        """
        number = round(duration / float(self.log_step))
        if not 0 < number <= MAX_RUN_ROWS:
            raise SimulationError(
                f"a run of {duration:g} s has {number} rows; choose a duration with 1 to {MAX_RUN_ROWS}"
            )
        self.changes.pop(name, None)
        with self.session.twin() as session:
            session.start(parameters=self.named(p))
            begin = time.perf_counter()
            for k in range(number + 1):
                now = float(k * self.log_step)
                if k:
                    if (changed := self.changes.pop(name, None)) is not None:
                        session.tune(self.named(changed))
                    session.advance(now)
                if self.pace:
                    time.sleep(max(0.0, begin + now / self.pace - time.perf_counter()))
                yield np.concatenate([[now], session.row()])


class _Handler(BaseHTTPRequestHandler):
    """Answer of one request."""

    server: LiveServer
    protocol_version = "HTTP/1.0"

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing."""

    def do_GET(self) -> None:
        """Send the page."""
        self._answer({"": self._send_page})

    def do_POST(self) -> None:
        """Send the rows of a run, or change the parameters of one that is running."""
        self._answer({"run": self._run, "tune": self._tune})

    def _answer(self, actions: dict[str, Callable[[], None]]) -> None:
        """Take the action that the address names.

        A foreign page cannot know the token. The host is checked since a foreign name may lead to this
        computer.
        """
        port = self.server.server_port
        is_here = self.headers.get("Host") in (f"127.0.0.1:{port}", f"localhost:{port}")
        token, _, rest = urlsplit(self.path).path.removeprefix("/").partition("/")
        if not is_here or not secrets.compare_digest(
            token.encode(), self.server.token.encode()
        ):
            self.send_error(HTTPStatus.FORBIDDEN)
        elif rest not in actions:
            self.send_error(HTTPStatus.NOT_FOUND)
        else:
            # Of a closed page; its session is closed, which ends the run.
            with contextlib.suppress(ConnectionError):
                actions[rest]()

    def _begin(self, kind: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Cache-Control", "no-store")
        self.end_headers()

    def _send_page(self) -> None:
        self._begin("text/html; charset=utf-8")
        self.wfile.write(self.server.page)

    def _numbers(self) -> Vector:
        """Return the parameters in the request."""
        size = 8 * self.server.session.prepared.plan.p.size
        sent = int(self.headers.get("Content-Length") or 0)
        body = self.rfile.read(min(sent, size))
        return np.frombuffer(body[: len(body) // 8 * 8], dtype="<f8").astype(float)

    def _asked(self) -> dict[str, str]:
        return {k: v[0] for k, v in parse_qs(urlsplit(self.path).query).items()}

    def _tune(self) -> None:
        self.server.changes[self._asked().get("run", "")] = self._numbers()
        self._begin("text/plain")

    def _run(self) -> None:
        """Send a line of JSON for each part of the rows, and one for the end."""
        asked = self._asked()
        p = self._numbers()
        self._begin("application/x-ndjson")
        last = {"fault": ""}
        part: list[Vector] = []
        sent = time.perf_counter()
        try:
            duration = float(asked.get("duration", "nan"))
            for row in self.server.rows(asked.get("run", ""), p, duration):
                part.append(row)
                if time.perf_counter() - sent > FLUSH_SECONDS:
                    self._send(part)
                    part, sent = [], time.perf_counter()
        except (TrussflowError, ValueError) as error:
            last["fault"] = str(error)
        self._send(part, last)

    def _send(self, rows: list[Vector], last: dict[str, str] | None = None) -> None:
        """Send rows as a line of JSON; the `last` one has a message, empty if the run is complete."""
        packed = np.array(rows, dtype="<f8").tobytes()
        line = {"rows": base64.b64encode(packed).decode(), **(last or {})}
        self.wfile.write(json.dumps(line).encode() + b"\n")
        self.wfile.flush()
