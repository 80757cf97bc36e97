"""One page with what a diagnosis found: `write_report`."""

from rodgen.output.report.page import report_page, write_fleet_report, write_report

__all__ = ["report_page", "write_fleet_report", "write_report"]
