"""Calls every method of a kind of another package once, before a training that may take hours."""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import torch

from jbench.encoders.kind import Learned
from jbench.encoders.loop import EncoderLearner
from jbench.encoders.states import States
from jbench.errors import RequestError, WorkError, sentence_of_failure

_ROWS = 8

_Result = TypeVar("_Result")


def check_kind(
    kind: Learned, name: str, states: States, latents: int, device: torch.device
) -> None:
    """Calls the methods on a few held-out rows, and `encode` and `decode` also on numpy arrays.

    Args:
        name: of the kind.
        states: that have been read.

    Raises:
        WorkError: if a method fails, or returns another shape than it must.
    """

    def attempt(method: str, call: Callable[[], _Result]) -> _Result:
        try:
            return call()
        except (RequestError, WorkError):
            raise
        except NotImplementedError:
            raise _refusal(name, f"it has no method {method}") from None
        except Exception as error:
            reason = f"{method} fails ({sentence_of_failure(error)})"
            raise _refusal(name, reason) from None

    def check_shape(method: str, call: Callable[[], Any], wanted: tuple[int, ...]) -> None:
        if (shape := np.shape(attempt(f"{method} of numpy arrays", call))) != wanted:
            raise _refusal(name, f"{method} returns the shape {shape}, not {wanted}")

    constants = attempt("constants", lambda: kind.constants(states))
    learner = attempt(
        "initial",
        lambda: EncoderLearner(
            kind, states.size, latents, 0, device, constants, action_size=states.action_size
        ),
    )
    ahead = kind.steps_ahead
    rows = torch.arange(min(_ROWS, states.sample.pairs(ahead)), device=device)
    clean = states.sample.take(rows, ahead, kind.uses_actions)
    batch = attempt("prepare", lambda: kind.prepare(clean, latents, torch.Generator()))
    trained = {key: value for key, value in learner.weights.items() if key not in constants}
    gradients = {key: torch.zeros_like(value) for key, value in trained.items()}
    attempt("loss", lambda: kind.gradient(learner.weights, gradients, batch))
    weights = {key: value.detach().cpu().numpy() for key, value in learner.weights.items()}
    features = np.zeros((len(rows), states.size), np.float32)
    encoded = np.zeros((len(rows), latents), np.float32)
    check_shape("encode", lambda: kind.encode(weights, features), encoded.shape)
    check_shape("decode", lambda: kind.decode(weights, encoded), features.shape)


def _refusal(name: str, reason: str) -> WorkError:
    return WorkError(
        f"The kind of encoder {name} can't be trained: {reason}; docs/your-own-encoder.md "
        "describes the methods."
    )
