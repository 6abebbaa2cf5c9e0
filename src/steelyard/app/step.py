"""A step of the app: what its page shows, what its forms do, and what both may use."""

import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from steelyard.app.jobs import Job, Jobs, Work
from steelyard.app.workspace import KINDS, Workspace
from steelyard.base.errors import DataError, SteelyardError
from steelyard.base.files import read_json
from steelyard.base.templates import templates_of
from steelyard.report import words
from steelyard.report.page import script_json

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
THREE = Path(__file__).parent / "three" / "three.min.js.gz"
"""The parts that the scene uses, compressed; `tools/update_browser_script.py` replaces it."""

Values = Mapping[str, Any]  # fields of a form, as JSON values
CLICKED = {
    "--loaded": "“carries a known mass”, step 2",
    "--payload-mass": "its mass, step 2",
    "--model": "“compared with”, step 3",
    "--no-check": "“go on all the same”, step 3",
}
"""Where on the pages an option of the commands is."""

OPEN = ""  # why a step is locked, where it is not


@dataclass(frozen=True)
class Outcome:
    """What is known of a work: its result, its error, or the job that is at it.

    All are `None` where it was never begun, or was stopped.
    """

    key: str
    result: Any = None
    error: Mapping[str, str] | None = None
    job: Job | None = None


@dataclass(frozen=True)
class Desk:
    """What a step works with: the files of the workspace, and work in processes."""

    workspace: Workspace
    jobs: Jobs

    def look(self, work: Work) -> Outcome:
        """What is known of a work on the files as they are now; it is not begun."""
        return self.at(work.key(self.workspace))

    def at(self, key: str) -> Outcome:
        """What is known of a work by its key, on the files as they were when it was begun."""
        path = self.workspace.derived(key)
        if not path.exists():
            return Outcome(key, error=self.jobs.unwritten.get(key), job=self.jobs.running.get(key))
        found = _read(path, path.stat().st_mtime_ns)
        return Outcome(key, found.get("result"), found.get("error"))

    def done(self, work: Work) -> Outcome:
        """The same, of a work that is begun if it is not known.

        Until it is done, and if it fails, the result is the latest of the same function with the
        same arguments, from files as they were, so that pages do not lose what they show.
        """
        found = self.look(work)
        if found.result is None and found.error is None and found.job is None:
            self.jobs.start(work)
            found = self.look(work)
        latest = self.jobs.latest
        if found.result is not None:
            latest[work.name] = found.key
        elif (key := latest.get(work.name)) and (before := self.known(key)) is not None:
            return replace(found, key=key, result=before)
        return found

    def known(self, key: str) -> Any:
        """The result of an earlier work by its key; `None` if there is none any more."""
        path = self.workspace.derived(key)
        return _read(path, path.stat().st_mtime_ns).get("result") if path.exists() else None

    def again(self, work: Work) -> None:
        """Begin a work anew, as after it was stopped."""
        key = work.key(self.workspace)
        self.workspace.derived(key).unlink(missing_ok=True)
        self.jobs.unwritten.pop(key, None)
        self.jobs.start(work)


@dataclass(frozen=True)
class Step:
    """One step; its template is `step_NAME.html`.

    Attributes:
        name: In addresses and file names.
        title: In the list of steps.
        numbers: What the template shows, from the workspace as it is.
        locked: Why the step cannot be begun yet; empty if it can.
        actions: What forms do, by their name; a `SteelyardError` is shown to the user.
        aside: Whether it is not on the way of every user: it is opened by choice alone.
    """

    name: str
    title: str
    numbers: Callable[[Desk], Values]
    locked: Callable[[Desk], str] = lambda desk: OPEN
    actions: Mapping[str, Callable[[Desk, Values], None]] = field(default_factory=dict)
    aside: bool = False


def text_of(form: Values, name: str, longest: int = 400) -> str:
    """A field of a form as text without spaces around it."""
    value = form.get(name)
    if not isinstance(value, str) or len(value) > longest:
        raise DataError("a field is missing, or too long", where=name, fix="fill it in again")
    return value.strip()


def one_of(form: Values, name: str, known: "tuple[str, ...] | list[str]") -> str:
    """A field that must be one of some texts."""
    value = text_of(form, name)
    if value not in known:
        raise DataError(f"'{value}' is not to choose from", where=name, fix="load the page again")
    return value


@lru_cache(maxsize=64)
def _read(path: Path, written: int) -> Mapping[str, Any]:
    try:
        return read_json(path, dict, what="the result", damaged="damaged", fix="remove it")
    except SteelyardError:
        return {}


def clicked(text: str) -> str:
    """Words with what to click in place of options of commands, but not inside `a command`."""
    return re.sub(rf"`[^`]*`|{'|'.join(CLICKED)}", lambda m: CLICKED.get(m[0], m[0]), text)


@cache
def _environment() -> "Environment":
    environment = templates_of(TEMPLATES, autoescape=True)
    environment.filters |= {"significant": words.significant, "json": script_json}
    environment.filters["figure"] = lambda text: script_json(json.loads(text))
    environment.filters["clicked"] = clicked
    environment.globals |= {"count": words.count, "file_kinds": KINDS}
    return environment


def fill(template: str, values: Values) -> str:
    """A template of this room filled with values, as safe HTML."""
    return Markup(_environment().get_template(template).render(values))
