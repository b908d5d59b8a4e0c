"""The result of an ensemble, which displays itself."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from gough_stewart.harness.ensemble.data import EnsembleData

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from gough_stewart.harness.report.document import Report


@dataclass(frozen=True, eq=False, repr=False)
class Ensemble(EnsembleData):
    """An ensemble that has run; displays the quantiles of its metrics, and its failures."""

    def report(self, *, charts: bool = True, worst: "Sequence[int] | Mapping[int, str]" = ()) -> "Report":
        """How many machines complete their runs and how well, what fails, and what makes them differ.

        Parameters
        ----------
        charts
            Also bands over time, histograms and dependence.
        worst
            Members to list, or a mapping with the address of each one's page, "" for none.

        Returns
        -------
        Report
            Verdict, all metrics as numbers with a value for each member, tables, and with `charts` bands and
            distributions.
        """
        from gough_stewart.harness.ensemble.report import ensemble_report, worst_by
        from gough_stewart.harness.ensemble.sensitivity import sensitivity_if_known

        by = worst_by(self)
        return ensemble_report(self, by, sensitivity_if_known(self, by), worst, charts=charts)

    def __repr__(self) -> str:
        """Title and report as in the terminal."""
        from gough_stewart.harness.report.terminal import text_of

        return "\n".join([f"Ensemble: {self.title}", text_of(self.report(charts=False))])

    def _repr_html_(self) -> str:
        """The report, for a notebook."""
        from gough_stewart.harness.report.notebook import to_html

        return to_html(self.report(charts=False))
