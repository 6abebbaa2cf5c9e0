"""Work with an identified model in a process: payload, contact, wrench, health, and exports."""

import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, cast

from steelyard.base.files import whole_folder, write_json
from steelyard.base.progress import Progress
from steelyard.export.code.export_code import CodeFormat, export_code
from steelyard.export.model_files.export_model_file import export as export_file
from steelyard.report.result import TEXT_WIDTH, Result
from steelyard.report.terminal import terminal
from steelyard.uses.contact.contact import contact
from steelyard.uses.health.health import health
from steelyard.uses.payload import payload as payloads
from steelyard.uses.wrench.wrench import external_wrench

Given = Mapping[str, Any]  # `model`, `logs`, `free` (logs without load or contact) and `frame`


def use(what: str, folder: str, progress: Progress, **given: Any) -> dict[str, Any]:
    """What `steelyard payload`, `contact`, `wrench` or `health` writes and prints."""
    with whole_folder(Path(folder)) as part:
        text = USES[what](given, part, progress)
    return {"folder": folder, "text": text, "page": (Path(folder) / "report.html").exists()}


def _payload(given: Given, folder: Path, progress: Progress) -> str:
    found = payloads.identify_payload(
        given["model"], given["logs"], given["frame"], unloaded=given["free"], progress=progress
    )
    write_json(folder / "payload.json", found.to_dict())
    text = io.StringIO()
    payloads.payload_lines(found, terminal(file=text, width=TEXT_WIDTH))
    return text.getvalue()


def _events(given: Given, folder: Path, progress: Progress) -> str:
    model, logs, frame = given["model"], given["logs"], given["frame"]
    return _written(payloads.events_of_logs(model, logs, frame, None, progress), folder)


def _contact(given: Given, folder: Path, progress: Progress) -> str:
    (log,) = given["logs"]
    found = contact(given["model"], log, calibrate=given["free"], progress=progress)
    return _written(found, folder)


def _wrench(given: Given, folder: Path, progress: Progress) -> str:
    (log,) = given["logs"]
    found = external_wrench(given["model"], log, given["frame"], progress=progress)
    return _written(found, folder)


def _health(given: Given, folder: Path, progress: Progress) -> str:
    return _written(health(given["model"], given["logs"], progress=progress), folder)


USES: Mapping[str, Callable[[Given, Path, Progress], str]] = {
    "payload": _payload,
    "payload-events": _events,
    "contact": _contact,
    "wrench": _wrench,
    "health": _health,
}


def _written(found: Result, folder: Path) -> str:
    found.write(folder)
    return str(found)


def export(
    model: str, to: str, path: str, original: str | None, progress: Progress
) -> dict[str, Any]:
    """What `steelyard export MODEL --to FORMAT -o PATH` writes; what the format lacks."""
    Path(path).parent.mkdir(exist_ok=True)
    if to in ("urdf", "mjcf"):
        lost: Sequence[str] = export_file(model, path, original)
        return {"path": path, "lacks": list(lost), "functions": []}
    functions = export_code(model, path, cast("CodeFormat", to))
    return {"path": path, "lacks": [], "functions": list(functions)}
