import pytest

from deploy.safety.lifecycle import Lifecycle, LifecycleError, LifecycleState

PATHS = {
    LifecycleState.UNCONFIGURED: (),
    LifecycleState.INACTIVE: ("configure",),
    LifecycleState.ACTIVE: ("configure", "activate"),
    LifecycleState.FINALIZED: ("shutdown",),
}
ALLOWED = {
    LifecycleState.UNCONFIGURED: {"configure": LifecycleState.INACTIVE, "shutdown": LifecycleState.FINALIZED},
    LifecycleState.INACTIVE: {
        "cleanup": LifecycleState.UNCONFIGURED,
        "activate": LifecycleState.ACTIVE,
        "shutdown": LifecycleState.FINALIZED,
    },
    LifecycleState.ACTIVE: {"deactivate": LifecycleState.INACTIVE, "shutdown": LifecycleState.FINALIZED},
    LifecycleState.FINALIZED: {},
}


def in_state(state: LifecycleState) -> Lifecycle:
    lifecycle = Lifecycle()
    for transition in PATHS[state]:
        lifecycle.trigger(transition)
    assert lifecycle.state is state
    return lifecycle


@pytest.mark.parametrize("state", PATHS)
@pytest.mark.parametrize("transition", ["configure", "cleanup", "activate", "deactivate", "shutdown"])
def test_every_transition_of_every_state(state, transition):
    lifecycle = in_state(state)
    assert set(lifecycle.allowed) == set(ALLOWED[state])
    if transition in ALLOWED[state]:
        assert lifecycle.trigger(transition) is ALLOWED[state][transition]
    else:
        with pytest.raises(LifecycleError) as caught:
            lifecycle.trigger(transition)
        assert state.label in str(caught.value)
        assert all(name in str(caught.value) for name in ALLOWED[state] or {"none"})
        assert lifecycle.state is state


def test_numbers_and_labels_are_those_of_ros():
    assert {state.label: state.value for state in LifecycleState} == {
        "unconfigured": 1,
        "inactive": 2,
        "active": 3,
        "finalized": 4,
        "configuring": 10,
        "cleaningup": 11,
        "shuttingdown": 12,
        "activating": 13,
        "deactivating": 14,
        "errorprocessing": 15,
    }


def test_changes_are_told_with_the_states_between():
    changes = []
    lifecycle = Lifecycle(lambda before, after: changes.append((before.label, after.label)))
    with lifecycle.transition("configure"):
        assert lifecycle.state is LifecycleState.CONFIGURING
        with pytest.raises(LifecycleError, match="configuring"):
            lifecycle.trigger("activate")
    assert changes == [("unconfigured", "configuring"), ("configuring", "inactive")]


def test_failed_work_leads_to_unconfigured():
    states = []
    lifecycle = Lifecycle(lambda before, after: states.append(after.label))
    lifecycle.trigger("configure")
    with pytest.raises(ValueError, match="broken"), lifecycle.transition("activate"):
        raise ValueError("broken")
    assert states[-3:] == ["activating", "errorprocessing", "unconfigured"]


def test_failed_shutdown_is_final_all_the_same():
    lifecycle = Lifecycle()
    with pytest.raises(ValueError, match="broken"), lifecycle.transition("shutdown"):
        raise ValueError("broken")
    assert lifecycle.state is LifecycleState.FINALIZED
