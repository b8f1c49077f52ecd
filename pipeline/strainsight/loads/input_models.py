"""Time models of an unknown input: u = amplitude · ζ₁, ζ̇ = A_u ζ + w, every component of ζ of order one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import comb

import numpy as np
from scipy.linalg import block_diag

from strainsight.errors import ConfigError
from strainsight.rom.model import ReducedModel

MATERN_VARIANCE = (1 / 2, 1 / 4, 3 / 16)
"""∫|H|²dω/2π of H = 1/(1 + iω)^(p+1), p = 0, 1, 2: variance of a Matérn process of λ = 1 under unit white noise."""


WALK = 0.5 / np.pi
"""κ of both walks [-]: variance 2πκ = 1 in one period 2π/ω, that is, one amplitude a, or aω of the rate."""


@dataclass(frozen=True)
class RandomWalk:
    """ũ̇ = w of intensity κω: in an interval 1/ω the load changes by √κ amplitudes (the thesis)."""


@dataclass(frozen=True)
class IntegratedRandomWalk:
    """ũ̇ = ω r,  ṙ = w of intensity κω: the rate of the load is a random walk, the load itself is smooth.

    frequency [Hz], ω = 2π·frequency: the highest frequency of the load. In one period 2π/ω the variance of the rate u̇ = aω r
    grows by 2πκ(aω)²."""

    frequency: float
    kappa: float = WALK

    def __post_init__(self) -> None:
        _positive(self.frequency, "the frequency of an integrated random walk")
        _positive(self.kappa, "the factor kappa of an integrated random walk")


@dataclass(frozen=True)
class Matern:
    """Stationary, of variance amplitude²; spectrum ∝ 1/(λ² + ω²)^(ν+½), with ν − ½ continuous derivatives.

    smoothness ν: 0.5, 1.5 or 2.5; bandwidth [Hz]: where the spectrum is half its value at zero,
    λ = 2π·bandwidth / √(2^(1/(ν+½)) − 1). Source: Hartikainen and Särkkä, MLSP (2010)."""

    bandwidth: float
    smoothness: float = 1.5

    def __post_init__(self) -> None:
        _positive(self.bandwidth, "the bandwidth of a Matérn input")


@dataclass(frozen=True)
class Oscillator:
    """Stationary, of variance amplitude², about one frequency: ũ̇ = ωr,  ṙ = −ωũ − 2ζωr + w of intensity 4ζω.

    frequency [Hz]; damping ζ [-]: half the power lies within about 2ζ·frequency, and phase and amplitude drift in
    1/(ζω). Best for a load of known frequency, and poor at other frequencies."""

    frequency: float
    damping: float = 0.05

    def __post_init__(self) -> None:
        _positive(self.frequency, "the frequency of an oscillator input")
        _positive(self.damping, "the damping of an oscillator input")


SMOOTHNESS = {"1/2": 0.5, "3/2": 1.5, "5/2": 2.5}
"""ν of a Matérn process by its name."""
InputModel = RandomWalk | IntegratedRandomWalk | Matern | Oscillator
RANDOM_WALK = RandomWalk()


def input_model(
    word: str, frequency: float, kappa: float | None = None, smoothness: str = "3/2", damping: float = 0.05
) -> InputModel:
    """Input model from its name in the config; frequency [Hz]: typical for the load, kappa: of an integrated walk, smoothness: of
    matern, damping: of oscillator."""
    match word:
        case "integrated_random_walk":
            return IntegratedRandomWalk(frequency, WALK if kappa is None else kappa)
        case "matern":
            return Matern(frequency, SMOOTHNESS[smoothness])
        case "oscillator":
            return Oscillator(frequency, damping)
    return RANDOM_WALK


def components(model: InputModel) -> int:
    """Length of ζ."""
    match model:
        case RandomWalk():
            return 1
        case Matern():
            return round(model.smoothness + 0.5)
    return 2


def rate_matrix(model: InputModel) -> np.ndarray:
    """A_u (k, k) [1/s]; ζ = [ũ, ũ̇/s, ũ̈/s² …] with s = ω of walk and oscillator, λ of a Matérn process."""
    match model:
        case RandomWalk():
            return np.zeros((1, 1))
        case IntegratedRandomWalk():
            return _omega(model.frequency) * np.array([[0.0, 1.0], [0.0, 0.0]])
        case Oscillator():
            return _omega(model.frequency) * np.array([[0.0, 1.0], [-1.0, -2 * model.damping]])
    k = components(model)
    A = np.eye(k, k=1)
    A[-1] = [-comb(k, j) for j in range(k)]
    return _matern_rate(model) * A


def input_intensity(model: InputModel, walk: float) -> np.ndarray:
    """Q_u (k, k) [1/s] of ζ, on its last component; walk [1/s]: κω of a random walk, unused by the others.

    integrated random walk κω;  Matérn λ/∫|H|²dω/2π = 2λ, 4λ, 16λ/3;  oscillator 4ζω: the last two have var ũ = 1.
    """
    k = components(model)
    Q = np.zeros((k, k))
    match model:
        case RandomWalk():
            Q[-1, -1] = walk
        case IntegratedRandomWalk():
            Q[-1, -1] = model.kappa * _omega(model.frequency)
        case Matern():
            Q[-1, -1] = _matern_rate(model) / MATERN_VARIANCE[k - 1]
        case Oscillator():
            Q[-1, -1] = 4 * model.damping * _omega(model.frequency)
    return Q


def line_intensity(model: InputModel, frequency: float, duration: float) -> float:
    """Intensity [1/s] of the noise on the last component of ζ for which a sine of amplitude 1 over the duration of a record is at
    one σ:

        T/(2 |C (iω − A_u)⁻¹ B|²)

    This is the energy of the noise that drives the model along that sine: ω²T/2 and ωT/2 for the two walks.
    frequency [Hz], ω = 2π·frequency: that of the load; duration T [s]."""
    A = rate_matrix(model)
    response = np.linalg.inv(1j * _omega(frequency) * np.eye(len(A)) - A)[0, -1]
    return float(duration / (2 * np.abs(response) ** 2))


def _matern_rate(model: Matern) -> float:
    return float(_omega(model.bandwidth) / np.sqrt(2 ** (1 / (model.smoothness + 0.5)) - 1))


def _omega(frequency: float) -> float:
    return 2 * np.pi * frequency


def _positive(value: float, what: str) -> None:
    if not 0 < value < np.inf:
        raise ConfigError(f"{what} is {value}", remedy="Specify a positive number.")


def positive_of(values: Mapping[str, float], name: str, word: str) -> float:
    """The value of that name. Raises ConfigError if it is missing or not positive; word: name of the quantity."""
    value = values.get(name)
    if value is None or not 0 < value < np.inf:
        raise ConfigError(f"{word} of {name} is {value}", remedy=f"Specify a positive {word} of {name}.")
    return value


@dataclass(frozen=True)
class Unknowns:
    """x* = [q, q̇, ζ of every input in order, p] with uᵢ = amplitudeᵢ ũᵢ, ũᵢ = ζ₁ of input i, ζ̇ = A_u ζ + w, and
    θᵢ = guessᵢ exp(pᵢ).

    inputs, parameters: names in the order of x*; amplitude: input → [N]; guess: parameter → [SI], positive;
    models: input → its time model, default a random walk, so that ζ = ũ; frequency: input → that of the load [Hz], required to
    evaluate parameters jointly with free loads.
    All may contain further names. Raises ConfigError if a scale is missing or not positive."""

    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    amplitude: Mapping[str, float]
    guess: Mapping[str, float]
    models: Mapping[str, InputModel] = field(default_factory=dict)
    frequency: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.inputs:
            positive_of(self.amplitude, name, "amplitude")
        for name in self.parameters:
            positive_of(self.guess, name, "guess")

    @property
    def names(self) -> tuple[str, ...]:
        """Inputs, then parameters: the unknowns themselves."""
        return self.inputs + self.parameters

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of all states after [q, q̇]: an input and the rates in its model, …, the parameters."""
        of = ("{}", "rate of {}", "curvature of {}")
        parts = zip(self.inputs, self.lengths, strict=True)
        return tuple(word.format(name) for name, length in parts for word in of[:length]) + self.parameters

    @property
    def count(self) -> int:
        """Number of unknowns; their models may have more states."""
        return len(self.inputs) + len(self.parameters)

    @property
    def scale(self) -> np.ndarray:
        """Amplitudes, then guesses (count,) [N and SI]: a small change of the i-th unknown is scaleᵢ dx*."""
        return np.array([self.amplitude[i] for i in self.inputs] + [self.guess[p] for p in self.parameters])

    @property
    def state_scale(self) -> np.ndarray:
        """`scale` for every name of `state_names`; rates of an input have its amplitude."""
        return np.repeat(self.scale, [*self.lengths, *(1 for _ in self.parameters)])

    @property
    def lengths(self) -> tuple[int, ...]:
        """Length of ζ of every input."""
        return tuple(components(self.model_of(name)) for name in self.inputs)

    def model_of(self, name: str) -> InputModel:
        """The model of one input."""
        return self.models.get(name, RANDOM_WALK)

    def rate_matrix(self) -> np.ndarray:
        """A_u of all inputs (Σk, Σk) [1/s], block by block."""
        return block_diag(np.zeros((0, 0)), *(rate_matrix(self.model_of(name)) for name in self.inputs))

    def size(self, model: ReducedModel) -> int:
        """n* = 2n + the states of the inputs' models + parameters."""
        return 2 * model.size + sum(self.lengths) + len(self.parameters)

    def position(self, model: ReducedModel) -> np.ndarray:
        """Index of every unknown in x* (count,), in the order of `names`; for an input that of ũ, the first of its ζ."""
        starts = np.cumsum([0, *self.lengths])
        offset = np.concatenate([starts[:-1], starts[-1] + np.arange(len(self.parameters))])
        return (2 * model.size + offset).astype(int)

    def input_columns(self, model: ReducedModel) -> list[int]:
        """Columns of the input shape of the model for the unknown inputs, in their order."""
        return [model.inputs.index(name) for name in self.inputs]
