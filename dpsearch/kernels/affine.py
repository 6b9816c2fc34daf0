"""``output += W @ x`` over lanes, the one inner loop that decides how fast a recurrent policy runs.

Written as an LLVM intrinsic because the plain loop over (row, column, lane) defeats the vectoriser: it cannot prove
that ``output`` does not alias the weights, and reloads everything for each lane (eight times slower, measured).
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from dpsearch.kernels.lanes import LANES

_I64 = ir.IntType(64)
_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_ROWS_AT_ONCE = 4  # rows that share one load of x; more brings nothing


@intrinsic
def affine(
    typing_context: Any, weights: Any, offset: Any, rows: Any, columns: Any, x: Any, output: Any
) -> Any:
    """``affine(weights, offset, rows, columns, x, output)``: ``output[:rows] += W @ x[:columns]``.

    ``W`` is the row-major (rows, columns) matrix that starts at ``weights[offset]``. Weights are ``(P,)``, shared by
    all lanes, or ``(P, LANES)``; ``x`` and ``output`` are ``(.., LANES)``. Products are fused with their sum and
    added in the order of the columns, so the result is the same on every machine.
    """
    signature = types.void(weights, types.intp, types.intp, types.intp, x, output)
    shared = weights.ndim == 1

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        weights_at, x_at, output_at = (
            context.make_array(signature.args[i])(context, builder, args[i]).data for i in (0, 4, 5)
        )
        offset, rows, columns = args[1:4]
        fma = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(_VECTOR, [_VECTOR] * 3), f"llvm.fma.v{LANES}f64"
        )

        def lanes_of(base: Any, row: Any) -> Any:
            element = builder.gep(base, [builder.mul(row, _I64(LANES))])
            return builder.bitcast(element, _VECTOR.as_pointer())

        def load(base: Any, row: Any) -> Any:
            return builder.load(lanes_of(base, row), align=8)

        def weight(index: Any) -> Any:
            if not shared:
                return load(weights_at, index)
            scalar = builder.load(builder.gep(weights_at, [index]))
            one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), scalar, ir.IntType(32)(0))
            zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
            return builder.shuffle_vector(one, ir.Constant(_VECTOR, ir.Undefined), zeros)

        def rows_from(first: Any, count: int) -> None:
            numbers = [builder.add(first, _I64(r)) for r in range(count)]
            start = [load(output_at, row) for row in numbers]
            before = builder.basic_block
            loop, after = builder.append_basic_block("columns"), builder.append_basic_block("after")
            builder.branch(loop)
            builder.position_at_end(loop)
            column = builder.phi(_I64)
            column.add_incoming(_I64(0), before)
            sums = [builder.phi(_VECTOR) for _ in numbers]
            factor = load(x_at, column)
            for row, initial, total in zip(numbers, start, sums, strict=True):
                index = builder.add(offset, builder.add(builder.mul(row, columns), column))
                total.add_incoming(initial, before)
                total.add_incoming(builder.call(fma, [weight(index), factor, total]), loop)
            following = builder.add(column, _I64(1))
            column.add_incoming(following, loop)
            builder.cbranch(builder.icmp_signed("<", following, columns), loop, after)
            builder.position_at_end(after)
            for row, total in zip(numbers, sums, strict=True):
                builder.store(total.incomings[1][0], lanes_of(output_at, row), align=8)

        with builder.if_then(builder.icmp_signed(">", columns, _I64(0))):
            blocks = builder.sdiv(rows, _I64(_ROWS_AT_ONCE))
            with cgutils.for_range(builder, blocks) as loop:
                rows_from(builder.mul(loop.index, _I64(_ROWS_AT_ONCE)), _ROWS_AT_ONCE)
            with cgutils.for_range(builder, builder.srem(rows, _I64(_ROWS_AT_ONCE))) as loop:
                rows_from(builder.add(builder.mul(blocks, _I64(_ROWS_AT_ONCE)), loop.index), 1)
        return context.get_dummy_value()

    return signature, codegen
