"""Numbers as a reader wants them: as many digits as are known, a dash for what is not."""

import math

ABSENT = "–"


def number(value: float | None, digits: int = 2) -> str:
    """The value with `digits` decimals; a dash if it is None, NaN or infinite. The minus sign is typographic."""
    if value is None or not math.isfinite(value):
        return ABSENT
    # Thousands are set apart from five figures on, as usual in print.
    text = f"{value:,.{digits}f}".replace(",", "\u202f" if abs(value) >= 10_000.0 else "")
    return text.replace("-", "−") if float(f"{value:.{digits}f}") != 0.0 else text.lstrip("-")


def significant(value: float | None, digits: int = 3) -> str:
    """The value with `digits` significant figures; powers of ten only where plain figures would be long."""
    if value is None or not math.isfinite(value):
        return ABSENT
    if value == 0.0:
        return "0"
    magnitude = math.floor(math.log10(abs(value)))
    if -5 <= magnitude < 7:
        return number(value, max(0, digits - 1 - magnitude))
    mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
    return f"{mantissa}·10^{int(exponent)}".replace("-", "−")


def quantity(value: float | None, unit: str, digits: int = 2) -> str:
    """A number with its unit, or a dash alone."""
    text = number(value, digits)
    return text if text == ABSENT else f"{text}\u00a0{unit}"


def plus_minus(value: float | None, sigma: float | None, unit: str, digits: int = 3) -> str:
    """Value ± sigma, both to two figures of sigma but at most `digits` decimals; the value alone without a sigma."""
    if value is None or not math.isfinite(value):
        return ABSENT
    if sigma is None or not math.isfinite(sigma) or sigma <= 0.0:
        return quantity(value, unit, digits)
    places = min(digits, max(0, 1 - math.floor(math.log10(sigma))))
    sigma = max(sigma, 10.0**-places)
    return f"{number(value, places)} ±\u00a0{number(sigma, places)}\u00a0{unit}"


def setting(value: object) -> str:
    """A parameter's value in words."""
    if value is None:
        return "not set"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:g}" if math.isfinite(value) else ABSENT
    return str(value)


def percent(share: float | None, digits: int = 1) -> str:
    """A share, 0 to 1, in per cent."""
    return quantity(None if share is None else 100.0 * share, "%", digits)


def relative_error(value: float | None, truth: float | None) -> float | None:
    """`(value − truth) / |truth|`, or None where it means nothing."""
    if value is None or truth is None or not (math.isfinite(value) and math.isfinite(truth)) or truth == 0.0:
        return None
    return (value - truth) / abs(truth)


def signed_percent(share: float | None, digits: int = 2) -> str:
    """A relative error in per cent, with its sign."""
    if share is None or not math.isfinite(share):
        return ABSENT
    sign = "+" if round(100.0 * share, digits) > 0.0 else ""
    return sign + percent(share, digits)
