"""Four rows of first-order lags at a time, in vector registers.

Row by row a lag f = a f + w s costs the latency of one multiply-add a row, since every row waits for the one before.
Four rows ahead the state follows f' = a^4 f + (a weighted sum of the inputs between), and the rows between are sums of
the same inputs and of the state at the block's start: only every fourth row waits, and what is summed fills vectors
of four numbers. Numba does not put neighbouring numbers into vectors by itself, so the loop is written in LLVM's own
terms; a processor without such registers gets the same sums in pieces.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

ROWS = 4
_VECTOR = ir.VectorType(ir.DoubleType(), ROWS)
_LANE = ir.IntType(32)
_ANY = ir.Constant(_VECTOR, ir.Undefined)


class _Code:
    """Vector instructions at the builder's place."""

    def __init__(self, context: Any, builder: Any) -> None:
        self.builder = builder
        self.number = lambda i: context.get_constant(types.intp, i)

    def place(self, pointer: Any, index: Any) -> Any:
        """Four numbers from `index` on, as the address of a vector."""
        return self.builder.bitcast(self.builder.gep(pointer, [index]), _VECTOR.as_pointer())

    def load(self, pointer: Any, index: Any) -> Any:
        return self.builder.load(self.place(pointer, index), align=8)

    def store(self, value: Any, pointer: Any, index: Any) -> None:
        self.builder.store(value, self.place(pointer, index), align=8)

    def lane(self, vector: Any, j: int) -> Any:
        """Lane j in all lanes."""
        return self.builder.shuffle_vector(vector, _ANY, ir.Constant(ir.VectorType(_LANE, ROWS), [j] * ROWS))

    def everywhere(self, pointer: Any, index: Any) -> Any:
        """One number in all lanes."""
        number = self.builder.load(self.builder.gep(pointer, [index]))
        return self.lane(self.builder.insert_element(_ANY, number, ir.Constant(_LANE, 0)), 0)

    def times(self, x: Any, y: Any) -> Any:
        return self.builder.fmul(x, y, flags=("contract",))

    def plus(self, x: Any, y: Any) -> Any:
        return self.builder.fadd(x, y, flags=("contract",))

    def products(self, x: list[Any], y: list[Any], start: Any = None) -> Any:
        """start + x[0] y[0] + x[1] y[1] + ..., each a fused multiply-add where the processor has one."""
        for a, b in zip(x, y, strict=True):
            start = self.times(a, b) if start is None else self.plus(self.times(a, b), start)
        return start


def four_rows(first_taps: int, second_taps: int, add: bool) -> Any:
    """A compiled loop over blocks of four rows, to be called from kernels:

    loop(first, second, now, later, carried, decay, f, out, blocks)

    Block i reads first[4 i + r], r < first_taps, and second[4 i + r], r < second_taps: the inputs x (taps,).
    now (taps, 4): output of the block's rows for each input. later (taps, 4): the states after the block for each
    input. carried (4, 4): output of the rows for each state before the block. decay (2, 4): of the states over a
    block, and what is missing in it. f (4,): the states before the first block, on return those after the last one.
    out (4 blocks,) is set or, with `add`, added to. The inputs are finite: an output is also made of inputs that come
    later, times zero. Compilation raises TypingError where an array is not contiguous float64.
    """
    taps = first_taps + second_taps

    def loop(typingctx: Any, first: Any, second: Any, now: Any, later: Any, carried: Any, decay: Any, f: Any,
             out: Any, blocks: Any) -> Any:  # fmt: skip
        for array in (first, second, now, later, carried, decay, f, out):
            if array.layout != "C" or array.dtype != types.float64:
                raise TypingError(f"four_rows: {array}; it takes contiguous arrays of float64")
        signature = types.void(first, second, now, later, carried, decay, f, out, blocks)

        def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
            code = _Code(context, builder)
            number = code.number
            data = [
                context.make_array(kind)(context, builder, value).data
                for kind, value in zip(sig.args[:-1], args[:-1], strict=True)
            ]
            x1, x2, p_now, p_later, p_carried, p_decay, p_f, p_out = data
            columns = [[code.load(p, number(ROWS * i)) for i in range(n)]
                       for p, n in ((p_now, taps), (p_later, taps), (p_carried, ROWS), (p_decay, 2))]  # fmt: skip
            to_rows, to_states, from_states, (kept, missing) = columns
            state, before = cgutils.alloca_once(builder, _VECTOR), cgutils.alloca_once(builder, _VECTOR)
            builder.store(code.load(p_f, number(0)), state)
            builder.store(code.load(p_f, number(0)), before)
            with cgutils.for_range(builder, args[-1]) as each:
                at = builder.mul(each.index, number(ROWS))
                x = [code.everywhere(x1, builder.add(at, number(r))) for r in range(first_taps)]
                x += [code.everywhere(x2, builder.add(at, number(r))) for r in range(second_taps)]
                here = builder.load(state)
                rows = code.products(to_rows, x, code.load(p_out, at) if add else None)
                rows = code.plus(rows, code.products(from_states, [code.lane(here, j) for j in range(ROWS)]))
                code.store(rows, p_out, at)
                # what rounding took from the decay is so little that the state of a block ago will do: no waiting
                news = code.products([*to_states, missing], [*x, builder.load(before)])
                builder.store(here, before)
                builder.store(code.plus(code.times(kept, here), news), state)
            code.store(builder.load(state), p_f, number(0))
            return context.get_dummy_value()

        return signature, generate

    return intrinsic(loop)
