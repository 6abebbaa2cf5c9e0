"""Motion and efforts of runs are kept, in memory or on disk: what reading the log anew gives."""

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from steelyard.runs import sample_cache
from steelyard.runs.processing_chain import Chain
from steelyard.runs.run import Block, Run
from steelyard.runs.sample_cache import KeptSamples
from swinging import GAIN, run_of, valued

SIGNALS = ("t", "q", "dq", "ddq", "effort", "moving")


def swing() -> Run:
    return run_of(lambda motion: valued().torque(motion) / GAIN, rest=2.0)


@pytest.fixture(autouse=True, params=["memory", "disk", "no room"])
def place(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Where samples are kept."""
    if request.param != "memory":
        monkeypatch.setattr(sample_cache, "KEPT", 0)
    if request.param == "no room":
        monkeypatch.setattr(sample_cache, "LEAST_FREE", np.inf)
    return str(request.param)


def read_anew(run: Run) -> Block:
    """The samples of a run without anything that is kept."""
    return Block.joined(list(replace(run, kept=KeptSamples()).blocks()))


def assert_alike(found: Block, wanted: Block) -> None:
    for name in SIGNALS:
        np.testing.assert_allclose(
            getattr(found, name).astype(float), getattr(wanted, name).astype(float), atol=1e-7
        )


@pytest.mark.parametrize("span", [(2.0, 11.0), (-np.inf, np.inf), (3.3337, 4.0), (5.0, 5.003)])
@pytest.mark.parametrize("size", [4096, 7])
def test_every_span_has_its_samples(span: tuple[float, float], size: int, place: str) -> None:
    whole = swing()
    assert len(list(whole.blocks()))
    part = replace(whole, span=span)
    assert part.kept is whole.kept and (whole.kept.source is not None) == (place != "no room")
    blocks = list(part.blocks(size))
    assert max(len(block.t) for block in blocks) <= size
    assert_alike(Block.joined(blocks), read_anew(part))


def test_what_is_kept_is_of_its_own_log() -> None:
    run = swing()
    list(run.blocks())
    moved = run.displaced(np.array([0.7]))
    assert_alike(Block.joined(list(moved.blocks())), read_anew(moved))
    again = moved.displaced(np.array([-0.2]))
    assert_alike(Block.joined(list(again.blocks())), read_anew(again))
    still = replace(run, rest_speed=np.array([1e9]))
    assert not Block.joined(list(still.blocks())).moving.any()
    assert_alike(Block.joined(list(run.blocks())), read_anew(run))


def test_a_log_is_read_once(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Drive gains that are found later change nothing that is kept; units of columns do."""
    run, passes, parts = swing(), list[Chain](), Chain.parts

    def counted(chain: Chain, *arguments: Any) -> Any:
        passes.append(chain)
        return parts(chain, *arguments)

    monkeypatch.setattr(Chain, "parts", counted)
    signals = run.recording.signals
    geared = replace(run, recording=replace(run.recording, signals=replace(signals, gains=[3.0])))
    for one in (run, geared, run):
        list(one.blocks())
    assert len(passes) == (3 if place == "no room" else 0)
    scaled = replace(signals, effort_scale=2.0 * signals.effort_scale)
    other = replace(run, recording=replace(run.recording, signals=scaled))
    efforts = [Block.joined(list(one.blocks())).effort for one in (run, other)]
    np.testing.assert_allclose(efforts[1], 2.0 * efforts[0])


def test_a_pass_that_ends_early_leaves_nothing() -> None:
    run = replace(swing(), kept=KeptSamples())
    next(iter(run.blocks(7)))
    assert run.kept.source is None


def test_nothing_kept_goes_to_another_process_or_changes() -> None:
    run = swing()
    first = next(iter(run.blocks()))
    assert pickle.loads(pickle.dumps(run)).kept.source is None
    with pytest.raises(ValueError, match="read-only"):
        first.q[0, 0] = 1.0
