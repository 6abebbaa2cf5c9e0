"""Long work in processes of its own: started, watched and stopped; results kept by their key."""

import asyncio
import hashlib
import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from steelyard.app.workspace import Workspace
from steelyard.base.errors import SteelyardError
from steelyard.base.files import write_json
from steelyard.base.progress import Event, module_command

_FILES = sorted(Path(__file__).parent.glob("*.py"))
PROGRAM = " ".join(str(path.stat().st_mtime_ns) for path in _FILES)
"""Of the code that makes results and of the pages that show them: others make their own."""

LONGEST_LINE = 1 << 20  # bytes of a line that a process says
AT_ONCE = 2  # processes of quick work at a time; of long work there is one


@dataclass(frozen=True)
class Work:
    """A function, called with named JSON values in a process, in the folder of the workspace.

    Attributes:
        function: Module and name, `steelyard.app.work_robot:scene`.
        given: Its arguments beside `progress`.
        files: Names of files that it reads; if one changes, it is another work.
        words: What it does, for people.
        long: Whether it waits for other long work.
    """

    function: str
    given: Mapping[str, Any]
    files: tuple[str, ...]
    words: str
    long: bool = False

    @property
    def name(self) -> str:
        """Of the function with these arguments, on whatever files."""
        return json.dumps([self.function, self.given], sort_keys=True)

    def key(self, workspace: Workspace) -> str:
        """Of the work of this version on these files as they are, 24 hexadecimal digits."""
        said = f"{PROGRAM} {self.name} {workspace.mark(self.files)}"
        return hashlib.sha256(said.encode()).hexdigest()[:24]


@dataclass(eq=False)
class Job:
    """A work that is waiting or running."""

    key: str
    work: Work
    event: Event | None = None
    since: float = field(default_factory=time.monotonic)  # when its phase began [s]
    stopping: bool = False
    process: asyncio.subprocess.Process | None = None

    @property
    def progress(self) -> dict[str, Any]:
        """As JSON values: the share that is done of the phase, and the time that it still needs."""
        event = self.event
        found: dict[str, Any] = {"key": self.key, "words": self.work.words, "long": self.work.long}
        if event is None or not event.total:
            return {**found, "phase": event.phase if event else "starting", "share": None}
        share = min(max(event.done / event.total, 0.0), 1.0)
        passed = time.monotonic() - self.since
        left = passed * (1.0 - share) / share if share > 0.0 and passed > 1.0 else None
        return {**found, "phase": event.phase, "note": event.note, "share": share, "left": left}


class Jobs:
    """The jobs of a workspace."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace = workspace
        self.running: dict[str, Job] = {}
        self.unwritten: dict[str, dict[str, str]] = {}  # errors that no file has, by key
        self.latest: dict[str, str] = {}  # key of the latest result by the name of its work
        self._turns = {False: asyncio.Semaphore(AT_ONCE), True: asyncio.Semaphore(1)}
        self._tasks: set[asyncio.Task[None]] = set()

    def start(self, work: Work) -> str:
        """Begin a work unless it is running; its key."""
        key = work.key(self.workspace)
        if key not in self.running:
            job = self.running[key] = Job(key, work)
            task = asyncio.get_running_loop().create_task(self._run(job))
            self._tasks.add(task)
            task.add_done_callback(self._tasks.discard)
        return key

    def stop(self, key: str) -> None:
        """Ask a job to stop: what was finished before stays, of itself nothing."""
        job = self.running.get(key)
        if job is None:
            return
        job.stopping = True
        if job.process is not None and job.process.stdin is not None:
            job.process.stdin.write(b"stop\n")

    def end(self) -> None:
        """End all processes."""
        for job in self.running.values():
            if job.process is not None and job.process.returncode is None:
                job.process.kill()

    async def _run(self, job: Job) -> None:
        try:
            async with self._turns[job.work.long]:
                if not job.stopping:
                    await self._work(job)
        finally:
            self.running.pop(job.key, None)

    async def _work(self, job: Job) -> None:
        pipe = asyncio.subprocess.PIPE
        job.process = process = await asyncio.create_subprocess_exec(
            *module_command("steelyard.app.work_process"),
            stdin=pipe,
            stdout=pipe,
            stderr=asyncio.subprocess.DEVNULL,
            cwd=self.workspace.folder,
            limit=LONGEST_LINE,
            start_new_session=True,  # Ctrl-C is for the server alone
            env={**os.environ, "PYTHONPATH": _absolute_path()},
        )
        assert process.stdin is not None and process.stdout is not None
        out = str(self.workspace.derived(job.key))
        said = {"function": job.work.function, "given": dict(job.work.given), "out": out}
        process.stdin.write(json.dumps(said).encode() + b"\n")
        async for line in process.stdout:
            phase, done, total, note = json.loads(line)
            if job.event is None or job.event.phase != phase:
                job.since = time.monotonic()
            job.event = Event(phase, done, total, note)
        await process.wait()
        died = {
            "wrong": "the work ended without a result, as if it was killed",
            "where": job.work.words,
            "fix": "see that there is memory for it; then change something, or try it again",
        }
        path = self.workspace.derived(job.key)
        if not job.stopping and not path.exists():
            try:
                write_json(path, {"error": died})
            except (OSError, SteelyardError) as error:  # such as a full disk
                died["wrong"] += f"; nor can it be written: {error}"
                self.unwritten[job.key] = died


def _absolute_path() -> str:
    """`PYTHONPATH` for a process in another folder."""
    given = os.environ.get("PYTHONPATH", "")
    return os.pathsep.join(os.path.abspath(one) for one in given.split(os.pathsep) if one)
