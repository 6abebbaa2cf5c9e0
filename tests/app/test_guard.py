"""What a running app refuses: other pages and hosts, no session, paths out of its folder."""

import json
import time

import pytest

from app.guided import Server
from app.hostile import got_through, prepared, tries

pytestmark = pytest.mark.slow

LEAST_TRIES = 200


def test_nothing_hostile_gets_through(server: Server) -> None:
    prepared(server)
    every = list(tries(server))
    assert len(every) >= LEAST_TRIES
    through = [(one, why) for one in every if (why := got_through(server, one))]
    assert through == []
    assert server.own("GET", "/robot")[0] == 200


def test_what_the_app_itself_asks_is_answered(server: Server) -> None:
    prepared(server)
    assert server.own("GET", "/")[0] == 303
    for path in ("/robot", "/logs", "/check", "/identify", "/static/plotly.js"):
        assert server.own("GET", path)[0] == 200
    assert server.own("PUT", "/upload/logs/b%20c.csv", b"t,q\n0,1\n")[0] == 204
    assert (server.folder / "logs" / "b_c.csv").read_text() == "t,q\n0,1\n"
    assert server.act("/logs/remove", log="logs/b_c.csv")[0] == 204
    assert not (server.folder / "logs" / "b_c.csv").exists()
    for _ in range(2):  # the second is not written over the first
        status, answer = server.own("PUT", "/upload/logs/twice.csv", b"t,q\n0,1\n")
    assert status == 422 and "there already" in json.loads(answer)["wrong"]
    assert server.act("/logs/remove", log="logs/twice.csv")[0] == 204
    unreadable = server.folder / "robot.toml"
    assert not unreadable.exists()
    unreadable.write_bytes(b"name = '\xff'")
    assert server.own("GET", "/logs")[0] == 200 and server.own("GET", "/")[0] == 303
    unreadable.unlink()


def test_a_refusal_says_what_where_and_how_to_correct_it(server: Server) -> None:
    status, answer = server.own("PUT", "/upload/logs/run.exe", b"x")
    assert status == 422
    assert set(json.loads(answer)) == {"wrong", "where", "fix"}


def test_an_upload_that_breaks_off_leaves_no_file(server: Server) -> None:
    import socket

    head = (
        f"PUT /upload/logs/cut.csv HTTP/1.1\r\nHost: 127.0.0.1:{server.port}\r\n"
        f"Cookie: {server.cookie}\r\nOrigin: {server.origin}\r\nContent-Length: 1000\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", server.port)) as connection:
        connection.sendall(head.encode() + b"t,q\n0,1\n")
        connection.shutdown(socket.SHUT_WR)
        while connection.recv(1000):  # until the server has noticed
            pass
    deadline = time.monotonic() + 60.0
    assert server.own("GET", "/robot")[0] == 200  # begun after the upload
    while list((server.folder / "logs").glob("*cut*")) and time.monotonic() < deadline:
        assert server.own("GET", "/robot")[0] == 200
    assert not list((server.folder / "logs").glob("*cut*"))


def test_headers_forbid_other_scripts_and_frames(server: Server) -> None:
    import http.client

    connection = http.client.HTTPConnection("127.0.0.1", server.port)
    connection.request("GET", "/robot", headers={"Cookie": server.cookie})
    answer = connection.getresponse()
    policy = answer.getheader("content-security-policy") or ""
    assert "script-src 'self'" in policy and "unsafe-eval" not in policy
    assert "frame-ancestors 'self'" in policy
    assert answer.getheader("x-content-type-options") == "nosniff"
    connection.close()
