"""The laws of a step, checked from outside: written from the definitions, without the solver."""
