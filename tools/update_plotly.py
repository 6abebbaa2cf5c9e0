"""Replaces the copy of plotly.js in the package by another version: `make plotly VERSION=4.1.1`.

The package `plotly.js-dist-min` comes from the npm registry, which states the hash of its archive.
`plotly.min.js`, its licence, and `source.json` with version, address and SHA-256 are written.
"""

import base64
import hashlib
import io
import json
import sys
import tarfile
from pathlib import Path
from urllib.request import urlopen

REGISTRY = "https://registry.npmjs.org/plotly.js-dist-min"
FOLDER = Path(__file__).parents[1] / "src" / "steelyard" / "report" / "plotly"
FILES = ("plotly.min.js", "LICENSE")


def main(version: str) -> None:
    """Download one version, compare its hash, write its files."""
    with urlopen(f"{REGISTRY}/{version}") as answer:
        archive = json.load(answer)["dist"]
    with urlopen(archive["tarball"]) as answer:
        content = answer.read()
    if hash_of(content) != archive["integrity"]:
        sys.exit(f"{archive['tarball']} does not have the hash that the registry states")
    with tarfile.open(fileobj=io.BytesIO(content)) as members:
        texts = {name: members.extractfile(f"package/{name}").read() for name in FILES}
    for name, text in texts.items():
        (FOLDER / name).write_bytes(text)
    source = {
        "version": version,
        "address": archive["tarball"],
        "sha256": {name: hashlib.sha256(text).hexdigest() for name, text in texts.items()},
    }
    (FOLDER / "source.json").write_text(json.dumps(source, indent=2) + "\n", encoding="utf-8")


def hash_of(content: bytes) -> str:
    """The hash in the form of the registry."""
    return "sha512-" + base64.b64encode(hashlib.sha512(content).digest()).decode()


if __name__ == "__main__":
    main(*sys.argv[1:])
