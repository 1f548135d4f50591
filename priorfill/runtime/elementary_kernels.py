"""Compiled loops of elementary functions; see `priorfill.runtime.elementary`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from priorfill.runtime.compiled import compiled

__all__ = ["exponentials"]

LEAST, LARGEST = -708.0, 709.0
"""Arguments whose exponential is a normal number."""

LOG2_E = 1.44269504088896338700
LN2_HIGH = 6.93147180369123816490e-01
LN2_LOW = 1.90821492927058770002e-10
"""ln 2 in two parts; the first has 32 bits, so that its product with an exponent is exact."""

P1 = 1.66666666666666019037e-01
P2 = -2.77777777770155933842e-03
P3 = 6.61375632143793436117e-05
P4 = -1.65339022054652515390e-06
P5 = 4.13813679705723846039e-08

MANTISSA, BIAS = 52, 1023
"""Bits of a float64 below its exponent, and what is added to an exponent as it is stored."""

SHIFT = 1.5 * 2.0**MANTISSA
"""The lowest bits of the sum of this and a small whole number are those of the number. Processors
lack vector instructions for tables and for conversions between float64 and int64, or have slow
ones: with either, the loop takes twice as long."""


@compiled()
def exponentials(values: NDArray[np.float64], result: NDArray[np.float64]) -> None:
    """Write the exponential of each value (fdlibm's e_exp.c).

    Both arrays must be different: in place, the loop takes four times as long.
    """
    for i in range(values.size):
        x = values[i]
        bounded = x if x > LEAST else LEAST  # also if it is NaN
        bounded = min(bounded, LARGEST)
        exponent = np.floor(bounded * LOG2_E + 0.5)
        high = bounded - exponent * LN2_HIGH
        low = exponent * LN2_LOW
        r = high - low
        square = r * r
        c = r - square * (P1 + square * (P2 + square * (P3 + square * (P4 + square * P5))))
        y = 1.0 - ((low - (r * c) / (2.0 - c)) - high)
        bits = (np.float64(exponent + SHIFT).view(np.int64) + BIAS) << MANTISSA
        y *= np.int64(bits).view(np.float64)  # 2 to the power of the exponent
        if x <= LEAST:
            y = 0.0
        elif x > LARGEST:
            y = np.inf
        elif x != x:
            y = x
        result[i] = y
