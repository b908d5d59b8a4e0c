"""Which parameters of friction that sticks a log does not show: these get no number.

Inverse dynamics is not linear in them, so that only a fit says what its log determines.
"""

from collections.abc import Callable, Sequence

import numpy as np

from gough_stewart.harness.errors import IdentificationError
from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.rows.sticking import COULOMB, PRESLIDING, STICTION

# Standard errors beyond this share of a value: the interval of a linear fit no longer holds, and 0 is nearly in it.
_LARGEST_ERROR = 0.25
# Static friction shows if it is above Coulomb friction by so many standard errors.
_SIGNIFICANT = 4.0
NOT_SHOWN = "not shown by this log, so without a number"
SHOWS = "Slow motions with reversals show how a leg sticks: some mm/s, and forces and lengths at 500 Hz or more"


def fit_of_shown(
    fit_of: Callable[[tuple[str, ...]], Estimate], names: Sequence[str]
) -> tuple[Estimate, tuple[str, ...]]:
    """The fit of those of these elements that the log shows, and the others, which have no number.

    They stay at nominal in the fit, but for the damping of bristles: one that is not known would pass for stiffness.

    Raises
    ------
    IdentificationError
        None is left, or what the log lacks is not of friction that sticks.
    """
    hidden: tuple[str, ...] = ()
    damping = PRESLIDING[1]
    while True:
        kept = tuple(name for name in names if name not in hidden)
        if not kept:
            raise IdentificationError(f"{NOT_SHOWN}: {', '.join(names)}. {SHOWS}", names)
        try:
            fit = fit_of(kept)
        except IdentificationError as error:
            more = _with_dependent({name for name in error.names if name in (*STICTION, *PRESLIDING)}, kept)
            if not more:
                raise
        else:
            more = not_shown(fit)
            if not set(more) - {damping}:
                return fit, (*hidden, *more)
        hidden = (*hidden, *more)


def not_shown(fit: Estimate) -> tuple[str, ...]:
    """Elements of the law of friction that this fit does not determine, with those that have no meaning without them.

    Static friction needs the velocity over which it falls, and the bristle's damping its stiffness. Static friction
    that is not significantly above Coulomb friction is not shown, and so neither is that velocity.
    """
    values, errors = (dict(zip(fit.names, of.tolist(), strict=True)) for of in (fit.values, fit.standard_errors))
    found = {
        name
        for name in (*STICTION, *PRESLIDING)
        if name in values and not errors[name] <= _LARGEST_ERROR * values[name]
    }
    static = STICTION[0]
    coulomb = [k for k, name in enumerate(fit.names) if name.partition("[")[0] == COULOMB]
    if static in values and coulomb:
        difference = np.zeros(len(fit.names))
        difference[coulomb] = -1 / len(coulomb)
        difference[fit.names.index(static)] = 1.0
        spread = float(np.sqrt(difference @ fit.covariance @ difference))
        if not difference @ fit.values > _SIGNIFICANT * spread:
            found.add(static)
    return _with_dependent(found, fit.names)


def _with_dependent(lacking: set[str], names: Sequence[str]) -> tuple[str, ...]:
    """These, and of the names those that mean nothing without them."""
    if lacking & set(PRESLIDING[:1]):
        # without the reversals that would show it, other elements may show
        lacking = set(PRESLIDING)
    more = set(STICTION) if lacking & set(STICTION) else set()
    return tuple(name for name in names if name in lacking | more)
