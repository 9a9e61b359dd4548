"""Products of matrices take one thread where they are small, and as many as before elsewhere."""

from threadpoolctl import ThreadpoolController, threadpool_limits

from common.policies.policy_file import read_policy
from common.policies.shipped import shipped_policy
from common.system.blas import one_blas_thread
from tests.common.planners.environments import environment_in

BLAS = ThreadpoolController().select(user_api="blas")


def threads() -> list[int]:
    return [each.num_threads for each in BLAS.lib_controllers]


def test_a_decision_of_a_program_that_multiplies_on_two_threads_takes_one() -> None:
    observation = environment_in("rooms", 5_000_000).mapper.observe()
    policy, _ = read_policy(shipped_policy("exploration"))
    network, seen = policy._network, []

    def watched(graph):
        seen.append(threads())
        return network(graph)

    policy._network = watched
    with threadpool_limits(2, "blas"):
        before = threads()
        policy.decide(observation, greedy=True, rng=None)
        assert threads() == before
    assert before and set(before) == {2} and set(seen[0]) == {1}


def test_the_threads_are_as_before_after_an_error() -> None:
    with threadpool_limits(2, "blas"):
        try:
            with one_blas_thread():
                raise ValueError
        except ValueError:
            pass
        assert set(threads()) == {2}
