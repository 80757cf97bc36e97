"""What is on the site, and where: the one place to change when a page is added."""

from __future__ import annotations

from dataclasses import dataclass, field

__all__ = ["DERIVATIONS", "MODULES", "OUTLINE", "Section"]


@dataclass(frozen=True)
class Section:
    """A part of the site: a folder of docs.

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
        "Start",
        "start",
        "Install it, find a first error, use your own files, and work on the page.",
        {
            "install": "docs/start/install.md",
            "first_diagnosis": "docs/start/first_diagnosis.md",
            "first_diagnosis_in_python": "examples/off_by_20_um.py",
            "page": "docs/start/page.md",
        },
        {
            "first_diagnosis": "My machine is off by 20 µm",
            "first_diagnosis_in_python": "The same in Python",
        },
    ),
    Section(
        "Guides",
        "guides",
        "One task each: import, plan, watch, fleets, Python, C code, your own effects and equations.",
        {
            "telescope": "examples/corrected_machine.py",
            "import": "docs/guides/import.md",
            "import_robots": "docs/guides/import_robots.md",
            "import_telescopes": "docs/guides/import_telescopes.md",
            "similar_effects": "docs/guides/similar_effects.md",
            "plan": "docs/guides/plan.md",
            "watch": "docs/guides/watch.md",
            "fleet": "docs/guides/fleet.md",
            "scale": "docs/guides/scale.md",
            "python": "docs/guides/python.md",
            "c": "docs/guides/c.md",
            "own_effect": "docs/guides/own_effect.md",
            "own_equations": "docs/guides/own_equations.md",
            "axis": "docs/guides/axis.md",
            "machines_to_copy_from": "examples/machines/README.md",
            "answers": "examples/machines/ANSWERS.md",
        },
        {
            "machines_to_copy_from": "Machines to copy from",
            "answers": "Their answers",
            "own_equations": "Your own equations",
        },
    ),
    Section(
        "Reference",
        "reference",
        "Files, effects, commands, JSON, kernels, and every function of the Python packages.",
        {
            "machine_file": "docs/reference/machine_file.md",
            "measurements": "docs/reference/measurements.md",
            "effects": "docs/reference/effects.md",
            "catalogue": "",
            "command_line": "docs/reference/command_line.md",
            "commands": "",
            "json": "docs/reference/json.md",
            "solve_axis": "docs/reference/solve_axis.md",
            "kernels": "",
            "python": "",
            "changes": "CHANGELOG.md",
        },
    ),
    Section(
        "Science",
        "science",
        "How a diagnosis decides, proofs, errors of the sources, accuracy, speed, and limits.",
        {
            "evidence": "docs/science/evidence.md",
            "ideas": "docs/science/ideas.md",
            "limits": "docs/science/limits.md",
            "trust": "docs/science/trust.md",
            "solver_method": "docs/science/solver_method.md",
            "accuracy": "docs/science/accuracy.md",
            "certified": "docs/science/certified.md",
            "benchmarks": "benchmarks/README.md",
            "derivations": "",
            "errata": "",
            "rodrigues_problem": "",
            "tricept_uncertainty": "",
            "spatial_mechanisms": "",
            "instantaneous_euler_angles": "",
        },
    ),
    Section(
        "Mechanisms",
        "mechanisms",
        "Machines on legs, robots and closed loops, and the papers that they come from.",
        {
            "tricept": "docs/mechanisms/tricept.md",
            "three_sps_s": "docs/mechanisms/three_sps_s.md",
            "instantaneous_euler": "docs/mechanisms/instantaneous_euler.md",
            "spatial_mechanisms": "docs/mechanisms/spatial_mechanisms.md",
            "mechanisms_to_copy_from": "examples/mechanisms/README.md",
        },
        {
            "three_sps_s": "A ball and three legs",
            "spatial_mechanisms": "Robots and closed loops",
            "mechanisms_to_copy_from": "Mechanisms to copy from",
        },
    ),
    Section(
        "Development",
        "dev",
        "How the code is organised, how to add to it, and the reasons for its design.",
        {
            "contributing": "CONTRIBUTING.md",
            "development": "docs/dev/development.md",
            "decisions": "docs/dev/decisions.md",
            "security": "SECURITY.md",
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
