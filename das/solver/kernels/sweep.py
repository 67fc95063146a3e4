"""The backward sweep: least cost and time-to-go of every state under every multiplier.

The landings of a state are tried under several multipliers at once, in the vectors of the processor. Compiled as a loop
over the multipliers, the sweep would spend most of its time on checking whether its arrays overlap, and on writing the
best cost to memory after every landing and reading it again. Numba has no way to write vectors. The loop over the
landings is therefore written here in the language of numba's back end (LLVM): the best costs of `LANES` multipliers,
and the landings that give them, stay in registers until all landings are tried. The back end splits the vectors to fit
the processor.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from das.compiling import kernel
from das.solver.kernels.tuples import Moves
from das.solver.tolerances import INFEASIBLE, UNREACHABLE

LANES = 8
"""Multipliers in a vector: as many float64 as the widest vectors hold."""

_NONE = -1
_FLAGS = ("contract", "nnan", "ninf", "nsz")
"""A product and a sum may be fused. Their order is kept, so that every part of the ladder gets the same bits."""


class NodeRows(NamedTuple):
    """Values (J) and times-to-go (s) of the states of one decision node (speeds, L)."""

    value_j: NDArray[np.float64]
    time_to_go_s: NDArray[np.float32]


def relaxation(vectors: int, *, partly: bool = False) -> Any:
    """A function for kernels: least cost and time-to-go of one state under `vectors`·LANES multipliers.

    It takes the moves of some nodes, the place (node of the moves, speed, first multiplier, end of the multipliers),
    the multipliers, the rows of the node after and the rows of the node, which it fills. With `partly` only the
    multipliers before the end are read and written.
    """

    @intrinsic
    def relax(_typing, moves, place, price, ahead, here):
        def generate(context, builder, signature, arguments):
            arrays = _Arrays(context, builder, signature, arguments)
            _Relaxation(builder, arrays, vectors, partly).write()
            return context.get_dummy_value()

        return types.void(moves, place, price, ahead, here), generate

    return relax


class _Arrays:
    """The arguments of a relaxation, taken apart: where their arrays begin, how large they are, and the place."""

    def __init__(self, context, builder, signature, arguments):
        from numba.core import cgutils

        def array(kind, value):
            return context.make_array(kind)(context, builder, value)

        def parts(which):
            kinds = signature.args[which].types
            return [array(kind, builder.extract_value(arguments[which], i)) for i, kind in enumerate(kinds)]

        moves, ahead, here = parts(0), parts(3), parts(4)
        _, self.states, self.landings = cgutils.unpack_tuple(builder, moves[0].shape)
        _, self.multipliers = cgutils.unpack_tuple(builder, ahead[0].shape)
        self.moves = Moves(*(one.data for one in moves))
        self.ahead, self.here = (NodeRows(*(one.data for one in rows)) for rows in (ahead, here))
        self.node, self.speed, self.first, self.end = cgutils.unpack_tuple(builder, arguments[1])
        self.price = array(signature.args[2], arguments[2]).data


class _Relaxation:
    """Writes the code: a loop over the landings of a state, then the result."""

    def __init__(self, builder, arrays, vectors, partly):
        from llvmlite import ir

        self.ir, self.builder, self.arrays = ir, builder, arrays
        self.offsets = [LANES * i for i in range(vectors)]
        self.whole, self.number = ir.IntType(64), ir.DoubleType()
        self.lane = self.constant(self.whole, range(LANES))
        self.row = builder.mul(builder.add(builder.mul(arrays.node, arrays.states), arrays.speed), arrays.landings)
        within = builder.icmp_signed("<", self.lane, self.spread(builder.sub(arrays.end, arrays.first)))
        self.mask = within if partly else None

    def write(self):
        """Write all of the code."""
        best, choice = self.tried()
        for offset, least, landing in zip(self.offsets, best, choice, strict=True):
            self.settle(offset, least, landing)

    def tried(self):
        """The loop over the landings: the least costs, and which landings give them."""
        builder, arrays, whole = self.builder, self.arrays, self.whole
        prices = [self.load(arrays.price, builder.add(arrays.first, whole(offset))) for offset in self.offsets]
        place = builder.add(builder.mul(arrays.node, arrays.states), arrays.speed)
        count = builder.sext(builder.load(builder.gep(arrays.moves.filled, [place])), whole)
        before = builder.block
        head, body, after = (builder.append_basic_block(f"landings_{name}") for name in ("head", "body", "after"))
        builder.branch(head)
        builder.position_at_end(head)
        landing = builder.phi(whole)
        best = [builder.phi(self.vector(self.number)) for _ in prices]
        choice = [builder.phi(self.vector(whole)) for _ in prices]
        builder.cbranch(builder.icmp_signed("<", landing, count), body, after)
        builder.position_at_end(body)
        costs = self.costs(landing, prices)
        cheaper = [builder.fcmp_ordered("<", cost, least) for cost, least in zip(costs, best, strict=True)]
        tried = self.spread(landing)
        new_best = [builder.select(*each) for each in zip(cheaper, costs, best, strict=True)]
        new_choice = [builder.select(less, tried, one) for less, one in zip(cheaper, choice, strict=True)]
        following = builder.add(landing, whole(1))
        builder.branch(head)
        starts = [whole(0)]
        starts += [self.constant(self.number, [INFEASIBLE] * LANES)] * len(best)
        starts += [self.constant(whole, [_NONE] * LANES)] * len(choice)
        news = [following, *new_best, *new_choice]
        for phi, start, new in zip([landing, *best, *choice], starts, news, strict=True):
            phi.add_incoming(start, before)
            phi.add_incoming(new, body)
        builder.position_at_end(after)
        return best, choice

    def costs(self, landing, prices):
        """Energy + λ·time + value at the landing (linear in v²) under each vector of multipliers."""
        builder, arrays, place = self.builder, self.arrays, self.builder.add(self.row, landing)
        energy_j = self.spread(builder.load(builder.gep(arrays.moves.energy_j, [place])))
        time_s = self.spread(self.double(builder.load(builder.gep(arrays.moves.time_s, [place]))))
        share = self.double(builder.load(builder.gep(arrays.moves.weight, [place])))
        above, below = self.spread(share), self.spread(builder.fsub(self.number(1.0), share))
        target = builder.sext(builder.load(builder.gep(arrays.moves.target, [place])), self.whole)
        at = builder.add(builder.mul(target, arrays.multipliers), arrays.first)
        costs = []
        for offset, price in zip(self.offsets, prices, strict=True):
            low = self.load(arrays.ahead.value_j, builder.add(at, self.whole(offset)))
            high = self.load(arrays.ahead.value_j, builder.add(builder.add(at, arrays.multipliers), self.whole(offset)))
            costs.append(self.plus(self.plus(self.plus(energy_j, price, time_s), below, low), above, high))
        return costs

    def settle(self, offset, best, choice):
        """Write the value and the time-to-go of a vector of multipliers."""
        builder, arrays, ir = self.builder, self.arrays, self.ir
        reached = builder.and_(
            builder.icmp_signed(">=", choice, self.constant(self.whole, [0] * LANES)),
            # Between a feasible and an infeasible neighbour the interpolated cost is neither.
            builder.fcmp_ordered("<=", best, self.constant(self.number, [UNREACHABLE] * LANES)),
        )
        known = reached if self.mask is None else builder.and_(reached, self.mask)
        place = builder.add(self.spread(self.row), choice)
        share = self.gather(arrays.moves.weight, place, ir.FloatType(), known)
        target = builder.sext(self.gather(arrays.moves.target, place, ir.IntType(32), known), self.vector(self.whole))
        rows = self.spread(arrays.multipliers)
        column = builder.add(self.spread(builder.add(arrays.first, self.whole(offset))), self.lane)
        at = builder.add(builder.mul(target, rows), column)
        low = self.double(self.gather(arrays.ahead.time_to_go_s, at, ir.FloatType(), known))
        high = self.gather(arrays.ahead.time_to_go_s, builder.add(at, rows), ir.FloatType(), known)
        below = builder.fsub(self.constant(self.number, [1.0] * LANES), self.double(share))
        step_s = self.double(self.gather(arrays.moves.time_s, place, ir.FloatType(), known))
        time_s = builder.fadd(self.plus(step_s, below, low), self.double(builder.fmul(share, high)))
        out = builder.add(builder.add(builder.mul(arrays.speed, arrays.multipliers), arrays.first), self.whole(offset))
        never = self.constant(self.number, [INFEASIBLE] * LANES)
        self.store(builder.select(reached, best, never), arrays.here.value_j, out)
        time_s = builder.select(reached, time_s, never)
        self.store(builder.fptrunc(time_s, self.vector(ir.FloatType())), arrays.here.time_to_go_s, out)

    def plus(self, sum_, factor, other):
        """sum + factor·other."""
        builder = self.builder
        return builder.fadd(builder.fmul(factor, other, flags=_FLAGS), sum_, flags=_FLAGS)

    def vector(self, kind):
        """The type of a vector of this kind."""
        return self.ir.VectorType(kind, LANES)

    def constant(self, kind, values):
        """A vector of constants."""
        return self.ir.Constant(self.vector(kind), list(values))

    def spread(self, value):
        """A vector whose lanes are all one value."""
        builder, ir = self.builder, self.ir
        undefined, first = ir.Constant(self.vector(value.type), ir.Undefined), ir.IntType(32)(0)
        alone = builder.insert_element(undefined, value, first)
        return builder.shuffle_vector(alone, undefined, self.constant(ir.IntType(32), [0] * LANES))

    def double(self, value):
        """A number or vector in double precision."""
        wide = self.vector(self.number) if isinstance(value.type, self.ir.VectorType) else self.number
        return self.builder.fpext(value, wide)

    def load(self, data, place):
        """The vector of double precision at a place of an array."""
        kind = self.vector(self.number)
        pointer = self.builder.bitcast(self.builder.gep(data, [place]), kind.as_pointer())
        if self.mask is None:
            loaded = self.builder.load(pointer)
            loaded.align = self.bytes_of(kind.element)
            return loaded
        rest = self.constant(self.number, [0.0] * LANES)
        return self.call("load", kind, [pointer, self.alignment(kind), self.mask, rest])

    def store(self, value, data, place):
        """Write a vector to a place of an array."""
        pointer = self.builder.bitcast(self.builder.gep(data, [place]), value.type.as_pointer())
        if self.mask is None:
            self.builder.store(value, pointer).align = self.bytes_of(value.type.element)
        else:
            self.call("store", value.type, [value, pointer, self.alignment(value.type), self.mask])

    def gather(self, data, places, kind, mask):
        """The numbers at the places of an array where the mask is set."""
        builder, ir = self.builder, self.ir
        begin = self.spread(builder.ptrtoint(data, self.whole))
        size = self.constant(self.whole, [self.bytes_of(kind)] * LANES)
        addresses = builder.add(begin, builder.mul(places, size))
        pointers = builder.inttoptr(addresses, self.vector(ir.PointerType(kind)))
        vector = self.vector(kind)
        rest = ir.Constant(vector, [0 if isinstance(kind, ir.IntType) else 0.0] * LANES)
        return self.call("gather", vector, [pointers, self.alignment(vector), mask, rest])

    def call(self, what, vector, arguments):
        """Call the back end's masked load, store or gather of a kind of vector."""
        from numba.core import cgutils

        ir = self.ir
        kind = {ir.DoubleType: "f64", ir.FloatType: "f32", ir.IntType: "i32"}[type(vector.element)]
        pointers = f"v{LANES}p0" if what == "gather" else "p0"
        returned = ir.VoidType() if what == "store" else vector
        function = cgutils.get_or_insert_function(
            self.builder.module,
            ir.FunctionType(returned, [argument.type for argument in arguments]),
            f"llvm.masked.{what}.v{LANES}{kind}.{pointers}",
        )
        return self.builder.call(function, arguments)

    def alignment(self, vector):
        """The alignment (bytes) that the back end may rely on: that of a single number."""
        return self.ir.IntType(32)(self.bytes_of(vector.element))

    def bytes_of(self, kind):
        """Size of a number (bytes)."""
        return 8 if isinstance(kind, self.ir.DoubleType) else 4


_TWO_VECTORS = 2 * LANES
_relax_two, _relax_one, _relax_some = relaxation(2), relaxation(1), relaxation(1, partly=True)


@kernel
def backward_sweep(first, last, lam, moves, value, time_to_go):
    """Bellman sweep of the multipliers lam[first … last − 1] at once: value (J) and time-to-go (s) of every state.

    value[k, j, l] = min over landings of energy + lam·dt + value at the landing (linear in v²). Row k = n of both
    outputs must hold the end values; the other rows are filled.
    """
    n, states = moves.filled.shape
    for k in range(n - 1, -1, -1):
        ahead, here = NodeRows(value[k + 1], time_to_go[k + 1]), NodeRows(value[k], time_to_go[k])
        for j in range(states):
            l = first
            while last - l >= _TWO_VECTORS:
                _relax_two(moves, (k, j, l, last), lam, ahead, here)
                l += _TWO_VECTORS
            if last - l >= LANES:
                _relax_one(moves, (k, j, l, last), lam, ahead, here)
                l += LANES
            if l < last:
                _relax_some(moves, (k, j, l, last), lam, ahead, here)
