"""The nonsmooth machine as C99, so that a law on any controller can be tested against it before it meets the axis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from design.deployment.hooks_in_c import in_c
from design.deployment.templating import filled, hexadecimal
from models.effects.base import Effect, Place
from models.effects.catalogue import named
from models.machine import Machine
from models.simulation.simulator import substeps_of

LEFT_OUT: Final = {Place.CONTROL: "it is in the controller's law, not in the axis"}


@dataclass(frozen=True)
class HookSource:
    """A hook in C: its place, name and code, and where its effect's parameters and memory begin."""

    place: str
    name: str
    code: str
    parameters: int
    memory: int


@dataclass(frozen=True)
class PlantNumbers:
    """What the plant's template is filled with; SI."""

    sample_time: float
    modes: int
    by_friction: int
    counts: tuple[int, ...]
    step: tuple[float, ...]
    phi: tuple[float, ...]
    gamma: tuple[float, ...]
    delay: int
    stiffness: tuple[float, ...]
    limit: tuple[float, ...]
    damping: tuple[float, ...]
    thrust_limit: float
    resolution: float
    offset: float
    parameters: tuple[float, ...]
    memory: int
    hooks: tuple[HookSource, ...]
    places: tuple[str, ...]


def plant_sources(machine: Machine) -> dict[str, str]:
    """The sources by file name; SI units inside. Raises `hooks_in_c.HookError` for an effect that C cannot have."""
    numbers = plant_numbers(machine)
    left = {name: reason for name, effect in named(machine.effects).items() if (reason := _left_out(effect))}
    return {
        f"axis_plant.{end}": filled(
            f"axis_plant.{end}.j2", hexadecimal, m=numbers, effects=bool(machine.effects), left_out=left
        )
        for end in ("h", "c")
    }


def plant_numbers(machine: Machine) -> PlantNumbers:
    """The plant's numbers [SI] as the simulator has them."""
    sampled, friction = substeps_of(machine), machine.friction
    hooks, parameters, memory = _hooks([one for one in machine.effects if not _left_out(one)], len(friction.limit))
    return PlantNumbers(
        sample_time=machine.sample_time,
        modes=sampled.phi.shape[1],
        by_friction=sampled.by_friction,
        counts=tuple(sampled.counts.tolist()),
        step=tuple(sampled.step.tolist()),
        phi=tuple(sampled.phi.ravel().tolist()),
        gamma=tuple(sampled.gamma.ravel().tolist()),
        delay=sampled.delay,
        stiffness=friction.stiffness,
        limit=friction.limit,
        damping=friction.damping,
        thrust_limit=machine.drive.rated_thrust,
        resolution=machine.scale.resolution,
        offset=machine.drive.offset,
        parameters=parameters,
        memory=memory,
        hooks=hooks,
        places=tuple(place.name.lower() for place in Place if place not in LEFT_OUT),
    )


def _left_out(effect: Effect) -> str:
    return next((reason for place, reason in LEFT_OUT.items() if place in effect.hooks), "")


def _hooks(effects: list[Effect], elements: int) -> tuple[tuple[HookSource, ...], tuple[float, ...], int]:
    """The hooks in C, all effects' parameters, and how many numbers they keep; as models.simulation.hooks.pack."""
    found, parameters, memory = list[HookSource](), list[float](), 0
    for i, effect in enumerate(effects):
        size = effect.memory(elements)
        for place, hook in effect.hooks.items():
            name = f"effect_{i}_{place.name.lower()}"
            code = in_c(name, hook, size)
            found.append(HookSource(place.name.lower(), name, code, len(parameters), memory))
        parameters += effect.values().tolist()
        memory += size
    return tuple(found), tuple(parameters), memory
