"""Work-precision diagrams: error of the whole motion vs. CPU time, all solvers on all cases."""
