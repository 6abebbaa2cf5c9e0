"""Motion and efforts of short runs stay in memory: they are what reading the log anew gives."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from steelyard.runs import run as run_module
from steelyard.runs.run import Block, Run
from swinging import GAIN, run_of, valued

SIGNALS = ("t", "q", "dq", "ddq", "effort", "moving")


def swing() -> Run:
    return run_of(lambda motion: valued().torque(motion) / GAIN, rest=2.0)


def read_anew(run: Run, monkeypatch: pytest.MonkeyPatch) -> Block:
    """The samples of a run without anything that is kept."""
    with monkeypatch.context() as patched:
        patched.setattr(run_module, "KEPT", 0)
        return Block.joined(list(run.blocks()))


def assert_alike(found: Block, wanted: Block) -> None:
    for name in SIGNALS:
        np.testing.assert_allclose(
            getattr(found, name).astype(float), getattr(wanted, name).astype(float), atol=1e-7
        )


@pytest.mark.parametrize("span", [(2.0, 11.0), (-np.inf, np.inf), (3.3337, 4.0), (5.0, 5.003)])
@pytest.mark.parametrize("size", [4096, 7])
def test_every_span_has_its_samples(
    span: tuple[float, float], size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = swing()
    assert len(list(whole.blocks()))
    part = replace(whole, span=span)
    assert part.kept is whole.kept and whole.kept.blocks
    blocks = list(part.blocks(size))
    assert max(len(block.t) for block in blocks) <= size
    assert_alike(Block.joined(blocks), read_anew(part, monkeypatch))


def test_what_is_kept_is_of_its_own_log(monkeypatch: pytest.MonkeyPatch) -> None:
    run = swing()
    list(run.blocks())
    moved = run.displaced(np.array([0.7]))
    assert_alike(Block.joined(list(moved.blocks())), read_anew(moved, monkeypatch))
    again = moved.displaced(np.array([-0.2]))
    assert_alike(Block.joined(list(again.blocks())), read_anew(again, monkeypatch))
    still = replace(run, rest_speed=np.array([1e9]))
    assert not Block.joined(list(still.blocks())).moving.any()
    assert_alike(Block.joined(list(run.blocks())), read_anew(run, monkeypatch))


def test_nothing_kept_goes_to_another_process_or_changes() -> None:
    run = swing()
    first = next(iter(run.blocks()))
    assert not pickle.loads(pickle.dumps(run)).kept.blocks
    with pytest.raises(ValueError, match="read-only"):
        first.q[0, 0] = 1.0
