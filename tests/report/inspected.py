"""Contents of the pages of `contact`, `wrench`, `payload --when` and `health`."""

from dataclasses import replace

import numpy as np

from steelyard.estimate.external.contact_thresholds import RANGES, ContactThresholds
from steelyard.estimate.external.wrench_methods_and_observer_step import Expected
from steelyard.estimate.payload.payload_estimate import PayloadEstimate
from steelyard.estimate.scores.residual_traces_and_band_calibration import ResidualTrace
from steelyard.robot.inertia_and_placement import Placement
from steelyard.robot.robot import Frame
from steelyard.uses.contact.contact import ContactEvent, JointLoad
from steelyard.uses.contact.contact_page import Contacts
from steelyard.uses.health.drift_detection import QUANTITIES, Series, changes_of
from steelyard.uses.health.health import Health
from steelyard.uses.payload.change_detection import SlidingMass
from steelyard.uses.payload.pick_up_and_put_down import Carried, Kind, PayloadEvent, PayloadEvents
from steelyard.uses.wrench.measured_wrench_and_sensor_mounting import (
    MeasuredWrench,
    Sensor,
    SensorLoad,
    component_errors,
)
from steelyard.uses.wrench.wrench import ExternalWrench
from steelyard.uses.wrench.wrench_along_run import WrenchEstimate

JOINTS = ("shoulder_lift_joint", "a_joint_with_a_name_that_is_rather_long")


def contact_content() -> Contacts:
    """Two joints, one contact, one threshold that is not the range's own."""
    t = np.arange(0.0, 20.0, 0.02)
    push = np.where((t > 5.0) & (t < 6.0), 30.0, 0.0)
    residual = np.stack([push + np.sin(9.0 * t), 0.1 * push + np.cos(7.0 * t)])
    speed = np.abs(np.sin(np.stack([t, 0.7 * t])))
    trace = ResidualTrace(
        "shift", t, 0.02, residual, speed, speed, residual, np.zeros((2, 2, len(t)))
    )
    limits = np.tile(np.arange(12.0, 7.0, -1.0), (2, 1))
    own = tuple(tuple(k > 0 for k in range(len(RANGES))) for _ in JOINTS)
    edges = np.tile([0.01, 0.2, 0.8], (2, 1))
    load = JointLoad(JOINTS[0], "Nm", 31.0, 31.0, 2.6, True)
    return Contacts(
        robot="arm",
        joints=JOINTS,
        units=("Nm", "N"),
        trace=trace,
        thresholds=ContactThresholds(edges, 8.0, 6.0, 600.0, limits, own, np.array([9.0, np.nan])),
        events=(ContactEvent(5.0, 6.0, 5.2, (load,), ("upper_arm", "forearm")),),
        sigma=np.ones(2),
        usual=np.full(2, 40.0),
        source="3 calibration logs",
        carried=None,
        suspected=(),
        wanted=None,
        fitted=True,
        notes=("free3 was fitted: left out of the calibration",),
        details=("cut-offs: motion 18 Hz, regression 6 Hz",),
    )


def payload_events() -> PayloadEvents:
    """Something of 2 kg, picked up at 13 s and put down at 54 s."""
    t = np.arange(1.5, 66.0, 0.1)
    inside = np.clip((t - 11.5) / 3.0, 0.0, 1.0) - np.clip((t - 52.5) / 3.0, 0.0, 1.0)
    sliding = SlidingMass(t, 2.0 * inside + 0.1 * np.sin(5.0 * t), 0.3 + 0.1 * np.cos(t))
    ten = np.array([2.0, 0.0, 0.0, 0.1, 0.02, 0.0, 0.02, 0.0, 0.0, 0.01])
    load = PayloadEstimate("tool0", "flange", ten, 1e-3 * np.eye(10), np.ones(2), np.ones(2))
    kinds: tuple[tuple[Kind, float], ...] = (("picked up", 13.0), ("put down", 54.0))
    events = tuple(
        PayloadEvent(time, time - 0.2, time + 0.2, 40.0, kind=kind, mass=2.0, mass_half_width=0.1)
        for kind, time in kinds
    )
    carried = (Carried(13.2, 53.8, load),)
    notes = ("drive gains are assumed known within 2 % each",)
    return PayloadEvents(
        "shift", "tool0", "flange", events, carried, 0.1, 3.0, 0.5, True, notes, sliding
    )


def health_content() -> Health:
    """Two joints over three logs; the dry friction of the first one grows."""
    rng = np.random.default_rng(0)
    log = np.repeat([0.0, 1.0, 2.0], 12)
    t = np.tile(20.0 * np.arange(12) + 10.0, 3)
    std = np.full(len(log), 0.02)
    series = tuple(
        Series(
            joint,
            quantity,
            "Nm" if quantity == "offset" else "",
            log,
            t,
            0.02 * rng.standard_normal(len(log)) + (0.5 * log if (k, q) == (0, 0) else 0.0),
            std,
            2.0 * std,
            1.0,
            0.01,
        )
        for k, joint in enumerate(JOINTS)
        for q, quantity in enumerate(QUANTITIES)
    )
    names = ("monday", "tuesday", "friday_with_a_long_name")
    changes = changes_of(series, names)
    return Health(
        "arm", JOINTS, names, series, changes, ("friday: a payload",), ("cut-offs: motion 18 Hz",)
    )


def wrench_content(frame: str = "tool0") -> ExternalWrench:
    """Two joints, which show two of six directions; one push."""
    t = np.arange(0.0, 20.0, 0.06)
    push = np.where((t > 5.0) & (t < 6.0), 30.0, 0.0)
    wrench = np.outer(push, [1.0, -0.5, 0.0, 0.0, 0.0, 0.1])
    half = np.tile([2.0, 2.0, 59.0, 5.9, 5.9, 0.3], (len(t), 1))
    torque = np.stack([push, 0.2 * push], axis=1)
    learned = np.diag([0.99, 0.99, 0.0, 0.1, 0.0, 0.9])
    estimate = WrenchEstimate(
        run="shift",
        frame=frame,
        axes="frame",
        residual="momentum",
        method="smoothed",
        expected=Expected(),
        bandwidth=5.0,
        joints=JOINTS,
        units=("Nm", "N"),
        t=t,
        wrench=wrench,
        half_width=half,
        force_half_width=np.full(len(t), 5.0),
        force_upper=np.full(len(t), 90.0),
        torque=torque,
        torque_half_width=np.ones_like(torque),
        least_data_share=np.zeros(len(t)),
        learned=np.tile(learned, (len(t), 1, 1)),
        condition=np.full(len(t), np.inf),
    )
    return ExternalWrench("arm", estimate, 8.0, True, (), ("cut-offs: motion 18 Hz",))


def measured_wrench_content() -> ExternalWrench:
    """The same beside a sensor that is turned."""
    content = wrench_content()
    estimate = content.estimate
    wrench = 0.9 * estimate.wrench
    base = Frame("tool0", 1, np.eye(3), np.zeros(3))
    columns = tuple(f"a_long_topic/wrench.force_torque_{k}" for k in range(6))
    measured = MeasuredWrench(
        Sensor(columns, base, Placement(position=(0.0, 0.0, 0.05)), "by_robot", ()),
        wrench,
        SensorLoad(np.arange(6.0), 1.5, 1.2, np.array([0.0, 0.0, 0.1])),
        component_errors(estimate, wrench),
        'other axes of the sensor would fit much better: with --sensor-at "0 0 0.05 0 0 1.571" '
        "forces differ by 3.1 N (RMS) instead of 22 N",
    )
    return replace(content, measured=measured)
