import numpy as np

from actors.expert.visibility import fill_words, look_from_all


def test_a_viewpoint_sees_its_disc_and_not_behind_walls():
    free = np.ones((20, 20), dtype=np.bool_)
    free[:, 12] = False
    sight = look_from_all(free, np.array([[8.0, 8.0]]), 6.0, 720)
    seen = np.zeros(free.shape, dtype=np.bool_)
    for k in range(len(sight.tile)):
        row, column = divmod(int(sight.tile[k]), 3)
        for bit in range(64):
            if int(sight.mask[k]) >> bit & 1:
                seen[row * 8 + bit // 8, column * 8 + bit % 8] = True
    y, x = np.mgrid[:20, :20] + 0.5
    distance = np.hypot(x - 8.0, y - 8.0)
    assert seen[(distance < 5.2) & (x < 12)].all()
    assert not seen[distance > 6.8].any()
    assert not seen[:, 12:].any()


def test_words_hold_exactly_the_cells():
    cells = np.array([0, 7, 8, 25, 26 * 9 + 3], dtype=np.int64)
    words = np.full(16, 5, dtype=np.uint64)
    fill_words(cells, 26, words)
    assert sum(int(word).bit_count() for word in words) == len(cells)
    assert int(words[0]) == 0b10000001
    assert int(words[4]) == 1 << (8 + 3)
