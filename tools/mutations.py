"""What tests find: `python tools/mutations.py 40` changes one place of `src` at a time at random.

A flipped operator, another constant, a condition turned round or a statement left out, in a copy
of the working tree, where the tests of its room run until one fails. `--seed` draws others.
"""

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT, ROOMS = Path(__file__).parents[1], Path("src", "steelyard")
PAIRS = (
    (ast.Add, ast.Sub),
    (ast.Mult, ast.Div),
    (ast.Lt, ast.GtE),
    (ast.Gt, ast.LtE),
    (ast.Eq, ast.NotEq),
    (ast.And, ast.Or),
)
FLIPPED: dict[type, type] = {a: b for pair in PAIRS for a, b in (pair, pair[::-1])}


@dataclass(frozen=True)
class Mutation:
    """The node at a line and columns of a file is replaced by a text."""

    path: Path
    node: Any  # an expression or a statement
    new: str

    def apply(self, root: Path) -> str:
        """Change the file below `root`; what was changed."""
        file = root / self.path
        lines = file.read_bytes().splitlines(keepends=True)
        first, last = self.node.lineno - 1, (self.node.end_lineno or self.node.lineno) - 1
        start, end = self.node.col_offset, self.node.end_col_offset
        old = ast.get_source_segment(b"".join(lines).decode(), self.node) or ""
        lines[first : last + 1] = [lines[first][:start] + self.new.encode() + lines[last][end:]]
        file.write_bytes(b"".join(lines))
        return f"{self.path}:{first + 1}  {' '.join(old.split())}  ->  {self.new}"


def changed(node: ast.AST) -> ast.AST | None:
    """The same with one thing else, or nothing."""
    match node:
        case ast.BinOp(op=op) | ast.BoolOp(op=op) if type(op) in FLIPPED:
            return type(node)(**{**vars(node), "op": FLIPPED[type(op)]()})
        case ast.Compare(ops=[op]) if type(op) in FLIPPED:
            return ast.Compare(node.left, [FLIPPED[type(op)]()], node.comparators)
        case ast.Constant(value=bool(value)):
            return ast.Constant(not value)
        case ast.Constant(value=int(value) | float(value)):
            return ast.Constant(value + 1)
        case ast.IfExp():
            return ast.IfExp(ast.UnaryOp(ast.Not(), node.test), node.body, node.orelse)
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise() | ast.Continue():
            return ast.Pass()
    return None


def mutations(path: Path) -> list[Mutation]:
    """All of the functions of one file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    bodies = (n.body for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))
    nodes = {n for body in bodies for part in body for n in ast.walk(part)}
    within = {n for f in nodes if isinstance(f, ast.JoinedStr) for n in ast.walk(f)}
    pairs = [(n, changed(n)) for n in ast.walk(tree) if n in nodes - within]
    texts = (
        (n, f"({ast.unparse(x)})" if isinstance(x, ast.expr) else "pass") for n, x in pairs if x
    )
    return [Mutation(path.relative_to(ROOT), node, text) for node, text in texts]


def found(copy: Path, room: str) -> bool:
    """Whether a test of the room fails, in a copy of the working tree."""
    command = [sys.executable, "-m", "pytest", "-qx", "--tb=no", "-o", f"cache_dir={copy}-cache"]
    paths = {**os.environ, "PYTHONPATH": str(copy / "src")}
    done = subprocess.run([*command, f"tests/{room}"], cwd=copy, env=paths, capture_output=True)
    return done.returncode in (1, 2)


def main() -> None:
    """Draw the same number in each room, then change, run, print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rooms", nargs="*")
    parser.add_argument("--only", nargs="*", type=int, help="of the numbers that were printed")
    given = parser.parse_args()
    tested, places = {path.parent.name for path in (ROOT / "tests").glob("*/test_*.py")}, {}
    for room in given.rooms or sorted(tested & {p.name for p in (ROOT / ROOMS).iterdir()}):
        files = sorted((ROOT / ROOMS / room).rglob("*.py"))
        places[room] = [one for file in files for one in mutations(file)]
    draw, outcomes = random.Random(given.seed), list[bool]()
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        for number in range(given.count):
            room = list(places)[number % len(places)]
            mutation = draw.choice(places[room])
            if given.only and number not in given.only:
                continue
            shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".*", "site"))
            what, hit = mutation.apply(copy), found(copy, room)
            outcomes.append(hit)
            print(f"{number:4d} {'found' if hit else 'NOT FOUND':9s} {what}", flush=True)
            shutil.rmtree(copy)
    print(f"{sum(outcomes)} of {len(outcomes)} found")


if __name__ == "__main__":
    main()
