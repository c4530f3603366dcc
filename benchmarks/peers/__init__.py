"""Other solvers on the same problems: SUNDIALS (C), SciPy (compiled and article's right-hand side) and MuJoCo."""
