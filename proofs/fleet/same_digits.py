"""The same digits on processes, on Dask, from a damaged store, from S3; nothing silent.

A worker is killed with -9 while it works, and so is the scheduler; a log is cut off; a thousand
bits of the store are flipped; logs lie on a server that speaks S3.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from proofs.support import simulated_fleet as simulated
from proofs.support.claims import Claim, main_of

import steelyard
from steelyard.base.errors import SteelyardError
from steelyard.base.progress import Event
from steelyard.fleet.fleet_result_and_page import Fleet

FLEET = simulated.Fleet(6, 10, {2: simulated.Fault(5, joint=2, friction=2.0)})
SAME, FLIPS = 1e-12, 1000


def numbers(found: Fleet) -> list[float]:
    """Everything that was found, as numbers."""
    changes = [x for c in found.changes for x in (*c.size.tolist(), *c.std.tolist(), c.p)]
    levels = [x for level in found.levels for x in (*level.value.tolist(), *level.std.tolist())]
    return [*found.model.estimate.values.values.tolist(), *changes, *levels]


def apart(one: Fleet, other: Fleet) -> float:
    """Largest relative difference of all numbers; infinite where their number differs."""
    a, b = numbers(one), numbers(other)
    if len(a) != len(b):
        return np.inf
    size = np.maximum(np.abs(a), 1e-9)
    return float(np.max(np.abs(np.subtract(a, b)) / size))


class Work:
    """A fleet's folder, and runs of it in stores that hold the first model only."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        simulated.write(FLEET, folder)
        steelyard.plan_fleet(folder / "arm.toml", folder / "logs", temperature="temp",
                             store=folder / "begun", processes=1)  # fmt: skip

    def store(self, name: str) -> Path:
        """A store of that name, with the first model only."""
        place = self.folder / name
        shutil.rmtree(place, ignore_errors=True)
        shutil.copytree(self.folder / "begun", place)
        return place

    def run(self, store: Path, logs: Path | str | None = None, **more: Any) -> Fleet:
        """What is found in the logs, or in others."""
        return steelyard.fleet(
            self.folder / "arm.toml", logs or self.folder / "logs", temperature="temp",
            store=store, **more,
        )  # fmt: skip


def after(done: int, act: Callable[[], None]) -> Callable[[Event], bool]:
    """Progress that acts once when so many logs are done."""
    left = [True]

    def watch(event: Event) -> bool:
        if left and event.phase == "logs" and event.done >= done:
            left.clear()
            act()
        return True

    return watch


def dask(kind: str, *arguments: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "distributed.cli.dask_" + kind, *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def cluster(folder: Path, workers: int) -> tuple[str, list[subprocess.Popen[bytes]]]:
    """A scheduler and workers of this machine; its address, and their processes."""
    file = folder / f"scheduler{time.monotonic_ns()}.json"
    started = [dask("scheduler", "--port", "0", "--host", "127.0.0.1", "--no-dashboard",
                    "--scheduler-file", str(file))]  # fmt: skip
    ready = threading.Event()
    while not file.exists():
        ready.wait(0.05)
    while True:
        try:
            address = str(json.loads(file.read_text())["address"])
            break
        except ValueError:
            ready.wait(0.05)
    for _ in range(workers):
        started.append(dask("worker", address, "--nthreads", "1", "--no-dashboard",
                            "--nworkers", "1", "--local-directory", str(folder)))  # fmt: skip
    return address, started


def children(pid: int) -> list[int]:
    found = subprocess.run(["pgrep", "-P", str(pid)], capture_output=True, text=True)
    own = [int(x) for x in found.stdout.split()]
    return [*own, *(x for child in own for x in children(child))]


def end(started: list[subprocess.Popen[bytes]]) -> None:
    for process in reversed(started):
        for pid in [*children(process.pid), process.pid]:
            try:
                os.kill(pid, signal.SIGKILL)
            except ProcessLookupError:
                pass
        process.wait()


def killed_worker(work: Work) -> Fleet:
    """A worker is killed with -9 when ten logs are done; another one takes its place."""
    address, started = cluster(work.folder, 2)
    try:

        def kill() -> None:
            os.kill(children(started[1].pid)[-1], signal.SIGKILL)

        return work.run(work.store("worker"), cluster=address, progress=after(10, kill))
    finally:
        end(started)


def killed_scheduler(work: Work) -> tuple[str, Fleet, int]:
    """The scheduler is killed; what is said, and what a second run finds, and has to make."""
    store, said = work.store("scheduler"), "nothing"
    address, started = cluster(work.folder, 2)
    try:

        def kill() -> None:
            os.kill(started[0].pid, signal.SIGKILL)

        try:
            work.run(store, cluster=address, progress=after(10, kill))
        except SteelyardError as error:
            said = error.wrong
    finally:
        end(started)
    address, started = cluster(work.folder, 2)
    try:
        found = work.run(store, cluster=address)
    finally:
        end(started)
    return said, found, found.work.made


def on_s3(work: Work) -> Fleet:
    """The logs, and the store, on a server that speaks S3."""
    import boto3
    from moto.server import ThreadedMotoServer

    server = ThreadedMotoServer(port=0)
    server.start()
    host, port = server.get_host_and_port()
    url = f"http://{host}:{port}"
    os.environ |= {
        "AWS_ACCESS_KEY_ID": "testing", "AWS_SECRET_ACCESS_KEY": "testing",
        "AWS_ENDPOINT_URL": url, "AWS_DEFAULT_REGION": "us-east-1",
    }  # fmt: skip
    try:
        client = boto3.client("s3", endpoint_url=url)
        client.create_bucket(Bucket="plant")
        for path in sorted((work.folder / "logs").rglob("*.parquet")):
            name = path.relative_to(work.folder).as_posix()
            client.upload_file(str(path), "plant", name)
        return steelyard.fleet(
            work.folder / "arm.toml", "s3://plant/logs", temperature="temp",
            store="s3://plant/store", processes=1,
        )  # fmt: skip
    finally:
        server.stop()


def flipped(work: Work, store: Path, first: Fleet) -> tuple[int, int]:
    """Flip bits in entries of a store: how often numbers differ, and entries made again."""
    rng, wrong, again = random.Random(0), 0, 0
    entries = sorted(store.glob("*.entry"))
    rounds = 20
    for _ in range(rounds):
        kept = {}
        for _ in range(FLIPS // rounds):
            path = rng.choice(entries)
            content = bytearray(path.read_bytes())
            kept.setdefault(path, bytes(content))
            place = rng.randrange(len(content))
            content[place] ^= 1 << rng.randrange(8)
            path.write_bytes(bytes(content))
        found = work.run(store, processes=1)
        wrong += apart(first, found) > 0.0
        again += found.work.damaged
    return wrong, again


def cut_off(work: Work) -> tuple[str, ...]:
    """A log that ends in the middle: what the result says of it."""
    logs = work.folder / "cut"
    shutil.copytree(work.folder / "logs", logs)
    path = sorted(logs.rglob("*.parquet"))[23]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    found = work.run(work.store("cutoff"), logs, processes=1)
    return tuple(one.log for one in found.left_out if Path(one.log) == path)


def main() -> list[Claim]:
    claims = []

    def same(what: str, other: Fleet, told: str = "") -> None:
        far = apart(first, other)
        said = f"{told}largest difference {far:.1e}"
        claims.append(Claim(what, said, f"<= {SAME:g}", far <= SAME))

    with tempfile.TemporaryDirectory() as name:
        work = Work(Path(name))
        store = work.store("first")
        first = work.run(store, processes=1)
        same("two processes of this machine", work.run(work.store("two"), processes=2))
        same("Dask with two workers", work.run(work.store("dask"), cluster="local:2"))
        same("Dask, a worker killed with -9", killed_worker(work))
        said, found, made = killed_scheduler(work)
        good = said == "the cluster was lost" and made < FLEET.robots * FLEET.days - 10
        same("Dask, the scheduler killed and started again", found, f"'{said}', {made} made; ")
        claims.append(Claim("what was done before is kept", f"{made} of 60 made again",
                            "said, and at least 10 kept", good))  # fmt: skip
        same("logs and store on a server of S3", on_s3(work))
        wrong, again = flipped(work, store, first)
        claims.append(Claim(f"{FLIPS} flipped bits in the store", f"{wrong} wrong results, {again} "
                            "entries made again", "0 wrong", wrong == 0 and again > 0))  # fmt: skip
        named = cut_off(work)
        claims.append(Claim("a log that is cut off", f"named: {named}", "named", len(named) == 1))
    return claims


if __name__ == "__main__":
    main_of(main)
