"""Figures: each is a function of data that returns a Plotly figure, for notebooks, commands, the report and web pages.

`save_figure` writes one into a file: ``.html`` works everywhere and needs no network; ``.png``, ``.svg`` and ``.pdf``
are drawn by Kaleido, which needs Chrome or Chromium. Functions are imported when they are first asked for, so that each
needs no more than what it draws.
"""

from importlib import import_module as _import_module
from typing import TYPE_CHECKING as _TYPE_CHECKING
from typing import Any as _Any

if _TYPE_CHECKING:
    from rodgen.output.figures.axis import axis_fit as axis_fit
    from rodgen.output.figures.comparisons import comparison as comparison
    from rodgen.output.figures.comparisons import residuals_in_order as residuals_in_order
    from rodgen.output.figures.diagnoses import diagnosis as diagnosis
    from rodgen.output.figures.diagnoses import planned_poses as planned_poses
    from rodgen.output.figures.distributions import (
        autocorrelation_of_residuals as autocorrelation_of_residuals,
    )
    from rodgen.output.figures.distributions import distribution_of_residuals as distribution_of_residuals
    from rodgen.output.figures.distributions import quantiles_of_residuals as quantiles_of_residuals
    from rodgen.output.figures.files import check_figure_name as check_figure_name
    from rodgen.output.figures.files import check_images as check_images
    from rodgen.output.figures.files import check_place as check_place
    from rodgen.output.figures.files import save_figure as save_figure
    from rodgen.output.figures.files import save_figures as save_figures
    from rodgen.output.figures.fleets import fleet_nights as fleet_nights
    from rodgen.output.figures.fleets import fleet_parameter as fleet_parameter
    from rodgen.output.figures.ladders import ladder as ladder
    from rodgen.output.figures.machines import residual_vectors as residual_vectors
    from rodgen.output.figures.machines import skeleton as skeleton
    from rodgen.output.figures.maps import residual_map as residual_map
    from rodgen.output.figures.mechanism import planar_representation as planar_representation
    from rodgen.output.figures.parallel import orientation_workspace as orientation_workspace
    from rodgen.output.figures.parallel import uncertainty_map as uncertainty_map
    from rodgen.output.figures.polar import joints_that_go_round as joints_that_go_round
    from rodgen.output.figures.polar import polar_plot as polar_plot
    from rodgen.output.figures.residuals import explained_marks as explained_marks
    from rodgen.output.figures.residuals import residual_plot as residual_plot

_PLACES = {
    "autocorrelation_of_residuals": "distributions",
    "axis_fit": "axis",
    "check_figure_name": "files",
    "check_images": "files",
    "check_place": "files",
    "comparison": "comparisons",
    "diagnosis": "diagnoses",
    "distribution_of_residuals": "distributions",
    "explained_marks": "residuals",
    "fleet_nights": "fleets",
    "fleet_parameter": "fleets",
    "joints_that_go_round": "polar",
    "ladder": "ladders",
    "orientation_workspace": "parallel",
    "planar_representation": "mechanism",
    "planned_poses": "diagnoses",
    "polar_plot": "polar",
    "quantiles_of_residuals": "distributions",
    "residual_map": "maps",
    "residual_plot": "residuals",
    "residual_vectors": "machines",
    "residuals_in_order": "comparisons",
    "save_figure": "files",
    "save_figures": "files",
    "skeleton": "machines",
    "uncertainty_map": "parallel",
}
"""The module of each function."""

__all__ = sorted(_PLACES)


def __getattr__(name: str) -> _Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(_import_module(f"{__name__}.{_PLACES[name]}"), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_PLACES})
