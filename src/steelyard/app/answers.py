"""What the server answers: pages of the steps, their forms, files that are dropped, events."""

import asyncio
import json
import shutil
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote
from uuid import uuid4

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, RedirectResponse, Response, StreamingResponse
from starlette.routing import Route

from steelyard.app import steps
from steelyard.app.downloads import PLAIN_BYTES, download
from steelyard.app.step import TEMPLATES, THREE, Desk, Step, fill
from steelyard.app.workspace import KINDS, MODEL_FILES
from steelyard.base.errors import DataError, ModelError, OutputError, SteelyardError
from steelyard.report.page import PLOTLY
from steelyard.report.page import TEMPLATES as REPORT_TEMPLATES

LOOK_S = 0.25  # time between two looks at the files [s]
LARGEST_FILE = 1 << 31  # bytes of a file that is dropped
LARGEST_FORM = 1 << 18  # bytes of a form
SPARE_BYTES = 1 << 29  # of the disk that stay free
SANDBOX = "sandbox allow-scripts allow-popups"
"""What a report may do in the page: its scripts run, but as of no origin, without the session."""

STATIC: dict[str, tuple[Path, str]] = {
    "app.css": (TEMPLATES / "app.css", "text/css"),
    "app.js": (TEMPLATES / "app.js", "text/javascript"),
    "scene.js": (TEMPLATES / "scene.js", "text/javascript"),
    "three.js": (THREE, "text/javascript"),
    "style.css": (REPORT_TEMPLATES / "style.css", "text/css"),
    "page.js": (REPORT_TEMPLATES / "page.js", "text/javascript"),
    "plotly.js": (PLOTLY, "text/javascript"),
}
"""Files that pages load, by their names in addresses."""


STAMP = str(max(path.stat().st_mtime_ns for path, _ in STATIC.values()))
"""Part of their addresses, so that browsers keep them, but not those of another version."""


@dataclass(eq=False)
class Answers:
    """Answers by address, on a workspace; `version` grows with every change of its files."""

    desk: Desk
    version: int = 0
    ended: bool = False
    listeners: set[asyncio.Queue[str]] = field(default_factory=set)

    @property
    def said(self) -> str:
        """The state as an event for pages."""
        jobs = [job.progress for job in self.desk.jobs.running.values()]
        return json.dumps({"version": self.version, "jobs": jobs})

    def _seen(self) -> str:
        try:
            return self.desk.workspace.fingerprint()
        except OSError:  # a folder that goes while it is looked at
            return ""

    async def watch(self, stop: Callable[[], bool]) -> None:
        """Look at the files and jobs until it shall stop, and tell all pages what changes.

        Pages that listen are told nothing more at its end, which ends their answers.
        """
        seen, said = "", ""
        while not stop():
            now = await asyncio.to_thread(self._seen)
            now += ",".join(self.desk.jobs.running)
            self.version += now != seen
            seen = now
            if self.said != said:
                said = self.said
                for listener in self.listeners:
                    listener.put_nowait(said)
            await asyncio.sleep(LOOK_S)
        self.ended = True
        for listener in self.listeners:
            listener.put_nowait("")

    def application(self, stop: Callable[[], bool], end: Callable[[], None]) -> Starlette:
        """The application, without its guard.

        Args:
            stop: Asked several times a second whether it shall end.
            end: Called once it shall.
        """

        @asynccontextmanager
        async def living(_: Starlette) -> AsyncIterator[None]:
            async def watch() -> None:
                await self.watch(stop)
                end()

            task = asyncio.create_task(watch())
            yield
            task.cancel()
            self.desk.jobs.end()

        return Starlette(
            routes=[
                Route("/", self._start),
                Route("/events", self._events),
                Route("/undo", self._undo, methods=["POST"]),
                Route("/stop/{key}", self._stop, methods=["POST"]),
                Route("/static/{name}", self._static),
                Route("/derived/{key}", self._derived),
                Route("/report/{name:path}", self._report),
                Route("/download/{name:path}", self._offered),
                Route("/upload/{kind}/{name:path}", self._upload, methods=["PUT"]),
                Route("/{step}", self._page),
                Route("/{step}/{action}", self._act, methods=["POST"]),
            ],
            exception_handlers={
                SteelyardError: self._refused,
                json.JSONDecodeError: self._malformed,
                UnicodeDecodeError: self._malformed,
                UnicodeEncodeError: self._failed,
                OSError: self._failed,
                RecursionError: self._malformed,
            },
            lifespan=living,
        )

    async def _start(self, request: Request) -> Response:
        return RedirectResponse(f"/{steps.current(self.desk).name}", 303)

    async def _page(self, request: Request) -> Response:
        return Response(
            self._shown(steps.named(request.path_params["step"])), media_type="text/html"
        )

    async def _act(self, request: Request) -> Response:
        form = json.loads(await _body(request))
        step = steps.named(request.path_params["step"])
        action = step.actions.get(request.path_params["action"])
        if action is None or not isinstance(form, dict):
            raise OutputError(
                "there is no such action", where=request.url.path, fix="load the page again"
            )
        action(self.desk, form)
        return Response(status_code=204)

    async def _undo(self, request: Request) -> Response:
        self.desk.workspace.undo()
        return Response(status_code=204)

    async def _stop(self, request: Request) -> Response:
        self.desk.jobs.stop(request.path_params["key"])
        return Response(status_code=204)

    async def _upload(self, request: Request) -> Response:
        kind = request.path_params["kind"]
        if kind not in KINDS:
            raise OutputError("there is no such folder", where=kind, fix="load the page again")
        path = self.desk.workspace.new_file(kind, request.path_params["name"])
        if kind != MODEL_FILES and path.exists():
            raise OutputError(
                "a file of this name is there already",
                where=path.name,
                fix="rename the new one, or remove the old one first",
            )
        try:
            await _store(request, path)
        except ClientDisconnect:
            return Response(status_code=400)
        return Response(status_code=204)

    async def _derived(self, request: Request) -> Response:
        path = self.desk.workspace.derived(request.path_params["key"])
        if not path.is_file():
            raise OutputError("there is no such result", where=path.stem, fix="load the page again")
        return FileResponse(path, media_type="application/json")

    async def _report(self, request: Request) -> Response:
        name = request.path_params["name"]
        path = self.desk.workspace.path(name)
        if (
            path.suffix != ".html"
            or not path.is_file()
            or not name.startswith(("models/", "reports/", "motions/"))
        ):
            raise OutputError("this is no report", where=name, fix="choose one on a page")
        headers = {"content-security-policy": SANDBOX}
        return FileResponse(path, media_type="text/html", headers=headers)

    async def _offered(self, request: Request) -> Response:
        path, content = await asyncio.to_thread(
            download, self.desk.workspace, request.path_params["name"]
        )
        if content is None:
            return FileResponse(path, media_type=PLAIN_BYTES, filename=path.name)
        headers = {"content-disposition": f"attachment; filename*=utf-8''{quote(path.name)}.zip"}
        return Response(content, media_type=PLAIN_BYTES, headers=headers)

    async def _static(self, request: Request) -> Response:
        found = STATIC.get(request.path_params["name"])
        if found is None:
            raise OutputError(
                "there is no such file", where=request.url.path, fix="load the page again"
            )
        path, kind = found
        headers = {"cache-control": "private, max-age=86400"}  # the address changes with the file
        headers |= {"content-encoding": "gzip"} if path.suffix == ".gz" else {}
        return Response(path.read_bytes(), media_type=kind, headers=headers)

    async def _events(self, request: Request) -> Response:
        queue: asyncio.Queue[str] = asyncio.Queue()

        async def told() -> AsyncIterator[str]:
            self.listeners.add(queue)
            try:
                yield f"data: {self.said}\n\n"
                while not self.ended and (said := await queue.get()):
                    yield f"data: {said}\n\n"
            finally:
                self.listeners.discard(queue)

        return StreamingResponse(told(), media_type="text/event-stream")

    async def _refused(self, request: Request, error: Exception) -> Response:
        assert isinstance(error, SteelyardError)
        said = {"wrong": error.wrong, "where": error.where, "fix": error.fix}
        return Response(json.dumps(said), 422, media_type="application/json")

    async def _failed(self, request: Request, error: Exception) -> Response:
        why = getattr(error, "strerror", None) or str(error)
        said = {
            "wrong": f"a file cannot be written or read: {why}",
            "where": request.url.path,
            "fix": "see that the folder can be written, and that names are plain and short",
        }
        return Response(json.dumps(said), 422, media_type="application/json")

    async def _malformed(self, request: Request, error: Exception) -> Response:
        said = {
            "wrong": "the page sent what is no form",
            "where": request.url.path,
            "fix": "load it again",
        }
        return Response(json.dumps(said), 400, media_type="application/json")

    def _shown(self, step: Step) -> str:
        """A step as a page; a workspace whose files cannot be read shows why."""
        desk, version = self.desk, self.version
        workspace = desk.workspace
        change: tuple[str, ...] = ()
        shown = [(one, "") for one in steps.STEPS]
        try:
            shown, change = [(one, one.locked(desk)) for one in steps.STEPS], workspace.last_change
            why = step.locked(desk)
            body = (
                fill("locked.html", {"why": why})
                if why
                else fill(f"step_{step.name}.html", step.numbers(desk))
            )
        except SteelyardError as error:
            body = fill("error.html", {"error": error})
        except RecursionError:
            deep = ModelError(
                "brackets are nested too deeply", where=workspace.robot_file.name, fix="correct it"
            )
            body = fill("error.html", {"error": deep})
        return fill(
            "app.html",
            {
                "step": step,
                "steps": shown,
                "body": body,
                "folder": str(workspace.folder),
                "change": change,
                "versions": bool(change) or not workspace.readable,
                "jobs": len(desk.jobs.running),
                "version": version,
                "static": STAMP,
            },
        )


async def _body(request: Request) -> bytes:
    found = bytearray()
    async for part in request.stream():
        found += part
        if len(found) > LARGEST_FORM:
            raise DataError("the form is too long", where=request.url.path, fix="shorten it")
    return bytes(found)


async def _store(request: Request, path: Path) -> None:
    """Write what is sent to a file that is there whole or not at all."""
    length = request.headers.get("content-length", "")
    size = int(length) if length.isdigit() else LARGEST_FILE
    free = shutil.disk_usage(path.anchor).free - SPARE_BYTES
    if size > min(LARGEST_FILE, free):
        raise DataError(
            f"the file is larger than {min(LARGEST_FILE, max(free, 0)) >> 20} MiB, "
            "or its size is not told",
            where=path.name,
            fix="copy it into the folder of the workspace",
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.parent / f".{path.name}.{uuid4().hex[:8]}.part"
    try:
        with part.open("wb") as file:
            got = 0
            async for piece in request.stream():
                got += len(piece)
                if got > size:
                    raise DataError(
                        "more was sent than announced", where=path.name, fix="send it again"
                    )
                await asyncio.to_thread(file.write, piece)  # a disk that is slow holds no page up
        if got < size and length:
            raise DataError("the file came in part only", where=path.name, fix="send it again")
        part.replace(path)
    finally:
        with suppress(OSError):
            part.unlink()
