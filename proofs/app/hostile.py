"""Tries to get through to the app: requests from elsewhere, paths out of the folder, bad files."""

import io
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from proofs.support.claims import Claim, main_of

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from app.guided import Visitor, another_tab, serving, simulated_arm, visiting  # noqa: E402
from app.hostile import SECRET, got_through, prepared, tries  # noqa: E402

LEAST = 200
EVIL = "<script>document.body.dataset.errors='ran'</script>"
EVENT = "<img src=x onerror=\"document.body.dataset.errors='ran'\">"
STEPS = ("robot", "logs", "check", "identify")
LARGEST_MIB = 1000.0  # memory of the server; it reads no file that was dropped


def main() -> list[Claim]:
    """Claims on requests, and on files that are dropped."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        arm = folder / "arm"
        arm.mkdir()
        simulated_arm(arm)
        return [*_requests(folder / "a" / "workspace"), *_files(folder, arm)]


def _requests(folder: Path) -> list[Claim]:
    with serving(folder) as server:
        server.enter()
        prepared(server)
        every = list(tries(server))
        through = [(one, why) for one in every if (why := got_through(server, one))]
        answers = server.own("GET", "/robot")[0]
    for one, why in through:
        print(f"{one.what}, {one.method} {one.path}: {why}", file=sys.stderr)
    return [
        Claim("requests that get through", f"{len(through)} of {len(every)}",
              f"0 of {LEAST} or more", not through and len(every) >= LEAST),
        Claim("the app's own page after them", str(answers), "200", answers == 200),
    ]  # fmt: skip


def _robots(urdf: str, secret: Path) -> Iterator[tuple[str, str]]:
    """Model files of strangers by what they try."""

    def called(name: str) -> str:
        named = name.replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")
        return urdf.replace('"joint1"', f'"{named}"')

    laughs = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 12))
    yield "script", called(EVIL)
    yield "event", called(EVENT)
    yield "quotes", called("'\"><b>&{{7*7}}${7*7}")
    yield "billion laughs", f'<!DOCTYPE r [<!ENTITY l0 "ha">{laughs}]><robot name="&l11;"/>'
    yield "entity", f'<!DOCTYPE r [<!ENTITY s SYSTEM "{secret.as_uri()}">]><robot name="&s;"/>'
    yield "deep", "<robot>" + "<a>" * 200_000
    mesh = f'<geometry><mesh filename="{secret.as_uri()}"/></geometry>'
    yield "mesh", urdf.replace('<geometry><box size="0.3 0.08 0.08"/></geometry>', mesh)
    include = f'<xacro:include filename="{secret}"/>'
    head = '<robot name="x" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    yield "include.urdf.xacro", f"{head}{include}</robot>"
    endless = '<xacro:macro name="a"><xacro:a/></xacro:macro><xacro:a/>'
    yield "endless.urdf.xacro", f"{head}{endless}</robot>"
    yield "python.urdf.xacro", f"{head}<link name=\"${{__import__('os').getcwd()}}\"/></robot>"


def _bomb() -> bytes:
    """A NumPy archive of 120 kB whose array has 8 GB."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000,), }"
        head += b" " * (118 - len(head) - 1) + b"\n"
        with archive.open("time.npy", "w", force_zip64=True) as file:
            file.write(b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head)
            for _ in range(120):
                file.write(bytes(1 << 20))
    return out.getvalue()


def _logs(log: str) -> Iterator[tuple[str, bytes]]:
    """Logs of strangers by their names."""
    yield "script.csv", log.replace("q1", f"q1{EVIL}", 1).encode()
    yield "event.csv", log.replace("q1", f'"{EVENT.replace(chr(34), chr(34) * 2)}"', 1).encode()
    yield f"{EVIL.replace('/', '')}.csv", log.encode()
    yield "bomb.npz", _bomb()
    yield "wide.csv", b",".join(b"c%d" % k for k in range(200_000)) + b"\n1\n"
    yield "binary.csv", bytes(range(256)) * 4000
    yield "line.csv", b"x" * (30 << 20)
    yield (
        "pickle.npy",
        b"\x93NUMPY\x01\x00v\x00"
        + b"{'descr': '|O', 'fortran_order': False, 'shape': (1,), }".ljust(117)
        + b"\ncos\nsystem\n(S'touch ran'\ntR.",
    )
    yield "broken.parquet", b"PAR1" + bytes(1000) + b"PAR1"
    yield "broken.mcap", b"\x89MCAP0\r\n" + b"\xff" * 1000
    yield "broken.h5", b"\x89HDF\r\n\x1a\n" + b"\xff" * 1000


def _files(folder: Path, arm: Path) -> list[Claim]:
    urdf, log = (arm / "arm.urdf").read_text(), (arm / "a.csv").read_text()
    secret = folder / "secret"
    secret.write_text(SECRET)
    given = folder / "given"
    given.mkdir()
    robots = [(f"{n}.urdf" if "." not in n else n, t.encode()) for n, t in _robots(urdf, secret)]
    cases = [(robot, ("a.csv", log.encode())) for robot in robots]
    cases += [(("arm.urdf", urdf.encode()), one) for one in _logs(log)]
    ran, lost, hung, most, browser = list[str](), list[str](), list[str](), 0.0, None
    with ExitStack() as stack:
        for number, (robot, one) in enumerate(cases):
            what = robot[0] if robot[0] != "arm.urdf" else one[0]
            for name, content in (robot, one):
                (given / name).write_bytes(content)
            with serving(folder / f"workspace{number}") as server:
                if browser is None:
                    visitor = stack.enter_context(visiting(server.address))
                    browser = visitor.page.context
                else:
                    visitor = another_tab(browser, server.address)
                seen = _seen(visitor, server.origin, given / robot[0], given / one[0])
                ran += [what] * seen.ran
                lost += [what] * seen.lost
                hung += [what] * seen.hung
                most = max(most, _memory(server.process.pid))
                visitor.page.close()
            ran += [what] * any(p.name == "ran" for p in folder.rglob("ran"))
            print(f"{what}: {seen}", file=sys.stderr)
    return [
        Claim(f"files whose names or contents ran, of {len(cases)}", str(len(ran)), "0", not ran),
        Claim("files that showed what is outside of the workspace", str(len(lost)), "0", not lost),
        Claim("files with which the app was not ready again in time", ", ".join(hung) or "0", "0",
              not hung),
        Claim("memory of the server with them", f"{most:.0f} MiB", f"below {LARGEST_MIB:.0f} MiB",
              most < LARGEST_MIB),
    ]  # fmt: skip


@dataclass
class Seen:
    """What happened with two files: a script ran, the secret was shown, the app was not ready."""

    ran: bool = False
    lost: bool = False
    hung: bool = False


def _seen(visitor: Visitor, origin: str, robot: Path, log: Path) -> Seen:
    """Drop both files, and look at every step."""
    seen = Seen()
    visitor.drop("robot", robot)
    seen.hung |= not _ready(visitor)
    visitor.page.goto(f"{origin}/logs")
    if visitor.page.locator("#files-logs").count():
        visitor.drop("logs", log)
        seen.hung |= not _ready(visitor)
    for step in STEPS:
        visitor.page.goto(f"{origin}/{step}")
        seen.hung |= not _ready(visitor)
        seen.ran |= bool(visitor.page.evaluate("document.body.dataset.errors || ''"))
        seen.lost |= SECRET in visitor.page.content()
    return seen


def _ready(visitor: Visitor) -> bool:
    from playwright.sync_api import Error

    try:
        visitor.idle()
    except Error:
        return False
    return True


def _memory(process: int) -> float:
    """Most memory that a process had [MiB]."""
    for line in Path(f"/proc/{process}/status").read_text().splitlines():
        if line.startswith("VmHWM"):
            return float(line.split()[1]) / 1024.0
    return 0.0


if __name__ == "__main__":
    main_of(main)
