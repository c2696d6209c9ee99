"""The paper: its citation, its published curves and the matrices of its figures."""

AUTHORS = ("Jérémy Augot", "Aaron J. Snoswell", "Surya P. N. Singh")
TITLE = "A Reduced-Order Approach to Assist with Reinforcement Learning for Underactuated Robotics"
VENUE = "Australasian Conference on Robotics and Automation (ACRA)"
YEAR = 2020
CITATION = f"{', '.join(AUTHORS[:-1])} and {AUTHORS[-1]}: {TITLE}. {VENUE}, {YEAR}."
