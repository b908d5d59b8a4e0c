"""Frequency responses of a loop by injection: `[injection]` in a file, and the same in Python.

A known periodic force is added to the command of one leg, or of one mode of the platform; the loop's reaction gives its
frequency response: averages over periods, coherence, and confidence. Each kind of injection is one class; a new class
is all that a new kind needs.
"""

from abc import abstractmethod
from typing import Annotated, ClassVar, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from gough_stewart.harness.control.loop_margins import ComplexArray
from gough_stewart.harness.errors import ControllerError
from gough_stewart.harness.section import Band, Kind, PositiveForce, PositiveTime
from gough_stewart.model.vectors import FloatArray

ModeName = Literal["surge", "sway", "heave", "roll", "pitch", "yaw"]
MODES: tuple[ModeName, ...] = get_args(ModeName)
CONFIDENCE = 0.95
# The least number of periods in a run: one to settle, two to compare.
_LEAST_PERIODS = 2
# Number of random phase sets; the flattest signal is used.
_DRAWS = 50
# A shift register repeats after 2^n − 1 bits.
_REGISTERS = range(3, 21)
# Up to this share of its clock rate a random sequence has a nearly flat spectrum (it falls by 1 dB).
_FLAT_PART = 0.4
_LINES = 60


class InjectionChoice(Kind):
    """A force added to the command of one leg or mode, to measure the frequency response of the loop."""

    error: ClassVar[type[ControllerError]] = ControllerError
    leg: Annotated[int, Field(ge=1, le=6)] | None = None
    mode: ModeName | None = None  # a force along, or a torque about, a world axis
    amplitude: PositiveForce  # the largest force on a leg
    band: Band  # the lowest and the highest frequency
    period: PositiveTime | None = None  # after which the signal repeats; that of the lowest frequency by default
    settle: Annotated[int, Field(ge=0)] = 1  # number of periods at the beginning that are dropped
    seed: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _makes_sense(self) -> "InjectionChoice":
        if (self.leg is None) == (self.mode is None):
            raise ValueError(f"expected leg (1 to 6) or mode ({', '.join(MODES)}), and only one of them")
        low, high = np.asarray(self.band)
        if not 0 < low < high:
            raise ValueError(f"band is {low:g} to {high:g} Hz; expected two frequencies > 0, the lower one first")
        return self

    @abstractmethod
    def signal(self, sample_time: float) -> FloatArray:
        """One period at the samples (n,), with an absolute value of at most 1."""

    @property
    def channel(self) -> str:
        """The excited channel, for display."""
        return f"leg {self.leg}" if self.mode is None else self.mode

    def samples(self, sample_time: float) -> int:
        """Number of samples per period."""
        period = 1 / float(np.asarray(self.band)[0]) if self.period is None else self.period
        return max(1, round(period / sample_time))

    def lines(self, sample_time: float) -> NDArray[np.intp]:
        """The harmonics of the period in the band, at which the response is evaluated."""
        return _in_band(self.band, len(self.signal(sample_time)), sample_time)

    def directions(self, jacobian: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Forces a (6,) of the six legs, at most 1, and the row b (6,) that measures the excited channel, b a = 1.

        For a leg both are unit vectors. For a mode a = J⁻ᵀ e / max|J⁻ᵀ e|, forces that add up to a single force or
        torque, and b gives the force or torque Jᵀ u relative to that of a. J is the leg Jacobian (6, 6).
        """
        if self.leg is not None:
            unit = np.eye(6)[self.leg - 1]
            return unit, unit
        k = MODES.index(self.mode)
        forces = np.linalg.solve(jacobian.T, np.eye(6)[k])
        size = np.abs(forces).max()
        return forces / size, jacobian.T[k] * size

    def forces(self, count: int, sample_time: float, jacobian: FloatArray) -> FloatArray:
        """The injected force at every sample of a run (count, 6) [N]."""
        self.lines(sample_time)
        period, least = self.signal(sample_time), self.settle + _LEAST_PERIODS
        if count / len(period) < least:
            raise ControllerError(
                f"a run of {count * sample_time:g} s has {count / len(period):.3g} periods of "
                f"{len(period) * sample_time:g} s; expected at least {self.settle} to settle and {_LEAST_PERIODS} to "
                f"compare: a loop.duration of {least * len(period) * sample_time:g} s"
            )
        return self.amplitude * np.resize(period, count)[:, None] * self.directions(jacobian)[0]


class Multisine(InjectionChoice):
    """Sines of equal amplitude at harmonics of the period, with a low crest factor; best for a linear loop."""

    type: Literal["multisine"] = "multisine"
    # number of lines, spaced logarithmically over the band; fewer lines have larger amplitudes
    lines_at_most: Annotated[int, Field(ge=1)] = _LINES

    def lines(self, sample_time: float) -> NDArray[np.intp]:
        """At most `lines_at_most` harmonics in the band, spaced logarithmically."""
        inside = _in_band(self.band, self.samples(sample_time), sample_time)
        spaced = np.geomspace(inside[0], inside[-1], self.lines_at_most)
        return np.unique(np.clip(np.round(spaced), inside[0], inside[-1])).astype(np.intp)

    def signal(self, sample_time: float) -> FloatArray:
        """The flattest of several sums Σ cos(2π k t/n + φ_k) with random phases."""
        n, k = self.samples(sample_time), self.lines(sample_time)
        rng, best, smallest = np.random.default_rng(self.seed), np.zeros(n), np.inf
        for _ in range(_DRAWS):
            spectrum = np.zeros(n // 2 + 1, dtype=complex)
            spectrum[k] = np.exp(2j * np.pi * rng.uniform(size=len(k)))
            drawn = np.fft.irfft(spectrum, n)
            if np.abs(drawn).max() < smallest:
                best, smallest = drawn, np.abs(drawn).max()
        return np.asarray(best / smallest)


class Sweep(InjectionChoice):
    """A sine that sweeps the band once per period, linearly in time."""

    type: Literal["chirp"] = "chirp"

    def signal(self, sample_time: float) -> FloatArray:
        """sin(2π (f₁ t + (f₂ − f₁) t²/(2 T))), with whole cycles in the period T, so that it repeats without a jump."""
        n = self.samples(sample_time)
        low, high = np.asarray(self.band)
        turns = np.arange(n) / n
        cycles = max(1, round((low + high) / 2 * n * sample_time))
        slope = (high - low) / 2 * n * sample_time
        return np.asarray(np.sin(2 * np.pi * ((cycles - slope) * turns + slope * turns**2)))


class Prbs(InjectionChoice):
    """A pseudo-random binary sequence of maximum length: full amplitude at all times, so much power."""

    type: Literal["prbs"] = "prbs"

    def signal(self, sample_time: float) -> FloatArray:
        """Bits ±1, each held over some samples for a nearly flat spectrum in the band; the period may get longer."""
        hold = max(1, int(_FLAT_PART / (float(np.asarray(self.band)[1]) * sample_time)))
        bits = self.samples(sample_time) / hold
        register = next((r for r in _REGISTERS if 2**r - 1 >= bits), None)
        if register is None:
            raise ControllerError(
                f"a prbs of {bits:.3g} bits; expected at most {2 ** _REGISTERS[-1] - 1}: a shorter period"
            )
        state = np.random.default_rng(self.seed).integers(0, 2, register)
        from scipy.signal import max_len_seq

        state[-1] = 1  # a register of zeros would stay zero
        return np.repeat(2.0 * max_len_seq(register, state=state)[0] - 1, hold)


def _in_band(band: object, n: int, sample_time: float) -> NDArray[np.intp]:
    """The harmonics of a period of n samples in the band."""
    low, high = np.asarray(band)
    if not high < 0.5 / sample_time:
        raise ControllerError(
            f"band is {low:g} to {high:g} Hz at a sample_time of {sample_time:g} s; expected less than half the sample "
            f"rate, {0.5 / sample_time:g} Hz"
        )
    period = n * sample_time
    inside = np.arange(max(1, np.ceil(low * period - 1e-6)), np.floor(high * period + 1e-6) + 1)
    if not inside.size:
        raise ControllerError(
            f"band is {low:g} to {high:g} Hz, without a harmonic of the period of {period:g} s; expected a longer one"
        )
    return inside.astype(np.intp)


class Response(NamedTuple):
    """The response of one channel at the lines of the injection, the other channels closed."""

    S: ComplexArray  # u/d, from the injected to the total force
    radius: FloatArray  # of the 95 % confidence circle about S, or about T
    coherence: FloatArray  # share of the power of u that the injection explains, 0 to 1
    periods: int

    @property
    def T(self) -> ComplexArray:
        """1 − S: the share of the injected force that the controller cancels."""
        return np.asarray(1 - self.S)

    @property
    def L(self) -> ComplexArray:
        """1/S − 1, the loop transfer with this channel cut and the others closed."""
        return np.asarray(1 / self.S - 1)

    @property
    def loop_radius(self) -> FloatArray:
        """Radius of the circle about L: radius/|S|², valid while it is small."""
        return np.asarray(self.radius / np.abs(self.S) ** 2)


def response_of_periods(
    injected: FloatArray, force: FloatArray, samples: int, lines: NDArray[np.intp], settle: int
) -> Response:
    """S at the harmonics of a period, from forces (n,) [N], injected and total, at the samples of a loop.

    With D_p, U_p the transforms of period p: S = ∑ U_p D_p* / ∑ |D_p|², coherence |∑ U_p D_p*|² / (∑ |U_p|² ∑ |D_p|²).
    If the deviations between P periods are circular complex normal with variance s², |S − S_true|² P |D|²/s² has
    Fisher's distribution with 2 and 2 (P − 1) degrees of freedom [Pintelon & Schoukens, System Identification, 2012,
    ch. 2].

    Whole periods of so many samples count from the beginning, but for those that settle.
    """
    periods = len(force) // samples - settle
    if periods < 2:
        raise ControllerError(
            f"{len(force) / samples:.3g} periods, of which {settle} settle; expected at least two more: a longer run"
        )
    from scipy.special import fdtri  # slow to import

    used = slice(settle * samples, (settle + periods) * samples)
    D, U = (np.fft.rfft(values[used].reshape(periods, samples), axis=1)[:, lines] for values in (injected, force))
    power_of_d, power_of_u = (np.abs(D) ** 2).sum(axis=0), (np.abs(U) ** 2).sum(axis=0)
    if not (power_of_d > 0).all():
        raise ControllerError("the injection has no power at some of its lines; expected the injection of this run")
    cross = (U * D.conj()).sum(axis=0)
    S = cross / power_of_d
    variance = (np.abs(U - S * D) ** 2).sum(axis=0) / (periods - 1)
    quantile = fdtri(2, 2 * (periods - 1), CONFIDENCE)
    return Response(
        S, np.sqrt(quantile * variance / power_of_d), np.abs(cross) ** 2 / (power_of_u * power_of_d), periods
    )
