"""Builds the copy of plotly.js in the package from another version: `make plotly VERSION=4.1.1`.

npm installs `plotly.js` and esbuild, and compares them with the hashes that its registry states;
esbuild bundles the parts that `plotly_entry.js` names. The bundle, compressed, the licence, and
`source.json` with versions, npm's hash of the package and SHA-256 are written. Needs npm.
"""

import gzip
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ENTRY = Path(__file__).with_name("plotly_entry.js")
FOLDER = Path(__file__).parents[1] / "src" / "steelyard" / "report" / "plotly"
ESBUILD = "0.25.0"
OPTIONS = (
    "--bundle",
    "--minify",
    "--format=iife",
    "--global-name=Plotly",
    "--define:global=window",
    "--define:define.amd=false",
    "--target=es2020",
    "--log-level=warning",
)


def main(version: str) -> None:
    """Install, bundle, and write the files of one version."""
    npm = shutil.which("npm")
    if npm is None:
        sys.exit("npm is missing: install Node.js")
    with tempfile.TemporaryDirectory() as name:
        there = Path(name)
        (there / "package.json").write_text("{}", encoding="utf-8")
        packages = (f"plotly.js@{version}", f"esbuild@{ESBUILD}")
        quiet = ("--ignore-scripts", "--no-audit", "--no-fund", "--save-exact")
        subprocess.run([npm, "install", *quiet, *packages], cwd=there, check=True)
        lock = json.loads((there / "package-lock.json").read_text(encoding="utf-8"))
        integrity = lock["packages"]["node_modules/plotly.js"]["integrity"]
        write(version, integrity, bundle(there), there / "node_modules" / "plotly.js" / "LICENSE")


def bundle(there: Path) -> bytes:
    """The script that defines `Plotly`."""
    shutil.copy(ENTRY, there)
    program = there / "node_modules" / ".bin" / "esbuild"
    out = there / "plotly.min.js"
    subprocess.run([program, ENTRY.name, *OPTIONS, f"--outfile={out}"], cwd=there, check=True)
    return out.read_bytes()


def write(version: str, integrity: str, script: bytes, licence: Path) -> None:
    """The files of the package."""
    (FOLDER / "plotly.min.js.gz").write_bytes(gzip.compress(script, 9, mtime=0))
    shutil.copyfile(licence, FOLDER / "LICENSE")
    texts = {"plotly.min.js": script, "LICENSE": licence.read_bytes()}
    source = {
        "version": version,
        "package": f"plotly.js@{version}",
        "integrity": integrity,
        "esbuild": ESBUILD,
        "sha256": {name: hashlib.sha256(text).hexdigest() for name, text in texts.items()},
    }
    (FOLDER / "source.json").write_text(json.dumps(source, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
