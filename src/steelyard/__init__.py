"""steelyard: weigh a robot from its motion and its torque.

`load_model(path).torque(motion)` predicts joint efforts with a model that `steelyard identify`
wrote; `load_model(path).start().step(q, dq, ddq)` does so sample by sample.
"""

from typing import TYPE_CHECKING, Any

from steelyard.errors import SteelyardError as SteelyardError

if TYPE_CHECKING:
    from steelyard.estimation.identified import IdentifiedModel as IdentifiedModel
    from steelyard.estimation.identified import load_model as load_model
    from steelyard.motion import Motion as Motion

    __version__: str

_HOMES = {
    "Motion": "steelyard.motion",
    "load_model": "steelyard.estimation.identified",
    "IdentifiedModel": "steelyard.estimation.identified",
}


def __getattr__(name: str) -> Any:
    """Load what is heavier only when it is asked for: the command line starts at once."""
    import importlib

    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("steelyard")
    if name in _HOMES:
        return getattr(importlib.import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'steelyard' has no attribute '{name}'")
