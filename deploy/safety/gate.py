"""The bridge's end of the watchdog process."""

from __future__ import annotations

from common.closing import Closing
from deploy.config import DeployConfig
from deploy.safety.gate_state import GateState


class VelocityGate(Closing):
    """Start the watchdog process, tell it what the bridge wishes, and hear what it does.

    The watchdog owns the velocity topic (and `/stop`); the bridge itself never publishes there. No call blocks.

    Usage::

        with VelocityGate(config) as gate:
            gate.wish(0.5, 0.1)  # at driving.rate
            if not gate.state.clear: ...
    """

    def __init__(self, config: DeployConfig) -> None:
        raise NotImplementedError

    def wish(self, linear: float, angular: float) -> None:
        """Ask for a velocity (m/s, rad/s); it ends a hold, and is forgotten after `safety.bridge_timeout`."""
        raise NotImplementedError

    def hold(self, reason: str) -> None:
        """Ask for zero velocity until the next `wish` or `resume`."""
        raise NotImplementedError

    def resume(self) -> None:
        """End a hold without a wish, when the robot's own stack drives."""
        raise NotImplementedError

    def emergency_stop(self, reason: str) -> None:
        """Latch the emergency stop, as a message on its topic does."""
        raise NotImplementedError

    def release(self) -> None:
        """Release the emergency stop; it latches again if its topic says so again."""
        raise NotImplementedError

    @property
    def state(self) -> GateState:
        """What the watchdog said last; `alive` is false while there is none."""
        raise NotImplementedError

    def close(self) -> None:
        """End the watchdog in order: it sends zeros once more and ends."""
        raise NotImplementedError
