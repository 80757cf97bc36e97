"""From the steps of a machine's model to the programs that a fit runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rodgen.codegen.tape import Tape, with_known
from rodgen.codegen.tape_jacobian import jacobian_row
from rodgen.machines.algebra import TapeBuilder, on_tape
from rodgen.machines.closed_chain import closed_chain, pose_of
from rodgen.machines.model_steps import ModelSteps
from rodgen.machines.structure import Structure

if TYPE_CHECKING:
    from rodgen.codegen.program import Program


def derive_programs(structure: Structure) -> list[Program]:
    """Return the programs of a machine that a fit runs: ``place``, ``residual`` and ``residual_and_jacobian``.

    Returns
    -------
    list of Program
        With the inputs ``rows``, ``g``, ``e``; see :mod:`rodgen.machines.structure` for their layouts. ``place``
        has the output ``place``: the predicted point or direction, of poses followed by the matrix of the attitude, of
        attitudes and angles this matrix alone;
        ``residual`` measured less predicted, times the weight; ``residual_and_jacobian`` that and
        ``residual_jacobian``, (components, slots). Of a closed chain that needs a start also ``pose``: where its
        platform is, as a start for other values.
    """
    tape = Tape()
    algebra = on_tape(tape)
    place: TapeBuilder = model_kernel(ModelSteps(structure, "place", algebra, with_residual=False))
    residual: TapeBuilder = model_kernel(ModelSteps(structure, "residual", algebra))
    freedoms = residual.inputs.get("freedom", [])
    variables = [*freedoms, *residual.inputs["e"][: len(structure.parameters)]]
    inputs = {name: (len(x),) for name, x in residual.inputs.items() if name != "freedom"}
    values = residual.outputs["residual"]
    outputs: dict[str, dict[str, tuple[tuple[int, ...], Sequence[Any]]]] = {
        "place": {"place": ((len(place.outputs["place"]),), place.outputs["place"])},
        "residual": {"residual": ((len(values),), values)},
    }
    if variables:
        derivatives = jacobian_row(values, variables)
        shape = (len(values), len(variables))
        outputs["residual_and_jacobian"] = {
            **outputs["residual"],
            "residual_jacobian": (shape, derivatives),
        }
    if structure.kinematics.pose_numbers:
        pose = pose_of(ModelSteps(structure, "pose", algebra)).outputs["pose"]
        outputs["pose"] = {"pose": ((len(pose),), pose)}
    # the change of a freedom is in the geometry already
    wanted = [x for ports in outputs.values() for _, numbers in ports.values() for x in numbers]
    known = with_known(wanted, dict.fromkeys(freedoms, 0))
    return [
        tape.program(
            name,
            inputs,
            {port: (shape, [known.get(x, x) for x in numbers]) for port, (shape, numbers) in ports.items()},
        )
        for name, ports in outputs.items()
    ]


def model_kernel(steps: ModelSteps) -> Any:
    """Return the kernel of a model: its place, or its weighted residual."""
    s = steps.structure
    moves = s.moving
    inner, outer = range(s.inner), range(s.inner, len(s.joints))
    if s.measurand.line == "vertical":  # it stands still, as the bed does
        inner = range(0)
    axes_moved = steps.axes() if s.measurand.has_axes else []
    if s.kinematics.is_closed:
        x, turned = closed_chain(steps, steps.target(), axes_moved)
    else:
        x = steps.carried(steps.target(), outer, moves=moves)
        turned = [steps.carried(axis, range(len(s.joints)), moves=False) for axis in axes_moved]
    x = steps.carried(steps.lifted(x), inner, moves=moves)
    place = s.measurand.seen(steps, steps.framed(x, moves=moves))
    axes = None
    if axes_moved:
        axes = steps.matrix.hstack(*(steps.framed(axis, moves=False) for axis in turned))
    if not steps.with_residual:
        predicted = steps.matrix([*place, *([] if axes is None else axes)][-s.measurand.place_numbers :])
        steps.builder.output("place", predicted, unit="1", doc="predicted point, direction or attitude")
        return steps.builder.build()
    reading = steps.matrix([steps.column["reading", i] for i in range(s.measurand.inputs)])
    residual = s.measurand.residual(steps, reading, place, axes)
    weights = [steps.column["weight", i] for i in range(s.components)]
    weighted = steps.matrix([r * w for r, w in zip(residual, weights, strict=True)])
    if s.correlated:
        whitening = [steps.column["whitening", i] for i in range(s.components**2)]
        weighted = steps.matrix(s.components, s.components, whitening) * weighted
    steps.builder.output("residual", weighted, unit="1", doc="measured less predicted, times the weight")
    return steps.builder.build()
