"""An estimate as tables."""

from gough_stewart.harness.identify.diagnosis.diagnosis import Diagnosis
from gough_stewart.harness.identify.diagnosis.lack_of_fit import LackOfFit
from gough_stewart.harness.identify.estimate import Estimate
from gough_stewart.harness.identify.names import unit_of
from gough_stewart.harness.output.tables import Named, Sheet


def sheets_of(estimate: Estimate) -> list[Sheet]:
    """Parameters with their intervals; identifiability; residuals; whether the model fits."""
    sheets = [_parameters(estimate), _identifiability(estimate), _residuals(estimate)]
    if estimate.diagnosis is not None and estimate.diagnosis.test is not None:
        sheets.append(_tests(estimate.diagnosis.test))
        if estimate.diagnosis.findings:
            sheets.append(_findings(estimate.diagnosis))
    return sheets


def _parameters(estimate: Estimate) -> Sheet:
    sheet = Sheet("Parameters, with 95 % intervals", ("", "before", "estimate", "±", "± %"))
    half = estimate.values - estimate.interval[:, 0]
    for k, name in enumerate(estimate.names):
        value, row = estimate.values[k], (Named(name, unit_of(name)), f"{estimate.nominal[k]:.5g}")
        if name in estimate.not_excited:
            sheet.add(*row, "not excited", "–", "–")
        elif name in estimate.at_bound:
            sheet.add(*row, f"{value:.6g}", "at its bound", "–")
        else:
            share = f"{100 * half[k] / abs(value):.2g}" if value else "–"
            sheet.add(*row, f"{value:.6g}", f"{half[k]:.2g}", share)
    return sheet


def _identifiability(estimate: Estimate) -> Sheet:
    title = f"Identifiability; condition number {estimate.condition_number:.3g}"
    sheet = Sheet(title, ("combination, relative to scale", "± %"))
    for k, sigma in enumerate(estimate.singular_values):
        sheet.add(estimate.combination(k), f"{100 / sigma:.2g}" if k < estimate.rank else "unobservable")
    return sheet


def _residuals(estimate: Estimate) -> Sheet:
    found = estimate.residuals
    heads = (f"residual [{found.unit}]", "fitted", "validation", "of signal, %", "p of whiteness")
    sheet = Sheet(f"Residuals of the {found.quantity}", heads)
    for k, rms in enumerate(found.rms):
        aside = "–" if found.validation_rms is None else f"{found.validation_rms[k]:.4g}"
        share = f"{100 * rms / found.signal_rms[k]:.3g}" if found.signal_rms[k] > 0 else "–"
        white = "–" if found.whiteness is None else f"{found.whiteness[k]:.2g}"
        sheet.add(f"{found.quantity} {k + 1}", f"{rms:.4g}", aside, share, white)
    return sheet


def _tests(test: LackOfFit) -> Sheet:
    sheet = Sheet(f"What the residuals contain; all tests p = {test.combined:.2g}", ("tested", "p"))
    for name, p in test.p_values.items():
        sheet.add(name, f"{p:.2g}")
    return sheet


def _findings(diagnosis: Diagnosis) -> Sheet:
    others = ": the first is most likely, the others are not separated from it" if len(diagnosis.findings) > 1 else ""
    sheet = Sheet(f"Diagnosis{others}", ("", "misfit explained"))
    for finding in diagnosis.findings:
        sheet.add(finding.text, f"{100 * finding.improvement:.0f} %")
    return sheet
