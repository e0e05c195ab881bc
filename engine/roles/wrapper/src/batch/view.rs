//! Access to one episode of a batch, in its own simulation or in a group.

use swarmwright_protocol::BatchSensors;
use swarmwright_worlds::{Failure as Cause, Simulation, Together, measure};

use crate::group::Group;
use crate::guard::{all_finite, guarded};

/// An episode in its own simulation, or a member of a group.
pub(super) enum View<'a> {
    Alone(&'a dyn Simulation),
    Member(&'a dyn Together, usize),
}

impl<'a> View<'a> {
    pub(super) fn of(
        own: Option<&'a dyn Simulation>,
        group: Option<&'a mut Group>,
        index: usize,
    ) -> Option<Self> {
        match own {
            Some(simulation) => Some(Self::Alone(simulation)),
            None => Some(Self::Member(group?.episodes()?, index)),
        }
    }

    /// Returns the fitness and the requested metrics.
    pub(super) fn end(&self, metrics: &[usize], names: &[String]) -> Result<Vec<f64>, Cause> {
        let results = guarded(|| match self {
            Self::Alone(simulation) => {
                let mut results = vec![simulation.fitness(); 1 + metrics.len()];
                measure(*simulation, metrics, &mut results[1..]);
                results
            }
            Self::Member(group, index) => group.results(*index).to_vec(),
        })?;
        all_finite(&results, names)?;
        Ok(results)
    }

    fn read(&self, agent: u32, sensors: &mut [f32]) {
        match self {
            Self::Alone(simulation) => simulation.sense(agent, sensors),
            Self::Member(group, index) => group.sense(*index, agent, sensors),
        }
    }

    /// Appends agents and sensors. Returns the number of rows; `None` if the episode has ended.
    pub(super) fn sense(
        &self,
        sensors: usize,
        message: &mut BatchSensors,
    ) -> Result<Option<usize>, Cause> {
        let (acting, done) = match self {
            Self::Alone(simulation) => (simulation.acting(), simulation.acting().is_empty()),
            Self::Member(group, index) => (group.acting(*index), group.done(*index)),
        };
        if done {
            return Ok(None);
        }
        for &agent in acting {
            let start = message.sensors.0.len();
            message.sensors.0.resize(start + sensors, 0.0);
            let row = &mut message.sensors.0[start..];
            self.read(agent, row);
            if let Some(index) = row.iter().position(|value| !value.is_finite()) {
                let value = row[index];
                let reason =
                    format!("sensor {index} of agent {agent} is {value}, not a finite number");
                return Err(reason.into());
            }
            message.agents.0.push(agent);
        }
        Ok(Some(acting.len()))
    }
}
