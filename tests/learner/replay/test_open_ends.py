from learner.replay.open_ends import OpenEnds

STEP, OTHER = ("desk-0", 1, 7, 16), ("desk-0", 1, 7, 32)


def test_an_end_is_taken_once():
    ends = OpenEnds()
    ends.note(STEP, 41)
    assert ends.take(OTHER) is None
    assert ends.take(STEP) == 41
    assert ends.take(STEP) is None
    ends.forget(41)


def test_what_left_the_buffer_is_joined_to_nothing():
    ends = OpenEnds()
    ends.note(STEP, 41)
    ends.note(OTHER, 57)
    ends.forget(41)
    assert ends.take(STEP) is None
    assert ends.take(OTHER) == 57


def test_the_same_step_again_replaces_the_first():
    ends = OpenEnds()
    ends.note(STEP, 41)
    ends.note(STEP, 57)
    ends.forget(41)
    assert ends.take(STEP) == 57
