"""Derivatives of traced functions, by sweeps backwards through their graph."""

from __future__ import annotations

from typing import Any

from looping_pendulum.reference_ode.core.expressions import Expression, ExpressionMath


def slopes_of(output: Expression) -> dict[int, Any]:
    """Return the derivatives of an output by every node that it depends on, numbers or expressions of the same graph.

    They are by the node's number; of a node that is missing the output does not depend.
    """
    graph, xp = output.graph, ExpressionMath(output.graph)
    slopes: dict[int, Any] = {output.number: 1.0}

    def add(x: Any, slope: Any) -> None:
        if isinstance(x, Expression) and (isinstance(slope, Expression) or slope != 0):
            slopes[x.number] = slopes[x.number] + slope if x.number in slopes else slope

    # A node is built after its operands, so that backwards every node comes after all that depend on it
    for node in sorted(_nodes_below(output), key=lambda n: n.number, reverse=True):
        slope = slopes.get(node.number)
        if slope is None or node.operation == "symbol":
            continue
        a, *others = node.operands
        b = others[0] if others else None
        match node.operation:
            case "+":
                add(a, slope)
                add(b, slope)
            case "-":
                add(a, slope)
                add(b, -slope)
            case "*":
                add(a, slope * b)
                add(b, slope * a)
            case "/":
                quotient = slope / b
                add(a, quotient)
                add(b, -(quotient * node))
            case "neg":
                add(a, -slope)
            case "?:":
                # The condition has no derivative; `where` keeps what is not finite in the branch that is not taken out
                add(b, graph.where(a, slope, 0.0))
                add(others[1], graph.where(a, 0.0, slope))
            case "abs":
                add(a, graph.where(a >= 0, slope, -slope))
            case "sqrt":
                # At 0 it is the size of a velocity at rest, which only multiplies components of 0
                add(a, graph.where(a > 0, slope * 0.5 / node, 0.0))
            case "exp":
                add(a, slope * node)
            case "log":
                add(a, slope / a)
            case "sin":
                add(a, slope * xp.cos(a))
            case "cos":
                add(a, -(slope * xp.sin(a)))
            case "tanh":
                add(a, slope * (1.0 - node * node))
            case _:
                raise TypeError(f"{node.operation} has no derivative")
    return slopes


def _nodes_below(output: Expression) -> list[Expression]:
    """Return all nodes on which ``output`` depends smoothly, itself included: those of conditions are left out."""
    found = {output.number: output}
    waiting = [output]
    while waiting:
        node = waiting.pop()
        operands = node.operands[1:] if node.operation == "?:" else () if node.operation == "symbol" else node.operands
        for x in operands:
            if isinstance(x, Expression) and x.number not in found:
                found[x.number] = x
                waiting.append(x)
    return list(found.values())
