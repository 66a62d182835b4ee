"""What one needs in a notebook, under one name: `import positioning as pos`.

A machine is loaded, a feedforward is designed and assembled into a controller, the controller is simulated and
validated on the nonsmooth machine, a PID is tuned, records are read and diagnosed. Each name is imported from its
module when it is first used, so that importing this one takes no time; `help(pos.simulate)` shows shapes, units and
an example. Quantities are SI numbers: metres, seconds, newtons.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:  # for editors and type checkers, which do not run __getattr__; a test ties both lists
    from design.controller import assemble as assemble
    from design.controller import design_deadbeat as design_deadbeat
    from design.deadbeat import Constraints as Constraints
    from design.deadbeat import Deadbeat as Deadbeat
    from design.deadbeat import DesignError as DesignError
    from design.deadbeat import shortest_settling_time as shortest_settling_time
    from design.loop import assess as assess_loop
    from design.pid.problem import Tuning as Tuning
    from design.pid.tuning import tune_pid as tune_pid
    from design.trajectory.history_aware import Limits as TrajectoryLimits
    from design.trajectory.history_aware import Task as TrajectoryTask
    from design.trajectory.history_aware import Trajectory as Trajectory
    from design.trajectory.history_aware import build as build_trajectory
    from design.trajectory.history_aware import solve as solve_trajectory
    from diagnosis.diagnose import Diagnosis as Diagnosis
    from diagnosis.diagnose import diagnose as diagnose
    from models.controller import PID as PID
    from models.controller import Controller as Controller
    from models.controller import load as load_controller
    from models.friction import Friction as Friction
    from models.friction import branch as friction_branch
    from models.friction import elements as friction_elements
    from models.machine import Machine as Machine
    from models.machine import MachineError as MachineError
    from models.machine import load as load_machine
    from models.plant import Mode as Mode
    from models.plant import Plant as Plant
    from models.plant import frequency_response as frequency_response
    from models.records.columns import Columns as Columns
    from models.records.files import read_record as read_record
    from models.records.record import Record as Record
    from models.records.record import feeding_sequence as feeding_sequence
    from models.records.settling import settling_time as settling_time
    from models.simulation.simulator import Response as Response
    from models.simulation.simulator import simulate as simulate
    from models.simulation.simulator import simulate_many as simulate_many
    from models.variation import Variation as Variation
    from models.variation import drawn as drawn
    from models.variation import varied as varied
    from reports.plot import plot as plot
    from studies.validation import Validation as Validation
    from studies.validation import validate as validate

# Each name with the module that it is from, and what it is called there where that is not the same.
_WHERE: Final = {
    "Columns": "models.records.columns",
    "Constraints": "design.deadbeat",
    "Controller": "models.controller",
    "Deadbeat": "design.deadbeat",
    "DesignError": "design.deadbeat",
    "Diagnosis": "diagnosis.diagnose",
    "Friction": "models.friction",
    "Machine": "models.machine",
    "MachineError": "models.machine",
    "Mode": "models.plant",
    "PID": "models.controller",
    "Plant": "models.plant",
    "Record": "models.records.record",
    "Response": "models.simulation.simulator",
    "Trajectory": "design.trajectory.history_aware",
    "TrajectoryLimits": "design.trajectory.history_aware:Limits",
    "TrajectoryTask": "design.trajectory.history_aware:Task",
    "Tuning": "design.pid.problem",
    "Validation": "studies.validation",
    "Variation": "models.variation",
    "assemble": "design.controller",
    "assess_loop": "design.loop:assess",
    "build_trajectory": "design.trajectory.history_aware:build",
    "design_deadbeat": "design.controller",
    "diagnose": "diagnosis.diagnose",
    "drawn": "models.variation",
    "feeding_sequence": "models.records.record",
    "frequency_response": "models.plant",
    "friction_branch": "models.friction:branch",
    "friction_elements": "models.friction:elements",
    "load_controller": "models.controller:load",
    "load_machine": "models.machine:load",
    "plot": "reports.plot",
    "read_record": "models.records.files",
    "settling_time": "models.records.settling",
    "shortest_settling_time": "design.deadbeat",
    "simulate": "models.simulation.simulator",
    "simulate_many": "models.simulation.simulator",
    "solve_trajectory": "design.trajectory.history_aware:solve",
    "tune_pid": "design.pid.tuning",
    "validate": "studies.validation",
    "varied": "models.variation",
}

__all__ = [*_WHERE]  # noqa: PLE0604  (the keys are text)

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
