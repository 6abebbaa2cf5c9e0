"""What the workspace offers for download: a file as it is, a folder as a zip."""

import os
from io import BytesIO
from pathlib import Path
from zipfile import ZIP_DEFLATED, ZipFile

from steelyard.app.workspace import EXPORTS, MODELS, MOTIONS, REPORTS, Workspace
from steelyard.base.errors import OutputError

OFFERED = (MODELS, MOTIONS, REPORTS, EXPORTS)  # folders that files are offered from
PLAIN_BYTES = "application/octet-stream"
LARGEST_FOLDER = 1 << 28  # bytes of the files of a folder


def download(workspace: Workspace, name: str) -> tuple[Path, bytes | None]:
    """The path of a file; of a folder with its content as a zip.

    Raises:
        OutputError: Nothing of this name is offered, or the folder is too large.
    """
    path, parts = workspace.path(name), name.split("/")
    if parts[0] not in OFFERED or len(parts) < 2 or not path.exists() or "" in parts:
        raise OutputError("there is no such file", where=name, fix="choose one on a page")
    return path, (_zipped(workspace, path) if path.is_dir() else None)


def _zipped(workspace: Workspace, folder: Path) -> bytes:
    """Its files, without links that lead out of the workspace."""
    found, size = BytesIO(), 0
    with ZipFile(found, "w", ZIP_DEFLATED) as packed:
        for place, folders, names in os.walk(folder):
            folders.sort()
            for file in (Path(place) / name for name in sorted(names)):
                if not file.is_file() or not file.resolve().is_relative_to(workspace.folder):
                    continue
                size += file.stat().st_size
                if size > LARGEST_FOLDER:
                    raise OutputError(
                        f"the folder holds more than {LARGEST_FOLDER >> 20} MiB",
                        where=folder.name,
                        fix="copy it from the folder of the workspace",
                    )
                packed.write(file, file.relative_to(folder.parent))
    return found.getvalue()
