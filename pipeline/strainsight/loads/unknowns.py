"""What is estimated beside the states, and where each stands in the augmented state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from strainsight.errors import ConfigError
from strainsight.loads.input_models import (
    RANDOM_WALK,
    InputModel,
    block_diagonal,
    component_names,
    components,
    rate_matrix,
)
from strainsight.rom.model import ReducedModel


@dataclass(frozen=True)
class Unknowns:
    """x* = [q, q̇, ζ of every input one behind the other, p] with uᵢ = amplitudeᵢ ũᵢ, ũᵢ = ζ₁ of input i, ζ̇ = A_u ζ + w,
    and θᵢ = guessᵢ exp(pᵢ).

    inputs, parameters: names in the order of x*; amplitude: input → [N]; guess: parameter → [SI], positive;
    models: input → its model in time, a random walk where none is given, so that ζ = ũ; frequency: input → that of the load [Hz],
    which parameters that are judged beside free loads ask for.
    All may hold more names than are unknown. Raises ConfigError where a scale is missing or not positive.
    """

    inputs: tuple[str, ...]
    parameters: tuple[str, ...]
    amplitude: Mapping[str, float]
    guess: Mapping[str, float]
    models: Mapping[str, InputModel] = field(default_factory=dict)
    frequency: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for names, scales, word in (
            (self.inputs, self.amplitude, "amplitude"),
            (self.parameters, self.guess, "guess"),
        ):
            for name in names:
                value = scales.get(name)
                if value is None or not 0 < value < np.inf:
                    raise ConfigError(f"{word} of {name} is {value}", remedy=f"give {name} a positive {word}")

    @property
    def names(self) -> tuple[str, ...]:
        """Inputs, then parameters: the unknowns themselves."""
        return self.inputs + self.parameters

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of all states behind [q, q̇]: an input, the rates its model has beside it, …, the parameters."""
        own = (component_names(self.model_of(name), name) for name in self.inputs)
        return tuple(part for names in own for part in names) + self.parameters

    @property
    def count(self) -> int:
        """Number of unknowns; their models may need more states than that."""
        return len(self.inputs) + len(self.parameters)

    @property
    def scale(self) -> np.ndarray:
        """Amplitudes, then guesses (count,) [N and SI]: a small change of the i-th unknown is scaleᵢ dx*."""
        return np.array([self.amplitude[i] for i in self.inputs] + [self.guess[p] for p in self.parameters])

    @property
    def state_scale(self) -> np.ndarray:
        """`scale` for every name of `state_names`: rates of an input have its amplitude."""
        lengths = [*self.lengths, *(1 for _ in self.parameters)]
        return np.repeat(self.scale, lengths)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Length of ζ of every input."""
        return tuple(components(self.model_of(name)) for name in self.inputs)

    def model_of(self, name: str) -> InputModel:
        """The model of one input."""
        return self.models.get(name, RANDOM_WALK)

    def frequency_of(self, name: str) -> float:
        """Typical frequency [Hz] of one input. Raises ConfigError where none is given."""
        value = self.frequency.get(name)
        if value is None or not 0 < value < np.inf:
            raise ConfigError(f"frequency of {name} is {value}", remedy=f"give {name} a positive frequency")
        return value

    def rate_matrix(self) -> np.ndarray:
        """A_u of all inputs (Σk, Σk) [1/s], block by block."""
        return block_diagonal([rate_matrix(self.model_of(name)) for name in self.inputs])

    def size(self, model: ReducedModel) -> int:
        """n* = 2n + the states of the inputs' models + parameters."""
        return 2 * model.size + sum(self.lengths) + len(self.parameters)

    def position(self, model: ReducedModel) -> np.ndarray:
        """Where every unknown stands in x* (count,), in the order of `names`: of an input its ũ, the first of its ζ."""
        starts = np.cumsum([0, *self.lengths])
        own = np.concatenate([starts[:-1], starts[-1] + np.arange(len(self.parameters))])
        return (2 * model.size + own).astype(int)

    def input_columns(self, model: ReducedModel) -> list[int]:
        """Columns of the model's input shape that belong to the unknown inputs, in their order."""
        return [model.inputs.index(name) for name in self.inputs]
