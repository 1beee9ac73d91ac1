"""First minutes with Bowstring from Python. Run it from anywhere: python first_minutes.py"""

import numpy as np

import bowstring as bs
from bowstring.constant_curvature import RobotArcs

np.set_printoptions(precision=3, suppress=True)

# 1. A robot: built in, or your own file (see my_robot.yaml). Fields can be overridden.
robot = bs.load_robot("amouri2019")
thick = robot.with_({"segments.0.disks.clamped_length": "3 mm"})
print(f"1. {robot.name}: {1e3 * robot.length:g} mm long, {len(robot.tendons.angle_rad)} tendons")

# 2. Physics: the equilibrium under 80 N on tendon 1. No numbers unless it converged.
solution = bs.solve(robot, [80, 0, 0]).raise_for_status()
print(f"2. tip by statics:               {1e3 * solution.tip.position} mm")
print(f"   with 3 mm thick disks:        {1e3 * bs.solve(thick, [80, 0, 0]).tip.position} mm")

# 3. Constant curvature has two meanings: given the tendon lengths ...
from_lengths = RobotArcs.from_lengths(robot, solution.tendon_lengths)
print(f"3. arc from its tendon lengths:  {1e3 * from_lengths.tip.position} mm")

# 4. ... or given the force, by the linear law. This is the one that fails.
from_force = RobotArcs.from_tensions(robot, [80, 0, 0])
print(f"4. arc from the force:           {1e3 * from_force.tip.position} mm")

# 5. Both are corrected in closed form: straight spans, and the mean lever arm.
chord = RobotArcs.from_lengths(robot, solution.tendon_lengths, correction="chord")
arm = RobotArcs.from_tensions(robot, [80, 0, 0], law="arm")
for name, arcs in (("lengths, chords", chord), ("force, mean arm", arm)):
    error = np.linalg.norm(arcs.tip.position - solution.tip.position)
    print(f"5. error from {name}:    {1e3 * error:.4f} mm")

# 6. Many loads in one call: a sweep follows one path, a batch takes independent loads.
forces = np.linspace(0, 80, 17)
sweep = bs.sweep(robot, np.outer(forces, [1, 0, 0]), load=bs.Load(gravity=(0, 0, -9.81)))
print(f"6. upright under gravity, tip height from {1e3 * sweep.tip_position[0, 2]:.1f} to", end="")
print(f" {1e3 * sweep.tip_position[-1, 2]:.1f} mm; all converged: {sweep.converged.all()}")
