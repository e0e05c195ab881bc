//! The simulation of a mission in another physics simulator.

use std::f32::consts::PI;
use std::sync::Arc;

use swarmwright_arena::{Motion, Physics, Place, Pose, Settings, Start, TICK, World};
use swarmwright_simulation::parameters::wrong;
use swarmwright_simulation::simulation::Describer;
use swarmwright_simulation::{
    Description, Determinism, ParameterError, ParameterInfo, Parameters, Scene, Simulation, fail,
};

use crate::arena::{Arena, describe};

/// Creates simulators.
type Create = dyn Fn() -> Result<Box<dyn Physics>, String> + Send + Sync;

/// A kind of simulator, with its name in experiments.
pub struct PhysicsKind {
    /// Name of the simulator in experiments.
    pub title: String,
    /// Whether episodes are reproducible.
    pub determinism: Determinism,
    /// Whether a process can have only one simulator.
    pub only_one: bool,
    /// Creates a simulator, or returns the reason why it cannot.
    pub create: Box<Create>,
}

/// A mission of the arena in another simulator. Parameters, sensors and metrics are those of the arena.
pub struct PhysicsSimulation {
    kind: Arc<PhysicsKind>,
    physics: Box<dyn Physics>,
    arena: Arena,
    /// The world of the previous episode.
    world: Option<World>,
    motions: Vec<Motion>,
    robots: Vec<Pose>,
    objects: Vec<Pose>,
    rays: Vec<f32>,
}

impl PhysicsSimulation {
    /// Creates the simulation, before its first episode.
    ///
    /// # Errors
    /// Returns the reason if the simulator cannot be created.
    pub fn new(kind: Arc<PhysicsKind>) -> Result<Self, String> {
        Ok(Self {
            physics: (kind.create)()?,
            kind,
            arena: Arena::default(),
            world: None,
            motions: Vec::new(),
            robots: Vec::new(),
            objects: Vec::new(),
            rays: Vec::new(),
        })
    }

    /// Reads all poses from the simulator and updates the sensors.
    fn look(&mut self) {
        self.physics.poses(&mut self.robots, &mut self.objects);
        for (noun, poses) in [("robot", &self.robots), ("object", &self.objects)] {
            for (index, Pose { x, y, heading }) in poses.iter().enumerate() {
                if !(x + y + heading).is_finite() {
                    fail(format!(
                        "{}: {noun} {index} is at ({x}, {y}) with heading {heading}, not finite numbers",
                        self.kind.title
                    ));
                }
            }
        }
        let rays = if self.measure() { &self.rays[..] } else { &[] };
        self.arena.look(&self.robots, &self.objects, rays);
    }

    /// Reads all rays from the simulator. Returns whether it has rays.
    fn measure(&mut self) -> bool {
        let Some(world) = &self.world else {
            return false;
        };
        let most = world.most_rays();
        self.rays.resize(world.robots.len() * most, 0.0);
        if self.rays.is_empty() {
            return false;
        }
        for (index, distances) in self.rays.chunks_exact_mut(most).enumerate() {
            let count = world.models[world.robots[index] as usize].rays.len();
            let distances = &mut distances[..count];
            if !self.physics.rays(index, distances) {
                return false;
            }
            if distances.iter().any(|distance| distance.is_nan()) {
                fail(format!(
                    "{}: a ray of robot {index} is NaN",
                    self.kind.title
                ));
            }
        }
        true
    }

    fn describe(kind: &PhysicsKind, settings: &Settings) -> Description {
        Description {
            title: kind.title.clone(),
            determinism: kind.determinism,
            ..describe(settings)
        }
    }
}

impl Arena {
    /// Computes the motions of the drives for these actuator values.
    fn motions(&mut self, actuators: &[f32], motions: &mut Vec<Motion>) {
        let (team, swarm) = (&self.settings.team, &mut self.swarm);
        swarm.command(team, actuators);
        motions.clear();
        motions.extend((0..team.len()).map(|index| {
            let ([vx, vy], turn) = swarm.aim(index);
            let (cos, sin) = (swarm.bodies.cos[index].0, swarm.bodies.sin[index].0);
            Motion {
                forward: vx * cos + vy * sin,
                sideways: if team.robot(index).drive.is_holonomic() {
                    vy * cos - vx * sin
                } else {
                    0.0
                },
                turn,
            }
        }));
    }

    /// Moves all robots and objects, then updates sensors and metrics.
    fn look(&mut self, robots: &[Pose], objects: &[Pose], rays: &[f32]) {
        let (mission, team) = (&self.settings.mission, &self.settings.team);
        let at = |pose: &Pose| Place {
            at: [pose.x, pose.y],
            heading: half_turns(pose.heading),
        };
        self.swarm
            .put(robots.iter().map(at), objects.iter().map(at), TICK);
        self.swarm.senses.measured(rays, team.len());
        self.swarm.look(team, &mission.place);
        self.count();
        self.end();
    }
}

/// Converts radians to half turns, -1..=1.
fn half_turns(radians: f32) -> f32 {
    let turns = radians / PI;
    turns - 2.0 * (turns / 2.0).round()
}

/// Converts a pose to radians, for the simulator.
fn radians(pose: Place) -> Pose {
    Pose {
        x: pose.at[0],
        y: pose.at[1],
        heading: pose.heading * PI,
    }
}

/// Rejects what other simulators cannot do.
fn check_abilities(kind: &PhysicsKind, settings: &Settings) -> Result<(), ParameterError> {
    without_grippers(kind, settings)?;
    if settings.mission.rules.restart.is_some() {
        let reason = format!(
            "{} does not put robots and objects back; use simulation: arena, or a mission without restart",
            kind.title
        );
        return Err(wrong("mission.restart", reason));
    }
    Ok(())
}

/// Rejects grippers: other simulators move objects themselves and do not know which ones robots hold.
fn without_grippers(kind: &PhysicsKind, settings: &Settings) -> Result<(), ParameterError> {
    if settings.team.gripper().is_none() {
        return Ok(());
    }
    let reason = format!(
        "{} has no grippers; use simulation: arena, or robots without the actuator {{kind: gripper}}",
        kind.title
    );
    let name = if settings.team.is_listed() {
        "robots"
    } else {
        "robot"
    };
    Err(wrong(name, reason))
}

impl Simulation for PhysicsSimulation {
    fn description(&self) -> Description {
        Self::describe(&self.kind, &self.arena.settings)
    }

    fn describer(&self) -> Option<Describer> {
        let kind = Arc::clone(&self.kind);
        Some(Arc::new(move |parameters| {
            let settings = Settings::read(parameters)?;
            check_abilities(&kind, &settings)?;
            Ok(Self::describe(&kind, &settings))
        }))
    }

    fn parameters(&self) -> Vec<ParameterInfo> {
        self.arena.parameters()
    }

    fn sensor_names(&self) -> Vec<String> {
        self.arena.sensor_names()
    }

    fn sensor_units(&self) -> Vec<String> {
        self.arena.sensor_units()
    }

    fn actuator_names(&self) -> Vec<String> {
        self.arena.actuator_names()
    }

    fn actuator_units(&self) -> Vec<String> {
        self.arena.actuator_units()
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        check_abilities(&self.kind, &Settings::read(parameters)?)?;
        self.arena.reset(parameters)?;
        let (settings, bodies) = (&self.arena.settings, &self.arena.swarm.bodies);
        self.robots = bodies.poses().map(radians).collect();
        self.objects = bodies.objects.poses().map(radians).collect();
        let world = World::new(settings);
        let before = self.world.take();
        let start = Start {
            changed: before.as_ref() != Some(&world),
            world: &world,
            robots: &self.robots,
            objects: &self.objects,
            seed: settings.seed,
        };
        self.physics.start(&start)?;
        self.world = Some(world);
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        self.arena.acting()
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        self.arena.sense(agent, sensors);
    }

    fn step(&mut self, actuators: &[f32]) {
        if self.arena.acting.is_empty() {
            return;
        }
        self.arena.motions(actuators, &mut self.motions);
        self.physics.step(&self.motions);
        self.look();
    }

    fn fitness(&self) -> f64 {
        self.arena.fitness()
    }

    fn metrics(&self) -> Vec<f64> {
        self.arena.metrics()
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        if self.kind.only_one {
            return None;
        }
        match Self::new(Arc::clone(&self.kind)) {
            Ok(another) => Some(Box::new(another)),
            Err(reason) => fail(reason),
        }
    }

    fn has_scenes(&self) -> bool {
        true
    }

    fn scene(&self) -> Option<Scene> {
        self.arena.scene()
    }

    fn step_size(&self) -> u64 {
        self.arena.step_size()
    }
}
