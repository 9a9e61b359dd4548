"""Cards inside ONNX files."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.errors import CheckpointError
from common.policies.onnx_file import KEY, split, with_card

onnx = pytest.importorskip("onnx")


def model() -> bytes:
    info = [onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["N"]) for name in ("x", "y")]
    graph = onnx.helper.make_graph([onnx.helper.make_node("Identity", ["x"], ["y"])], "g", [info[0]], [info[1]])
    return onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)]).SerializeToString()


@given(st.text(max_size=3000))
def test_a_card_comes_back_and_the_model_stays_as_it_was(card):
    data = with_card(model(), card)
    assert split(data) == (model(), card)


def test_other_tools_see_the_card_as_metadata():
    read = onnx.load_from_string(with_card(model(), '{"run": "büro"}'))
    onnx.checker.check_model(read)
    assert {entry.key: entry.value for entry in read.metadata_props} == {KEY: '{"run": "büro"}'}


def test_a_model_without_a_card_is_refused():
    with pytest.raises(CheckpointError, match="export it with"):
        split(model())


@given(st.binary(max_size=200))
def test_what_is_no_model_is_refused(data):
    with pytest.raises(CheckpointError):
        split(data)


@given(st.data())
def test_a_file_cut_off_anywhere_is_refused(data):
    whole = with_card(model(), "x" * 300)
    with pytest.raises(CheckpointError):
        split(whole[: data.draw(st.integers(0, len(whole) - 1))])
