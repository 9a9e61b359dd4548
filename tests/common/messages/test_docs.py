"""The examples of docs/bus.md are what the code writes, and they decode."""

import re
from pathlib import Path

import numpy as np

from common.messages.codec import pack, unpack
from common.messages.experience import Delivery
from common.messages.replies import Ack
from common.messages.schema import decode, encode
from tests.common.messages import examples

PAGE = (Path(__file__).parents[3] / "docs" / "bus.md").read_text("utf-8")
BLOCKS = dict(re.findall(r"```hex (\w+)\n(.*?)\n```", PAGE, re.DOTALL))


def test_the_page_holds_the_current_examples():
    assert examples.blocks() == BLOCKS, "run `python -m tests.common.messages.examples` and paste its blocks"


def test_the_examples_decode():
    delivery = decode(bytes.fromhex(BLOCKS["delivery"]), Delivery)
    assert encode(delivery) == encode(examples.delivery())
    assert (delivery.actor, delivery.body.rewards[0]) == ("desk-0", 0.5)
    assert decode(bytes.fromhex(BLOCKS["ack"]), Ack) == examples.ack()
    payload = bytes.fromhex(BLOCKS["array"])
    data = b"\x81\xa1a\xc7" + bytes([len(payload), 1]) + payload
    np.testing.assert_array_equal(unpack(data)["a"], examples.array())
    assert pack({"a": examples.array()}) == data
