"""Tries to get through to a running app: from elsewhere, without a session, out of its folder."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

from app.guided import Server

SERVER_FAILED = 500  # the least status that says so
SECRET = "the secret beside the workspace"
FORM = json.dumps({"log": "logs/a.csv"}).encode()

ADDRESSES = (
    ("GET", "/"),
    ("GET", "/robot"),
    ("GET", "/logs"),
    ("GET", "/events"),
    ("GET", "/static/app.js"),
    ("GET", "/static/plotly.js"),
    ("GET", "/derived/0123456789abcdef01234567"),
    ("GET", "/report/models/m/report.html"),
    ("POST", "/undo"),
    ("POST", "/logs/show"),
    ("POST", "/check/run"),
    ("POST", "/stop/0123456789abcdef01234567"),
    ("PUT", "/upload/logs/stolen.csv"),
    ("PUT", "/upload/robot/stolen.urdf"),
    ("GET", "/download/models/m/model.json"),
    ("POST", "/design/design"),
    ("POST", "/use/export"),
)

OUT = (
    "../secret.html",
    "models/../../secret.html",
    "models/../../../../../../etc/passwd",
    "%2e%2e/secret.html",
    "%2e%2e%2fsecret.html",
    "models/%2e%2e/%2e%2e/secret.html",
    "models/..%2f..%2fsecret.html",
    "models%2f..%2f..%2fsecret.html",
    "models/..%5c..%5csecret.html",
    "..%5csecret.html",
    "%2fetc%2fpasswd",
    "/etc/passwd",
    "//etc/passwd",
    "models/%00/../../secret.html",
    "models/linked.html",
    "models/folder/secret.html",
    "reports/linked.html",
    "file:///etc/passwd",
    "models/%252e%252e/%252e%252e/secret.html",
    "robot.toml",
    "app.json",
    "history/000001.toml",
    "logs/a.csv",
)

UPLOADS = (
    "../stolen.csv",
    "..%2fstolen.csv",
    "..%5cstolen.csv",
    "a/../../stolen.csv",
    "a%2f..%2f..%2fstolen.csv",
    "%2fstolen.csv/..%2f..",
    "stolen.html",
    "stolen.py",
    "stolen.toml",
    "stolen.csv%00.html",
    "stolen",
    ".csv",
    "%2e%2e",
    "x/" * 30 + "stolen.csv",
    "outside/stolen.csv",
)


@dataclass(frozen=True)
class Try:
    """A request that must not get through."""

    what: str
    method: str
    path: str
    headers: Mapping[str, str]
    body: bytes | None = field(default=None, repr=False)


def prepared(server: Server) -> None:
    """Put a secret beside the workspace, links to it inside, and a log."""
    folder = server.folder
    outside = folder.parent / "outside"
    outside.mkdir(exist_ok=True)
    for secret in (folder.parent / "secret.html", outside / "secret.html"):
        secret.write_text(SECRET)
    (folder / "logs" / "a.csv").write_text("t,q\n0,1\n")
    for link, target in (
        ("models/linked.html", folder.parent / "secret.html"),
        ("reports/linked.html", folder.parent / "secret.html"),
        ("models/folder", outside),
        ("logs/outside", outside),
    ):
        if not (folder / link).is_symlink():
            (folder / link).symlink_to(target)


def tries(server: Server) -> Iterator[Try]:
    """All of them."""
    own = {"Cookie": server.cookie, "Origin": server.origin}
    name, host = server.cookie.split("=")[0], f"127.0.0.1:{server.port}"
    token = server.address.split("token=")[1]

    def body(method: str) -> bytes | None:
        return None if method == "GET" else FORM

    sessions: dict[str, Mapping[str, str]] = {
        "without a session": {},
        "with another session": {"Cookie": f"{name}={'x' * 43}"},
        "with an empty session": {"Cookie": f"{name}="},
        "with the token as session": {"Cookie": f"{name}={token}"},
        "with a cookie that is none": {
            "Cookie": f'{name}="\\";{server.cookie[len(name) + 1 : -1]}'
        },
    }
    for (what, headers), (method, path) in product(sessions.items(), ADDRESSES):
        yield Try(what, method, path, {"Origin": server.origin, **headers}, body(method))
    for path in (f"/?token={token}", f"/robot?token={token}", "/?token=", "/?token=x&token=y"):
        yield Try("with a token that was used", "GET", path, {})
    hosts = ("evil.example", f"evil.example:{server.port}", "127.0.0.1", "127.0.0.1:1", "localhost",
             f"localhost.evil.example:{server.port}", f"[::1]:{server.port}",
             f"0.0.0.0:{server.port}",
             f"127.0.0.1.evil.example:{server.port}", "", f"{host}, evil.example")  # fmt: skip
    for host_given, (method, path) in product(hosts, (ADDRESSES[1], ADDRESSES[9])):
        yield Try(f"host '{host_given}'", method, path, {**own, "Host": host_given}, body(method))
    origins = ("http://evil.example", "null", f"https://{host}", "http://127.0.0.1:1", "",
               f"http://localhost:{server.port}", f"http://{host}.evil.example",
               f"{server.origin}/")  # fmt: skip
    for given, (method, path) in product(origins, (ADDRESSES[1], *ADDRESSES[8:10], ADDRESSES[12])):
        yield Try(f"origin '{given}'", method, path, {**own, "Origin": given}, body(method))
    for method, path in ADDRESSES[8:]:
        yield Try("no origin", method, path, {"Cookie": server.cookie}, FORM)
    for site, (method, path) in product(("cross-site", "same-site"), ADDRESSES[1:10:4]):
        yield Try(f"from {site}", method, path, {**own, "Sec-Fetch-Site": site}, body(method))
    for path in OUT:
        yield Try("out of the folder", "GET", f"/report/{path}", own)
        yield Try("out of the folder", "GET", f"/download/{path}", own)
    for path in (
        "../robot.toml",
        "%2e%2e%2frobot.toml",
        "x" * 24,
        "..",
        "0123456789ABCDEF01234567",
    ):
        yield Try("no result", "GET", f"/derived/{path}", own)
        yield Try("no static file", "GET", f"/static/{path}", own)
    for kind, path in product(("logs", "robot"), UPLOADS):
        yield Try("upload out of place", "PUT", f"/upload/{kind}/{path}", own, b"t,q\n0,1\n")
    for kind in ("history", "models", ".derived", "..", "%2e%2e", "reports"):
        yield Try("upload elsewhere", "PUT", f"/upload/{kind}/stolen.csv", own, b"x")
    upgrade = {"Connection": "Upgrade", "Upgrade": "websocket", "Sec-WebSocket-Version": "13",
               "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}  # fmt: skip
    for path, session in product(("/", "/robot", "/_nicegui_ws/socket.io"), ({}, own)):
        yield Try("WebSocket", "GET", path, {**upgrade, **session, "Origin": "http://evil.example"})
    bodies = (
        b"",
        b"{",
        b"[]",
        b"3",
        b'"x"',
        b"[" * 100_000,
        b'{"a":' * 100_000,
        b"\xff\xfe",
        b" " * 300_000,
    )
    for content in bodies:
        yield Try("no form", "POST", "/logs/show", own, content)
    for form in (
        {"log": "../a.csv"},
        {"log": ["logs/a.csv"]},
        {"log": None},
        {"log": "logs/outside/secret.html"},
    ):
        yield Try(
            "a name that is not offered", "POST", "/logs/remove", own, json.dumps(form).encode()
        )
    long = {**own, "Content-Length": str(1 << 40)}
    yield Try("an upload of 1 TiB", "PUT", "/upload/logs/long.csv", long, b"t,q\n")


def got_through(server: Server, one: Try) -> str:
    """How a try got through; empty if it did not."""
    before = _state(server.folder)
    status, answer = server.ask(one.method, one.path, one.body, one.headers)
    if SECRET.encode() in answer or b"root:" in answer:
        return "it read what is outside"
    if status < 400:
        return f"it was answered with {status}"
    if status >= SERVER_FAILED:
        return f"the server failed with {status}"
    if _state(server.folder) != before:
        return "it changed files"
    return ""


def _state(folder: Path) -> list[str]:
    """All files of the workspace and beside it, but results."""
    found = [p for p in folder.parent.rglob("*") if ".derived" not in p.parts]
    return sorted(f"{p} {p.stat().st_size}" for p in found if p.is_file())
