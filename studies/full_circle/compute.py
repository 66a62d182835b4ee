"""The circle on one's own axis, or on withheld machines."""

from __future__ import annotations

from models.machine import Machine
from studies.beforehand import require_designable
from studies.full_circle import own_axis, trial
from studies.full_circle.options import CircleOptions
from studies.options import BadInputError
from studies.study import Answer, Progress


def compute(machine: Machine, options: CircleOptions, progress: Progress) -> Answer:
    """Answers the study's question. Raises BadInputError for options or records that can't be used."""
    if options.records is not None:
        if options.cases is not None:
            raise BadInputError("--cases: counts withheld machines; leave it out with --records")
        if options.machine is None:
            raise BadInputError("--records: needs the file of the machine that they are of; give --machine")
        return own_axis.compute(machine, options, progress)
    if options.machine is not None:
        require_designable(machine)
        raise BadInputError("--machine: is for the records of one's own axis; give --records FOLDER as well")
    return trial.compute(options, progress)
