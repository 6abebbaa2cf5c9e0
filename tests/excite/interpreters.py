"""Interpreters of programs for ROS 2 and UR, which know their rules and nothing of ours."""

import re
from typing import Any

import numpy as np
from ruamel.yaml import YAML


class Follower:
    """joint_trajectory_controller: polynomials of degree five between points."""

    def __init__(self, text: str) -> None:
        self.message = YAML(typ="safe").load(text)
        points = self.message["points"]
        stamps = [point["time_from_start"] for point in points]
        self.nanoseconds = [s["sec"] * 10**9 + s["nanosec"] for s in stamps]
        assert all(a < b for a, b in zip(self.nanoseconds, self.nanoseconds[1:], strict=False))
        assert all(0 <= s["nanosec"] < 10**9 for s in stamps)
        kinds = ("positions", "velocities", "accelerations")
        self.states = np.array([[p[kind] for kind in kinds] for p in points])
        assert not np.abs(self.states[-1, 1]).max() > np.finfo(np.float32).eps  # or it is refused

    @property
    def start(self) -> float:
        """When the motion begins, after the approach [s]."""
        return self.nanoseconds[0] * 1e-9

    def at(self, t: np.ndarray) -> np.ndarray:
        """Positions at times of the message, shape `(N, n)`; later than its first point."""
        stamps = np.array(self.nanoseconds) * 1e-9
        k = np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, len(stamps) - 2)
        h, s = stamps[k + 1] - stamps[k], np.clip(t - stamps[k], 0.0, stamps[k + 1] - stamps[k])
        (q0, v0, a0), (q1, v1, a1) = (np.moveaxis(self.states[k + i], 1, 0) for i in (0, 1))
        h, s = h[:, None], s[:, None]
        c3 = (20 * (q1 - q0) - (8 * v1 + 12 * v0) * h - (3 * a0 - a1) * h**2) / (2 * h**3)
        c4 = (30 * (q0 - q1) + (14 * v1 + 16 * v0) * h + (3 * a0 - 2 * a1) * h**2) / (2 * h**4)
        c5 = (12 * (q1 - q0) - 6 * (v1 + v0) * h - (a0 - a1) * h**2) / (2 * h**5)
        return q0 + v0 * s + a0 / 2 * s**2 + c3 * s**3 + c4 * s**4 + c5 * s**5


def moments(duration: float) -> np.ndarray:
    """Times of a controller at 1 kHz that began at an odd moment, and random ones."""
    rng = np.random.default_rng(0)
    grid = np.arange(0.00037, duration, 1e-3)
    return np.sort(np.concatenate([[0.0, duration], grid, rng.uniform(0.0, duration, 5000)]))


SIGNATURES: dict[str, tuple[str, ...]] = {
    "movej": ("q", "a", "v", "t", "r"),
    "servoj": ("q", "a", "v", "t", "lookahead_time", "gain"),
    "stopj": ("a",),
    "sleep": ("t",),
    "sync": (),
}
DEFAULTS: dict[str, float] = {"t": 0.0, "r": 0.0, "lookahead_time": 0.1, "gain": 300.0}


class URController:
    """Runs a URScript program of calls, one after the other, that move six joints."""

    def __init__(self, script: str, posture: np.ndarray, period: float) -> None:
        self.q, self.clock, self.period, self.moving = posture, 0.0, period, False
        self.set_points: list[tuple[float, np.ndarray]] = []
        self.fastest = 0.0
        bare = [re.sub(r"#.*", "", line).rstrip() for line in script.splitlines()]
        lines = [line.strip() for line in bare if line.strip()]
        assert re.fullmatch(r"def \w+\(\):", lines[0]) and lines[-1] == "end"
        self._run(lines[1:-1])
        assert not self.moving, "the program ends without stopj"

    def _run(self, lines: list[str]) -> None:
        for line in lines:
            call = re.fullmatch(r"(\w+)\((.*)\)", line)
            assert call, f"no statement: {line}"
            name, text = call.groups()
            self._call(name, self._arguments(name, text))

    def _arguments(self, name: str, text: str) -> dict[str, Any]:
        names = SIGNATURES[name]
        given: dict[str, Any] = {k: v for k, v in DEFAULTS.items() if k in names}
        for place, part in enumerate(re.findall(r"(?:\w+=)?(?:\[[^\]]*\]|[^,\s]+)", text)):
            key, _, value = part.rpartition("=")
            assert (key or names[place]) in names, f"{name} has no argument {key}"
            given[key or names[place]] = self._value(value)
        return given

    def _value(self, text: str) -> Any:
        if text.startswith("["):
            return np.array([float(part) for part in text[1:-1].split(",")])
        return float(text)

    def _call(self, name: str, a: dict[str, Any]) -> None:
        if name == "movej":
            distance = np.abs(a["q"] - self.q).max()
            self.fastest = max(self.fastest, a["v"])
            self.clock += distance / a["v"] + a["v"] / a["a"]
            self.q, self.moving = a["q"], False
        elif name == "servoj":
            assert a["q"].shape == (6,)
            assert 0.03 <= a["lookahead_time"] <= 0.2 and 100 <= a["gain"] <= 2000
            ticks = a["t"] / self.period
            assert abs(ticks - round(ticks)) < 1e-9 and round(ticks) >= 1
            assert np.abs(a["q"] - self.q).max() / a["t"] < 2 * np.pi, "protective stop"
            self.set_points.append((self.clock, a["q"]))
            self.clock += a["t"]
            self.q, self.moving = a["q"], True
        elif name == "stopj":
            self.moving = False
        elif name == "sleep":
            self.clock += a["t"]
