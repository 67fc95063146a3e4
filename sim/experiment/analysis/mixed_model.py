"""The mixed model of a comparison: drivers differ in their level and in their effect, and conditions in their noise.

Where each driver drives one condition only, drivers have a level of their own and no effect.

`value = level + effect · condition + cell + position + level of the driver + effect of the driver · condition + noise`,
with the last three random. The noise of the noisier condition has a part of its own, because one condition may scatter
several times as much as another. The model is fitted by restricted maximum likelihood (statsmodels, MixedLM). It is a
second opinion that decides nothing.

A fit without a standard error, or in which a part is not told from chance (singular), is not shown. The model is then
fitted again without the correlation of the drivers' level and effect, then with one noise, then without their effect.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from das.domain.errors import DasError
from sim.experiment.analysis.reading import Floats, RunStudy, Texts
from sim.experiment.plan import PlannedComparison

BOUNDARY: Final = 0.01
"""Share of the residual variance below which a variance counts as 0, and the fit as singular: the optimizer ends near
0, not at 0. statsmodels warns of the boundary at the same share."""
CERTAIN: Final = 0.999
"""Correlation (±) of the drivers' level and effect above which a fit counts as singular as well."""
STILL: Final = 1e-5
"""Share of the other's variance below which a condition counts as one that does not scatter."""
LEAST_DRIVERS: Final = 5
"""Fewest drivers for which a model is fitted."""
METHODS: Final = ("bfgs", "lbfgs", "powell")


@dataclass(frozen=True, kw_only=True)
class MixedFit:
    """A fitted mixed model, in the unit of the measure; standard deviations that cannot be told apart are NaN.

    `effect` is the difference a − b with its 95 % interval. `noise` has the residual standard deviations at a and b.
    `remark` says in a sentence what was left out of the model, and why; empty for the whole model.
    """

    effect: float
    interval: tuple[float, float]
    level_sd: float
    effect_sd: float
    noise: tuple[float, float]
    remark: str


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


class _Form(NamedTuple):
    """What a model has besides a level of each driver, and what is said where that is less than all.

    `slopes`: an effect of each driver, which may be `correlated` with his level. `noises`: a noise for each condition.
    """

    slopes: bool
    correlated: bool
    noises: bool
    said: str = ""


PAIRED: Final = (
    _Form(slopes=True, correlated=True, noises=True),
    _Form(slopes=True, correlated=False, noises=True, said="Levels and effects of drivers are taken as unrelated"),
    _Form(slopes=True, correlated=False, noises=False, said="One noise is taken for both conditions"),
    _Form(slopes=False, correlated=False, noises=True, said="One effect is taken for all drivers"),
    _Form(slopes=False, correlated=False, noises=False, said="One effect is taken for all drivers, and one noise"),
)
"""The models for drivers with several trials in a condition: each is fitted only if none before it can be shown."""
ONE_TRIAL: Final = (
    _Form(
        slopes=False, correlated=False, noises=False,
        said="One effect is taken for all drivers, and one noise, because each driver made one trial in a condition",
    ),
)  # fmt: skip
GROUPS: Final = (_Form(slopes=False, correlated=False, noises=True),)


def fit_mixed_model(study: RunStudy, comparison: PlannedComparison) -> MixedFit:
    """Fit the mixed model of a comparison, simplified where it must be; DasError where no fit can be shown."""
    data = _data(study, comparison)
    forms = (PAIRED if _told_apart(data) else ONE_TRIAL) if data.within else GROUPS
    noisier, wrong = _noisier(data), ""
    for form in forms:
        said = form.said + (f", because otherwise {wrong}" if wrong else "")
        try:
            result = _fitted(data, form, noisier)
            _check(result, form)
        except DasError as error:
            wrong = str(error)
        else:
            return _as_fit(data, result, form, noisier, f"{said}." if said else "")
    raise DasError(wrong)


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


def _fitted(data: _Data, form: _Form, noisier: float) -> Any:
    """The fitted model of statsmodels; its warnings are left out, because `_check` says what is wrong with a fit.

    DasError where the fit breaks off.
    """
    from statsmodels.regression.mixed_linear_model import MixedLM, VCSpec

    groups = sorted(set(data.driver.tolist()))
    rows = [np.flatnonzero(data.driver == one) for one in groups]
    parts = {}
    if form.noises:
        parts["noise"] = [np.eye(len(one))[:, data.condition[one] == noisier] for one in rows]
    if data.days is not None and form.slopes:  # a day driven once, by one driver, cannot be told from noise
        parts["day"] = [
            np.column_stack([data.days[one] == day for day in np.unique(data.days[one])]) * 1.0 for one in rows
        ]
    if form.slopes and not form.correlated:
        parts["effect"] = [data.condition[one][:, None] for one in rows]
    spec = VCSpec(
        list(parts),
        [[[f"{name}{i}" for i in range(mat.shape[1])] for mat in mats] for name, mats in parts.items()],
        list(parts.values()),
    )
    random = np.column_stack([np.ones(len(data.values)), data.condition][: 2 if form.correlated else 1])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = MixedLM(data.values, data.fixed, groups=data.driver, exog_re=random, exog_vc=spec if parts else None)
        try:
            return model.fit(reml=True, method=list(METHODS), maxiter=300)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            raise DasError(f"the fit broke off ({error})") from error


class _Variances(NamedTuple):
    """The variances of a fit, as shares of that of all values; `effect` is NaN without effects of drivers."""

    level: float
    effect: float
    covariance: float
    residual: float
    noise: float

    @classmethod
    def of(cls, result: Any) -> _Variances:
        """The variances in a result of statsmodels."""
        random = np.atleast_2d(np.asarray(result.cov_re, dtype=np.float64))
        names = result.model.exog_vc.names if len(result.vcomp) else []
        extra = dict(zip(names, np.asarray(result.vcomp).tolist(), strict=True))
        both = len(random) > 1
        return cls(
            level=float(random[0, 0]),
            effect=float(random[1, 1]) if both else extra.get("effect", math.nan),
            covariance=float(random[0, 1]) if both else 0.0,
            residual=float(result.scale),
            noise=extra.get("noise", 0.0),
        )


def _check(result: Any, form: _Form) -> None:
    """Raise DasError for a fit that cannot be shown."""
    found = _Variances.of(result)
    if not result.converged:
        raise DasError("the fit did not converge")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        error = float(np.asarray(result.bse_fe)[1])
    if not (math.isfinite(error) and error > 0):
        raise DasError("the fit has no standard error")
    if found.residual < STILL * found.noise:
        raise DasError("the fit depends on rounding, as one condition hardly scatters")
    if found.level < BOUNDARY * found.residual:
        raise DasError("the fit is singular: drivers do not differ in their level by more than chance explains")
    if found.effect < BOUNDARY * found.residual:
        raise DasError("the fit is singular: the effect does not differ between drivers by more than chance explains")
    if form.correlated and abs(found.covariance) > CERTAIN * math.sqrt(found.level * found.effect):
        raise DasError("the fit is singular: level and effect of the drivers are completely correlated")


def _as_fit(data: _Data, result: Any, form: _Form, noisier: float, remark: str) -> MixedFit:
    from scipy import stats

    scale, found = data.scale, _Variances.of(result)
    louder, quieter = (scale * math.sqrt(one) for one in (found.residual + found.noise, found.residual))
    effect, error = (scale * float(np.asarray(one)[1]) for one in (result.fe_params, result.bse_fe))
    # Drivers are independent of each other, trials are not. So the t distribution has one degree of freedom less than
    # there are drivers, and two less if the drivers are in two groups.
    reach = float(stats.t.ppf(0.975, len(set(data.driver.tolist())) - (1 if data.within else 2))) * error
    return MixedFit(
        effect=effect,
        interval=(effect - reach, effect + reach),
        level_sd=scale * math.sqrt(found.level),
        effect_sd=scale * math.sqrt(found.effect) if form.slopes else math.nan,
        noise=(louder, quieter) if noisier > 0 else (quieter, louder),
        remark=remark,
    )
