"""Answers to lifecycle requests that the present state does not allow."""

from __future__ import annotations

from typing import Any

from rclpy.lifecycle import LifecycleNode


def answer_unavailable_transitions(node: LifecycleNode) -> None:
    """Make ``~/change_state`` answer every request, and log why one is refused.

    rclpy raises an exception for a transition that the present state does not have, and sends no
    answer: the client would wait forever.
    """
    service, machine = node._service_change_state, node._state_machine
    change = service.callback

    def answer(request: Any, response: Any) -> Any:
        state, wanted = machine.current_state[1], request.transition
        available = {label: number for number, label, *_ in machine.available_transitions}
        try:
            return change(request, response)
        except Exception as error:
            known = wanted.label in available or wanted.id in available.values()
            reason = f"; {error}" if known else ""
            those = ", ".join(f"{label} ({number})" for label, number in available.items())
            node.get_logger().error(
                f"transition {wanted.label or wanted.id} refused: the node is {state}; it allows "
                f"{those or 'none'}{reason}"
            )
            response.success = False
            return response

    service.callback = answer
