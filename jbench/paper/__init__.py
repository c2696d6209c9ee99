"""The paper: its citation, its published curves and the matrices of its figures."""

CITATION = (
    "Jérémy Augot, Aaron J. Snoswell and Surya P. N. Singh: A Reduced-Order Approach to Assist "
    "with Reinforcement Learning for Underactuated Robotics. Australasian Conference on Robotics "
    "and Automation (ACRA), 2020."
)
