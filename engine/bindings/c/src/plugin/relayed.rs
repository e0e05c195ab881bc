//! A simulator with its own loop, as a simulation for the wrapper.

use std::sync::Arc;

use swarmwright_worlds::{Description, ParameterError, Parameters, Simulation, fail};

use super::relay::{Answer, Relay, Request};

pub(super) struct Relayed {
    relay: Arc<Relay>,
    description: Description,
    agents: Vec<u32>,
    sensors: Vec<f32>,
    /// Fitness and metrics, once the episode has ended.
    end: Option<(f64, Vec<f64>)>,
}

impl Relayed {
    pub(super) fn new(relay: Arc<Relay>, description: Description) -> Self {
        Self {
            relay,
            description,
            agents: Vec::new(),
            sensors: Vec::new(),
            end: None,
        }
    }

    fn ask(&mut self, request: Request) -> Result<(), ParameterError> {
        self.agents.clear();
        self.end = None;
        match self.relay.ask(request) {
            Ok(Answer::Sensed { agents, sensors }) => {
                (self.agents, self.sensors) = (agents, sensors);
                Ok(())
            }
            Ok(Answer::Ended { fitness, metrics }) => {
                self.end = Some((fitness, metrics));
                Ok(())
            }
            Ok(Answer::Refused(error)) => Err(error),
            Ok(Answer::Failed(reason)) | Err(reason) => {
                self.end = Some((f64::NAN, Vec::new()));
                fail(reason)
            }
        }
    }
}

impl Simulation for Relayed {
    fn description(&self) -> Description {
        self.description.clone()
    }

    fn reset(&mut self, parameters: &Parameters) -> Result<(), ParameterError> {
        crate::foreign::seed(parameters)?;
        self.ask(Request::Reset(Box::new(parameters.clone())))
    }

    fn acting(&self) -> &[u32] {
        &self.agents
    }

    fn done(&self) -> bool {
        self.end.is_some()
    }

    fn sense(&self, agent: u32, sensors: &mut [f32]) {
        let width = self.description.sensors;
        let row = self
            .agents
            .binary_search(&agent)
            .ok()
            .and_then(|row| self.sensors.get(row * width..(row + 1) * width));
        if let Some(row) = row {
            sensors.copy_from_slice(row);
        }
    }

    fn step(&mut self, actuators: &[f32]) {
        if let Err(error) = self.ask(Request::Step(actuators.to_vec())) {
            fail(error.to_string());
        }
    }

    fn fitness(&self) -> f64 {
        self.end.as_ref().map_or(f64::NAN, |(fitness, _)| *fitness)
    }

    fn metrics(&self) -> Vec<f64> {
        self.end
            .as_ref()
            .map_or_else(Vec::new, |(_, metrics)| metrics.clone())
    }
}
