//! Missions whose robots another simulator moves.
#![allow(clippy::unwrap_used)] // helpers of tests

use std::f32::consts::{FRAC_PI_2, PI};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Mutex};

use serde_json::{Value, json};
use swarmwright_arena::{Motion, Physics, Pose, Start, World};
use swarmwright_kernels::{Arena, PhysicsKind, PhysicsSimulation};
use swarmwright_simulation::{
    Determinism, Failure, ParameterError, Scene, Simulation, parameters::wrong,
};

/// What the simulator was told, and what it is to do wrong.
#[derive(Default)]
struct Record {
    worlds: Vec<World>,
    changed: Vec<bool>,
    seeds: Vec<u64>,
    motions: Vec<Motion>,
    refuses: bool,
    loses: bool,
    rays: Option<f32>,
}

/// Robots that go where they are told, in many small parts.
struct Floating {
    record: Arc<Mutex<Record>>,
    robots: Vec<Pose>,
    objects: Vec<Pose>,
}

const PARTS: u16 = 100;

impl Physics for Floating {
    fn start(&mut self, start: &Start<'_>) -> Result<(), ParameterError> {
        let mut record = self.record.lock().unwrap();
        if record.refuses {
            return Err(wrong("robots", "at most 3 robots are possible".to_owned()));
        }
        record.worlds.push(start.world.clone());
        record.changed.push(start.changed);
        record.seeds.push(start.seed);
        self.robots = start.robots.to_vec();
        self.objects = start.objects.to_vec();
        Ok(())
    }

    fn step(&mut self, robots: &[Motion]) {
        let part = 0.1 / f32::from(PARTS);
        for (pose, motion) in self.robots.iter_mut().zip(robots) {
            for _ in 0..PARTS {
                let (sin, cos) = pose.heading.sin_cos();
                pose.x += (motion.forward * cos - motion.sideways * sin) * part;
                pose.y += (motion.forward * sin + motion.sideways * cos) * part;
                pose.heading += motion.turn * part;
            }
        }
        let mut record = self.record.lock().unwrap();
        record.motions.extend_from_slice(robots);
        if record.loses {
            self.robots[1].y = f32::NAN;
        }
    }

    fn poses(&mut self, robots: &mut [Pose], objects: &mut [Pose]) {
        robots.copy_from_slice(&self.robots);
        objects.copy_from_slice(&self.objects);
    }

    fn rays(&mut self, _: usize, distances: &mut [f32]) -> bool {
        let rays = self.record.lock().unwrap().rays;
        distances.fill(rays.unwrap_or_default());
        rays.is_some()
    }
}

fn floating(record: &Arc<Mutex<Record>>) -> PhysicsSimulation {
    let record = Arc::clone(record);
    let create = move || {
        Ok(Box::new(Floating {
            record: Arc::clone(&record),
            robots: Vec::new(),
            objects: Vec::new(),
        }) as Box<dyn Physics>)
    };
    PhysicsSimulation::new(Arc::new(PhysicsKind {
        title: "arena-floating".to_owned(),
        determinism: Determinism::Bitwise,
        only_one: true,
        create: Box::new(create),
    }))
    .unwrap()
}

/// A wide arena without anything in it, and robots without noise.
fn empty_arena(drive: &Value, more: &Value) -> Value {
    let mut robot = json!({"radius": 0.05, "drive": drive,
        "sensors": [{"kind": "compass"}], "actuators": []});
    for (name, value) in more.as_object().unwrap() {
        robot[name] = value.clone();
    }
    json!({
        "mission": {"walls": {"rectangle": [200, 200]}, "start": {"rectangle": {"x": [-40, 40], "y": [-40, 40]}},
            "metrics": {"far": {"kind": "order"}}, "fitness": "order"},
        "robot": robot, "robots": 5, "duration": 10, "seed": 7,
    })
}

fn headings(scene: &Scene) -> Vec<[f32; 3]> {
    let bodies = scene.bodies.iter();
    bodies.map(|b| [b.x, b.y, b.heading.unwrap()]).collect()
}

fn sensed(simulation: &dyn Simulation, agent: u32) -> Vec<f32> {
    let mut sensors = vec![0.0; simulation.description().sensors];
    simulation.sense(agent, &mut sensors);
    sensors
}

#[test]
fn robots_go_as_in_the_arena_where_nothing_is_in_their_way() {
    let drives = [
        (
            json!({"kind": "differential", "wheel_base": 0.08, "max_speed": 0.2}),
            vec![0.9, 1.0],
        ),
        (
            json!({"kind": "holonomic", "max_turn": 1.0, "max_speed": 0.2}),
            vec![0.5, -0.7, 0.1],
        ),
        (
            json!({"kind": "car", "wheel_base": 0.1, "max_steering": 30, "max_speed": 0.2}),
            vec![1.0, 0.2],
        ),
    ];
    for (drive, row) in drives {
        let parameters = empty_arena(&drive, &json!({}));
        let parameters = parameters.as_object().unwrap();
        let (mut here, mut there) = (Arena::default(), floating(&Arc::default()));
        here.reset(parameters).unwrap();
        there.reset(parameters).unwrap();
        assert_eq!(
            headings(&here.scene().unwrap()),
            headings(&there.scene().unwrap())
        );
        let actuators = row.repeat(5);
        while !here.done() {
            here.step(&actuators);
            there.step(&actuators);
        }
        assert!(there.done());
        let (here, there) = (
            headings(&here.scene().unwrap()),
            headings(&there.scene().unwrap()),
        );
        for (one, other) in here.iter().flatten().zip(there.iter().flatten()) {
            // The arena turns and drives in parts of its own.
            assert!((one - other).abs() < 0.03, "{drive}: {one} {other}");
        }
    }
}

#[test]
fn all_but_the_motion_is_the_arenas() {
    let parameters = json!({"mission": "aggregation", "robots": 4, "duration": 3, "seed": 11});
    let parameters = parameters.as_object().unwrap();
    let mut there = floating(&Arc::default());
    there.reset(parameters).unwrap();
    let mut here = Arena::default();
    here.reset(parameters).unwrap();
    let (ours, theirs) = (here.description(), there.description());
    assert_eq!(theirs.title, "arena-floating");
    assert_eq!(
        (ours.sensors, ours.actuators, ours.metrics),
        (theirs.sensors, theirs.actuators, theirs.metrics)
    );
    assert_eq!(there.described(parameters).unwrap(), there.description());
    for agent in 0..4 {
        assert_eq!(
            sensed(&here, agent),
            sensed(&there, agent),
            "at the start all is equal"
        );
    }
    while !there.done() {
        assert_eq!(there.acting(), [0, 1, 2, 3]);
        there.step(&[0.0; 8]);
        here.step(&[0.0; 8]);
    }
    for agent in 0..4 {
        assert_eq!(
            sensed(&here, agent),
            sensed(&there, agent),
            "no robot moved"
        );
    }
    assert_eq!(
        (here.fitness(), here.metrics()),
        (there.fitness(), there.metrics())
    );
}

#[test]
fn the_world_is_what_the_mission_says() {
    let record = Arc::default();
    let mut there = floating(&record);
    let objects = json!([{"name": "disc", "radius": 0.1, "mass": 0.5, "center": [0.5, 0.0], "angle": 90},
        {"name": "box", "size": [0.2, 0.1], "mass": 1.0, "center": [-0.5, 0.0]}]);
    let mission = json!({
        "walls": {"rectangle": [4, 2], "height": 0.3},
        "obstacles": [{"center": [1, 0.5], "size": [0.2, 0.4], "height": 0.1}],
        "floor": {"color": 0.5, "patches": [{"name": "nest", "circle": {"center": [0, 0], "radius": 0.3}, "color": "black"},
            {"name": "side", "rectangle": {"x": [1, 2], "y": [-1, 1]}, "color": "random"}]},
        "lights": [{"at": [0, 1, 0.4], "intensity": 2}],
        "objects": objects, "fitness": "order", "start": {"rectangle": {"x": [-1.5, 1.5], "y": [-0.8, 0.8]}},
    });
    let parameters = json!({"mission": mission, "robots": [{"robot": "e-puck-rm1.1", "count": 2}, {"robot": "e-puck-rm1.1", "count": 1, "name": "third"}]});
    let mut parameters = parameters.as_object().unwrap().clone();
    for seed in [1_u64, 2, 2] {
        parameters.insert("seed".to_owned(), json!(seed));
        there.reset(&parameters).unwrap();
    }
    parameters["mission"]["walls"]["height"] = json!(0.4);
    there.reset(&parameters).unwrap();
    let record = record.lock().unwrap();
    assert_eq!(record.changed, [true, false, false, true]);
    assert_eq!(record.seeds, [1, 2, 2, 2]);
    let world = &record.worlds[0];
    assert_eq!(world.walls.len(), 2);
    assert_eq!(
        world.walls[0].points,
        [[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]]
    );
    assert_eq!([world.walls[0].height, world.walls[1].height], [0.3, 0.1]);
    assert_eq!(world.walls[1].points.len(), 4);
    assert_eq!(world.patches.len(), 2);
    assert!(
        world.patches[0]
            .points
            .iter()
            .all(|[x, y]| (x.hypot(*y) - 0.3).abs() < 1e-6)
    );
    assert_eq!([world.patches[0].grey, world.patches[1].grey], [0.0, -1.0]);
    assert_eq!([world.lights[0].z, world.lights[0].intensity], [0.4, 2.0]);
    assert_eq!(world.robots, [0, 0, 1]);
    let model = &world.models[0];
    assert_eq!(model.rays.len(), 8);
    assert!(model.rays.iter().all(|angle| angle.abs() <= PI));
    assert!(model.wheel_base > 0.0 && model.ray_range > 0.0 && model.acceleration > 0.0);
    assert_eq!(
        [world.objects[0].radius, world.objects[1].radius],
        [0.1, 0.0]
    );
    assert_eq!(world.objects[1].size, [0.2, 0.1]);
}

#[test]
fn rays_of_the_simulator_count() {
    let record = Arc::<Mutex<Record>>::default();
    let mut there = floating(&record);
    let proximity = json!({"sensors": [{"kind": "proximity", "angles": [0, 90, 200], "range": 0.4, "noise": 0.0}]});
    let drive = json!({"kind": "differential", "wheel_base": 0.08, "max_speed": 0.2});
    let parameters = empty_arena(&drive, &proximity);
    there.reset(parameters.as_object().unwrap()).unwrap();
    there.step(&[0.0; 10]);
    assert_eq!(sensed(&there, 3), [0.0; 3], "nothing is near");
    record.lock().unwrap().rays = Some(0.1);
    there.step(&[0.0; 10]);
    let near = sensed(&there, 3);
    assert!(near.iter().all(|reading| *reading > 0.0), "{near:?}");
    record.lock().unwrap().rays = Some(0.4);
    there.step(&[0.0; 10]);
    assert_eq!(sensed(&there, 3), [0.0; 3], "the range");
    let world = record.lock().unwrap().worlds[0].clone();
    assert!((world.models[0].rays[1] - FRAC_PI_2).abs() < 1e-6);
    record.lock().unwrap().rays = Some(f32::NAN);
    let failed = catch_unwind(AssertUnwindSafe(|| there.step(&[0.0; 10])));
    let failure = failed.unwrap_err().downcast::<Failure>().unwrap();
    assert_eq!(failure.reason, "arena-floating: a ray of robot 0 is NaN");
}

#[test]
fn what_goes_wrong_ends_the_episode_with_a_reason() {
    let record = Arc::<Mutex<Record>>::default();
    let mut there = floating(&record);
    let parameters = json!({"mission": "aggregation", "robots": 4});
    let parameters = parameters.as_object().unwrap();
    record.lock().unwrap().refuses = true;
    let refused = there.reset(parameters).unwrap_err();
    assert_eq!(
        refused.to_string(),
        "parameter robots: at most 3 robots are possible"
    );
    record.lock().unwrap().refuses = false;
    there.reset(parameters).unwrap();
    assert!(
        record.lock().unwrap().changed[0],
        "nothing was built before"
    );
    record.lock().unwrap().loses = true;
    let failed = catch_unwind(AssertUnwindSafe(|| there.step(&[0.5; 8])));
    let failure = failed.unwrap_err().downcast::<Failure>().unwrap();
    assert!(
        failure
            .reason
            .starts_with("arena-floating: robot 1 is at ("),
        "{failure}"
    );
    record.lock().unwrap().loses = false;
    there.reset(parameters).unwrap();
    there.step(&[0.5; 8]);
    let wrong = json!({"mission": "agregation"});
    assert!(there.reset(wrong.as_object().unwrap()).is_err());
}

#[test]
fn nothing_is_put_back() {
    let mut simulation = floating(&Arc::default());
    let parameters = json!({"mission": "soccer"});
    let parameters = parameters.as_object().unwrap();
    let refused = simulation.reset(parameters).unwrap_err().to_string();
    assert!(
        refused.contains("mission.restart: arena-floating does not put robots and objects back"),
        "{refused}"
    );
}

#[test]
fn grippers_are_not_there() {
    let mut simulation = floating(&Arc::default());
    let parameters = json!({"mission": "object_retrieval"});
    let parameters = parameters.as_object().unwrap();
    let refused = simulation.reset(parameters).unwrap_err().to_string();
    assert!(
        refused.contains("has no grippers; use simulation: arena, or robots without"),
        "{refused}"
    );
    let described = simulation.describer().unwrap()(parameters)
        .unwrap_err()
        .to_string();
    assert_eq!(described, refused);
}
