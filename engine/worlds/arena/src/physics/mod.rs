//! Missions whose robots are moved by another simulator: it gets motions and gives poses, and all the rest stays the arena's.

mod simulation;
mod world;

use swarmwright_simulation::ParameterError;

pub use simulation::{PhysicsKind, PhysicsSimulation};
pub use world::{RobotModel, World, WorldLight, WorldObject, WorldPatch, WorldWall};

/// Where something is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct Pose {
    /// Metres.
    pub x: f32,
    /// Metres.
    pub y: f32,
    /// Radians counter-clockwise from x.
    pub heading: f32,
}

/// What a drive is to do in a tick, in the frame of the robot, its noise included.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct Motion {
    /// m/s.
    pub forward: f32,
    /// m/s to the left; 0 of robots with wheels.
    pub sideways: f32,
    /// rad/s counter-clockwise.
    pub turn: f32,
}

/// How an episode begins.
#[derive(Debug)]
pub struct Start<'a> {
    /// What is to be there.
    pub world: &'a World,
    /// Whether the world is another one than that of the episode before.
    pub changed: bool,
    /// Where robots stand.
    pub robots: &'a [Pose],
    /// Where objects lie.
    pub objects: &'a [Pose],
    /// The parameter `seed`.
    pub seed: u64,
}

/// A simulator that moves robots and objects. What it cannot go on with it says by [`fail`](swarmwright_simulation::fail).
pub trait Physics: Send {
    /// Begins an episode.
    ///
    /// # Errors
    /// A parameter of the mission that the simulator cannot do: too many robots, objects, ..
    fn start(&mut self, start: &Start<'_>) -> Result<(), ParameterError>;

    /// Moves on by a tick of the world; a motion for each robot.
    fn step(&mut self, robots: &[Motion]);

    /// Writes where all are.
    fn poses(&mut self, robots: &mut [Pose], objects: &mut [Pose]);

    /// Writes how far a robot's proximity rays reach from where they begin, metres, the range of the sensor where they meet
    /// nothing; false for simulators without rays: the arena computes them then, as at the start of each episode.
    fn rays(&mut self, robot: usize, distances: &mut [f32]) -> bool {
        let _ = (robot, distances);
        false
    }
}
