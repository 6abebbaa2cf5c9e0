"""`make prove`: all proofs into one table; fails where one is missed, or without the data."""

import importlib
import sys
import time
import traceback
from pathlib import Path

from proofs.support.claims import Claim, data_folder, table


def main() -> int:
    """Run every proof, or those that arguments name: `checks`, or `checks/pairs`."""
    data_folder()
    here = Path(__file__).parent
    every = sorted(
        path.relative_to(here).with_suffix("").as_posix()
        for path in here.glob("*/*.py")
        if path.parent.name != "support"
    )
    wanted = sys.argv[1:] or every
    names = [name for name in every if name.startswith(tuple(wanted))]
    if not names:
        print(f"no proof begins with {' or '.join(wanted)}; there are {', '.join(every)}")
        return 1
    claims: list[Claim] = []
    for name in names:
        start = time.perf_counter()
        try:
            found = importlib.import_module(f"proofs.{name.replace('/', '.')}").main()
        except Exception:
            traceback.print_exc()
            found = [Claim(name, "the proof stopped with an error", "a figure", False)]
        print(f"{name}: {time.perf_counter() - start:.0f} s", file=sys.stderr, flush=True)
        claims += [Claim(f"{name}  {c.name}", c.value, c.bound, c.holds) for c in found]
    print(table(claims))
    missed = sum(not claim.holds for claim in claims)
    print(f"{len(claims) - missed} claims hold, {missed} missed")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
