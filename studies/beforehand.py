"""What a study asks of a machine before any work, so that what cannot be worked on is refused at once, in one line."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from design import feasibility
from design.controller import bare_controller
from design.deadbeat import DesignError
from models.controller import Controller
from models.machine import Machine
from studies.options import BadInputError


def require_designable(machine: Machine, option: str = "--machine") -> None:
    """Raises BadInputError for a machine on which no feedforward could be judged; the option that gave it is named."""
    _ask(feasibility.require_designable, machine, option)


def require_controller(machine: Machine) -> Controller:
    """The controller that the machine's specification asks for. Raises BadInputError where there is none.

    It is without friction compensation, whose number of elements may take a search.
    """
    require_designable(machine)
    try:
        return bare_controller(machine)
    except DesignError as error:
        raise BadInputError(f"--machine: {error}") from error


def require_stable(machine: Machine, option: str = "--machine") -> None:
    """Raises BadInputError for a machine whose feedback makes an unstable loop; the option that gave it is named."""
    _ask(feasibility.require_stable, machine, option)


def require_pid(machine: Machine) -> None:
    """Raises BadInputError where another feedback runs than a plain PID, around which the study designs."""
    _ask(feasibility.require_pid, machine, "--machine")


def require_members(members: Iterable[Machine]) -> None:
    """`require_designable` of every member of the ensemble of --ensemble; the message names the member."""
    for member in members:
        _ask(feasibility.require_designable, member, f"--ensemble: {member.name}")


def _ask(require: Callable[[Machine], None], machine: Machine, option: str) -> None:
    try:
        require(machine)
    except DesignError as error:
        raise BadInputError(f"{option}: {error}") from error
