//! A simulation that runs controllers itself gets each before its episode, and steers no agents then.
#![allow(clippy::unwrap_used)] // helpers of tests

use serde_json::{Map, json};
use swarmwright_controllers::{Controller, Specification};
use swarmwright_worlds::{Description, ParameterError, Parameters, Simulation, rollout};

/// Its fitness is the sum of the weights of the controller that it was given.
#[derive(Default)]
struct Runner {
    given: Option<Vec<f32>>,
    running: Vec<f32>,
}

impl Simulation for Runner {
    fn description(&self) -> Description {
        Description {
            title: "runner".into(),
            dimensions: 2,
            max_agents: None,
            sensors: 2,
            actuators: 1,
            metrics: (&[]).into(),
            determinism: Default::default(),
        }
    }

    fn take_controller(&mut self, controller: &Controller) {
        self.given = Some(controller.specification().weights().to_vec());
    }

    fn reset(&mut self, _parameters: &Parameters) -> Result<(), ParameterError> {
        self.running = self.given.take().unwrap_or_default();
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        &[]
    }

    fn sense(&self, _agent: u32, _sensors: &mut [f32]) {}

    fn step(&mut self, _actuators: &[f32]) {}

    fn fitness(&self) -> f64 {
        self.running.iter().copied().map(f64::from).sum()
    }
}

#[test]
fn the_controller_comes_before_the_episode() {
    let text = json!({"version": 1, "kind": "layered", "sensors": 2, "actuators": 1, "hidden": [],
        "activation": "tanh", "output_range": [-1.0, 1.0], "weights": [0.5, 0.25, -2.0]});
    let specification = Specification::from_json(&text.to_string()).unwrap();
    let controller = Controller::new(&specification);
    assert_eq!(controller.specification(), specification);
    let mut runner = Runner::default();
    let found = rollout(&mut runner, &Map::new(), &controller).unwrap();
    assert!((found + 1.25).abs() < f64::EPSILON);
    // What crosses the broker step by step begins without one.
    runner.reset(&Map::new()).unwrap();
    assert!(runner.fitness().abs() < f64::EPSILON);
}
