"""steelyard: weigh a robot from its motion and its torque.

`load_model(path).torque(motion)` predicts joint efforts with a model that `steelyard identify`
wrote; `load_model(path).start().step(q, dq, ddq)` does so sample by sample.
"""

from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from steelyard.errors import SteelyardError as SteelyardError
from steelyard.motion import Motion as Motion

if TYPE_CHECKING:
    from steelyard.estimation.identified import IdentifiedModel as IdentifiedModel
    from steelyard.estimation.identified import load_model as load_model

__version__ = version("steelyard")


def __getattr__(name: str) -> Any:
    """Load what is heavier only when it is asked for."""
    if name in ("load_model", "IdentifiedModel"):
        from steelyard.estimation import identified

        return getattr(identified, name)
    raise AttributeError(f"module 'steelyard' has no attribute '{name}'")
