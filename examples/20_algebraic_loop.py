"""
Algebraic loops
===============

Two amplifiers without memory that read each other: nothing says which comes first, and nothing is
guessed. The error names the way around, port by port, and the picture shows it in red. (To have such
equations solved: the example *Algebraic loops, solved*.)
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
# No amplifier is infinitely fast. With a lag in the circle there is an order again, and the loop settles at
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
