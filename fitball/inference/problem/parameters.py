"""Which parameters a fit has: free with a prior, or fixed at a value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fitball.errors import ParameterError, suggestion
from fitball.inference.problem.noise import KINDS
from fitball.inference.problem.priors import Prior, parse_prior
from fitball.models.specs import POSITIVE, ParameterSpec
from fitball.observables import OBSERVABLES, SHARED_NOISE, SHARED_SD, ColumnNoise


def _spec(noise: ColumnNoise, unit: str) -> ParameterSpec:
    prior = f"lognormal({noise.typical}, 0.7)"
    words = f"noise of {noise.of}"
    shown = next((column.shown for column in OBSERVABLES.values() if column.noise is noise), None)
    return ParameterSpec(
        noise.name, unit, noise.lower, noise.upper, prior, words, noise.symbol, possible=POSITIVE, shown=shown
    )


# Noise of the measurement, one standard deviation, common to all rows that state none of their own.
SD_SPECS: Mapping[str, ParameterSpec] = {
    SHARED_SD: _spec(SHARED_NOISE, OBSERVABLES["v_x2"].unit),
    **{column.noise.name: _spec(column.noise, column.unit) for column in OBSERVABLES.values()},
}
# What separates force records from the model; where there are records, their size centres the first prior.
FORCE_NOISE = ("force_sd", "force_misfit")
_FORCE_SPECS: Mapping[str, ParameterSpec] = {
    "force_sd": ParameterSpec(
        "force_sd", "N", 1e-3, 1e4, "lognormal(10, 1.0)", "noise of one sample of a force record", r"$\sigma_F$"
    ),
    "force_misfit": ParameterSpec(
        "force_misfit", "", 1e-4, 3.0, "lognormal(0.03, 1.0)",
        "slow misfit of the model's force to a record, as a share of its peak", r"$\delta_F$",
        shown=("%", 1e2),
    ),
}  # fmt: skip
NOISE_SPECS: Mapping[str, ParameterSpec] = {
    **SD_SPECS,
    **_FORCE_SPECS,
    **{spec.name: spec for kind in KINDS.values() for spec in kind.parameters},
}


@dataclass(frozen=True)
class Parameter:
    """A parameter of a fit: its spec, its prior, and the value it is fixed at (None when free). `prior_source` is
    where a prior from the literature was published, empty for any other.
    """

    spec: ParameterSpec
    prior: Prior
    fixed: float | None
    fixed_because: str = ""
    prior_source: str = ""

    @property
    def name(self) -> str:
        """The name of the parameter."""
        return self.spec.name

    @property
    def free(self) -> bool:
        """Whether the data may move it."""
        return self.fixed is None


def build_parameters(
    names: Sequence[str],
    specs: Mapping[str, ParameterSpec],
    priors: Mapping[str, str],
    fixed: Mapping[str, tuple[float, str]],
    ball_names: Sequence[str] = (),
    extra: Mapping[str, ParameterSpec] | None = None,
    sources: Mapping[str, str] | None = None,
) -> tuple[Parameter, ...]:
    """Parameters called `names`, with overridden `priors`, and `fixed` name -> (value, why).

    `specs` are those of the model, `extra` are further parameters that only this problem has, by name; `sources` is
    where priors were published. Raises
    ParameterError for a name that is not among them, a value outside its bounds, or a bad prior.
    """
    others = extra or {}
    everything = (*names, *ball_names, *others)
    for kind, given in (("prior", priors), ("fixed value", fixed)):
        for name in given:
            if name not in everything:
                raise ParameterError(f"{kind} for unknown parameter '{name}': {suggestion(name, everything)}")
    built = []
    for name in everything:
        spec = others.get(name) or NOISE_SPECS.get(name) or specs[name]
        prior = parse_prior(name, priors.get(name, spec.prior), spec.lower, spec.upper, spec.unit)
        value, why = fixed.get(name, (None, ""))
        if value is not None and not spec.lower <= value <= spec.upper:
            raise ParameterError(
                f"fixed value {name} = {value:g}"
                + (f" {spec.unit}" if spec.unit else "")
                + f" lies outside its bounds [{spec.lower:g}, {spec.upper:g}]"
            )
        built.append(Parameter(spec, prior, value, why, "" if sources is None else sources.get(name, "")))
    return tuple(built)
