"""The case through the FMU, and what happens when it cannot go through."""

from dataclasses import replace
from typing import Any

import fmpy
import numpy as np
import pytest

from gough_stewart.fmu_build.build import VERSIONS
from gough_stewart.harness.paper import fmu_runs
from gough_stewart.harness.paper.fmu_runs import run_fmu
from gough_stewart.harness.paper.open_loop import run_kernel
from gough_stewart.harness.plants.unit import FmiType, FmuInstance
from gough_stewart.model.errors import StepError
from gough_stewart.model.formulations.cases import paper_case
from tests.support.fmu_plants import Fmu


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("fmi_type", ["CoSimulation", "ModelExchange"])
def test_states_are_those_of_the_kernel_at_every_row(fmus: dict[str, Fmu], version: str, fmi_type: FmiType) -> None:
    """Expected: DOP853 at 1e-12."""
    case = paper_case()
    assert np.abs(run_fmu(fmus[version].path, case, fmi_type) - run_kernel(case).states).max() <= 1e-7


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("fmi_type", ["CoSimulation", "ModelExchange"])
def test_a_case_that_the_plant_cannot_go_through_is_an_error_with_its_reason(
    fmus: dict[str, Fmu], version: str, fmi_type: FmiType
) -> None:
    """The paper's case passes a singular pose at 1.136 s."""
    with pytest.raises(StepError, match="singular"):
        run_fmu(fmus[version].path, replace(paper_case(), duration=1.5), fmi_type)


@pytest.mark.parametrize("says", [True, False])
def test_a_run_that_ends_early_or_warns_is_an_error(
    fmus: dict[str, Fmu], says: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Expected: a warning of the unit in the error's text, though all rows are there; too few rows without one."""
    simulate, made = fmpy.simulate_fmu, list[Any]()

    class Noted(FmuInstance):
        def __init__(self, *arguments: Any) -> None:
            super().__init__(*arguments)
            made.append(self)

    def simulated(*arguments: Any, **options: Any) -> Any:
        found = simulate(*arguments, **options)
        if says:
            made[-1].messages.append("a warning of the unit")
        return found if says else found[:-1]

    monkeypatch.setattr(fmu_runs, "FmuInstance", Noted)
    monkeypatch.setattr(fmpy, "simulate_fmu", simulated)
    with pytest.raises(StepError, match=r"FMI 3\.0 CoSimulation: rows") as caught:
        run_fmu(fmus["3.0"].path, paper_case(), "CoSimulation")
    assert ("a warning of the unit" in str(caught.value)) == says
