"""Hand-written policies for the five tasks: closed-form control laws with a few tuned constants.

All laws combine two ways of moving:

Driving: the mass oscillates about the side to which the robot is to move, and the robot follows it.
Each reversal jolts the torso, which rocks on its springy legs, and the feet slip.

Turning: the mass rotates in one direction. The torso moves with it, its weight shifts from foot to
foot, and the robot turns in the same direction, although the motor's reaction torque opposes it.

With the motor off, friction holds the robot; it does not move below a torque of about 0.3.

Torques are fractions of the full torque. "Forward" and "left" are in the robot's frame. A bearing
is 0 forward and increases to the left (counter-clockwise). All other units are SI (m, s, rad).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from jbench.tasks import features

Array = NDArray[np.float64]
Plane = NDArray[np.complex128]
"""Vectors in the plane of the floor as complex numbers: forward + 1j left, or x + 1j y."""

_TORSO_OFFSET = (0.0, 0.006008, -0.011055)
"""Centre of mass of the torso in its own frame (m): `model.torso_offset`."""


class Heuristic(Protocol):
    """A hand-written policy for a batch of robots."""

    task: ClassVar[str]

    def reset(self, robots: int) -> None:
        """Resets the internal state for this many robots."""

    def act(self, observation: NDArray[np.floating]) -> Array:
        """Returns actions (robots, 1) in [-1, 1] for observations (robots, dim(O))."""


def heuristic(task: str) -> Heuristic:
    """Returns the hand-written policy of a task with its tuned constants.

    Raises:
        KeyError: if the task does not exist.
    """
    return HEURISTICS[task]()


class _Motion(NamedTuple):
    """The quantities of an observation that the laws use, each (robots,)."""

    mass: Array  # direction of the eccentric mass; 0 forward, pi / 2 left (rad)
    mass_rate: Array  # rad/s
    speed: Plane  # of the torso's centre of mass (m/s)
    tilt: Plane  # sines of the angles of the forward and left axes above horizontal (1)
    tilt_rate: Plane  # its rate (1/s)
    yaw_rate: Array  # rad/s
    heading: Array  # direction of the forward axis in the world (rad)
    position: Plane  # in the world (m)
    target: Plane  # relative to the robot; 0 if not observed (m)
    angle: Array  # remaining yaw angle; 0 if not observed (rad)


def _read(task: str, observation: NDArray[np.floating]) -> _Motion:
    """Returns the motion of the robots in their own frames, observed from above."""
    physical = features.denormalize(task, np.asarray(observation, dtype=np.float64))
    ends = np.cumsum([features.FEATURE_SIZES[n] for n in features.TASK_SPECS[task].features])
    parts = np.split(physical, ends[:-1], axis=-1)
    observed = dict(zip(features.TASK_SPECS[task].features, parts, strict=True))
    position, velocity = observed["position"], observed["velocity"]
    mass, mass_rate = observed["motor_position"][..., 0], observed["motor_velocity"][..., 0]
    torso = features.center_of_mass_velocity(position, velocity, np.array(_TORSO_OFFSET))
    heading = features.heading(features.State(position, velocity, mass, mass_rate, torso))
    up = features.rotation_matrix(position[..., 3:7])[..., 2, :]
    none = np.zeros_like(mass)
    target = observed.get("target_in_jitterbug_frame", np.zeros((*none.shape, 3)))
    return _Motion(
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
class _Law:
    """Base class of the laws: their state, and actions from torques."""

    task: ClassVar[str]

    def reset(self, robots: int) -> None:
        """Resets which robots rest and which turn."""
        self._rests = np.zeros(robots, dtype=bool)
        self._turns = np.zeros(robots, dtype=bool)

    def act(self, observation: NDArray[np.floating]) -> Array:
        """Returns actions (robots, 1) in [-1, 1] for observations (robots, dim(O))."""
        return np.clip(self._torque(_read(self.task, observation)), -1, 1)[..., None]

    def _torque(self, motion: _Motion) -> Array:
        """Returns torques (robots,)."""
        raise NotImplementedError

    def _rest(self, value: Array, arrive: float, depart: float) -> NDArray[np.bool_]:
        """Applies hysteresis: rest below `arrive`, resume above `depart`."""
        self._rests = value < np.where(self._rests, np.maximum(depart, arrive), arrive)
        return self._rests


@dataclass
class _Driver(_Law):
    """Oscillates the mass about the side to which the robot is to move.

    A memoryless oscillator similar to van der Pol's: a spring pulls the mass to the desired side,
    and a damping term adds energy while the mass is on that side and removes it on the other. Its
    period is not fixed, so it synchronises with the rocking of the torso through the gain on the
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
        motion: _Motion,
        bearing: Array,
        drive_scale: Array | float = 1.0,
        more: Array | float = 0.0,
    ) -> Array:
        """Returns the torque (robots,) that drives towards a bearing (robots,).

        Args:
            bearing: in the robot's frame (rad).
            drive_scale: factor of the energy term.
            more: torque to add.
        """
        to_bearing = np.exp(-1j * bearing)
        sine, cosine = np.sin(motion.mass - bearing), np.cos(motion.mass - bearing)
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

    def _bounded_tilt(self, motion: _Motion) -> Plane:
        """Returns the tilt, limited to `max_tilt`."""
        return motion.tilt * np.minimum(1, self.max_tilt / np.maximum(np.abs(motion.tilt), 1e-6))


@dataclass
class _Turner(_Law):
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
        motion: _Motion,
        more: Array | float = 0.0,
        at_max_torque: NDArray[np.bool_] | bool = False,
    ) -> Array:
        """Returns the torque (robots,) that turns by the remaining angle.

        Args:
            more: relative torque to add.
            at_max_torque: mask of robots that turn with the maximum torque.
        """
        direction, remaining = np.sign(motion.angle), np.abs(motion.angle)
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


@dataclass
class MoveFromOrigin(_Driver):
    """Drives away from the origin and rests permanently where the reward is 1.

    Near the origin it moves to its front left, where it is fastest.
    """

    task: ClassVar[str] = "move_from_origin"
    spring: float = 0.435  # as in `_Driver`, like the next six; faster from rest
    energy_gain: float = 0.0062
    side_damping: float = 3.9
    tilt_gain: float = 6.4
    max_tilt: float = 0.134
    yaw_gain: float = 0.0117
    bearing_gain: float = 0.21
    origin_radius: float = 0.0135  # within this distance of the origin it uses `start_bearing` (m)
    start_bearing: float = 0.81  # bearing of the fastest start (rad)
    away: float = 0.12  # beyond this distance it rests permanently (m)

    def _torque(self, motion: _Motion) -> Array:
        distance = np.abs(motion.position)
        self._rests |= distance > self.away
        outwards = np.angle(motion.position * np.exp(-1j * motion.heading))
        bearing = np.where(distance < self.origin_radius, self.start_bearing, outwards)
        return np.where(self._rests, 0, self._drive(motion, bearing))


@dataclass
class FaceDirection(_Turner):
    """Turns to the target's direction and rests.

    It rests slightly early, since mass and torso need two control steps to stop.
    """

    task: ClassVar[str] = "face_direction"
    arrive: float = 0.075  # rests below this remaining angle (rad)
    depart: float = 0.08  # turns again above this angle (rad)

    def _torque(self, motion: _Motion) -> Array:
        rests = self._rest(np.abs(motion.angle), self.arrive, self.depart)
        return np.where(rests, 0, self._turn(motion))


@dataclass
class MoveInDirection(_Driver):
    """Drives in the target's direction regardless of the robot's heading.

    More terms synchronise the oscillation with the rocking rate, the tilt and the speed. This
    increases the reward, but the robot falls more often and is too inaccurate for the tasks with a
    target position.
    """

    task: ClassVar[str] = "move_in_direction"
    spring: float = 0.41  # as in `_Driver`
    energy_gain: float = 0.00098  # as in `_Driver` (s)
    side_damping: float = 0.98  # as in `_Driver` (s/m)
    tilt_gain: float = 5.3  # as in `_Driver`
    yaw_gain: float = 0.0099  # as in `_Driver` (s)
    bearing_gain: float = 0.25  # as in `_Driver`
    free_energy_gain: float = 0.0021  # torque per rad/s of the mass, independent of its angle (s)
    speed_damping: float = 0.012  # reduction of that per m/s along the bearing (s^2/m)
    pitch_damping: float = 0.00052  # reduction of that per rad/s of pitch rate (s^2)
    rate_spring: float = 3.2e-5  # spring per square of the mass's rate (s^2)
    tilt_phase_gain: float = 2.4  # as `tilt_gain`, times the cosine of the mass's angle
    roll_gain: float = 0.075  # torque per rad/s of tilt across, times the cosine of twice it (s)

    def _torque(self, motion: _Motion) -> Array:
        to_bearing = np.exp(-1j * motion.angle)
        along, rate = (motion.speed * to_bearing).real, motion.tilt_rate * to_bearing
        tilt, mass = self._bounded_tilt(motion) * to_bearing, motion.mass - motion.angle
        free_energy_gain = (
            self.free_energy_gain - self.speed_damping * along - self.pitch_damping * rate.real
        )
        more = (
            free_energy_gain * motion.mass_rate
            - self.rate_spring * motion.mass_rate**2 * np.sin(mass)
            + self.tilt_phase_gain * tilt.imag * np.cos(mass)
            + self.roll_gain * rate.imag * np.cos(2 * mass)
        )
        return self._drive(motion, motion.angle, more=more)


@dataclass
class MoveToPosition(_Driver):
    """Drives to the predicted relative target position, more gently when near, and rests there."""

    task: ClassVar[str] = "move_to_position"
    ahead: float = 0.061  # prediction horizon (s), the time that it coasts
    min_drive_scale: float = 0.3  # factor of the energy term at the target
    drive_scale_gain: float = 15.5  # factor per metre of distance (1/m)
    arrive: float = 0.0025  # rests below this distance (m)
    depart: float = 0.0032  # drives again above this distance (m)

    def _torque(self, motion: _Motion) -> Array:
        rests = self._rest(np.abs(motion.target), self.arrive, self.depart)
        predicted = motion.target - self.ahead * motion.speed
        drive_scale = np.minimum(
            self.min_drive_scale + self.drive_scale_gain * np.abs(predicted), 1
        )
        bearing = np.angle(predicted)
        steering = self._steering(motion, bearing)
        return np.where(rests, 0, self._drive(motion, bearing, drive_scale, steering))

    def _steering(self, motion: _Motion, bearing: Array) -> Array | float:
        """Returns the torque (robots,) that turns the robot while it drives."""
        return 0.0


@dataclass
class MoveToPose(_Turner, MoveToPosition):
    """Turns to the target heading while far away, drives to the target, and turns there again.

    Driving changes the heading, and turning changes the position, so its tolerances are larger than
    those of the laws for position or heading only. It steers while it drives. While it turns, a
    torque modulation over each revolution moves it towards the target.
    """

    task: ClassVar[str] = "move_to_pose"
    min_drive_scale: float = 0.23  # as in `MoveToPosition`
    arrive: float = 0.0066  # as in `MoveToPosition` (m)
    depart: float = 0.0113  # as in `MoveToPosition` (m)
    min_torque: float = 0.28  # as in `_Turner`
    torque_gain: float = 0.287  # as in `_Turner` (1/rad)
    front: float = -0.27  # as in `_Turner`
    near: float = 0.0117  # within this distance it may turn (m)
    turn_on: float = 0.3  # starts turning above this remaining angle (rad)
    turn_off: float = 0.225  # stops turning below this remaining angle (rad)
    turn_off_distance: float = 0.0166  # stops turning beyond this distance (m)
    far: float = 0.049  # beyond this distance it may turn with the maximum torque (m)
    far_turn_on: float = 1.23  # starts turning above this remaining angle (rad)
    far_turn_off: float = 0.44  # stops turning below this remaining angle (rad)
    steer: float = 0.061  # torque per rad of remaining angle while it drives (1/rad)
    steer_phase_gain: float = 0.1  # the same per cosine of the mass's angle to the bearing (1/rad)
    max_steer_angle: float = 1.0  # bound of the remaining angle in the steering torque (rad)
    homing: float = 0.3  # amplitude of the torque modulation
    homing_phase: float = 1.48  # phase of its maximum before the target's bearing (rad)
    homing_distance: float = 0.02  # distance at which the modulation reaches its full amplitude (m)

    def _torque(self, motion: _Motion) -> Array:
        remaining, distance = np.abs(motion.angle), np.abs(motion.target)
        far = distance > self.far
        turn_on = np.where(far, self.far_turn_on, self.turn_on)
        turn_off = np.where(far, self.far_turn_off, self.turn_off)
        reach = np.where(self._turns, self.turn_off_distance, self.near)
        self._turns = (far | (distance < reach)) & (
            remaining > np.where(self._turns, turn_off, turn_on)
        )
        passed = np.sign(motion.angle) * (motion.mass - np.angle(motion.target))
        reach = np.where(far, 0, np.minimum(distance / self.homing_distance, 1))
        homing = self.homing * reach * np.cos(passed + self.homing_phase)
        turning = self._turn(motion, homing, at_max_torque=far)
        return np.where(self._turns, turning, super()._torque(motion))

    def _steering(self, motion: _Motion, bearing: Array) -> Array:
        angle = np.clip(motion.angle, -self.max_steer_angle, self.max_steer_angle)
        return angle * (self.steer + self.steer_phase_gain * np.cos(motion.mass - bearing))


HEURISTICS: dict[str, Callable[[], Heuristic]] = {
    law.task: law
    for law in (MoveFromOrigin, FaceDirection, MoveInDirection, MoveToPosition, MoveToPose)
}
"""The policy of each task."""
