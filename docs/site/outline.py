"""What is on the site, and where: the one place to change when a page is added."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["DERIVATIONS", "MODULES", "OUTLINE", "Section"]


@dataclass(frozen=True)
class Section:
    """A part of the site: one of the four kinds of documentation, after Diátaxis.

    Attributes
    ----------
    title, folder, text : str
        The text is for the card on the first page.
    pages : dict of str to str
        Names of pages in the folder, and the files of the repository that they show; an empty one is generated.
    titles : dict of str to str
        Shorter titles for the table of contents.
    """

    title: str
    folder: str
    text: str
    pages: dict[str, str]
    titles: dict[str, str] = field(default_factory=dict)


OUTLINE = (
    Section(
        "Get started",
        "start",
        "Install it, and follow two machines from readings to the answer.",
        {
            "install": "docs/install.md",
            "my_machine_is_off": "docs/diagnose.md",
            "the_same_in_python": "examples/off_by_20_um.py",
            "axis_of_a_machine": "docs/tutorial.md",
        },
        {
            "my_machine_is_off": "My machine is off by 20 µm",
            "the_same_in_python": "The same in Python",
        },
    ),
    Section(
        "How-to guides",
        "how-to",
        "Machines of your own, measurements, code for controllers, robots, your own equations.",
        {
            "telescope": "examples/corrected_machine.py",
            "import": "docs/import.md",
            "similar_effects": "docs/similar_effects.md",
            "plan": "docs/plan.md",
            "watch": "docs/watch.md",
            "workbench": "docs/workbench.md",
            "fleet": "docs/fleet.md",
            "python": "docs/python.md",
            "own_effect": "docs/own_effect.md",
            "c": "docs/c.md",
            "machines_to_copy_from": "examples/machines/README.md",
            "answers": "examples/machines/ANSWERS.md",
            "solver": "docs/solver.md",
            "tricept": "docs/tricept.md",
            "three_sps_s": "docs/three_sps_s.md",
            "instantaneous_euler": "docs/instantaneous_euler.md",
            "spatial_mechanisms": "docs/spatial_mechanisms.md",
            "mechanisms_to_copy_from": "examples/mechanisms/README.md",
            "own_equations": "docs/own_equations.md",
        },
        {
            "machines_to_copy_from": "Machines to copy from",
            "answers": "Their answers",
            "solver": "The axis of one rotation",
            "three_sps_s": "A ball and three legs",
            "spatial_mechanisms": "Robots and closed loops",
            "mechanisms_to_copy_from": "Mechanisms to copy from",
            "own_equations": "Your own equations",
        },
    ),
    Section(
        "Reference",
        "reference",
        "Commands, files, the catalogue of effects, kernels, and every function of the Python packages.",
        {
            "command_line": "docs/command_line.md",
            "commands": "",
            "formats": "docs/formats.md",
            "effects": "",
            "kernels": "",
            "python": "",
            "changes": "CHANGELOG.md",
        },
    ),
    Section(
        "Explanation",
        "explanation",
        "The mathematics with its proofs, errors of the sources, accuracy, speed, and limits.",
        {
            "diagnosis_evidence": "docs/diagnosis_evidence.md",
            "solver_method": "docs/solver_method.md",
            "rodrigues_problem": "",
            "tricept_uncertainty": "",
            "spatial_mechanisms": "",
            "instantaneous_euler_angles": "",
            "derivations": "",
            "errata": "",
            "trust": "docs/trust.md",
            "accuracy": "docs/accuracy.md",
            "certified": "docs/certified.md",
            "benchmarks": "docs/benchmarks.md",
            "limits": "docs/limits.md",
            "scale": "docs/scale.md",
            "security": "SECURITY.md",
            "contributing": "CONTRIBUTING.md",
            "development": "docs/development.md",
            "decisions": "docs/decisions.md",
        },
    ),
)

DERIVATIONS = {
    "The axis of a rotation": ("rodrigues", "axis", "axis_sensitivity", "axis_fit", "helical_axis"),
    "Rotations and Euler angles": (
        "rotations",
        "instantaneous_euler",
        "instantaneous_euler_inverse",
        "instantaneous_euler_ridges",
        "instantaneous_euler_motion",
        "instantaneous_euler_arm",
    ),
    "Machines": (
        "machine_model",
        "effects",
        "closed_chain",
        "tricept",
        "tricept_uncertainty",
        "three_sps_s",
        "delta",
    ),
    "Robots and loops": (
        "spherical_polygons",
        "trig_equation",
        "biquadratic_pair",
        "spatial_links",
        "spatial_loops",
        "robots_6r",
    ),
}
"""The derivations by subject, in the order in which they are best read."""
NAMES = [name for names in DERIVATIONS.values() for name in names]
"""Their names, in this order."""

MODULES = {
    "rodgen": "The axis of a rotation, rotations, machines and measurements.",
    "rodgen.machines.machine": "A machine file.",
    "rodgen.data.measurements": "A measurement file.",
    "rodgen.calibration.fit": "Fits of machines to measurements.",
    "rodgen.calibration.compare": "Residuals compared with everything that was recorded.",
    "rodgen.calibration.diagnose": "The physical effect that a model lacks.",
    "rodgen.calibration.plan": "What to measure next.",
    "rodgen.calibration.watch": "New readings, watched for a change of the machine.",
    "rodgen.calibration.noise_floor": "The noise of readings.",
    "rodgen.calibration.determinacy": "What the data determine.",
    "rodgen.calibration.simulate": "Simulated measurements.",
    "rodgen.machines.emit": "Emitted code of a fitted machine.",
    "rodgen.output.report": "The report.",
    "rodgen.figures": "Figures.",
    "rodgen.tricept": "The Tricept.",
    "rodgen.three_sps_s": "A platform on a ball and three legs.",
    "rodgen.delta": "Delta robots and printers.",
    "rodgen.instantaneous_euler": "Instantaneous Euler angles.",
    "rodgen.screws": "Lines and screws.",
    "rodgen.spatial": "Robots and closed loops.",
    "rodgen.symbolic": "Equations: statements and proofs.",
    "rodgen.codegen": "Kernels: from equations to code.",
    "rodgen.errors": "Errors.",
}
"""Public modules, by the names under which users import them."""
