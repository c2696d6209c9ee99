"""The paper: its citation, its published curves and the matrices of its figures."""
