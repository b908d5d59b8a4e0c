"""The paper's open-loop case: computed by independent formulations, compared, and written as a report."""
