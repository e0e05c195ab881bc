//! Bodies that are pressed together: none leaves the arena, none passes through another one.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Value, json};
use swarmwright_kernels::Arena;
use swarmwright_simulation::{Body, Simulation};

/// What went worst in an episode in a rectangle.
struct Worst {
    /// How often the middle of a robot or an object was outside at the end of a tick.
    outside: usize,
    /// How far two robots overlapped, as a part of the smaller radius.
    overlap: f32,
}

/// All robots drive into a corner, or else at random.
fn worst_overlap(
    robots: &Value,
    size: [f32; 2],
    objects: &Value,
    target: bool,
    seed: u64,
) -> Worst {
    let mission = json!({"walls": {"rectangle": size}, "metrics": {}, "fitness": {"factors": {}}, "objects": objects,
        "start": {"rectangle": {"x": [-size[0] / 2.0 + 0.05, size[0] / 2.0 - 0.05],
            "y": [-size[1] / 2.0 + 0.05, size[1] / 2.0 - 0.05]}}});
    let mut arena = Arena::default();
    let parameters = json!({"mission": mission, "robots": robots, "duration": 40, "seed": seed});
    arena.reset(parameters.as_object().unwrap()).unwrap();
    let mut worst = Worst {
        outside: 0,
        overlap: 0.0,
    };
    let mut state = seed as u32;
    while !arena.done() {
        let scene = arena.scene().unwrap();
        let agents: Vec<&Body> = scene
            .bodies
            .iter()
            .filter(|body| body.kind == "agent")
            .collect();
        let mut actuators = Vec::new();
        let points = scene.floor.as_ref().unwrap().points.clone();
        let most = [0, 1].map(|axis| points.iter().map(|p| p[axis]).fold(f32::MIN, f32::max));
        let least = [0, 1].map(|axis| points.iter().map(|p| p[axis]).fold(f32::MAX, f32::min));
        for body in &agents {
            state ^= state << 13;
            state ^= state >> 17;
            state ^= state << 5;
            let turn = if target {
                let heading = (most[1] - body.y).atan2(most[0] - body.x);
                let off = heading - body.heading.unwrap();
                (off.sin()).clamp(-0.5, 0.5)
            } else {
                (state % 2001) as f32 / 1000.0 - 1.0
            };
            actuators.extend([(1.0 - turn).min(1.0), (1.0 + turn).min(1.0)]);
        }
        arena.step(&actuators);
        let scene = arena.scene().unwrap();
        let bodies: Vec<&Body> = scene
            .bodies
            .iter()
            .filter(|body| body.kind == "agent")
            .collect();
        let out = scene.bodies.iter().filter(|body| {
            body.x < least[0] || body.y < least[1] || body.x > most[0] || body.y > most[1]
        });
        worst.outside += out.count();
        for (index, a) in bodies.iter().enumerate() {
            for b in &bodies[index + 1..] {
                let least = a.radius.min(b.radius);
                let overlap = (a.radius + b.radius - (a.x - b.x).hypot(a.y - b.y)) / least;
                worst.overlap = worst.overlap.max(overlap);
            }
        }
    }
    worst
}

fn robot(radius: f64, mass: f64, max_speed: f64, acceleration: f64) -> Value {
    json!({"radius": radius, "mass": mass, "sensors": [{"kind": "proximity", "count": 4, "range": 0.1, "response": [0, 1, 0]}],
        "drive": {"kind": "differential", "wheel_base": radius * 1.5, "max_speed": max_speed, "acceleration": acceleration}})
}

/// In most episodes all press into a corner; in the others they drive about.
fn check(name: &str, robots: &Value, size: [f32; 2], objects: &Value, most: f32) {
    for (target, seed) in [(true, 1), (true, 2), (false, 3)] {
        let worst = worst_overlap(robots, size, objects, target, seed);
        assert_eq!(worst.outside, 0, "{name}, seed {seed}");
        assert!(
            worst.overlap < most,
            "{name}, seed {seed}: {}",
            worst.overlap
        );
    }
}

#[test]
fn robots_that_press_into_a_corner_keep_their_places() {
    let none = json!([]);
    let e_pucks = |count: u32| json!([{"robot": "e-puck-rm1.1", "count": count}]);
    check("e-pucks", &e_pucks(20), [1.5, 1.5], &none, 0.25);
    check("crowded e-pucks", &e_pucks(50), [1.2, 1.2], &none, 0.32);
}

#[test]
fn drives_without_limit_press_no_robot_through_another() {
    for acceleration in [10.0, 30.0, 1000.0] {
        let robots = json!([{"robot": robot(0.035, 1.0, 0.12, acceleration), "count": 20}]);
        check("acceleration", &robots, [1.0, 1.0], &json!([]), 0.35);
    }
}

#[test]
fn light_robots_among_heavy_ones_stay_in_the_arena() {
    let kilobots = json!({"robot": robot(0.0165, 0.016, 0.02, 3.75), "count": 40});
    // Faster than 25 radii of the small ones a second the large ones run over them.
    for (speed, most) in [(0.4, 1.5), (1.0, 20.0)] {
        let robots = json!([{"robot": robot(0.3, 20.0, speed, 3.75), "count": 4}, kilobots]);
        check("kilobots", &robots, [4.0, 4.0], &json!([]), most);
    }
}

#[test]
fn light_objects_stay_in_the_arena() {
    let start = json!({"rectangle": {"x": [-0.5, 0.5], "y": [-0.5, 0.5]}});
    let objects = json!([
        {"name": "ball", "radius": 0.03, "mass": 0.01, "count": 6, "start": start},
        {"name": "box", "size": [0.06, 0.04], "mass": 0.02, "count": 3, "start": start},
    ]);
    for speed in [0.3, 1.2] {
        let heavy = json!([{"robot": robot(0.15, 6.0, speed, 3.75), "count": 6}]);
        check("heavy robots", &heavy, [2.0, 2.0], &objects, 0.1);
    }
    let e_pucks = json!([{"robot": "e-puck-rm1.1", "count": 20}]);
    check("e-pucks", &e_pucks, [1.2, 1.2], &objects, 0.25);
}
