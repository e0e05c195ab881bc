//! Missions in other physics simulators: the simulator moves the robots and reports their poses; the arena does
//! everything else.

mod world;

use swarmwright_simulation::ParameterError;

pub use world::{RobotModel, World, WorldLight, WorldObject, WorldPatch, WorldWall};

/// Pose of a robot or object.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct Pose {
    /// Position along x, metres.
    pub x: f32,
    /// Position along y, metres.
    pub y: f32,
    /// Heading, radians counter-clockwise from x.
    pub heading: f32,
}

/// Motion of a drive for a tick, in the frame of the robot, with the drive's noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C)]
pub struct Motion {
    /// Forward speed, m/s.
    pub forward: f32,
    /// Speed to the left, m/s; 0 for robots with wheels.
    pub sideways: f32,
    /// Angular velocity, rad/s counter-clockwise.
    pub turn: f32,
}

/// The start of an episode.
#[derive(Debug)]
pub struct Start<'a> {
    /// The world to simulate.
    pub world: &'a World,
    /// Whether the world differs from that of the previous episode.
    pub changed: bool,
    /// Start poses of the robots.
    pub robots: &'a [Pose],
    /// Start poses of the objects.
    pub objects: &'a [Pose],
    /// Value of the parameter `seed`.
    pub seed: u64,
}

/// A simulator that moves robots and objects. It reports fatal errors with [`fail`](swarmwright_simulation::fail).
pub trait Physics: Send {
    /// Starts an episode.
    ///
    /// # Errors
    /// Returns an error about a mission that the simulator does not support, for example with too many robots.
    fn start(&mut self, start: &Start<'_>) -> Result<(), ParameterError>;

    /// Advances the world by a tick; `robots` has a motion for each robot.
    fn step(&mut self, robots: &[Motion]);

    /// Writes the poses of all robots and objects.
    fn poses(&mut self, robots: &mut [Pose], objects: &mut [Pose]);

    /// Writes how far a robot's proximity rays reach from their starting points, metres; rays that hit nothing have the
    /// range of the sensor. Returns `false` if the simulator has no rays; the arena then computes them, as it does at
    /// the start of each episode.
    fn rays(&mut self, robot: usize, distances: &mut [f32]) -> bool {
        let _ = (robot, distances);
        false
    }
}
