"""The app under load and when it is killed: clicks answered in time, no half file after kill -9."""

import os
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import polars as pl
from proofs.support.claims import Claim, main_of

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from app.guided import Server, Visitor, serving, simulated_arm, visiting  # noqa: E402

TIMED = True
MOST_MS = 200.0  # from a click to the page that answers it
CLICKS = 25  # of each kind of load
KILLED_AFTER = (0.3, 1.0, 2.0, 3.5, 5.0)  # from the beginning of a fit [s]
UPLOAD_BYTES, UPLOADS = 100 << 20, 12
LONG_ROWS = 1_000_000
MANY_LOGS = 20

CLICK = """async log => {
  const button = () => [...document.querySelectorAll("form[data-post='/logs/show'] button")]
    .find(one => one.value === log);
  const start = performance.now();
  await new Promise(done => {
    const seen = new MutationObserver(() => { if (button().disabled) done(); });
    seen.observe(document.body, { attributes: true, childList: true, subtree: true });
    button().click();
  });
  return performance.now() - start;
}"""
"""Click `Show` of a log; the time until the page is the one that shows it, which is before it is
painted and its curves are drawn [ms]."""

PAUSE_S = 0.6  # of the user between two clicks


def main() -> list[Claim]:
    """Claims on clicks under load and on killed servers."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arm = folder / "arm"
        arm.mkdir()
        simulated_arm(arm)
        return [*_clicks(folder / "load", arm), *_kills(folder / "killed", arm)]


def _prepared(folder: Path, arm: Path, logs: int) -> None:
    """A workspace with the robot and copies of a log."""
    for kind in ("robot", "logs"):
        (folder / kind).mkdir(parents=True)
    (folder / "robot" / "arm.urdf").write_bytes((arm / "arm.urdf").read_bytes())
    for number in range(logs):
        log = (arm / ("b.csv" if number % 2 else "a.csv")).read_bytes()
        (folder / "logs" / f"log{number:02d}.csv").write_bytes(log)


def _clicks(folder: Path, arm: Path) -> list[Claim]:
    _prepared(folder, arm, MANY_LOGS)
    with serving(folder) as server, visiting(server.address) as visitor:
        server.cookie = _cookie(visitor, server)
        visitor.page.goto(f"{server.origin}/robot")
        assert server.act("/robot/added")[0] == 204
        visitor.see(".space3d[data-drawn]")
        visitor.step("Logs")
        visitor.see(".picture .main-svg")
        visitor.idle()
        names = [f"logs/log{number:02d}.csv" for number in range(MANY_LOGS)]
        claims = [_claim(f"{MANY_LOGS} logs, each read when it is clicked", visitor, names)]
        claims.append(_claim(f"{MANY_LOGS} logs that were read", visitor, names))
        claims.append(
            _beside(
                f"{UPLOADS} uploads of 100 MB, one after the other",
                visitor,
                names,
                lambda: _upload(server),
            )
        )
        claims.append(
            _beside(
                f"a log of {LONG_ROWS:,} rows being read",
                visitor,
                names,
                lambda: _long(folder, server),
            )
        )
        assert visitor.wrong == []
    return claims


def _cookie(visitor: Visitor, server: Server) -> str:
    (own,) = visitor.page.context.cookies(server.origin)
    return f"{own['name']}={own['value']}"


def _measured(visitor: Visitor, names: list[str], going: Callable[[], bool]) -> list[float]:
    found = list[float]()
    for number in range(CLICKS):
        shown = names[(number + 1) % len(names)]
        time.sleep(PAUSE_S)
        found.append(float(visitor.page.evaluate(CLICK, shown)))
        if not going():
            break
    return found


def _claim(
    what: str, visitor: Visitor, names: list[str], times: list[float] | None = None
) -> Claim:
    found = _measured(visitor, names, lambda: True) if times is None else times
    value = f"median {np.median(found):.0f}, largest {max(found):.0f} ms of {len(found)}"
    value += f" (load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores)"
    return Claim(f"a click beside {what}", value, f"below {MOST_MS:.0f} ms", max(found) < MOST_MS)


def _beside(what: str, visitor: Visitor, names: list[str], load: Callable[[], None]) -> Claim:
    thread = threading.Thread(target=load)
    thread.start()
    time.sleep(0.3)
    times = _measured(visitor, names, thread.is_alive)
    thread.join()
    return _claim(what, visitor, names, times)


def _upload(server: Server) -> None:
    line = b"0.001,0.1,0.2,0.3,1.0,2.0,3.0\n"
    content = b"time_s,q1,q2,q3,tau1_Nm,tau2_Nm,tau3_Nm\n" + line * (UPLOAD_BYTES // len(line))
    for _ in range(UPLOADS):
        status, _ = server.own("PUT", "/upload/logs/zz_large.csv", content)
        assert status == 204
        (server.folder / "logs" / "zz_large.csv").unlink()


def _long(folder: Path, server: Server) -> None:
    """Put a long log there, and ask for it until it is read."""
    t = np.arange(LONG_ROWS) * 1e-3
    columns = {"time_s": t} | {f"q{k}": np.sin(0.1 * k * t) for k in (1, 2, 3)}
    columns |= {f"tau{k}_Nm": np.cos(t * k) for k in (1, 2, 3)}
    part = folder / "long.part"
    pl.DataFrame(columns).write_csv(part)
    part.rename(folder / "logs" / "zz_long.csv")
    server.act("/logs/show", log="logs/zz_long.csv")
    server.own("GET", "/logs")
    key = server.running("zz_long")
    while key and key in server.jobs():
        time.sleep(0.1)


def _state(folder: Path) -> dict[str, bytes]:
    """All files of a workspace but what is computed from others."""
    found = [p for p in folder.rglob("*") if p.is_file() and ".derived" not in p.parts]
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in found}


def _kills(folder: Path, arm: Path) -> list[Claim]:
    _prepared(folder, arm, 2)
    changed, parts, alive, late = 0, 0, 0, 0
    with serving(folder) as server:
        server.enter()
        server.act("/robot/added")
        server.idle()
        server.act("/check/run")
        server.idle()
    for seconds in KILLED_AFTER:
        with serving(folder) as server:
            server.enter()
            status, _ = server.act("/identify/run")
            assert status == 204
            before = _state(folder)
            assert server.running("identifying")
            time.sleep(seconds)
            late += "identifying" not in "".join(server.jobs().values())
            server.kill()
        alive += not _gone(folder)
        after = _state(folder)
        changed += {k: v for k, v in after.items() if not k.startswith("models/")} != before
        parts += any(p.name.endswith(".part") for p in folder.rglob("*"))
    with serving(folder) as server:
        server.enter()
        assert server.act("/identify/run")[0] == 204
        server.idle()
    models = [p for p in (folder / "models").iterdir()]
    whole = [p for p in models if (p / "model.json").exists() and (p / "report.html").exists()]
    count = len(KILLED_AFTER)
    return [
        Claim(f"kill -9 of the server during a fit, {count} times: files that changed",
              str(changed), "0", not changed),
        Claim("parts of files that are left", str(parts), "0", not parts),
        Claim("works that outlive their server", str(alive), "0", not alive),
        Claim("fits that ended before the kill, so that nothing was tried", str(late),
              f"below {count}", late < count),
        Claim("models that are whole, after a restart and another fit",
              f"{len(whole)} of {len(models)}", "all", 0 < len(whole) == len(models)),
    ]  # fmt: skip


def _gone(folder: Path, most: float = 10.0) -> bool:
    """Whether no process works in a folder any more, after a while."""
    end = time.monotonic() + most
    while time.monotonic() < end:
        if not any(_folder_of(p) == str(folder) for p in Path("/proc").glob("[0-9]*")):
            return True
        time.sleep(0.05)
    return False


def _folder_of(process: Path) -> str:
    try:
        return os.readlink(process / "cwd")
    except OSError:
        return ""


if __name__ == "__main__":
    main_of(main)
