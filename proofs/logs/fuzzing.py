"""Broken files of every format: a clear error or a clean table, never a crash, a hang, a flood.

Every file is read in a child process with a limit on its memory and on its time; that a case kills
it, outlives the limit or takes more memory than allowed is counted.
"""

import multiprocessing
import os
import random
import re
import resource
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from struct import pack
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import h5py
import numpy as np
import polars as pl
from proofs.support.claims import Claim, main_of

from steelyard.base.errors import SteelyardError
from steelyard.logs.formats import FORMATS, open_log

CASES = 260
"""Broken files per kind of file."""
SLOW = 25
"""The same where a process is started for each file."""
LONGEST = 30.0
"""Seconds that a case may take."""
ENOUGH = 400_000
"""Rows after which a table that goes on is believed."""
LEAST = 64.0
"""Memory that any case may take [MiB]."""
TIMES = 4.0
"""Decoded sizes of a part that it may take beyond."""


@dataclass(frozen=True)
class Outcome:
    """How a case ended.

    Attributes:
        kind: `error`, `table`, `crash`, `hang`, or what else was raised.
        memory: Peak above where it began [MiB].
        allowed: What the part that was read allows [MiB].
        seconds: How long it took.
    """

    kind: str
    memory: float = 0.0
    allowed: float = LEAST
    seconds: float = 0.0


def main(cases: int = CASES, slow: int = SLOW) -> list[Claim]:
    """All kinds of files."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["TMPDIR"] = name  # unpacked copies that a killed child leaves
        seeds = sound_files(folder)
        missing = set(FORMATS) - {path.suffix for path in seeds.values()}
        if missing:
            return [Claim("every format is fuzzed", f"without {sorted(missing)}", "all", False)]
        claims = []
        for label, path in seeds.items():
            own = path.suffix in (".h5", ".hdf5") or "7.3" in label
            count = slow if own else cases
            rng = random.Random(label)
            raw = path.read_bytes()
            broken: Iterable[bytes] = (mutated(raw, rng) for _ in range(count))
            claims.append(judged(label, list(outcomes(folder, path, broken))))
        bombs = list(bomb_files(folder / "bombs"))
        sound = {path.suffix: path for path in seeds.values()}
        found = [o for bomb in bombs for o in outcomes(folder, sound[bomb.suffix], [bomb])]
        return [*claims, judged(f"{len(bombs)} bombs and huge headers", found)]


def judged(label: str, found: list[Outcome]) -> Claim:
    """A claim on all cases of one kind."""
    counts = Counter(outcome.kind for outcome in found)
    over = [o for o in found if o.memory > o.allowed]
    bad = {kind: n for kind, n in counts.items() if kind not in ("error", "table")}
    most = max((o.memory for o in found), default=0.0)
    longest = max((o.seconds for o in found), default=0.0)
    figure = f"{counts['error']} errors, {counts['table']} tables, {most:.0f} MiB, {longest:.1f} s"
    figure += f"; {bad}" if bad else ""
    figure += f"; {len(over)} above what a part allows" if over else ""
    bound = "no crash, no hang, max(64 MiB, 4 parts)"
    return Claim(f"{len(found)} broken files: {label}", figure, bound, not bad and not over)


@dataclass(frozen=True)
class Limits:
    """What a child may take: seconds a file, and memory beyond what it begins with [MiB]."""

    seconds: float = LONGEST
    room: float = 4096.0


def outcomes(
    folder: Path,
    sound: Path,
    contents: Iterable[bytes | Path],
    read: Callable[[str], float] | None = None,
    limits: Limits = Limits(),
) -> Iterator[Outcome]:
    """How reading each file ends, in a child that has read a sound one before.

    `read` gives the decoded size of what it read [MiB]; without it logs are read.
    """
    context = multiprocessing.get_context("spawn")
    child: Any = None
    pipe: Any = None
    target = folder / f"broken{sound.suffix}"
    for content in contents:
        if child is None:
            pipe, other = context.Pipe()
            child = context.Process(
                target=work, args=(other, str(sound), read or _read, limits.room), daemon=True
            )
            child.start()
            other.close()
            pipe.recv()
        if isinstance(content, bytes):
            target.write_bytes(content)
        try:
            pipe.send(str(target if isinstance(content, bytes) else content))
            if pipe.poll(limits.seconds):
                outcome = pipe.recv()
                if outcome.kind not in ("error", "table"):
                    _keep(target, content)
                yield outcome
                continue
            child.kill()
            yield Outcome("hang", seconds=limits.seconds)
        except (EOFError, BrokenPipeError):
            child.join()
            yield Outcome(f"crash {child.exitcode}")
        child = None
        _keep(target, content)
    if child is not None:
        child.kill()
        child.join()


def _keep(target: Path, content: bytes | Path) -> None:
    """Keep what crashed a reader where FUZZ_KEEP says, to look at it."""
    keep = os.environ.get("FUZZ_KEEP")
    if keep and isinstance(content, bytes):
        (Path(keep) / f"{zlib.crc32(content):08x}{target.suffix}").write_bytes(content)


def work(pipe: Connection, sound: str, read: Callable[[str], float], room: float) -> None:
    """Read files as they are named, in a process with little memory to spare."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    read(sound)
    most = 1024 * int(figure("VmSize") + room) * 1024
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    pipe.send("ready")
    while True:
        path = pipe.recv()
        Path("/proc/self/clear_refs").write_text("5")
        before, children = figure("VmRSS"), _of_children()
        start = time.perf_counter()
        kind, part = "table", 0.0
        try:
            part = read(path)
        except SteelyardError as error:
            kind = "error" if error.wrong and error.fix and error.where else "a bare error"
        except BaseException as error:
            kind = f"{type(error).__name__}: {error}"[:80]
        memory = max(figure("VmHWM") - before, _of_children() - children)
        seconds = time.perf_counter() - start
        pipe.send(Outcome(kind, memory, max(LEAST, TIMES * part), seconds))


def _read(path: str) -> float:
    """Read a log as far as it is believed; the size of its largest part [MiB]."""
    log = open_log(path)
    names = [name for name in dict.fromkeys(log.columns) if log.columns.count(name) == 1][:64]
    rows, largest = 0, 0
    for part in log.parts(names):
        if part.dtype != np.float64 or part.ndim != 2 or part.shape[1] != len(names):
            raise TypeError(f"a part of {part.dtype} and shape {part.shape}")
        rows += len(part)
        largest = max(largest, part.nbytes)
        if rows > ENOUGH:
            break
    return largest / 2**20


def figure(name: str) -> float:
    """Memory of this process as the system counts it [MiB]."""
    found = re.search(rf"{name}:\s+(\d+) kB", Path("/proc/self/status").read_text())
    return float(found[1]) / 1024.0 if found else 0.0


def _of_children() -> float:
    """The largest child so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024.0


def mutated(raw: bytes, rng: random.Random) -> bytes:
    """A file with something broken in it."""
    data = bytearray(raw)
    kind = rng.randrange(8)
    at = rng.randrange(len(data)) if rng.random() < 0.5 else _edge(len(data), rng)
    if kind == 0:
        return bytes(data[: rng.choice((0, 1, 4, at))])
    if kind == 1:
        data[at : at + rng.choice((1, 8, 100))] = rng.randbytes(rng.choice((0, 1, 8, 100)))
    elif kind == 2:
        data[at : at + 8] = rng.choice((b"\xff" * 8, bytes(8), pack("<Q", 1 << 40), b"\x7f" * 8))
    elif kind == 3:
        data[at:at] = data[at : at + rng.randrange(1, 2000)]
    elif kind == 4:
        data[at : at + 4] = pack("<I", rng.choice((0x7FFFFFFF, 1 << 30, 1 << 24, 1)))
    else:
        for _ in range(rng.choice((1, 1, 2, 5, 30))):
            data[_edge(len(data), rng) if kind == 5 else rng.randrange(len(data))] ^= (
                1 << rng.randrange(8)
            )
    return bytes(data)


def _edge(length: int, rng: random.Random) -> int:
    """A byte near the start or the end, where formats keep their headers."""
    near = min(length - 1, int(rng.expovariate(1 / 400)))
    return near if rng.random() < 0.5 else length - 1 - near


def sound_files(folder: Path) -> dict[str, Path]:
    """A small good file of every kind, several where a format has several layouts."""
    from proofs.support.log_files import Table, write_messages, write_tables

    rng = np.random.default_rng(0)
    n, rows = 3, 300
    q, dq, tau = rng.normal(size=(3, rows, n))
    table = Table(("a", "b", "c"), 10**18 + 4_000_000 * np.arange(rows), q, dq, tau)
    tables = write_tables(folder, table)
    files = {label: path for label, path in tables.items() if path.is_file()}
    files["npz, not compressed"] = folder / "plain.npz"
    np.savez(folder / "plain.npz", **table.arrays)
    frame = pl.DataFrame(table.columns)
    frame.write_csv(folder / "run.tsv", separator="\t")
    (folder / "run.txt").write_text(frame.write_csv(separator=" "))
    (folder / "run.hdf5").write_bytes(files["HDF5"].read_bytes())
    for codec in ("snappy", "uncompressed"):
        files[f"Parquet, {codec}"] = folder / f"{codec}.parquet"
        frame.write_parquet(files[f"Parquet, {codec}"], compression=codec, row_group_size=128)
    files |= {"TSV": folder / "run.tsv", "TXT": folder / "run.txt", ".hdf5": folder / "run.hdf5"}
    for label, path in write_messages(folder, table).items():
        inside = [path] if path.is_file() else [p for p in path.iterdir() if p.suffix != ".yaml"]
        files[label] = inside[0]
    (folder / "run.active").write_bytes(files["ROS 1 bag"].read_bytes())
    return {**files, "ROS 1 bag, active": folder / "run.active"}


def bomb_files(folder: Path) -> Iterator[Path]:
    """Small files that stand for a lot, and headers that promise it."""
    folder.mkdir()
    head = b"\x93NUMPY\x02\x00"
    template = b"{'descr': '<f8', 'fortran_order': %s, 'shape': (%d, %d), }\n"
    for order, shape in (
        (b"False", (1 << 24, 2)),
        (b"True", (1 << 24, 2)),
        (b"False", (2, 1 << 24)),
    ):
        path = folder / f"{order.decode()}{shape[0]}.npz"
        header = template % (order, *shape)
        with ZipFile(path, "w", ZIP_DEFLATED) as archive, archive.open("q.npy", "w") as member:
            member.write(head + pack("<I", len(header)) + header)
            for _ in range(1 << 8):
                member.write(bytes(1 << 20))
        yield path
    with ZipFile(folder / "header.npz", "w", ZIP_DEFLATED) as archive:
        archive.writestr("q.npy", head + pack("<I", 1 << 28) + b" " * (1 << 28))
    yield folder / "header.npz"
    yield _matlab_bomb(folder / "zeros.mat")
    yield _text(folder / "newlines.csv", b"t,a\n0,1\n", b"\n" * (1 << 20), 128)
    yield _text(folder / "line.csv", b"t,a\n0,1\n", b"1" * (1 << 20), 128)
    yield _text(folder / "wide.csv", b",".join(b"c%d" % k for k in range(9999)) + b"\n",
                b"1\n" * (1 << 19), 64)  # fmt: skip
    yield _text(folder / "header.csv", b"", b"name," * (1 << 18), 64)
    pl.DataFrame({f"c{k}": np.zeros(1 << 24) for k in range(4)}).write_parquet(
        folder / "zeros.parquet", row_group_size=1 << 24, data_page_size=1 << 30
    )
    yield folder / "zeros.parquet"
    with h5py.File(folder / "zeros.h5", "w") as file:
        file.create_dataset("q", (1 << 22, 4), "f8", chunks=(1 << 15, 4), compression="gzip")
        for start in range(0, 1 << 22, 1 << 15):
            file["q"][start : start + (1 << 15)] = 0.0
        file.create_dataset("hollow", (1 << 40,), "f8", chunks=(1 << 20,))
    yield folder / "zeros.h5"


def _matlab_bomb(path: Path) -> Path:
    rows = 1 << 22
    body = pack("<4I", 6, 8, 6, 0) + pack("<2I2i", 5, 8, rows, 8) + pack("<2H4s", 1, 1, b"q")
    body += pack("<2I", 9, 64 * rows)
    deflate = zlib.compressobj()
    data = deflate.compress(pack("<2I", 14, len(body) + 64 * rows) + body)
    for _ in range(64 * rows >> 20):
        data += deflate.compress(bytes(1 << 20))
    data += deflate.flush()
    start = b"MATLAB 5.0".ljust(116) + bytes(8) + pack("<H2s", 0x0100, b"IM")
    path.write_bytes(start + pack("<2I", 15, len(data)) + data)
    return path


def _text(path: Path, start: bytes, block: bytes, times: int) -> Path:
    with path.open("wb") as file:
        file.write(start)
        for _ in range(times):
            file.write(block)
    return path


if __name__ == "__main__":
    main_of(main)
