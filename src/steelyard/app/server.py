"""The server of the app, on this machine alone."""

import hashlib
import socket
import webbrowser
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from http.client import HTTPConnection, HTTPException
from pathlib import Path

from steelyard.app.guard import PLACE, Guard
from steelyard.app.jobs import Jobs
from steelyard.app.step import Desk
from steelyard.app.workspace import DERIVED, opened
from steelyard.base.errors import OutputError, require

HOST = "127.0.0.1"
PORT = "port"  # file in the folder of results: of the app that was started last
ANSWER_S = 2.0  # that another app may take to answer [s]


def serve(
    folder: Path,
    port: int,
    browser: bool,
    say: Callable[[str], None],
    stop: Callable[[], bool],
) -> None:
    """Serve a workspace on this machine until it shall stop; `say` prints its address.

    Args:
        folder: The workspace; it is made if it is missing.
        port: Of the address; a free one if 0.
        browser: Whether the browser is opened.
        say: Called with the address.
        stop: Asked several times a second whether it shall stop, as after Ctrl-C.
    """
    where = "steelyard app"
    for package in ("starlette", "uvicorn"):
        require(package, "app", "the app's pages", where)
    import uvicorn

    from steelyard.app.answers import Answers

    class Server(uvicorn.Server):
        """Leaves signals to the program: one that comes before it runs is not lost."""

        def capture_signals(self) -> AbstractContextManager[None]:  # type: ignore[override]
            return nullcontext()

        def end(self) -> None:
            self.should_exit = True

    _refuse_second(folder, where)
    workspace = opened(folder)
    answers = Answers(Desk(workspace, Jobs(workspace)))
    listening = _listening(port)
    port = listening.getsockname()[1]
    (workspace.folder / DERIVED / PORT).write_text(str(port), encoding="utf-8")
    guard = Guard(answers.application(stop, lambda: server.end()), port, _place(folder))
    address = f"http://{HOST}:{port}/?token={guard.token}"
    say(address)
    settings = uvicorn.Config(
        guard, log_level="error", access_log=False, server_header=False, ws="none",
        timeout_graceful_shutdown=1,
    )  # fmt: skip
    server = Server(settings)
    if browser:
        webbrowser.open(address)
    server.run(sockets=[listening])


def _refuse_second(folder: Path, where: str) -> None:
    """An app that runs on the folder already would lose what it is at by another one's start.

    Raises:
        OutputError: There is one, as it answers at the port that it noted.
    """
    try:
        port = int((folder / DERIVED / PORT).read_text(encoding="utf-8"))
        connection = HTTPConnection(HOST, port, timeout=ANSWER_S)
        connection.request("GET", "/")
        there = connection.getresponse().getheader(PLACE.decode())
        connection.close()
    except (OSError, ValueError, HTTPException):
        return
    if there == _place(folder):
        raise OutputError(
            f"the folder is open in another app, at http://{HOST}:{port}",
            where=where,
            fix="use its page, end it (Ctrl-C), or name another folder",
        )


def _place(folder: Path) -> str:
    """Which folder it is, as a hash."""
    return hashlib.sha256(str(folder.resolve()).encode()).hexdigest()[:24]


def _listening(port: int) -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind((HOST, port))
    except OSError as error:
        found.close()
        raise OutputError(
            f"port {port} cannot be used: {error.strerror}",
            where="--port",
            fix="name another one, or leave it out for one that is free",
        ) from error
    found.listen()
    return found
