"""Hand-written policies for the five tasks: closed-form control laws with a few tuned constants.

They drive and turn by the laws of `control_laws.py`, which defines their units, too.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from jbench.array_types import FloatArray
from jbench.tasks.jitterbug.control_laws import Driver, Law, Motion, Turner


@dataclass
class MoveFromOrigin(Driver):
    """Drives away from the origin and rests permanently where the reward is 1.

    Near the origin it moves to its front left, where it is fastest.
    """

    task: ClassVar[str] = "move_from_origin"
    spring: float = 0.435  # as in `Driver`, like the next six; faster from rest
    energy_gain: float = 0.0062
    side_damping: float = 3.9
    tilt_gain: float = 6.4
    max_tilt: float = 0.134
    yaw_gain: float = 0.0117
    bearing_gain: float = 0.21
    origin_radius: float = 0.0135  # within this distance of the origin it uses `start_bearing` (m)
    start_bearing: float = 0.81  # bearing of the fastest start (rad)
    away: float = 0.12  # beyond this distance it rests permanently (m)

    def _torque(self, motion: Motion) -> FloatArray:
        """Drives on outwards until it is far away."""
        distance = np.abs(motion.position)
        self._rests |= distance > self.away
        outwards = np.angle(motion.position * np.exp(-1j * motion.heading))
        bearing = np.where(distance < self.origin_radius, self.start_bearing, outwards)
        return np.where(self._rests, 0, self._drive(motion, bearing))


@dataclass
class FaceDirection(Turner):
    """Turns to the target's direction and rests.

    It rests slightly early, since mass and torso need two control steps to stop.
    """

    task: ClassVar[str] = "face_direction"
    arrive: float = 0.075  # rests below this remaining angle (rad)
    depart: float = 0.08  # turns again above this angle (rad)

    def _torque(self, motion: Motion) -> FloatArray:
        """Turns until the angle is small."""
        rests = self._rest(np.abs(motion.angle), self.arrive, self.depart)
        return np.where(rests, 0, self._turn(motion))


@dataclass
class MoveInDirection(Driver):
    """Drives in the target's direction regardless of the robot's heading.

    More terms synchronize the oscillation with the rocking rate, the tilt and the speed. This
    increases the reward, but the robot falls more often and is too inaccurate for the tasks with a
    target position.
    """

    task: ClassVar[str] = "move_in_direction"
    spring: float = 0.41  # as in `Driver`
    energy_gain: float = 0.00098  # as in `Driver` (s)
    side_damping: float = 0.98  # as in `Driver` (s/m)
    tilt_gain: float = 5.3  # as in `Driver`
    yaw_gain: float = 0.0099  # as in `Driver` (s)
    bearing_gain: float = 0.25  # as in `Driver`
    free_energy_gain: float = 0.0021  # torque per rad/s of the mass, independent of its angle (s)
    speed_damping: float = 0.012  # reduction of that per m/s along the bearing (s^2/m)
    pitch_damping: float = 0.00052  # reduction of that per rad/s of pitch rate (s^2)
    rate_spring: float = 3.2e-5  # spring per square of the mass's rate (s^2)
    tilt_phase_gain: float = 2.4  # as `tilt_gain`, times the cosine of the mass's angle
    roll_gain: float = 0.075  # torque per rad/s of tilt across, times the cosine of twice it (s)

    def _torque(self, motion: Motion) -> FloatArray:
        """Drives in the direction of the target."""
        to_bearing = np.exp(-1j * motion.angle)
        along = (motion.speed * to_bearing).real
        rate = motion.tilt_rate * to_bearing
        tilt = self._bounded_tilt(motion) * to_bearing
        mass = motion.mass - motion.angle
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
class MoveToPosition(Driver):
    """Drives to the predicted relative target position, more gently when near, and rests there."""

    task: ClassVar[str] = "move_to_position"
    ahead: float = 0.061  # prediction horizon (s), the time that it coasts
    min_drive_scale: float = 0.3  # factor of the energy term at the target
    drive_scale_gain: float = 15.5  # factor per meter of distance (1/m)
    arrive: float = 0.0025  # rests below this distance (m)
    depart: float = 0.0032  # drives again above this distance (m)

    def _torque(self, motion: Motion) -> FloatArray:
        """Drives to the target, slower near it."""
        rests = self._rest(np.abs(motion.target), self.arrive, self.depart)
        predicted = motion.target - self.ahead * motion.speed
        drive_scale = np.minimum(
            self.min_drive_scale + self.drive_scale_gain * np.abs(predicted), 1
        )
        bearing = np.angle(predicted)
        steering = self._steering(motion, bearing)
        return np.where(rests, 0, self._drive(motion, bearing, drive_scale, steering))

    def _steering(self, motion: Motion, bearing: FloatArray) -> FloatArray | float:
        """Returns the torque (robots,) that turns the robot while it drives."""
        return 0.0


@dataclass
class MoveToPose(Turner, MoveToPosition):
    """Turns to the target heading while far away, drives to the target, and turns there again.

    Driving changes the heading, and turning changes the position, so its tolerances are larger than
    those of the laws for position or heading only. It steers while it drives. While it turns, a
    torque modulation over each revolution moves it towards the target.
    """

    task: ClassVar[str] = "move_to_pose"
    min_drive_scale: float = 0.23  # as in `MoveToPosition`
    arrive: float = 0.0066  # as in `MoveToPosition` (m)
    depart: float = 0.0113  # as in `MoveToPosition` (m)
    min_torque: float = 0.28  # as in `Turner`
    torque_gain: float = 0.287  # as in `Turner` (1/rad)
    front: float = -0.27  # as in `Turner`
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

    def _torque(self, motion: Motion) -> FloatArray:
        """Drives to the target and turns there."""
        remaining = np.abs(motion.angle)
        distance = np.abs(motion.target)
        far = distance > self.far
        turn_on = np.where(far, self.far_turn_on, self.turn_on)
        turn_off = np.where(far, self.far_turn_off, self.turn_off)
        reach = np.where(self._turns, self.turn_off_distance, self.near)
        is_in_reach = far | (distance < reach)
        self._turns = is_in_reach & (remaining > np.where(self._turns, turn_off, turn_on))
        passed = np.sign(motion.angle) * (motion.mass - np.angle(motion.target))
        homing_scale = np.where(far, 0, np.minimum(distance / self.homing_distance, 1))
        homing = self.homing * homing_scale * np.cos(passed + self.homing_phase)
        turning = self._turn(motion, homing, at_max_torque=far)
        return np.where(self._turns, turning, super()._torque(motion))

    def _steering(self, motion: Motion, bearing: FloatArray) -> FloatArray:
        """Steers towards the target's heading on the way."""
        angle = np.clip(motion.angle, -self.max_steer_angle, self.max_steer_angle)
        return angle * (self.steer + self.steer_phase_gain * np.cos(motion.mass - bearing))


LAWS: dict[str, type[Law]] = {
    law.task: law
    for law in (MoveFromOrigin, FaceDirection, MoveInDirection, MoveToPosition, MoveToPose)
}
"""The policies by task, which begin with their tuned constants."""
