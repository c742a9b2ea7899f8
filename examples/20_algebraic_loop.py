"""
Algebraic loops
===============

Two amplifiers without memory that read each other have no order of evaluation. The error prints the loop,
port by port, and the picture shows it in red. (The example *Algebraic loops, solved* solves such equations.)
"""

from trussflow.blocks import AlgebraicLoopError, Constant, Diagram, Gain, Sum, TransferFunction, simulate

loop = Diagram("loop")
one, error, first, second = loop.add(one=Constant(1.0), error=Sum("+-"), first=Gain(2.0), second=Gain(0.3))
one.y >> error.u1
error >> first >> second
second.y >> error.u2
loop.draw("algebraic_loop.svg")
try:
    simulate(loop, 1.0, step=1e-3)
except AlgebraicLoopError as problem:
    print(problem)

# %%
# Real amplifiers have a lag. With a lag in the loop there is an order again, and the loop settles at
# 2 / (1 + 0.6):

loop = Diagram("loop with a lag")
one, error, first, second = loop.add(
    one=Constant(1.0), error=Sum("+-"), first=TransferFunction([2.0], [0.01, 1.0]), second=Gain(0.3)
)
one.y >> error.u1
error >> first >> second
second.y >> error.u2
loop.draw("loop_with_lag.svg")
print(simulate(loop, 0.1, step=1e-4)["first.y"][-1].values.round(6))
