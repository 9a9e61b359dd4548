"""What keeps the robot safe when anything fails."""

from deploy.safety.blacklist import Blacklist
from deploy.safety.gate import SafetyError, VelocityGate, behind_watchdog
from deploy.safety.gate_state import GateMode, GateState
from deploy.safety.geofence import Geofence
from deploy.safety.health import Fault, FaultKind, HealthMonitor
from deploy.safety.lifecycle import Lifecycle, LifecycleError, LifecycleState
from deploy.safety.loops import Loop, LoopDetector
from deploy.safety.progress import ProgressMonitor

__all__ = [
    "Blacklist",
    "Fault",
    "FaultKind",
    "GateMode",
    "GateState",
    "Geofence",
    "HealthMonitor",
    "Lifecycle",
    "LifecycleError",
    "LifecycleState",
    "Loop",
    "LoopDetector",
    "ProgressMonitor",
    "SafetyError",
    "VelocityGate",
    "behind_watchdog",
]
