"""Server of live pages: rows equal to a simulation, several pages at once, and requests that are refused."""

import base64
import http.client
import json
import socket
import struct
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager

import numpy as np
import pytest
from numpy.testing import assert_array_equal
from systems import assert_near

from trussflow.blocks import (
    Block,
    Constant,
    Diagram,
    Gain,
    Input,
    Integrator,
    Output,
    simulate,
)
from trussflow.blocks.live import page
from trussflow.blocks.live.page import server_of
from trussflow.blocks.tracing.plan import Plan

CALLS = []


class Counted(Block):
    """A Python block that notes the times of its calls, and fails for large inputs."""

    traced = False
    u = Input()
    y = Output()

    def output(self, t, x, u, p):
        CALLS.append(float(t))
        if u.u > 600.0:
            raise ZeroDivisionError("no more room")
        return {"y": 2.0 * np.asarray(u.u)}


def loop(middle):
    diagram = Diagram("loop")
    goal, block, place = diagram.add(
        goal=Constant(1.0), block=middle, place=Integrator()
    )
    (goal.y - place.y) >> block >> place
    diagram.expose(y=place.y)
    return diagram


@contextmanager
def served(diagram, **settings):
    """Serve a diagram in a thread."""
    with server_of(diagram, **{"step": 0.01, "duration": 0.5} | settings) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()


@contextmanager
def ask(server, method, place, body=b"", host=None, token=None):
    """Yield the answer to a request."""
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=60)
    headers = {} if host is None else {"Host": host}
    address = f"/{server.token if token is None else token}/{place}"
    connection.request(method, address, body, headers)
    with closing(connection), connection.getresponse() as answer:
        yield answer


def run(server, p, name="run"):
    """Return the rows and the message of a run."""
    place = f"run/{name}"
    sent = np.asarray(p, dtype="<f8").tobytes()
    with ask(server, "POST", place, sent) as answer:
        *lines, last = answer
    rows = b"".join(map(base64.b64decode, lines))
    return np.frombuffer(rows).reshape(-1, 2), json.loads(last)["fault"]


def test_a_served_diagram_is_traced_once(monkeypatch):
    plans = []
    monkeypatch.setattr(
        page, "Plan", lambda *given: plans.append(Plan(*given)) or plans[-1]
    )
    with served(loop(Gain(3.0))) as server:
        assert [server.prepared.plan] == plans
        assert run(server, plans[0].parameters(None))[1] == ""


@pytest.mark.parametrize("middle", [Gain(3.0), Counted().sampled(0.01)])
def test_rows_are_those_of_a_simulation(middle):
    diagram = loop(middle)
    expected = simulate(diagram, 1.0, step=0.01, log={"y": diagram.ports["y"]})
    with served(diagram, duration=1.0) as server:
        p = server.prepared.plan.parameters(None)
        rows, fault = run(server, p)
    assert fault == ""
    assert_array_equal(rows[:, 0], expected["time"])
    assert_array_equal(rows[:, 1], expected["y"])


def test_two_pages_have_runs_of_their_own():
    with served(loop(Gain(3.0)), pace=2.0) as server, ThreadPoolExecutor() as pool:
        plan = server.prepared.plan
        found = {
            gain: pool.submit(
                run, server, plan.parameters({"block.gain": gain}), f"page{gain}"
            )
            for gain in (1.0, 5.0)
        }
    for gain, future in found.items():
        time, y = future.result()[0].T
        assert_near(y, 1 - np.exp(-gain * time), 1e-6)


def test_a_paced_run_takes_new_values_while_it_goes_on():
    with served(loop(Gain(0.0)), pace=1.0, duration=0.6) as server:
        plan = server.prepared.plan
        values = plan.parameters({"block.gain": 3.0}).tobytes()

        def tune():
            with ask(server, "POST", "tune/run", values) as answer:
                assert answer.status == 200

        threading.Timer(0.2, tune).start()
        begin = time.perf_counter()
        rows, _ = run(server, plan.parameters(None))
        assert time.perf_counter() - begin >= 0.6
    still = np.flatnonzero(rows[:, 1] > 0.0)[0] - 1
    time_since = rows[still:, 0] - rows[still, 0]
    assert rows[still, 0] > 0.1
    assert_near(rows[still:, 1], 1 - np.exp(-3.0 * time_since), 1e-6)


@pytest.mark.parametrize("pace", [None, 1.0])
def test_a_closed_page_ends_its_run(pace, capsys):
    diagram = loop(Counted().sampled(0.01))
    with served(diagram, pace=pace, duration=9000.0) as server:
        p = server.prepared.plan.parameters(None)
        with ask(server, "POST", "run/a", p.tobytes()) as answer:
            answer.readline()
        before = -1
        while CALLS[-1] != before:
            before = CALLS[-1]
            time.sleep(0.3)
    assert before < 1000.0
    assert not capsys.readouterr().err


@pytest.mark.parametrize(
    "change, status",
    [
        ({}, 200),
        ({"token": "guess"}, 403),
        ({"token": ""}, 403),
        ({"host": "elsewhere.example"}, 403),
        ({"host": "localhost"}, 403),
        ({"place": "../../etc/passwd"}, 404),
    ],
)
def test_only_the_address_with_the_token_is_answered(change, status):
    with served(loop(Gain(3.0))) as server:
        settings = {"place": "", **change}
        with ask(server, "GET", settings.pop("place"), **settings) as answer:
            assert answer.status == status
            assert (b"<h1>loop</h1>" in answer.read()) == (status == 200)


@pytest.mark.parametrize(
    "change, message",
    [
        ({"p": [1.0]}, "does not send 3 parameters"),
        ({"p": [np.nan] * 3}, "finite"),
        ({"name": "a/b"}, "positional arguments"),
    ],
)
def test_a_wrong_run_gets_a_message(change, message):
    with served(loop(Gain(3.0))) as server:
        p = server.prepared.plan.parameters(None)
        rows, fault = run(server, **({"p": p} | change))
    assert rows.size == 0
    assert message in fault


@pytest.mark.parametrize("length", ["-1", "junk", "99999999999"])
def test_a_wrong_length_gets_a_message_without_a_traceback(length, capsys):
    with served(loop(Gain(3.0))) as server:
        head = f"POST /{server.token}/run/a HTTP/1.0\r\nHost: 127.0.0.1:{server.server_port}\r\n"
        place = "127.0.0.1", server.server_port
        with socket.create_connection(place, timeout=60) as client:
            client.sendall(f"{head}Content-Length: {length}\r\n\r\n".encode())
            assert b"load it again" in client.makefile("rb").read()
    assert not capsys.readouterr().err


def test_broken_and_strange_requests_print_no_traceback(capsys):
    with served(loop(Gain(3.0))) as server:
        for request in (b"GET http://[/ HTTP/1.0\r\n\r\n", b"\0\xff\r\n", b"POST"):
            with socket.create_connection(server.server_address) as client:
                client.sendall(request)
                # closing resets the connection
                client.setsockopt(
                    socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
                )
        run(server, server.prepared.plan.parameters(None))
    assert not capsys.readouterr().err


@pytest.mark.campaign
def test_a_served_page_follows_a_slider_during_a_paced_run(window):
    diagram = loop(Counted().sampled(0.01))
    with served(diagram, duration=20.0, pace=4.0, parameters=["goal.value"]) as server:
        window.open(server.address)
        window.wait("trussflowLive.run.time.length > 100")
        field = window.page.get_by_label("goal.value, number", exact=True)
        field.fill("3")
        field.dispatch_event("change")
        window.wait("trussflowLive.run.time.length > 1500")
        time, (place,) = window.rows()[0], window.rows()[1].T
        assert not window.trouble()
        # The held command 2 (r - y) reduces the distance from r by a factor of 0.98 in each sample.
        first = 1 - 0.98 ** np.arange(len(place))
        changed = np.flatnonzero(np.abs(place - first) > 1e-9)[0] - 1
        since = np.arange(len(place) - changed)
        assert_near(place[changed:], 3 - (3 - place[changed]) * 0.98**since, 1e-9)
        assert 0.5 < time[changed] < 15.0
        # A link that is opened begins a run of its own.
        window.open(server.address, "goal.value=2")
        window.wait("trussflowLive.run.time.length > 50")
        place = window.rows()[1][:, 0]
        assert_near(place, 2 - 2 * 0.98 ** np.arange(len(place)), 1e-9)
    assert all(url.startswith((server.address, "blob:")) for url in window.requests)
    assert not window.complaints


@pytest.mark.campaign
def test_a_served_page_shows_a_fault_and_the_end_of_the_server(window):
    diagram = loop(Counted().sampled(0.01))
    with served(diagram, duration=1.0) as server:
        window.open(server.address)
        window.set("goal.value", 666.0)
        assert "no more room" in window.trouble()
        window.set("goal.value", 0.5)
        assert not window.trouble()
        assert window.rows()[1][-1, 0] == pytest.approx(0.5 - 0.5 * 0.98**100)
        assert not window.complaints
    window.page.get_by_label("goal.value", exact=True).fill("900")
    window.wait(
        "document.getElementById('trouble').textContent.includes('cannot simulate')"
    )
    window.complaints.clear()
