"""A folder as a workspace: files by kind, the robot file with all its versions, choices.

All files are those of the commands. Beside them there are `history/`, versions of the robot file;
`app.json`, choices that no robot file has, such as which logs validate; and `.derived/`, what was
computed from the other files and is computed again where it is missing.
"""

import difflib
import hashlib
import json
import os
import re
import shutil
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from steelyard.base.errors import DataError, ModelError, OutputError, SteelyardError
from steelyard.base.files import read_json, whole_file, write_json
from steelyard.robot.file.toml_edits import Edit, edited

ROBOT_FILE = "robot.toml"
MODEL_FILES, LOGS, MODELS, REPORTS = "robot", "logs", "models", "reports"
MOTIONS, USED_LOGS, EXPORTS = "motions", "used-logs", "exports"
REMOVED = "removed"  # folder of files that were put aside
HISTORY, DERIVED, CHOICES = "history", ".derived", "app.json"
DRAFT = "proposed.toml"  # in the history: the robot file as it was proposed last
KINDS = {
    MODEL_FILES: (".urdf", ".xacro", ".xml", ".mjcf", ".stl", ".obj", ".dae", ".yaml", ".yml"),
    LOGS: (".csv", ".tsv", ".txt", ".parquet", ".mcap", ".bag", ".db3", ".npz", ".npy", ".mat")
    + (".h5", ".hdf5", ".jsonl"),
}
KINDS[USED_LOGS] = KINDS[LOGS]
"""Folders that files are dropped into, and the suffixes that they take."""

ROBOT_MODELS = (".urdf", ".xacro", ".xml", ".mjcf")
MOST_RESULTS = 300  # of works that are kept
MOST_VERSIONS = 1000  # of the robot file that are kept
LONGEST_NAME, DEEPEST_NAME = 120, 8  # characters of a name, folders in a path


@dataclass(frozen=True)
class Workspace:
    """A folder, resolved; all names are relative to it, with `/`."""

    folder: Path

    def path(self, name: str) -> Path:
        """The path of a name.

        Raises:
            OutputError: It is outside the folder, also by a link.
        """
        try:
            found = (self.folder / name).resolve()
        except (OSError, ValueError, RuntimeError):
            found = self.folder.parent
        parts = name.split("/")
        if not found.is_relative_to(self.folder) or ".." in parts or "\\" in name or not parts[0]:
            raise OutputError(
                "the path leads out of the workspace",
                where=name,
                fix="name a file inside the folder that the app was started with",
            )
        return found

    def new_file(self, kind: str, name: str) -> Path:
        """Where a file that was dropped is stored, by the name that its sender gave.

        Raises:
            SteelyardError: It is not a kind of file that belongs there.
        """
        parts = [part for part in name.replace("\\", "/").split("/") if part not in ("", ".")]
        if ".." in parts or not 0 < len(parts) <= DEEPEST_NAME or "\0" in name:
            raise DataError("a file cannot be called so", where=name, fix="rename it")
        safe = [re.sub(r"[^\w.+-]", "_", part)[-LONGEST_NAME:].lstrip(".-") for part in parts]
        if not all(safe) or Path(safe[-1]).suffix.lower() not in KINDS[kind]:
            raise DataError(
                f"'{parts[-1]}' is no file for this step",
                where=name,
                fix=f"files that are read here end in {', '.join(KINDS[kind])}",
            )
        return self.path("/".join([kind, *safe]))

    def remove(self, name: str) -> None:
        """Put a file aside, into `removed/`; of a link the link, not what it leads to."""
        self.path(name)
        place = self.folder / REMOVED
        place.mkdir(exist_ok=True)
        number, last = 1, name.rsplit("/", 1)[-1]
        while (place / f"{number}-{last}").exists():
            number += 1
        (self.folder / name).rename(place / f"{number}-{last}")

    def files(self, kind: str, suffixes: Iterable[str]) -> tuple[str, ...]:
        """Names of the files of a folder, those below it included, in order."""
        found = list[str]()
        for folder, folders, names in os.walk(self.folder / kind if self._inside(kind) else ""):
            folders[:] = [name for name in folders if not name.startswith(".")]
            here = Path(folder).relative_to(self.folder).as_posix()
            for name in names:
                if not name.startswith(".") and Path(name).suffix.lower() in suffixes:
                    found.append(f"{here}/{name}")
        return tuple(
            name
            for name in sorted(found)
            if self._inside(name) and os.path.isfile(self.folder / name)
        )

    def _inside(self, name: str) -> bool:
        """Whether something is there and in the folder; what is walked to is, but for links."""
        if "\\" not in name and not os.path.islink(self.folder / name):
            return True
        try:
            return self.path(name).exists()
        except OutputError:
            return False

    @property
    def robot_models(self) -> tuple[str, ...]:
        """URDF, xacro and MJCF files."""
        found = self.files(MODEL_FILES, ROBOT_MODELS)
        return tuple(name for name in found if not name.endswith("/package.xml"))  # of ROS

    @property
    def model_files(self) -> tuple[str, ...]:
        """Files that make the robot: models, meshes, parameters of a xacro."""
        return self.files(MODEL_FILES, KINDS[MODEL_FILES])

    @property
    def logs(self) -> tuple[str, ...]:
        """The logs."""
        return self.files(LOGS, KINDS[LOGS])

    @property
    def models(self) -> tuple[str, ...]:
        """Folders of identified models, the latest first."""
        return self._folders_with(MODELS, "model.json")

    @property
    def motions(self) -> tuple[str, ...]:
        """Folders of designed motions, the latest first."""
        return self._folders_with(MOTIONS, "trajectory.json")

    @property
    def used_logs(self) -> tuple[str, ...]:
        """Logs that a model is used on, and those that it is identified from."""
        return (*self.files(USED_LOGS, KINDS[USED_LOGS]), *self.logs)

    def _folders_with(self, kind: str, name: str) -> tuple[str, ...]:
        found = [
            x.removesuffix(f"/{name}")
            for x in self.files(kind, (Path(name).suffix,))
            if x.endswith(f"/{name}")
        ]
        return tuple(sorted(found, key=lambda x: -self.path(x).stat().st_mtime_ns))

    def new_name(self, kind: str, name: str, ending: str = "") -> str:
        """A name that is not there yet in one of the folders: `name-1` and so on."""
        number = 1
        while self.path(f"{kind}/{name}-{number}{ending}").exists():
            number += 1
        return f"{kind}/{name}-{number}{ending}"

    @property
    def robot_file(self) -> Path:
        """`robot.toml`, or else the only robot file that the commands wrote there."""
        usual = self.folder / ROBOT_FILE
        others = [p for p in sorted(self.folder.glob("*.toml")) if _is_robot_file(p)]
        return others[0] if not usual.exists() and len(others) == 1 else usual

    @property
    def robot_text(self) -> str | None:
        """The robot file; `None` if there is none."""
        path = self.path(self.robot_file.name)
        try:
            return path.read_text(encoding="utf-8")
        except FileNotFoundError:
            return None
        except (OSError, UnicodeDecodeError) as error:
            raise ModelError(
                f"the robot file cannot be read: {error}", where=path.name, fix="replace it"
            ) from None

    @property
    def readable(self) -> bool:
        """Whether the robot file can be read, if there is one."""
        try:
            _ = self.robot_text
        except SteelyardError:
            return False
        return True

    @property
    def versions(self) -> tuple[Path, ...]:
        """Versions of the robot file, the last of which is the present one."""
        return tuple(sorted((self.folder / HISTORY).glob("[0-9]*.toml")))

    def write_robot(self, text: str) -> None:
        """Replace the robot file, which can be undone, as what others wrote before can be."""
        self._note_version(self.robot_text)
        with whole_file(self.robot_file) as part:
            part.write_text(text, encoding="utf-8")
        self._note_version(text)

    def draft_robot(self, text: str) -> None:
        """Replace the robot file by a proposal, which others may replace until it is edited."""
        (self.folder / HISTORY).mkdir(exist_ok=True)
        with whole_file(self.folder / HISTORY / DRAFT) as part:
            part.write_text(text, encoding="utf-8")
        self.write_robot(text)

    @property
    def untouched(self) -> bool:
        """Whether there is no robot file, or one as it was proposed last."""
        text, draft = self.robot_text, self.folder / HISTORY / DRAFT
        return text is None or (draft.is_file() and draft.read_text(encoding="utf-8") == text)

    def edit_robot(self, changes: Iterable[Edit]) -> None:
        """Change keys of the robot file."""
        text = self.robot_text
        if text is None:
            raise ModelError(
                "there is no robot file yet", where=ROBOT_FILE, fix="give a robot first"
            )
        self.write_robot(edited(text, list(changes)))

    def undo(self) -> None:
        """Take the last change of the robot file back; what was undone stays in the history.

        A file that cannot be read is replaced by the last version that could.
        """
        try:
            self._note_version(self.robot_text)
        except ModelError:
            self._restore(self.versions)
            return
        *before, last = self.versions
        self._restore(before)
        last.replace(last.with_suffix(".undone"))

    def _restore(self, versions: Sequence[Path]) -> None:
        """Make the last of some versions the robot file; an empty one is none."""
        if not versions:
            raise OutputError(
                "nothing was changed", where=ROBOT_FILE, fix="there is nothing to undo"
            )
        if text := versions[-1].read_text(encoding="utf-8"):
            with whole_file(self.robot_file) as part:
                part.write_text(text, encoding="utf-8")
        else:
            self.robot_file.unlink(missing_ok=True)

    def _note_version(self, given: str | None) -> None:
        """Keep a version of the robot file; where there is none, an empty one."""
        known, text = self.versions, given or ""
        if known and known[-1].read_text(encoding="utf-8") == text:
            return
        number = int(known[-1].stem) + 1 if known else 1
        (self.folder / HISTORY).mkdir(exist_ok=True)
        with whole_file(self.folder / HISTORY / f"{number:06d}.toml") as part:
            part.write_text(text, encoding="utf-8")
        for old in known[: max(len(known) + 1 - MOST_VERSIONS, 0)]:
            old.unlink(missing_ok=True)

    @property
    def last_change(self) -> tuple[str, ...]:
        """Lines of the robot file that undo would take back, with - and + before them."""
        text, known = self.robot_text, [p.read_text(encoding="utf-8") for p in self.versions[-2:]]
        if known and known[-1] != (text or ""):
            known = [known[-1], text or ""]
        if len(known) < 2:
            return ()
        old, new = (one.splitlines() for one in known)
        lines = difflib.unified_diff(old, new, lineterm="", n=0)
        return tuple(line for line in lines if not line.startswith(("---", "+++", "@@")))

    @property
    def choices(self) -> Mapping[str, Any]:
        """What was chosen beside the robot file; a file that was changed by hand counts as none."""
        path = self.folder / CHOICES
        try:
            found = read_json(path, dict, what="the choices", damaged="damaged", fix="remove it")
        except SteelyardError:
            return {}
        chosen = found.get("choices")
        if not isinstance(chosen, dict) or found.get("mark") != _mark_of(chosen):
            return {}
        return chosen

    def choose(self, **changes: Any) -> None:
        """Change choices; `None` takes one out."""
        chosen = {k: v for k, v in {**self.choices, **changes}.items() if v is not None}
        write_json(self.folder / CHOICES, {"mark": _mark_of(chosen), "choices": chosen})

    def mark(self, names: Iterable[str]) -> str:
        """Changes if one of these files does: a hash of sizes and times of all of them."""
        seen = []
        for name in names:
            try:
                state = self.path(name).stat()
                seen.append((name, state.st_size, state.st_mtime_ns))
            except (OSError, OutputError):  # a link that leads out is as one that leads nowhere
                seen.append((name, -1, 0))
        return hashlib.sha256(json.dumps(seen).encode()).hexdigest()[:24]

    def derived(self, key: str) -> Path:
        """Where the result of a work is kept, by its key of hexadecimal digits."""
        if not re.fullmatch(r"[0-9a-f]{24}", key):
            raise OutputError("there is no such result", where=key, fix="load the page again")
        with suppress(OSError):  # it may be removed at any time
            (self.folder / DERIVED).mkdir(exist_ok=True)
        return self.folder / DERIVED / f"{key}.json"

    def fingerprint(self) -> str:
        """Changes if a file that pages show does."""
        names = [ROBOT_FILE, CHOICES, *(p.name for p in self.folder.glob("*.toml"))]
        shown = (MODEL_FILES, LOGS, MODELS, REPORTS, MOTIONS, USED_LOGS, EXPORTS)
        for kind in (*shown, HISTORY, DERIVED):
            for folder, folders, found in os.walk(self.folder / kind):
                folders[:] = folders if kind != DERIVED else []
                here = Path(folder).relative_to(self.folder).as_posix()
                names += [f"{here}/{name}" for name in found if not name.endswith(".part")]
        return self.mark(sorted(names))


def _tidy(folder: Path) -> None:
    """Remove parts of files that a killed app left, and results that were long not needed."""
    for name in (".", MODEL_FILES, LOGS, USED_LOGS, REPORTS, EXPORTS, HISTORY):
        for part in (folder / name).glob(".*.part"):
            if part.is_file():
                part.unlink()
    *old, _ = [*sorted((folder / DERIVED).glob("*.json"), key=_written)[:-MOST_RESULTS], None]
    for left in (p for p in (folder / DERIVED).iterdir() if p.suffix != ".json" or p in old):
        if left.is_dir():
            shutil.rmtree(left)
        else:
            left.unlink()


def _is_robot_file(path: Path) -> bool:
    """Whether a TOML file has tables of a robot."""
    try:
        return re.search(r"^\s*\[robot[.\]]", path.read_text("utf-8"), re.M) is not None
    except (OSError, UnicodeDecodeError):
        return False


def _written(path: Path) -> int:
    return path.stat().st_mtime_ns


def _mark_of(chosen: Mapping[str, Any]) -> str:
    """Of choices as the app writes them: others were changed by hand, to whatever types."""
    return hashlib.sha256(json.dumps(chosen, sort_keys=True).encode()).hexdigest()[:16]


def opened(folder: Path) -> Workspace:
    """The workspace of a folder, which is made if it is missing; what a killed work left goes."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        workspace = Workspace(folder.resolve(strict=True))
        (workspace.folder / DERIVED).mkdir(exist_ok=True)
        for name in (MODEL_FILES, LOGS, MODELS, REPORTS):
            workspace.path(name).mkdir(exist_ok=True)
        _tidy(workspace.folder)
    except OSError as error:
        raise OutputError(
            f"the folder cannot be used: {error.strerror}",
            where=str(folder),
            fix="name a folder that can be written",
        ) from error
    return workspace
