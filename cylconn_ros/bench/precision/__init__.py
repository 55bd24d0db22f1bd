"""Work-precision diagrams: error against CPU time, all solvers on all cases."""
