"""What one needs in a notebook, under one name: `import positioning as pos`.

A machine is loaded, a feedforward is designed and assembled into a controller, the controller is simulated and
validated on the nonsmooth machine, a PID is tuned, records are read and diagnosed. Each name is imported from its
module when it is first used, so that importing this one takes no time; `help(pos.simulate)` shows shapes, units and
an example. Quantities are SI numbers: metres, seconds, newtons.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:  # for editors and type checkers, which do not run __getattr__; a test ties both lists
    from design.controller import assemble, design_deadbeat
    from design.deadbeat import Constraints, Deadbeat, DesignError, shortest_settling_time
    from design.deployment.transfer_functions import transfer_functions
    from design.loop import assess as assess_loop
    from design.pid.problem import Tuning
    from design.pid.tuning import tune_pid
    from design.trajectory.history_aware import Limits as TrajectoryLimits
    from design.trajectory.history_aware import Task as TrajectoryTask
    from design.trajectory.history_aware import Trajectory
    from design.trajectory.history_aware import build as build_trajectory
    from design.trajectory.history_aware import solve as solve_trajectory
    from design.validation import Validation, validate
    from diagnosis.criteria import Criteria
    from diagnosis.diagnose import Diagnosis, diagnose
    from diagnosis.improved import improved_machine
    from models.controller import PID, Controller
    from models.controller import load as load_controller
    from models.friction import Friction
    from models.friction import elements as friction_elements
    from models.identification.pipeline import identify
    from models.machine import Machine, MachineError
    from models.machine import load as load_machine
    from models.machine_file import save as save_machine
    from models.plant import Mode, Plant, frequency_response
    from models.records.columns import Columns
    from models.records.files import read_record
    from models.records.record import Record, feeding_sequence
    from models.simulation.simulator import Response, simulate
    from models.variation import Variation, varied
    from reports.plot import plot
    from studies.catalogue import STUDIES as studies

# Each name with the module that it is from, and what it is called there where that is not the same.
_WHERE: Final = {
    "PID": "models.controller",
    "Columns": "models.records.columns",
    "Constraints": "design.deadbeat",
    "Controller": "models.controller",
    "Criteria": "diagnosis.criteria",
    "Deadbeat": "design.deadbeat",
    "DesignError": "design.deadbeat",
    "Diagnosis": "diagnosis.diagnose",
    "Friction": "models.friction",
    "Machine": "models.machine",
    "MachineError": "models.machine",
    "Mode": "models.plant",
    "Plant": "models.plant",
    "Record": "models.records.record",
    "Response": "models.simulation.simulator",
    "Trajectory": "design.trajectory.history_aware",
    "TrajectoryLimits": "design.trajectory.history_aware:Limits",
    "TrajectoryTask": "design.trajectory.history_aware:Task",
    "Tuning": "design.pid.problem",
    "Validation": "design.validation",
    "Variation": "models.variation",
    "assemble": "design.controller",
    "assess_loop": "design.loop:assess",
    "build_trajectory": "design.trajectory.history_aware:build",
    "design_deadbeat": "design.controller",
    "diagnose": "diagnosis.diagnose",
    "feeding_sequence": "models.records.record",
    "frequency_response": "models.plant",
    "friction_elements": "models.friction:elements",
    "identify": "models.identification.pipeline",
    "improved_machine": "diagnosis.improved",
    "load_controller": "models.controller:load",
    "load_machine": "models.machine:load",
    "plot": "reports.plot",
    "read_record": "models.records.files",
    "save_machine": "models.machine_file:save",
    "shortest_settling_time": "design.deadbeat",
    "simulate": "models.simulation.simulator",
    "solve_trajectory": "design.trajectory.history_aware:solve",
    "studies": "studies.catalogue:STUDIES",
    "transfer_functions": "design.deployment.transfer_functions",
    "tune_pid": "design.pid.tuning",
    "validate": "design.validation",
    "varied": "models.variation",
}

__all__ = [
    "PID",
    "Columns",
    "Constraints",
    "Controller",
    "Criteria",
    "Deadbeat",
    "DesignError",
    "Diagnosis",
    "Friction",
    "Machine",
    "MachineError",
    "Mode",
    "Plant",
    "Record",
    "Response",
    "Trajectory",
    "TrajectoryLimits",
    "TrajectoryTask",
    "Tuning",
    "Validation",
    "Variation",
    "assemble",
    "assess_loop",
    "build_trajectory",
    "design_deadbeat",
    "diagnose",
    "feeding_sequence",
    "frequency_response",
    "friction_elements",
    "identify",
    "improved_machine",
    "load_controller",
    "load_machine",
    "plot",
    "read_record",
    "save_machine",
    "shortest_settling_time",
    "simulate",
    "solve_trajectory",
    "studies",
    "transfer_functions",
    "tune_pid",
    "validate",
    "varied",
]


if not TYPE_CHECKING:  # a type checker would take it to have any name

    def __getattr__(name: str) -> Any:
        """The public name, imported now; it then stays in this module."""
        place = _WHERE.get(name)
        if place is None:
            raise AttributeError(
                f"module 'positioning' has no attribute {name!r}; dir(positioning) lists what there is"
            )
        module, _, original = place.partition(":")
        item = getattr(import_module(module), original or name)
        globals()[name] = item
        return item


def __dir__() -> list[str]:
    return sorted(__all__)
