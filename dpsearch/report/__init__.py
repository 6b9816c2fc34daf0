"""Results of many runs: statistics, tables, figures and the pages that hold them."""

from dpsearch.report.statistics import bootstrap_interval, success_interval
from dpsearch.report.tables import Row, Section, Table

__all__ = ["Row", "Section", "Table", "bootstrap_interval", "success_interval"]
