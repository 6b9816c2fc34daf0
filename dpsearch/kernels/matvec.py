"""``output = W @ x`` over lanes, the one inner loop that decides how fast a recurrent policy runs.

Written as an LLVM intrinsic because the plain loop over (row, column, lane) defeats the vectoriser: it cannot prove
that ``output`` does not alias the weights, and reloads everything for each lane (eight times slower, measured).
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from dpsearch.kernels.lanes import LANES, WIDTH

_I64 = ir.IntType(64)
# WIDTH doubles fill the widest register there is; wider vectors of single floats bring nothing
_DOUBLES, _SINGLES = ir.VectorType(ir.DoubleType(), WIDTH), ir.VectorType(ir.FloatType(), WIDTH)
_ROWS_AT_ONCE = 4  # rows that share one load of x; more brings nothing


@intrinsic
def matvec(
    typing_context: Any, weights: Any, offset: Any, rows: Any, columns: Any, x: Any, output: Any, lanes: Any
) -> Any:
    """``matvec(weights, offset, rows, columns, x, output, lanes)``: ``output[:rows] = W @ x[:columns]``, in some lanes.

    ``W`` is the row-major (rows, columns) matrix that starts at ``weights[offset]``. Weights are ``(P,)``, shared by
    all lanes, or ``(P, LANES)``; ``x`` is ``(.., LANES)``. Only the first ``lanes`` are computed, a multiple of
    ``WIDTH``. ``output`` is ``(.., LANES)``, or one-dimensional: then its rows are packed, ``lanes`` numbers each.
    Products are fused with their sum and added in the order of the columns, of which there must be one at least, so the
    result is the same on every machine.
    Weights and ``x`` are both float64, or both float32, which is what sums are then made in; ``output`` may be either.
    """
    signature = types.void(weights, types.intp, types.intp, types.intp, x, output, types.intp)
    shared = weights.ndim == 1
    vector, suffix = (_SINGLES, "f32") if x.dtype == types.float32 else (_DOUBLES, "f64")
    written = _SINGLES if output.dtype == types.float32 else _DOUBLES

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        weights_at, x_at, output_at = (
            context.make_array(signature.args[i])(context, builder, args[i]).data for i in (0, 4, 5)
        )
        _, offset, rows, columns, _, _, lanes = args
        fma = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(vector, [vector] * 3), f"llvm.fma.v{WIDTH}{suffix}"
        )
        every = _I64(LANES)

        def lanes_of(base: Any, row: Any, parts: list[Any], kind: Any, stride: Any) -> list[Any]:
            first = builder.mul(row, stride)
            elements = [builder.gep(base, [builder.add(first, part)]) for part in parts]
            return [builder.bitcast(element, kind.as_pointer()) for element in elements]

        def load(base: Any, row: Any, parts: list[Any]) -> list[Any]:
            return [builder.load(pointer, align=4) for pointer in lanes_of(base, row, parts, vector, every)]

        def store(total: Any, pointer: Any) -> None:
            if vector is _SINGLES and written is _DOUBLES:
                total = builder.fpext(total, _DOUBLES)
            builder.store(total, pointer, align=4)

        def weight(index: Any, parts: list[Any]) -> list[Any]:
            if not shared:
                return load(weights_at, index, parts)
            scalar = builder.load(builder.gep(weights_at, [index]))
            one = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, ir.IntType(32)(0))
            zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
            return [builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)] * len(parts)

        def rows_from(first: Any, count: int, parts: list[Any]) -> None:
            before = builder.basic_block
            loop, after = builder.append_basic_block("columns"), builder.append_basic_block("after")
            builder.branch(loop)
            builder.position_at_end(loop)
            column = builder.phi(_I64)
            column.add_incoming(_I64(0), before)
            sums = [[builder.phi(vector) for _ in parts] for _ in range(count)]
            factors = load(x_at, column, parts)
            for r, totals in enumerate(sums):
                row = builder.mul(builder.add(first, _I64(r)), columns)
                weights = weight(builder.add(offset, builder.add(row, column)), parts)
                for w, factor, total in zip(weights, factors, totals, strict=True):
                    total.add_incoming(ir.Constant(vector, None), before)
                    total.add_incoming(builder.call(fma, [w, factor, total]), loop)
            following = builder.add(column, _I64(1))
            column.add_incoming(following, loop)
            builder.cbranch(builder.icmp_signed("<", following, columns), loop, after)
            builder.position_at_end(after)
            for r, totals in enumerate(sums):
                row, stride = builder.add(first, _I64(r)), lanes if output.ndim == 1 else every
                pointers = lanes_of(output_at, row, parts, written, stride)
                for total, pointer in zip(totals, pointers, strict=True):
                    store(total.incomings[1][0], pointer)

        def all_rows(parts: list[Any]) -> None:
            blocks = builder.sdiv(rows, _I64(_ROWS_AT_ONCE))
            with cgutils.for_range(builder, blocks) as loop:
                rows_from(builder.mul(loop.index, _I64(_ROWS_AT_ONCE)), _ROWS_AT_ONCE, parts)
            with cgutils.for_range(builder, builder.srem(rows, _I64(_ROWS_AT_ONCE))) as loop:
                rows_from(builder.add(builder.mul(blocks, _I64(_ROWS_AT_ONCE)), loop.index), 1, parts)

        with builder.if_else(builder.icmp_signed("==", lanes, every)) as (full, few):
            with full:  # side by side, to hide latency
                all_rows([_I64(first) for first in range(0, LANES, WIDTH)])
            with few, cgutils.for_range(builder, builder.sdiv(lanes, _I64(WIDTH))) as loop:
                all_rows([builder.mul(loop.index, _I64(WIDTH))])
        return context.get_dummy_value()

    return signature, codegen
