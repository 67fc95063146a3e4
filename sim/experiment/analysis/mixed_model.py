"""The mixed model of a comparison: drivers differ in their level and in their effect, and conditions in their noise.

Where each driver drives one condition only, drivers have a level of their own and no effect.

`value = level + effect · condition + cell + position + level of the driver + effect of the driver · condition + noise`,
with the last three random. The noise of the noisier condition has a part of its own, because one condition may scatter
several times as much as another. The model is fitted by restricted maximum likelihood (statsmodels, MixedLM). It is an
independent check of the interval from resampled participants.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from das.domain.errors import DasError
from sim.experiment.analysis.reading import Floats, RunStudy, Texts
from sim.experiment.plan import PlannedComparison

BOUNDARY: Final = 0.01
"""A variance below this share of the residual variance counts as 0, and the fit as singular: the optimizer ends near
0, not at 0. statsmodels warns of the boundary at the same share."""
CERTAIN: Final = 0.999
"""A fit in which the drivers' level and effect correlate by more than this (±) counts as singular as well."""
LEAST_DRIVERS: Final = 5
"""Fewest drivers for which a model is fitted."""
METHODS: Final = ("bfgs", "lbfgs", "powell")


@dataclass(frozen=True, kw_only=True)
class MixedFit:
    """A fitted mixed model, in the unit of the measure; standard deviations that cannot be told apart are NaN.

    `effect` is the difference a − b with its 95 % interval. `noise` has the residual standard deviations at a and b.
    `remarks` says in sentences what is wrong with the fit: singular, not converged, or simplified.
    """

    effect: float
    interval: tuple[float, float]
    level_sd: float
    effect_sd: float
    noise: tuple[float, float]
    singular: bool
    converged: bool
    remarks: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class _Data:
    """The rows of a comparison: values standardised over all rows (`scale`), condition +½ for a and −½ for b."""

    values: Floats
    scale: float
    condition: Floats
    within: bool
    driver: Texts
    fixed: Floats
    days: Texts | None


def fit_mixed_model(study: RunStudy, comparison: PlannedComparison) -> MixedFit:
    """Fit the mixed model of a comparison; DasError where it cannot be fitted."""
    data = _data(study, comparison)
    slopes = data.within and _told_apart(data)
    noisier = _noisier(data)
    return _as_fit(data, _fitted(data, slopes, noisier), slopes, noisier)


def _data(study: RunStudy, comparison: PlannedComparison) -> _Data:
    trials, rows = study.trials, study.rows(comparison)
    values, driver = trials.values[comparison.measure][rows], trials.participant[rows]
    if len(np.unique(driver)) < LEAST_DRIVERS:
        raise DasError(f"fewer than {LEAST_DRIVERS} drivers")
    within = study.plan.factor(comparison.factor).within
    if not within and len(rows) < 1.5 * len(np.unique(driver)):
        raise DasError("each driver made only one trial, so the level of a driver cannot be told from chance")
    scale = float(values.std())
    if scale <= 1e-12 * max(float(np.abs(values).max()), 1e-300):
        raise DasError("all values are the same")
    condition = np.where(trials.levels[comparison.factor][rows] == comparison.a, 0.5, -0.5)
    other = study.conditions(rows, without=comparison.factor)
    days = np.array([f"{one} {day}" for one, day in zip(other, trials.day[rows], strict=True)])
    met = [len(np.unique(driver[days == day])) for day in np.unique(days)]
    shared = float(np.mean(met)) >= 2.0 and len(met) <= len(rows) // 4
    position = trials.position[rows].astype(np.float64)
    columns = [np.ones(len(rows)), condition, *_indicators(days if shared else other), position - position.mean()]
    return _Data(
        values=(values - values.mean()) / scale, scale=scale, condition=condition, within=within, driver=driver,
        fixed=_independent(np.column_stack(columns)), days=None if shared else days,
    )  # fmt: skip


def _indicators(cells: Texts) -> list[Floats]:
    """A column for each cell but the first: 1 in the rows of that cell."""
    return [(cells == one).astype(np.float64) for one in np.unique(cells)[1:]]


def _independent(columns: Floats) -> Floats:
    """The columns that do not depend linearly on those before them."""
    kept: list[int] = []
    for index in range(columns.shape[1]):
        if np.linalg.matrix_rank(columns[:, [*kept, index]]) > len(kept):
            kept.append(index)
    return columns[:, kept]


def _told_apart(data: _Data) -> bool:
    """Whether drivers have several trials in a condition, so that a driver's own effect can be told from noise."""
    counts = [
        min(np.sum(data.condition[data.driver == one] == level) for level in (-0.5, 0.5)) for one in set(data.driver)
    ]
    return float(np.mean(counts)) >= 1.5


def _noisier(data: _Data) -> float:
    """The condition (±½) whose values scatter more about the mean of each driver."""
    scatter = {}
    for level in (-0.5, 0.5):
        mine = data.condition == level
        rest = (
            data.values[mine] - data.fixed[mine] @ np.linalg.lstsq(data.fixed[mine], data.values[mine], rcond=None)[0]
        )
        names = data.driver[mine]
        scatter[level] = sum(float(((rest[names == one] - rest[names == one].mean()) ** 2).sum()) for one in set(names))
    return max(scatter, key=lambda level: scatter[level])


def _fitted(data: _Data, slopes: bool, noisier: float) -> Any:
    """The fitted model of statsmodels; its warnings are left out, because `MixedFit` says what is wrong with a fit."""
    from statsmodels.regression.mixed_linear_model import MixedLM, VCSpec

    groups = sorted(set(data.driver.tolist()))
    rows = [np.flatnonzero(data.driver == one) for one in groups]
    noises = slopes or not data.within
    parts = {"noise": [np.eye(len(one))[:, data.condition[one] == noisier] for one in rows]} if noises else {}
    if data.days is not None and slopes:  # a day driven once, by one driver, cannot be told from noise
        parts["day"] = [
            np.column_stack([data.days[one] == day for day in np.unique(data.days[one])]) * 1.0 for one in rows
        ]
    spec = VCSpec(
        list(parts),
        [[[f"{name}{i}" for i in range(mat.shape[1])] for mat in mats] for name, mats in parts.items()],
        list(parts.values()),
    )
    random = np.column_stack([np.ones(len(data.values)), data.condition][: 2 if slopes else 1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = MixedLM(data.values, data.fixed, groups=data.driver, exog_re=random, exog_vc=spec if parts else None)
        try:
            return model.fit(reml=True, method=list(METHODS), maxiter=300)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            raise DasError(f"the fit broke off ({error})") from error


def _as_fit(data: _Data, result: Any, slopes: bool, noisier: float) -> MixedFit:
    from scipy import stats

    scale, residual = data.scale, float(result.scale)
    random = np.atleast_2d(np.asarray(result.cov_re, dtype=np.float64))
    extra = (
        dict(zip(result.model.exog_vc.names, np.asarray(result.vcomp).tolist(), strict=True))
        if len(result.vcomp)
        else {}
    )
    variances = np.diag(random)
    small = variances < BOUNDARY * residual
    certain = slopes and not small.any() and abs(random[0, 1]) > CERTAIN * math.sqrt(float(variances.prod()))
    louder = math.sqrt(residual + extra.get("noise", 0.0)) * scale
    quieter = math.sqrt(residual) * scale
    error = float(np.asarray(result.bse_fe)[1]) * scale
    effect = float(np.asarray(result.fe_params)[1]) * scale
    # Drivers are independent of each other, trials are not. So the t distribution has one degree of freedom less than
    # there are drivers, and two less if the drivers are in two groups.
    reach = float(stats.t.ppf(0.975, len(set(data.driver.tolist())) - (1 if data.within else 2))) * error
    deviations = [math.sqrt(max(float(one), 0.0)) * scale for one in variances]
    return MixedFit(
        effect=effect,
        interval=(effect - reach, effect + reach),
        level_sd=deviations[0],
        effect_sd=deviations[1] if slopes else math.nan,
        noise=(louder, quieter) if noisier > 0 else (quieter, louder),
        singular=bool(small.any() or certain),
        converged=bool(result.converged),
        remarks=tuple(_remarks(small.tolist(), certain, slopes or not data.within, bool(result.converged), error)),
    )


def _remarks(small: list[bool], certain: bool, slopes: bool, converged: bool, error: float) -> list[str]:
    said = []
    if not converged:
        said.append("The fit did not converge; do not use its figures.")
    if small[0]:
        said.append("Singular: drivers do not differ in their level by more than chance explains.")
    if small[1:] and small[1]:
        said.append("Singular: the effect does not differ between drivers by more than chance explains.")
    if certain:
        said.append(
            "Singular: level and effect of the drivers are completely correlated, so they cannot be told apart."
        )
    if not slopes:
        said.append(
            "Each driver made one trial in a condition, so effects of single drivers cannot be told from chance, "
            "and the model takes one effect and one noise for all."
        )
    if not math.isfinite(error):
        said.append("The standard error could not be computed.")
    return said
