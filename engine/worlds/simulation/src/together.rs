//! Episodes that one simulation steps together.

use crate::{ParameterError, Parameters};

/// Many episodes of one simulation, each with a seed of its own: for those whose code steps many in the time of one. They
/// end when they end; until all have, each [`step`](Self::step) is one of every episode that has not.
pub trait Together: Send {
    /// Starts an episode for each seed. `wanted`: indices of the metrics that [`results`](Self::results) gives.
    ///
    /// # Errors
    /// As [`Simulation::reset`](crate::Simulation::reset).
    fn start(
        &mut self,
        parameters: &Parameters,
        seeds: &[u64],
        wanted: &[usize],
    ) -> Result<(), ParameterError>;

    /// The agents of an episode that act in the next step, ascending; none of one that has ended, or goes on by itself.
    fn acting(&self, episode: usize) -> &[u32];

    /// Whether an episode has ended.
    fn done(&self, episode: usize) -> bool;

    /// Writes the sensors of an agent of an episode.
    fn sense(&self, episode: usize, agent: u32, sensors: &mut [f32]);

    /// Moves on by one step. `actuators`: a row for each agent that acts, episode after episode.
    fn step(&mut self, actuators: &[f32]);

    /// The fitness of an episode that has ended, and the metrics that are wanted.
    fn results(&self, episode: usize) -> &[f64];
}
