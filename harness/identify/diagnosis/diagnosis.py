"""What is wrong with a log, as data and in words: the result of `diagnose`."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri

from gough_stewart.harness.identify.diagnosis.lack_of_fit import LEVEL, LackOfFit
from gough_stewart.harness.identify.names import unit_of
from gough_stewart.model.vectors import FloatArray

# Significance at which one hypothesis explains what another cannot.
SEPARATED = 0.01
COLOURED = "coloured noise"


@dataclass(frozen=True)
class Finding:
    """A hypothesis with its estimate."""

    name: str
    text: str
    parameters: tuple[str, ...]
    values: FloatArray  # (q,) [SI]
    covariance: FloatArray  # (q, q)
    improvement: float  # share of what the residuals have beyond noise, 0 to 1

    @property
    def standard_errors(self) -> FloatArray:
        """Square roots of the variances (q,) [SI]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def interval(self) -> FloatArray:
        """Lower and upper ends of the 95 % confidence intervals (q, 2) [SI]."""
        half = ndtri(0.975) * self.standard_errors
        return np.stack([self.values - half, self.values + half], axis=1)


class CommonGain(NamedTuple):
    """What a gain of all forces alike would do, which residuals hardly show."""

    standard_error: float  # of the gain, if it were estimated too
    names: tuple[str, ...]  # parameters that it would change by more than their standard errors
    standard_errors: FloatArray  # of those, if the gain were estimated too [SI]


@dataclass(frozen=True)
class Diagnosis:
    """Whether a log contradicts the model, and what is most likely wrong."""

    test: LackOfFit | None  # None if there is none, and why
    findings: tuple[Finding, ...]  # the named one first; empty without an alarm
    not_separated: tuple[str, ...]  # hypotheses that the data do not tell from the first
    remains: float  # p-value of what is left after the first finding
    common_gain: CommonGain | None
    force_noise: FloatArray  # standard deviation of the raw forces (6,) [N]
    length_noise: float  # of the raw lengths [m]
    whiteness: FloatArray  # p-values that the prewhitened residuals of the legs are white (6,)
    untested: str = ""  # why there is no test

    @property
    def alarm(self) -> bool:
        """Whether the log contradicts the model."""
        return self.test is not None and self.test.alarm

    @property
    def alarms(self) -> tuple[str, ...]:
        """The reason not to trust the fit, in words; empty without an alarm."""
        if self.test is None or not self.alarm:
            return ()
        said = (
            f"the log contradicts the model (p {_p(self.test.combined)}; a false alarm in {100 * LEVEL:.0f} of 100 "
            "logs); values and intervals are not valid"
        )
        if self.findings:
            said += f". Most likely: {self.findings[0].text}"
        return (said,)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The diagnosis in words, without the alarm."""
        said = []
        if self.test is None:
            said.append(f"not tested whether the model fits: {self.untested}")
        elif not self.alarm:
            said.append(f"the residuals are those of noise (p = {self.test.combined:.2g} of lack of fit)")
        if self.findings:
            first = self.findings[0]
            share = f"; this explains {100 * first.improvement:.0f} % of the misfit" if first.name != COLOURED else ""
            said.append(f"most likely: {first.text}{share}")
            if self.not_separated:
                said.append(f"not separated from it by this log: {'; '.join(self.not_separated)}")
            if self.remains < SEPARATED and first.name != COLOURED:
                said.append(f"something else is left after that (p {_p(self.remains)})")
        if self.common_gain is not None and any(unit_of(name) == "kg" for name in self.common_gain.names):
            found = self.common_gain
            parts = ", ".join(
                f"{name} to ± {1.96 * s:.2g} kg"
                for name, s in zip(found.names, found.standard_errors, strict=True)
                if unit_of(name) == "kg"
            )
            said.append(
                "a gain common to all forces looks like other masses: intervals assume that it is 1. Were it unknown, "
                f"this log would give it to ± {196 * found.standard_error:.2g} %, and {parts}. A known added mass or a "
                "calibrated force sensor separates them"
            )
        return tuple(said)

    def to_dict(self) -> dict[str, object]:
        """Plain data for files."""
        return {
            "alarm": self.alarm,
            "p_value": None if self.test is None else self.test.combined,
            "p_values": {} if self.test is None else self.test.p_values,
            "findings": [
                {
                    "hypothesis": each.name,
                    "text": each.text,
                    "improvement": each.improvement,
                    "parameters": {
                        name: {"value": v, "standard_error": s, "interval": i, "unit": _unit(name)}
                        for name, v, s, i in zip(
                            each.parameters, each.values, each.standard_errors, each.interval, strict=True
                        )
                    },
                }
                for each in self.findings
            ],
            "not_separated": self.not_separated,
            "p_value_of_the_rest": self.remains if self.findings else None,
            "common_force_gain": None
            if self.common_gain is None
            else {
                "standard_error": self.common_gain.standard_error,
                "standard_errors_with_it": dict(
                    zip(self.common_gain.names, self.common_gain.standard_errors.tolist(), strict=True)
                ),
            },
            "noise": {"force": self.force_noise, "length": self.length_noise},
            "sentences": self.sentences,
        }


def _p(value: float) -> str:
    return f"= {value:.2g}" if value > 3e-4 else "< 0.0003"


def _unit(name: str) -> str:
    try:
        return unit_of(name)
    except KeyError:
        return ""
