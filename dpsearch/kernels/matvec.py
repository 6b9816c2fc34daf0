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

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _Product(context, builder, signature, args).emit()
        return context.get_dummy_value()

    return signature, codegen


class _Product:
    """Emits the code of one product, for weights, ``x`` and output of given types."""

    def __init__(self, context: Any, builder: Any, signature: Any, args: Any) -> None:
        weights, _, _, _, x, output, _ = signature.args
        self.builder = builder
        self.weights, self.x, self.output = (
            context.make_array(signature.args[i])(context, builder, args[i]).data for i in (0, 4, 5)
        )
        _, self.offset, self.rows, self.columns, _, _, self.lanes = args
        self.shared, self.packed = weights.ndim == 1, output.ndim == 1
        self.vector, suffix = (_SINGLES, "f32") if x.dtype == types.float32 else (_DOUBLES, "f64")
        self.written = _SINGLES if output.dtype == types.float32 else _DOUBLES
        self.fma = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(self.vector, [self.vector] * 3), f"llvm.fma.v{WIDTH}{suffix}"
        )
        self.every = _I64(LANES)

    def emit(self) -> None:
        """All lanes of a full block side by side, to hide latency; of others, ``WIDTH`` at a time."""
        builder = self.builder
        with builder.if_else(builder.icmp_signed("==", self.lanes, self.every)) as (full, few):
            with full:
                self.all_rows([_I64(first) for first in range(0, LANES, WIDTH)])
            with few, cgutils.for_range(builder, builder.sdiv(self.lanes, _I64(WIDTH))) as loop:
                self.all_rows([builder.mul(loop.index, _I64(WIDTH))])

    def all_rows(self, parts: list[Any]) -> None:
        """Every row of the output, in the vectors of lanes that begin at ``parts``."""
        builder = self.builder
        blocks = builder.sdiv(self.rows, _I64(_ROWS_AT_ONCE))
        with cgutils.for_range(builder, blocks) as loop:
            self.rows_from(builder.mul(loop.index, _I64(_ROWS_AT_ONCE)), _ROWS_AT_ONCE, parts)
        with cgutils.for_range(builder, builder.srem(self.rows, _I64(_ROWS_AT_ONCE))) as loop:
            self.rows_from(builder.add(builder.mul(blocks, _I64(_ROWS_AT_ONCE)), loop.index), 1, parts)

    def rows_from(self, first: Any, count: int, parts: list[Any]) -> None:
        """``count`` rows of the output: a loop over columns, then the sums are stored."""
        builder = self.builder
        before = builder.basic_block
        loop, after = builder.append_basic_block("columns"), builder.append_basic_block("after")
        builder.branch(loop)
        builder.position_at_end(loop)
        column = builder.phi(_I64)
        column.add_incoming(_I64(0), before)
        sums = [[builder.phi(self.vector) for _ in parts] for _ in range(count)]
        factors = self.load(self.x, column, parts)
        for r, totals in enumerate(sums):
            row = builder.mul(builder.add(first, _I64(r)), self.columns)
            weights = self.weight(builder.add(self.offset, builder.add(row, column)), parts)
            for w, factor, total in zip(weights, factors, totals, strict=True):
                total.add_incoming(ir.Constant(self.vector, None), before)
                total.add_incoming(builder.call(self.fma, [w, factor, total]), loop)
        following = builder.add(column, _I64(1))
        column.add_incoming(following, loop)
        builder.cbranch(builder.icmp_signed("<", following, self.columns), loop, after)
        builder.position_at_end(after)
        for r, totals in enumerate(sums):
            row, stride = builder.add(first, _I64(r)), self.lanes if self.packed else self.every
            pointers = self.lanes_of(self.output, row, parts, self.written, stride)
            for total, pointer in zip(totals, pointers, strict=True):
                self.store(total.incomings[1][0], pointer)

    def lanes_of(self, base: Any, row: Any, parts: list[Any], kind: Any, stride: Any) -> list[Any]:
        """Pointers to vectors of lanes in one row."""
        builder = self.builder
        first = builder.mul(row, stride)
        elements = [builder.gep(base, [builder.add(first, part)]) for part in parts]
        return [builder.bitcast(element, kind.as_pointer()) for element in elements]

    def load(self, base: Any, row: Any, parts: list[Any]) -> list[Any]:
        """Vectors of lanes in one row."""
        pointers = self.lanes_of(base, row, parts, self.vector, self.every)
        return [self.builder.load(pointer, align=4) for pointer in pointers]

    def store(self, total: Any, pointer: Any) -> None:
        """Store a sum, in the precision of the output."""
        if self.vector is _SINGLES and self.written is _DOUBLES:
            total = self.builder.fpext(total, _DOUBLES)
        self.builder.store(total, pointer, align=4)

    def weight(self, index: Any, parts: list[Any]) -> list[Any]:
        """One weight for each vector of lanes: a vector of its own, or one number in all lanes."""
        if not self.shared:
            return self.load(self.weights, index, parts)
        builder, vector = self.builder, self.vector
        scalar = builder.load(builder.gep(self.weights, [index]))
        one = builder.insert_element(ir.Constant(vector, ir.Undefined), scalar, ir.IntType(32)(0))
        zeros = ir.Constant(ir.VectorType(ir.IntType(32), WIDTH), [0] * WIDTH)
        return [builder.shuffle_vector(one, ir.Constant(vector, ir.Undefined), zeros)] * len(parts)
