"""Vector instructions for the attention kernels, which numba does not generate by itself.

The loops over a head are short and of constant length. LLVM unrolls them into scalar code before it looks for vectors,
so `dot` and `add_scaled` are written as vectors: of the length of a head, whatever the processor's own vectors are.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from common.system.jit import njit

_FLOAT = ir.FloatType()


@intrinsic(prefer_literal=True)
def _dot(_typing_context: Any, a: Any, at_a: Any, b: Any, at_b: Any, size: Any) -> Any:
    """Sum a[at_a : at_a + size] * b[at_b : at_b + size].

    Both are flat, contiguous float32 arrays; ``size`` is a constant; nothing checks the bounds.
    """
    if not isinstance(size, types.IntegerLiteral):
        return None
    length = size.literal_value

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        left = builder.load(_address(context, builder, signature, arguments, 0, length), align=4)
        right = builder.load(_address(context, builder, signature, arguments, 2, length), align=4)
        product = builder.fmul(left, right, flags=("fast",))
        vector = ir.VectorType(_FLOAT, length)
        kind = ir.FunctionType(_FLOAT, [_FLOAT, vector])
        reduce = builder.module.declare_intrinsic(f"llvm.vector.reduce.fadd.v{length}f32", (), kind)
        return builder.call(reduce, [ir.Constant(_FLOAT, 0.0), product], fastmath=("fast",))

    return types.float32(a, at_a, b, at_b, size), generate


dot: Any = _dot
"""dot(a, at_a, b, at_b, size): sum of a[at_a : at_a + size] * b[at_b : at_b + size]."""


@intrinsic(prefer_literal=True)
def _add_scaled(_typing_context: Any, out: Any, at_out: Any, _factor: Any, b: Any, at_b: Any, size: Any) -> Any:
    """Do out[at_out : at_out + size] += factor * b[at_b : at_b + size].

    Both are flat, contiguous float32 arrays; ``size`` is a constant; nothing checks the bounds.
    """
    if not isinstance(size, types.IntegerLiteral):
        return None
    length = size.literal_value

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        vector = ir.VectorType(_FLOAT, length)
        target = _address(context, builder, signature, arguments, 0, length)
        first = builder.insert_element(ir.Constant(vector, ir.Undefined), arguments[2], ir.Constant(ir.IntType(32), 0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), length), [0] * length)
        factors = builder.shuffle_vector(first, ir.Constant(vector, ir.Undefined), zeros)
        addend = builder.load(_address(context, builder, signature, arguments, 3, length), align=4)
        product = builder.fmul(factors, addend, flags=("fast",))
        total = builder.fadd(builder.load(target, align=4), product, flags=("fast",))
        builder.store(total, target, align=4)
        return context.get_dummy_value()

    return types.void(out, at_out, types.float32, b, at_b, size), generate


add_scaled: Any = _add_scaled
"""add_scaled(out, at_out, factor, b, at_b, size): out[at_out : at_out + size] += factor * b[at_b : at_b + size]."""


def _address(context: Any, builder: Any, signature: Any, arguments: Any, index: int, length: int) -> Any:
    """Return the address of element ``arguments[index + 1]`` of array ``arguments[index]``, as a vector's."""
    array = context.make_array(signature.args[index])(context, builder, arguments[index])
    place = context.cast(builder, arguments[index + 1], signature.args[index + 1], types.intp)
    element = builder.gep(array.data, [place])
    return builder.bitcast(element, ir.VectorType(_FLOAT, length).as_pointer())


@njit(inline="always", fastmath=True, error_model="numpy")
def exp_negative(x: np.float32) -> np.float32:
    """Exponential of x <= 0 to float32 precision, in arithmetic that becomes vectors; below -87 as at -87.

    2^n e^r with |r| <= ln 2 / 2, and the minimax polynomial of Cephes for e^r.
    """
    x = max(x, np.float32(-87.0))
    n = math.floor(x * np.float32(1.44269504) + np.float32(0.5))
    r = x - n * np.float32(0.693359375) - n * np.float32(-2.12194440e-4)
    p = np.float32(1.9875691500e-4)
    p = p * r + np.float32(1.3981999507e-3)
    p = p * r + np.float32(8.3334519073e-3)
    p = p * r + np.float32(4.1665795894e-2)
    p = p * r + np.float32(1.6666665459e-1)
    p = p * r + np.float32(5.0000001201e-1)
    p = p * r * r + r + np.float32(1.0)
    return p * np.int32((np.int32(n) + np.int32(127)) << np.int32(23)).view(np.float32)
