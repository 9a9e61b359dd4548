import numpy as np

from common.system.copies import copy_rows, copy_values


def test_values_and_rows_go_to_the_beginning_and_the_rest_stays():
    values = np.arange(5)
    copy_values(values, np.array([7, 8]))
    assert values.tolist() == [7, 8, 2, 3, 4]
    copy_values(values[3:], values[:0])
    assert values.tolist() == [7, 8, 2, 3, 4]
    rows = np.zeros((3, 2), dtype=np.int32)
    copy_rows(rows, np.array([[1, 2]], dtype=np.int32))
    assert rows.tolist() == [[1, 2], [0, 0], [0, 0]]
