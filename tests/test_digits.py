"""Digits of numbers that people read: as many where rounding carries into the next decade."""

from __future__ import annotations

import pytest

from rodgen.calibration.words import three_digits, two_digits
from rodgen.kinematics.axis_fit.result import vector_text
from rodgen.output.numbers import shown_unit
from rodgen.statistics.digits import last_decimal, measured


@pytest.mark.parametrize("value", [0.9996, 99.96, 0.09996, 9.9951, 0.00099951, 0.231])
def test_digits_stay_as_many_where_rounding_carries(value):
    """Of 0.9996 three digits are 1.00: in a sentence, in a column, and with an uncertainty."""
    three = three_digits(value)
    assert float(three) == float(f"{value:.3g}")
    assert len(three.replace(".", "").lstrip("0")) == 3
    assert shown_unit("deg", [value]).plain(value) == three
    assert float(measured(1.0, value)[1]) == float(two_digits(value)) == float(f"{value:.2g}")
    assert last_decimal(value, 3) == last_decimal(float(three), 3)


def test_coordinates_have_two_digits_of_their_uncertainty():
    import numpy as np

    assert vector_text(np.array([1.23456, -2.0, 0.0]), 0.0996) == "(1.23, -2.00, 0.00)"
