"""The two ways of moving that all hand-written policies combine, as control laws.

Driving: the mass oscillates about the side to which the robot is to move, and the robot follows it.
Each reversal jolts the torso, which rocks on its springy legs, and the feet slip.

Turning: the mass rotates in one direction. The torso moves with it, its weight shifts from foot to
foot, and the robot turns in the same direction, although the motor's reaction torque opposes it.

With the motor off, friction holds the robot; it does not move below a torque of about 0.3.

Torques are fractions of the full torque. "Forward" and "left" are in the robot's frame. A bearing
is 0 forward and increases to the left (counter-clockwise). All other units are SI (m, s, rad).
"""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jbench.array_types import FloatArray
from jbench.tasks.jitterbug import features, geometry

Plane = NDArray[np.complex128]
"""Vectors in the plane of the floor as complex numbers: forward + 1j left, or x + 1j y."""

_TORSO_OFFSET = (0.0, 0.006008, -0.011055)  # center of mass of the torso: `model.torso_offset` (m)


class Motion(NamedTuple):
    """The quantities of an observation that the laws use, each (robots,)."""

    mass: FloatArray  # direction of the eccentric mass; 0 forward, pi / 2 left (rad)
    mass_rate: FloatArray  # rad/s
    speed: Plane  # of the torso's center of mass (m/s)
    tilt: Plane  # sines of the angles of the forward and left axes above horizontal (1)
    tilt_rate: Plane  # its rate (1/s)
    yaw_rate: FloatArray  # rad/s
    heading: FloatArray  # direction of the forward axis in the world (rad)
    position: Plane  # in the world (m)
    target: Plane  # relative to the robot; 0 if not observed (m)
    angle: FloatArray  # remaining yaw angle; 0 if not observed (rad)


def read_motion(task: str, observation: NDArray[np.floating]) -> Motion:
    """Returns the motion of the robots in their own frames, observed from above."""
    physical = features.denormalize(task, np.asarray(observation, dtype=np.float64))
    observed = features.split(task, physical)
    position = observed["position"]
    velocity = observed["velocity"]
    mass = observed["motor_position"][..., 0]
    mass_rate = observed["motor_velocity"][..., 0]
    torso = geometry.center_of_mass_velocity(position, velocity, np.array(_TORSO_OFFSET))
    heading = geometry.heading(geometry.State(position, velocity, mass, mass_rate, torso))
    up = geometry.rotation_matrix(position[..., 3:7])[..., 2, :]
    none = np.zeros_like(mass)
    target = observed.get("target_in_jitterbug_frame", np.zeros((*none.shape, 3)))

    return Motion(
        mass=mass,
        mass_rate=mass_rate,
        speed=(torso[..., 0] + 1j * torso[..., 1]) * np.exp(-1j * heading),
        tilt=-up[..., 1] + 1j * up[..., 0],
        tilt_rate=-velocity[..., 3] - 1j * velocity[..., 4],
        yaw_rate=velocity[..., 5],
        heading=heading,
        position=position[..., 0] + 1j * position[..., 1],
        target=-target[..., 1] + 1j * target[..., 0],
        angle=observed["angle_to_target"][..., 0] if "angle_to_target" in observed else none,
    )


@dataclass
class Law:
    """Base class of the laws: their state, and actions from torques."""

    task: ClassVar[str]

    def reset(self, robots: int) -> None:
        """Resets which robots rest and which turn."""
        self._rests = np.zeros(robots, dtype=bool)
        self._turns = np.zeros(robots, dtype=bool)

    def act(self, observation: NDArray[np.floating]) -> FloatArray:
        """Returns actions (robots, 1) in [-1, 1] for observations (robots, dim(O))."""
        return np.clip(self._torque(read_motion(self.task, observation)), -1, 1)[..., None]

    def _torque(self, motion: Motion) -> FloatArray:
        """Returns torques (robots,)."""
        raise NotImplementedError

    def _rest(self, value: FloatArray, arrive: float, depart: float) -> NDArray[np.bool_]:
        """Applies hysteresis: rest below `arrive`, resume above `depart`."""
        self._rests = value < np.where(self._rests, np.maximum(depart, arrive), arrive)
        return self._rests


@dataclass
class Driver(Law):
    """Oscillates the mass about the side to which the robot is to move.

    A memoryless oscillator similar to van der Pol's: a spring pulls the mass to the desired side,
    and a damping term adds energy while the mass is on that side and removes it on the other. Its
    period is not fixed, so it synchronizes with the rocking of the torso through the gain on the
    tilt. It drives at 0.12 m/s; a relay controller reaches 0.083 m/s.
    """

    spring: float = 0.41  # torque per sine of the mass's angle to the bearing
    energy_gain: float = 0.0046  # torque per rad/s of the mass, times the cosine of its angle (s)
    side_damping: float = 2.8  # torque per m/s to the left of the bearing, times that cosine (s/m)
    tilt_gain: float = 4.8  # torque per sine of the tilt across the bearing
    max_tilt: float = 0.15  # bound of the tilt's sine in that term
    yaw_gain: float = 0.01  # torque per rad/s of yaw rate (s)
    bearing_gain: float = 0.16  # torque against the sine of the bearing
    fall_tilt: float = 0.38  # sine of the tilt beyond which the mass moves to the raised side

    def _drive(
        self,
        motion: Motion,
        bearing: FloatArray,
        drive_scale: FloatArray | float = 1.0,
        more: FloatArray | float = 0.0,
    ) -> FloatArray:
        """Returns the torque (robots,) that drives towards a bearing (robots,), plus `more`."""
        to_bearing = np.exp(-1j * bearing)
        sine = np.sin(motion.mass - bearing)
        cosine = np.cos(motion.mass - bearing)
        torque = (
            -self.spring * sine
            + drive_scale * self.energy_gain * motion.mass_rate * cosine
            - self.side_damping * (motion.speed * to_bearing).imag * cosine
            + self.tilt_gain * (self._bounded_tilt(motion) * to_bearing).imag
            + self.yaw_gain * motion.yaw_rate
            - self.bearing_gain * np.sin(bearing)
            + more
        )
        righting = -np.sin(motion.mass - np.angle(motion.tilt))
        falls = np.abs(motion.tilt) > self.fall_tilt
        return np.where(falls, righting, np.clip(torque, -1, 1))

    def _bounded_tilt(self, motion: Motion) -> Plane:
        """Returns the tilt, shortened to the longest that the law takes into account."""
        return motion.tilt * np.minimum(1, self.max_tilt / np.maximum(np.abs(motion.tilt), 1e-6))


@dataclass
class Turner(Law):
    """Rotates the mass in the direction in which the robot is to turn.

    The torque increases with the remaining angle up to a bound. It is lower while the mass is in
    front and on the side of the turn, and it follows the torso's rocking. The mass then rotates
    unevenly and in phase with the torso, which turns about twice as fast as a constant torque.
    """

    min_torque: float = 0.185  # at a remaining angle of 0
    torque_gain: float = 1.36  # torque per rad of remaining angle (1/rad)
    max_torque: float = 0.63
    front: float = -0.42  # relative torque per cosine of the mass's angle
    side_gain: float = -0.385  # relative torque per sine, positive on the side of the turn
    double_gain: float = 0.19  # relative torque per cosine of twice that angle
    pitch_gain: float = 0.107  # relative torque per rad/s at which the front rises (s)
    roll_gain: float = 0.084  # relative torque per rad/s at which that side rises (s)

    def _turn(
        self,
        motion: Motion,
        more: FloatArray | float = 0.0,
        at_max_torque: NDArray[np.bool_] | bool = False,
    ) -> FloatArray:
        """Returns the torque (robots,) that turns by the remaining angle.

        `more` is relative torque to add; those of a mask turn with the maximum torque.
        """
        direction = np.sign(motion.angle)
        remaining = np.abs(motion.angle)
        modulation = (
            1
            + self.front * np.cos(motion.mass)
            + direction * self.side_gain * np.sin(motion.mass)
            + self.double_gain * np.cos(2 * motion.mass)
            + self.pitch_gain * motion.tilt_rate.real
            + direction * self.roll_gain * motion.tilt_rate.imag
            + more
        )
        torque = np.minimum(self.min_torque + self.torque_gain * remaining, self.max_torque)
        return direction * np.where(at_max_torque, self.max_torque, torque) * modulation
