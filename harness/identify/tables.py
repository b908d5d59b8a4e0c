"""An estimate as tables."""

from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.names import unit_of
from gough_stewart.harness.output.tables import Named, Sheet


def sheets_of(estimate: Estimate) -> list[Sheet]:
    """Parameters with their intervals; what the log sees; residuals."""
    return [_parameters(estimate), _identifiability(estimate), _residuals(estimate)]


def _parameters(estimate: Estimate) -> Sheet:
    sheet = Sheet("Parameters, with 95 % intervals", ("", "before", "found", "±", "% of it", "correlates most with"))
    correlation = estimate.correlation
    half = estimate.values - estimate.interval[:, 0]
    for k, name in enumerate(estimate.names):
        others = [abs(correlation[k, j]) if j != k else 0.0 for j in range(len(estimate.names))]
        j = max(range(len(others)), key=others.__getitem__)
        with_other = f"{estimate.names[j]} {correlation[k, j]:+.2f}" if others[j] > 0 else "–"
        value = estimate.values[k]
        share = f"{100 * half[k] / abs(value):.2g}" if value else "–"
        sheet.add(
            Named(name, unit_of(name)),
            f"{estimate.nominal[k]:.6g}",
            f"{value:.6g}",
            f"{half[k]:.2g}",
            share,
            with_other,
        )
    return sheet


def _identifiability(estimate: Estimate) -> Sheet:
    sheet = Sheet(
        f"What the log sees; condition number {estimate.condition_number:.3g}",
        ("combination, in shares of scale", "singular value", "standard error, % of scale"),
    )
    for k, sigma in enumerate(estimate.singular_values):
        error = f"{100 / sigma:.2g}" if k < estimate.rank else "not seen"
        sheet.add(estimate.combination(k), f"{sigma:.4g}", error)
    return sheet


def _residuals(estimate: Estimate) -> Sheet:
    found = estimate.residuals
    heads = (f"residual [{found.unit}]", "fitted", "kept aside", "of signal, %", "p of whiteness")
    sheet = Sheet(f"Residuals of the {found.quantity}", heads)
    for k, rms in enumerate(found.rms):
        aside = "–" if found.validation_rms is None else f"{found.validation_rms[k]:.4g}"
        share = f"{100 * rms / found.signal_rms[k]:.3g}" if found.signal_rms[k] > 0 else "–"
        white = "–" if found.whiteness is None else f"{found.whiteness[k]:.2g}"
        sheet.add(f"{found.quantity} {k + 1}", f"{rms:.4g}", aside, share, white)
    return sheet
