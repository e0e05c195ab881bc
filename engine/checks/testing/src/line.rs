//! A small simulation: agents on a line.

use serde_json::Value;
use swarmwright_worlds::{
    Description, Determinism, MetricInfo, ParameterError, Parameters, Simulation,
};

/// Metrics of [`Line`].
pub const LINE_METRICS: &[MetricInfo] = &[
    MetricInfo::new("steps", "steps", "Steps made."),
    MetricInfo::new("half", "", "Half the fitness."),
];

/// The most agents that there may be.
const MOST_AGENTS: usize = 10_000;

/// Agents on a line: each moves by its actuator; the fitness is the sum of the places, weighted by agent and seed.
pub struct Line {
    places: Vec<f32>,
    acting: Vec<u32>,
    step: u32,
    seed: f32,
    /// Distance per step, if agents control themselves.
    speed: Option<f32>,
    /// Sensors of an agent, at least 2.
    pub sensors: usize,
}

impl Default for Line {
    fn default() -> Self {
        Self::new()
    }
}

impl Line {
    /// A line whose agents have 2 sensors.
    #[must_use]
    pub fn new() -> Self {
        Self {
            places: Vec::new(),
            acting: Vec::new(),
            step: 0,
            seed: 0.0,
            speed: None,
            sensors: 2,
        }
    }
}

impl Simulation for Line {
    fn description(&self) -> Description {
        Description {
            title: "line".into(),
            dimensions: 2,
            max_agents: Some(100),
            sensors: self.sensors,
            actuators: 1,
            metrics: LINE_METRICS.into(),
            determinism: Determinism::Bitwise,
        }
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let number = |name: &str| parameters.get(name).and_then(Value::as_f64).unwrap_or(0.0);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "small numbers"
        )]
        let agents = number("numAgents") as usize;
        if !(1..=MOST_AGENTS).contains(&agents) {
            return Err(ParameterError {
                name: "numAgents".into(),
                reason: format!("must be 1 to {MOST_AGENTS}"),
            });
        }
        #[expect(clippy::cast_possible_truncation, reason = "small numbers")]
        let seed = number("seed") as f32;
        self.seed = seed;
        #[expect(clippy::cast_possible_truncation, reason = "small numbers")]
        let speed = |value: &Value| value.as_f64().map(|speed| speed as f32);
        self.speed = parameters.get("speed").and_then(speed);
        self.places = vec![0.0; agents];
        self.acting = (0..u32::try_from(agents).unwrap()).collect();
        self.step = 0;
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        if self.speed.is_some() {
            &[]
        } else {
            &self.acting
        }
    }

    fn done(&self) -> bool {
        self.acting.is_empty()
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        sensors.fill(self.seed);
        sensors[0] = self.places[agent as usize];
    }

    fn step(&mut self, actuators: &[f32]) {
        for (&agent, actuator) in self.acting.iter().zip(actuators) {
            self.places[agent as usize] += actuator;
        }
        if let Some(speed) = self.speed {
            for &agent in &self.acting {
                self.places[agent as usize] += speed + self.seed;
            }
        }
        self.step += 1;
        // Agents stop one after another, so that the number of messages changes from step to step.
        let step = self.step;
        self.acting.retain(|&agent| agent % 4 + 3 > step);
    }

    fn metrics(&self) -> Vec<f64> {
        vec![f64::from(self.step), self.fitness() / 2.0]
    }

    fn fitness(&self) -> f64 {
        self.places
            .iter()
            .enumerate()
            .map(|(agent, &position)| f64::from(position) * (agent + 1) as f64)
            .sum()
    }
}
