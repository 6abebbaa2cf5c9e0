"""Work that is remembered: small entries in a folder, found by what they were made from.

The name of an entry is the hash of all that its content depends on, and its content begins with its
own hash: an entry that was changed, cut or half written counts as missing, and is made again.
"""

import json
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any

from steelyard.base.files import cache_folder
from steelyard.logs.files_and_urls import Folder, StoredFile, digest

HASH_BYTES = 32


def key_of(made_from: Mapping[str, Any]) -> str:
    """The name of an entry by what its content depends on, as JSON values."""
    return sha256(json.dumps(made_from, sort_keys=True, allow_nan=False).encode()).hexdigest()


@dataclass(eq=False)
class RememberedWork:
    """Entries of a folder; `damaged` counts those whose content was not what its hash says."""

    folder: Folder
    damaged: int = field(default=0)

    def read(self, key: str) -> bytes | None:
        """The content of an entry; `None` if there is none, or a damaged one."""
        entry = self.folder.read(f"{key}.entry")
        if entry is None:
            return None
        content = entry[HASH_BYTES:]
        if sha256(key.encode() + content).digest() != entry[:HASH_BYTES]:
            self.damaged += 1
            return None
        return content

    def write(self, key: str, content: bytes) -> None:
        """Remember a content."""
        own = sha256(key.encode() + content).digest()
        self.folder.write(f"{key}.entry", own + content)

    def digest(self, file: StoredFile) -> str:
        """SHA-256 of a log's bytes, read only where its size or stamp is not known yet."""
        if not file.stamp:
            return digest(file)
        key = key_of({"url": file.url, "size": file.size, "stamp": file.stamp})
        known = self.read(key)
        if known is not None:
            return known.decode()
        found = digest(file)
        self.write(key, found.encode())
        return found


@contextmanager
def remembered_work(store: str | Path | None) -> Iterator[RememberedWork]:
    """Entries at a place, or in the cache; for this once only where the cache is switched off."""
    place = store if store is not None else cache_folder("fleet")
    if place is not None:
        yield RememberedWork(Folder(place))
        return
    with tempfile.TemporaryDirectory() as folder:
        yield RememberedWork(Folder(folder))
