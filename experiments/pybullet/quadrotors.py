"""Quadrotors in PyBullet: `simulation: quadrotors.py:Quadrotors`."""

import math

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from swarmwright import Parameter, Simulation
from swarmwright.display import Body, Scene

MASS, ARM, INERTIA = 0.5, 0.12, (0.0023, 0.0023, 0.004)  # kg, metres, kg m²
ROTORS = ARM * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])  # seen from above
DRAG = np.array([1, -1, 1, -1]) * 0.016  # torque of a rotor in N m for each N of thrust
MAX_THRUST = 3.0  # N, of one rotor
# Thrusts of the rotors -> thrust, roll, pitch and yaw torque of all; and back.
EFFECT = np.stack([np.ones(4), ROTORS[:, 1], -ROTORS[:, 0], DRAG])
MIXER = np.linalg.inv(EFFECT)
TICK, TICKS_PER_STEP = 1 / 240, 24  # of physics, in a step of 0.1 s


class Quadrotors(Simulation):
    """Quadrotors leave a crowded start and find positions 1 m from each other, at one height."""

    title = "pybullet quadrotors"
    dimensions = 3
    determinism = "bitwise"
    sensors = 9  # to the middle of all, to the nearest quadrotor, own velocity: x, y, z of each
    actuators = 3  # velocity in x, y, z that the autopilot holds, 1 m/s at most
    parameters = {
        "agents": Parameter(5, "Quadrotors.", minimum=2, maximum=100),
        "steps": Parameter(60, "Steps of 0.1 s.", minimum=1),
    }
    metrics = {
        "nearest": "Mean distance to the nearest quadrotor at the end, metres.",
        "crashed": "Quadrotors.",
    }
    step_seconds = frame_seconds = 0.1

    def __init__(self):
        self.bullet = BulletClient(pybullet.DIRECT)

    def reset(self, parameters, seed):
        random = np.random.default_rng(seed)
        self.steps = self.left = parameters["steps"]
        agents = parameters["agents"]
        self.bullet.resetSimulation()
        self.bullet.setGravity(0, 0, -9.81)
        self.bullet.setTimeStep(TICK)
        plane = self.bullet.createCollisionShape(pybullet.GEOM_PLANE)
        self.bullet.createMultiBody(0, plane)
        shape = self.bullet.createCollisionShape(pybullet.GEOM_CYLINDER, radius=ARM + 0.05, height=0.06)
        side = math.ceil(agents**0.5)
        self.drones = []
        for index in range(agents):
            position = [0.5 * (index % side), 0.5 * (index // side), 1.0] + random.uniform(-0.05, 0.05, 3)
            drone = self.bullet.createMultiBody(MASS, shape, basePosition=position.tolist())
            self.bullet.changeDynamics(
                drone, -1, localInertiaDiagonal=INERTIA, linearDamping=0, angularDamping=0
            )
            self.drones.append(drone)
        self.crashed = np.zeros(agents, bool)
        return self.observe()

    def step(self, actions):
        velocities = actions.astype(float)
        for _ in range(TICKS_PER_STEP):
            thrusts = self.autopilot(velocities)
            loads = (thrusts[:, None] * EFFECT).sum(axis=2)
            for drone, (thrust, *torque), crashed in zip(self.drones, loads.tolist(), self.crashed):
                if not crashed:
                    self.bullet.applyExternalForce(drone, -1, [0, 0, thrust], [0, 0, 0], pybullet.LINK_FRAME)
                    self.bullet.applyExternalTorque(drone, -1, torque, pybullet.LINK_FRAME)
            self.bullet.stepSimulation()
        for contact in self.bullet.getContactPoints():
            for body in contact[1:3]:
                if body in self.drones:
                    self.crashed[self.drones.index(body)] = True
        self.left -= 1
        return self.observe()

    def autopilot(self, velocities):
        """Return thrusts (agents, 4) in N that reach the velocities and keep the bodies upright."""
        _, frames, velocity, spin = self.state()
        force = MASS * (4 * (velocities - velocity) + [0, 0, 9.81])
        limit = 0.5 * np.maximum(force[:, 2], 1)  # tilts by 27 degrees at most
        force[:, :2] = np.clip(force[:, :2], -limit[:, None], limit[:, None])
        up = force / np.sqrt((force**2).sum(axis=1))[:, None]
        thrust = (force * frames[:, :, 2]).sum(axis=1)
        local_up = (frames.transpose(0, 2, 1) * up[:, None]).sum(axis=2)
        local_spin = (frames.transpose(0, 2, 1) * spin[:, None]).sum(axis=2)
        tilt = np.stack([-local_up[:, 1], local_up[:, 0], np.zeros(len(up))], axis=1)
        torque = np.array(INERTIA) * (120 * tilt - 22 * local_spin)
        loads = np.hstack([thrust[:, None], torque])
        return np.clip((loads[:, None] * MIXER).sum(axis=2), 0, MAX_THRUST)

    def state(self):
        """Return positions, rotation matrices (agents, 3, 3), velocities and spins, (agents, 3) each."""
        poses = [self.bullet.getBasePositionAndOrientation(drone) for drone in self.drones]
        moves = [self.bullet.getBaseVelocity(drone) for drone in self.drones]
        frames = [self.bullet.getMatrixFromQuaternion(rotation) for _, rotation in poses]
        velocity, spin = np.array(moves).transpose(1, 0, 2)
        return np.array([position for position, _ in poses]), np.reshape(frames, (-1, 3, 3)), velocity, spin

    def observe(self):
        self.positions, _, velocity, _ = self.state()
        offsets = self.positions[None] - self.positions[:, None]
        self.apart = np.sqrt((offsets**2).sum(axis=2)) + 100 * np.eye(len(offsets))
        nearest = offsets[np.arange(len(offsets)), self.apart.argmin(axis=1)]
        return np.hstack([offsets.mean(axis=1), nearest, velocity])

    def acting(self):
        return ~self.crashed

    def done(self):
        return self.left == 0

    def fitness(self):
        wrong = np.abs(self.apart.min(axis=1) - 1) + np.abs(self.positions[:, 2] - 1)
        return -float(np.where(self.crashed, 2, np.minimum(wrong, 2)).mean())

    def measure(self):
        return {"nearest": float(self.apart.min(axis=1).mean()), "crashed": float(self.crashed.sum())}

    def scene(self):
        drones = zip(self.positions.tolist(), self.crashed.tolist(), strict=True)
        bodies = [
            Body("agent", x + 2, y + 2, "crashed" if crashed else "free", 0.17)
            for (x, y, _), crashed in drones
        ]
        return Scene(6, 6, self.steps - self.left, self.title, bodies)
