"""Builds the copy of a script for browsers in the package from another version.

`make plotly VERSION=4.1.1`, `make three VERSION=0.187.0`: npm installs the package and esbuild, and
compares them with the hashes that its registry states; esbuild bundles the parts that
`plotly_entry.js` or `three_entry.js` names. The bundle, compressed, the licence, and `source.json`
with versions, npm's hash of the package and SHA-256 are written. Needs npm.
"""

import gzip
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

TOOLS = Path(__file__).parent
PACKAGE = TOOLS.parent / "src" / "steelyard"
ESBUILD = "0.25.0"
OPTIONS = (
    "--bundle",
    "--minify",
    "--format=iife",
    "--define:global=window",
    "--define:define.amd=false",
    "--target=es2020",
    "--log-level=warning",
)


@dataclass(frozen=True)
class Script:
    """A script of the package: npm's name, its short name, and the name that pages call it by."""

    package: str
    name: str
    variable: str
    folder: Path

    @property
    def entry(self) -> Path:
        """What names the parts of it."""
        return TOOLS / f"{self.name}_entry.js"


SCRIPTS = {
    "plotly": Script("plotly.js", "plotly", "Plotly", PACKAGE / "report" / "plotly"),
    "three": Script("three", "three", "Three", PACKAGE / "app" / "three"),
}


def main(name: str, version: str) -> None:
    """Install, bundle, and write the files of one version."""
    npm, script = shutil.which("npm"), SCRIPTS[name]
    if npm is None:
        sys.exit("npm is missing: install Node.js")
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder)
        (there / "package.json").write_text("{}", encoding="utf-8")
        packages = (f"{script.package}@{version}", f"esbuild@{ESBUILD}")
        quiet = ("--ignore-scripts", "--no-audit", "--no-fund", "--save-exact")
        subprocess.run([npm, "install", *quiet, *packages], cwd=there, check=True)
        lock = json.loads((there / "package-lock.json").read_text(encoding="utf-8"))
        integrity = lock["packages"][f"node_modules/{script.package}"]["integrity"]
        licence = there / "node_modules" / script.package / "LICENSE"
        write(script, version, integrity, bundle(script, there), licence)


def bundle(script: Script, there: Path) -> bytes:
    """The script that defines its variable."""
    shutil.copy(script.entry, there)
    program = there / "node_modules" / ".bin" / "esbuild"
    out = there / "bundle.min.js"
    own = (f"--global-name={script.variable}", f"--outfile={out}")
    subprocess.run([program, script.entry.name, *OPTIONS, *own], cwd=there, check=True)
    return out.read_bytes()


def write(script: Script, version: str, integrity: str, text: bytes, licence: Path) -> None:
    """The files of the package."""
    script.folder.mkdir(exist_ok=True)
    file = f"{script.name}.min.js"
    (script.folder / f"{file}.gz").write_bytes(gzip.compress(text, 9, mtime=0))
    shutil.copyfile(licence, script.folder / "LICENSE")
    texts = {file: text, "LICENSE": licence.read_bytes()}
    source = {
        "version": version,
        "package": f"{script.package}@{version}",
        "integrity": integrity,
        "esbuild": ESBUILD,
        "sha256": {name: hashlib.sha256(content).hexdigest() for name, content in texts.items()},
    }
    (script.folder / "source.json").write_text(
        json.dumps(source, indent=2) + "\n", encoding="utf-8"
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
