"""Late messages and clocks that were set back are told apart."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from deploy.tf.stamps import Order, StampOrder


def orders(*stamps):
    order = StampOrder()
    return [order.take(stamp) for stamp in stamps]


def test_new_repeated_and_late_stamps():
    assert orders(1.0, 1.1, 1.1, 1.05, 1.2, 1.15, 1.3) == [
        Order.AHEAD,
        Order.AHEAD,
        Order.REPEATED,
        Order.LATE,
        Order.AHEAD,
        Order.LATE,
        Order.AHEAD,
    ]


@given(st.floats(0.2, 100.0), st.sampled_from([10.0, 20.0, 30.0, 100.0]), st.floats(0.0, 2e9))
def test_a_clock_set_back_is_known_by_the_second_message(back, rate, start):
    order = StampOrder()
    for k in range(5):
        assert order.take(start + k / rate) is Order.AHEAD
    found = [order.take(start + k / rate - back) for k in range(5, 30)]
    assert Order.SET_BACK in found[:2]
    assert found.count(Order.SET_BACK) == 1
    assert set(found[2:]) == {Order.AHEAD}


def test_a_step_of_two_periods_is_found_though_stamps_jitter():
    assert orders(1.0, 1.1, 1.002, 1.12) == [Order.AHEAD, Order.AHEAD, Order.LATE, Order.SET_BACK]


@pytest.mark.parametrize("late", [0.05, 1.0, 9.0])
@pytest.mark.parametrize("period", [0.1, 0.02])
def test_one_that_was_overtaken_is_late(late, period):
    assert orders(10.0 - period, 10.0, 10.0 - late, 10.0 + period)[2:] == [Order.LATE, Order.AHEAD]
