//! Agents that add up their actuators, and fail on request.

use serde_json::Value;
use swarmwright_worlds::{
    Description, Determinism, Failure, MetricInfo, ParameterError, Parameters, Simulation, fail,
};

/// Metrics of [`Walk`].
pub const WALK_METRICS: &[MetricInfo] = &[
    MetricInfo::new("steps", "steps", "Steps made."),
    MetricInfo::new("half", "", "Half the fitness."),
];

/// Agents that add up their actuators. The parameter `trouble` says what goes wrong in episodes whose seed is a multiple
/// of 3: reset, sensor, panic, fail, fitness, metrics or metrics panic.
#[derive(Clone, Default)]
pub struct Walk {
    duplicable: bool,
    trouble: String,
    seed: u64,
    step: u32,
    acting: Vec<u32>,
    sum: f64,
}

impl Walk {
    /// One that can be duplicated.
    #[must_use]
    pub fn duplicable() -> Box<dyn Simulation> {
        Box::new(Self {
            duplicable: true,
            ..Self::default()
        })
    }

    fn is_in(&self, trouble: &str) -> bool {
        self.is_in_end(trouble) && self.step == 2
    }

    fn is_in_end(&self, trouble: &str) -> bool {
        self.trouble == trouble && self.seed.is_multiple_of(3)
    }
}

impl Simulation for Walk {
    fn description(&self) -> Description {
        Description {
            title: "walk".to_owned(),
            dimensions: 2,
            max_agents: None,
            sensors: 2,
            actuators: 1,
            metrics: WALK_METRICS.into(),
            determinism: Determinism::Bitwise,
        }
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        let number =
            |name: &str, default| parameters.get(name).map_or(Some(default), Value::as_u64);
        let wrong = |name: &str| ParameterError {
            name: name.to_owned(),
            reason: "expected a whole number".to_owned(),
        };
        let agents = number("agents", 2).ok_or_else(|| wrong("agents"))?;
        *self = Self {
            duplicable: self.duplicable,
            trouble: parameters
                .get("trouble")
                .and_then(Value::as_str)
                .unwrap_or_default()
                .to_owned(),
            seed: number("seed", 0).ok_or_else(|| wrong("seed"))?,
            step: 0,
            acting: (0..u32::try_from(agents).unwrap()).collect(),
            sum: 0.0,
        };
        assert!(
            !(self.trouble == "reset" && self.seed.is_multiple_of(3)),
            "no start"
        );
        Ok(())
    }

    fn acting(&self) -> &[u32] {
        &self.acting
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        sensors[0] = (self.seed % 100) as f32 / 100.0 + self.step as f32;
        sensors[1] = agent as f32;
        if self.is_in("sensor") {
            sensors[1] = f32::NAN;
        }
    }

    fn step(&mut self, actuators: &[f32]) {
        assert!(!self.is_in("panic"), "a wall came down");
        if self.is_in("fail") {
            fail(Failure {
                reason: "no way on".to_owned(),
                stack: Some("step\nwall".to_owned()),
            });
        }
        for (agent, actuator) in self.acting.iter().zip(actuators) {
            self.sum = self.sum * 1.1 + f64::from(*actuator) * f64::from(agent + 1);
        }
        self.step += 1;
        // Agents stop one after another.
        self.acting.retain(|agent| self.step < 4 + agent);
    }

    fn fitness(&self) -> f64 {
        if self.trouble == "fitness" && self.seed.is_multiple_of(3) {
            return f64::NAN;
        }
        self.sum
    }

    fn metrics(&self) -> Vec<f64> {
        assert!(!self.is_in_end("metrics panic"), "no ruler");
        let half = if self.is_in_end("metrics") {
            f64::INFINITY
        } else {
            self.sum / 2.0
        };
        vec![f64::from(self.step), half]
    }

    fn duplicate(&self) -> Option<Box<dyn Simulation>> {
        self.duplicable
            .then(|| Box::new(self.clone()) as Box<dyn Simulation>)
    }
}
