"""Hand-written policies for the five tasks: closed-form laws with a few constants, nothing learned.

Two ways of moving are all that the robot has, and every law here is made of them.

Driving: the mass swings to and fro about the side to which the robot shall go, and the robot
follows it: each reversal jolts the torso, which rocks on its springy legs, and the feet slip.

Turning: the mass goes round and round in one sense; the torso whirls with it, its weight going
from foot to foot, and the robot turns in the same sense (against the motor's mere reaction).

With the motor off, friction holds the robot: below a torque of about 0.3 it does not move.

Torques are shares of the full torque; "forward" and "left" are the robot's own, bearings are 0
forward and grow to the left (counter-clockwise), all other units are SI (m, s, rad).
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
    """A hand-written policy for any number of robots at a time."""

    task: ClassVar[str]

    def reset(self, robots: int) -> None:
        """Forgets all internal state; the next observations are of that many robots."""

    def act(self, observation: NDArray[np.floating]) -> Array:
        """Returns the (robots, 1) actions in [-1, 1] for (robots, dim(O)) observations."""


def heuristic(task: str) -> Heuristic:
    """Returns the hand-written policy of a task, with its tuned constants.

    Raises:
        KeyError: if there is no such task.
    """
    return HEURISTICS[task]()


class _Motion(NamedTuple):
    """What the laws read from an observation, each (robots,): see `_read`."""

    mass: Array  # direction of the eccentric mass: 0 forward, pi / 2 left (rad)
    mass_rate: Array  # rad/s
    speed: Plane  # of the torso's centre of mass (m/s)
    tilt: Plane  # sines of the angles by which the forward and left axes rise (1)
    tilt_rate: Plane  # its rate (1/s)
    yaw_rate: Array  # rad/s
    heading: Array  # direction of the forward axis in the world (rad)
    position: Plane  # in the world (m)
    target: Plane  # from the robot, 0 if not observed (m)
    angle: Array  # yaw by which to turn, 0 if not observed (rad)


def _read(task: str, observation: NDArray[np.floating]) -> _Motion:
    """Returns the motion of the robots, as seen from above in their own frames."""
    physical = features.denormalize(task, np.asarray(observation, dtype=np.float64))
    ends = np.cumsum([features.FEATURE_SIZES[n] for n in features.TASK_SPECS[task].features])
    parts = np.split(physical, ends[:-1], axis=-1)
    seen = dict(zip(features.TASK_SPECS[task].features, parts, strict=True))
    position, velocity = seen["position"], seen["velocity"]
    mass, mass_rate = seen["motor_position"][..., 0], seen["motor_velocity"][..., 0]
    torso = features.center_of_mass_velocity(position, velocity, np.array(_TORSO_OFFSET))
    heading = features.heading(features.State(position, velocity, mass, mass_rate, torso))
    up = features.rotation_matrix(position[..., 3:7])[..., 2, :]
    none = np.zeros_like(mass)
    target = seen.get("target_in_jitterbug_frame", np.zeros((*none.shape, 3)))
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
        angle=seen["angle_to_target"][..., 0] if "angle_to_target" in seen else none,
    )


@dataclass
class _Law:
    """What all laws share: their state and the way from observations to actions."""

    task: ClassVar[str]

    def reset(self, robots: int) -> None:
        """Forgets which robots rest and which turn."""
        self._rests = np.zeros(robots, dtype=bool)
        self._turns = np.zeros(robots, dtype=bool)

    def act(self, observation: NDArray[np.floating]) -> Array:
        """Returns the (robots, 1) actions in [-1, 1] for (robots, dim(O)) observations."""
        return np.clip(self._torque(_read(self.task, observation)), -1, 1)[..., None]

    def _torque(self, motion: _Motion) -> Array:
        """Returns the torques, (robots,)."""
        raise NotImplementedError

    def _rest(self, value: Array, arrive: float, depart: float) -> NDArray[np.bool_]:
        """Returns who rests: from where a value is below `arrive` until it is above `depart`."""
        self._rests = value < np.where(self._rests, np.maximum(depart, arrive), arrive)
        return self._rests


@dataclass
class _Driver(_Law):
    """Swings the mass about the side to which the robot shall go.

    A memoryless oscillator, much like van der Pol's: a spring pulls the mass to the wanted side,
    the pump feeds the swing while the mass is on that side and brakes it on the other. No clock
    fixes its period, so it can keep step with the rocking of the torso on its legs, which the
    gain on the tilt tells it. It drives at .12 m/s where swings by a relay reach .083 m/s.
    """

    spring: float = 0.41  # torque per sine of the mass's angle to the wanted side
    pump: float = 0.0046  # torque per rad/s of the mass, times the cosine of its angle (s)
    side_brake: float = 2.8  # torque per m/s to the left of the way, times that cosine (s/m)
    rocking: float = 4.8  # torque per sine of the tilt across the way
    largest_tilt: float = 0.15  # beyond this sine the gain on the tilt grows no more
    yaw_pump: float = 0.01  # torque per rad/s of yaw rate (s)
    side_lean: float = 0.16  # torque against the sine of the bearing
    falling: float = 0.38  # sine of the tilt beyond which the mass is laid on the raised side

    def _drive(
        self,
        motion: _Motion,
        bearing: Array,
        vigour: Array | float = 1.0,
        more: Array | float = 0.0,
    ) -> Array:
        """Returns the torque, (robots,), that drives to a bearing (robots,) in the robot's frame.

        Args:
            motion: of the robots.
            bearing: where to go (rad).
            vigour: share of the pump.
            more: torque to add.
        """
        to_way = np.exp(-1j * bearing)
        sine, cosine = np.sin(motion.mass - bearing), np.cos(motion.mass - bearing)
        torque = (
            -self.spring * sine
            + vigour * self.pump * motion.mass_rate * cosine
            - self.side_brake * (motion.speed * to_way).imag * cosine
            + self.rocking * (self._bounded_tilt(motion) * to_way).imag
            + self.yaw_pump * motion.yaw_rate
            - self.side_lean * np.sin(bearing)
            + more
        )
        righting = -np.sin(motion.mass - np.angle(motion.tilt))
        falls = np.abs(motion.tilt) > self.falling
        return np.where(falls, righting, np.clip(torque, -1, 1))

    def _bounded_tilt(self, motion: _Motion) -> Plane:
        """Returns the tilt, its size at most `largest_tilt`."""
        return motion.tilt * np.minimum(
            1, self.largest_tilt / np.maximum(np.abs(motion.tilt), 1e-6)
        )


@dataclass
class _Turner(_Law):
    """Whirls the mass in the sense in which the robot shall turn.

    The torque grows with the angle left, up to a bound. It falls while the mass is in front and
    on the side of the turn, and follows the torso's rocking, so that the mass goes round unevenly
    and in step with the torso: that turns about twice as fast as a constant torque.
    """

    least_torque: float = 0.185  # at no angle left
    torque_gain: float = 1.36  # torque per rad left (1/rad)
    most_torque: float = 0.63
    front: float = -0.42  # share of the torque more per cosine of the mass's angle
    inside: float = -0.385  # per its sine, positive on the side of the turn
    twice: float = 0.19  # per cosine of twice that angle
    nodding: float = 0.107  # per rad/s at which the front rises (s)
    rolling: float = 0.084  # per rad/s at which the side of the turn rises (s)

    def _turn(
        self, motion: _Motion, more: Array | float = 0.0, hurries: NDArray[np.bool_] | bool = False
    ) -> Array:
        """Returns the torque, (robots,), that turns by the angle.

        Args:
            motion: of the robots.
            more: to add to the share of the torque.
            hurries: who turns with the most torque, whatever the angle left.
        """
        sense, left = np.sign(motion.angle), np.abs(motion.angle)
        share = (
            1
            + self.front * np.cos(motion.mass)
            + sense * self.inside * np.sin(motion.mass)
            + self.twice * np.cos(2 * motion.mass)
            + self.nodding * motion.tilt_rate.real
            + sense * self.rolling * motion.tilt_rate.imag
            + more
        )
        torque = np.minimum(self.least_torque + self.torque_gain * left, self.most_torque)
        return sense * np.where(hurries, self.most_torque, torque) * share


@dataclass
class MoveFromOrigin(_Driver):
    """Drives away from the origin, then rests for good where the reward is full.

    Near the origin "away" has no direction: it leaves to its front left, where it is quickest.
    """

    task: ClassVar[str] = "move_from_origin"
    spring: float = 0.435  # as in `_Driver`, as are the next six; quicker from rest
    pump: float = 0.0062
    side_brake: float = 3.9
    rocking: float = 6.4
    largest_tilt: float = 0.134
    yaw_pump: float = 0.0117
    side_lean: float = 0.21
    lost: float = 0.0135  # within this distance of the origin it goes where it is quickest (m)
    quickest: float = 0.81  # that bearing (rad)
    away: float = 0.12  # beyond this distance it rests for good (m)

    def _torque(self, motion: _Motion) -> Array:
        distance = np.abs(motion.position)
        self._rests |= distance > self.away
        outwards = np.angle(motion.position * np.exp(-1j * motion.heading))
        bearing = np.where(distance < self.lost, self.quickest, outwards)
        return np.where(self._rests, 0, self._drive(motion, bearing))


@dataclass
class FaceDirection(_Turner):
    """Turns towards the target's direction and rests once it looks there.

    It rests a little early: the mass brakes within two control steps, the torso with it.
    """

    task: ClassVar[str] = "face_direction"
    arrive: float = 0.075  # the angle left at which it rests (rad)
    depart: float = 0.08  # the angle at which it turns again (rad)

    def _torque(self, motion: _Motion) -> Array:
        rests = self._rest(np.abs(motion.angle), self.arrive, self.depart)
        return np.where(rests, 0, self._turn(motion))


@dataclass
class MoveInDirection(_Driver):
    """Drives in the target's direction, whichever way the robot faces.

    More terms keep the swing in step with the rate of the torso's rocking, with its tilt and with
    the speed. That earns more of the reward, but the robot falls more often, and strays too much
    for the tasks with a position.
    """

    task: ClassVar[str] = "move_in_direction"
    spring: float = 0.41  # as in `_Driver`
    pump: float = 0.00098  # as in `_Driver` (s)
    side_brake: float = 0.98  # as in `_Driver` (s/m)
    rocking: float = 5.3  # as in `_Driver`
    yaw_pump: float = 0.0099  # as in `_Driver` (s)
    side_lean: float = 0.25  # as in `_Driver`
    free_pump: float = 0.0021  # torque per rad/s of the mass, wherever it is (s)
    speed_brake: float = 0.012  # less of that per m/s along the way (s^2/m)
    rise_brake: float = 0.00052  # less of that per rad/s at which the front of the way rises (s^2)
    quick_spring: float = 3.2e-5  # spring per square of the mass's rate (s^2)
    rocking_ahead: float = 2.4  # as `rocking`, times the cosine of the mass's angle
    rolling: float = 0.075  # torque per rad/s of tilt across, times the cosine of twice it (s)

    def _torque(self, motion: _Motion) -> Array:
        to_way = np.exp(-1j * motion.angle)
        along, rate = (motion.speed * to_way).real, motion.tilt_rate * to_way
        tilt, mass = self._bounded_tilt(motion) * to_way, motion.mass - motion.angle
        free_pump = self.free_pump - self.speed_brake * along - self.rise_brake * rate.real
        more = (
            free_pump * motion.mass_rate
            - self.quick_spring * motion.mass_rate**2 * np.sin(mass)
            + self.rocking_ahead * tilt.imag * np.cos(mass)
            + self.rolling * rate.imag * np.cos(2 * mass)
        )
        return self._drive(motion, motion.angle, more=more)


@dataclass
class MoveToPosition(_Driver):
    """Drives towards where the target will be seen shortly, softly when near, and rests there."""

    task: ClassVar[str] = "move_to_position"
    ahead: float = 0.061  # how long ahead it looks (s): what it will coast
    least_vigour: float = 0.3  # share of the pump at the target
    vigour_gain: float = 15.5  # share of the pump per metre of distance (1/m)
    arrive: float = 0.0025  # the distance at which it rests (m)
    depart: float = 0.0032  # the distance at which it drives again (m)

    def _torque(self, motion: _Motion) -> Array:
        rests = self._rest(np.abs(motion.target), self.arrive, self.depart)
        way = motion.target - self.ahead * motion.speed
        vigour = np.minimum(self.least_vigour + self.vigour_gain * np.abs(way), 1)
        bearing = np.angle(way)
        steering = self._steering(motion, bearing)
        return np.where(rests, 0, self._drive(motion, bearing, vigour, steering))

    def _steering(self, motion: _Motion, bearing: Array) -> Array | float:
        """Returns the torque, (robots,), by which it turns while it drives: here none."""
        return 0.0


@dataclass
class MoveToPose(_Turner, MoveToPosition):
    """Turns to the wanted heading on the way already, drives to the target and turns there again.

    Driving spoils the heading and turning the position, so it is content with less of each than
    the laws for one alone. It steers while it drives. While it turns, a torque that changes along
    each round pushes it home.
    """

    task: ClassVar[str] = "move_to_pose"
    least_vigour: float = 0.23  # as in `MoveToPosition`
    arrive: float = 0.0066  # as in `MoveToPosition` (m)
    depart: float = 0.0113  # as in `MoveToPosition` (m)
    least_torque: float = 0.28  # as in `_Turner`; gently, so as not to be led astray
    torque_gain: float = 0.287  # as in `_Turner` (1/rad)
    front: float = -0.27  # as in `_Turner`
    near: float = 0.0117  # within this distance it turns (m)
    strays: float = 0.3  # if the angle left is larger than this (rad)
    faces: float = 0.225  # until it is smaller than this (rad)
    astray: float = 0.0166  # or until it has drifted this far off (m)
    far: float = 0.049  # beyond this distance it turns, too, in a hurry (m)
    strays_far: float = 1.23  # if the angle left is larger than this (rad)
    faces_far: float = 0.44  # until it is smaller than this (rad)
    steer: float = 0.061  # torque per rad left while it drives (1/rad)
    steer_ahead: float = 0.1  # more of it per cosine of the mass's angle to the way (1/rad)
    most_steer: float = 1.0  # the angle beyond which it steers no more (rad)
    homing: float = 0.3  # share of torque more when the mass is where that helps
    homing_lead: float = 1.48  # angle before the target's bearing at which it is so (rad)
    homing_reach: float = 0.02  # the distance from which homing is in full (m)

    def _torque(self, motion: _Motion) -> Array:
        left, distance = np.abs(motion.angle), np.abs(motion.target)
        far = distance > self.far
        strays = np.where(far, self.strays_far, self.strays)
        faces = np.where(far, self.faces_far, self.faces)
        reach = np.where(self._turns, self.astray, self.near)
        self._turns = (far | (distance < reach)) & (left > np.where(self._turns, faces, strays))
        passed = np.sign(motion.angle) * (motion.mass - np.angle(motion.target))
        reach = np.where(far, 0, np.minimum(distance / self.homing_reach, 1))
        homing = self.homing * reach * np.cos(passed + self.homing_lead)
        turning = self._turn(motion, homing, hurries=far)
        return np.where(self._turns, turning, super()._torque(motion))

    def _steering(self, motion: _Motion, bearing: Array) -> Array:
        angle = np.clip(motion.angle, -self.most_steer, self.most_steer)
        return angle * (self.steer + self.steer_ahead * np.cos(motion.mass - bearing))


HEURISTICS: dict[str, Callable[[], Heuristic]] = {
    law.task: law
    for law in (MoveFromOrigin, FaceDirection, MoveInDirection, MoveToPosition, MoveToPose)
}
"""The policy of each task."""
