//! What an instance steps: a simulation in this process, or one behind a broker.

use swarmwright_worlds::Parameters;

/// What can be read of an episode.
#[derive(Debug, Clone, Default)]
pub struct View {
    /// (agents, sensors): of those who do not act, what they sensed last.
    pub sensors: Vec<f32>,
    /// Whether each agent's actuators are used in the next step.
    pub acts: Vec<bool>,
    pub done: bool,
    /// NaN as long as it is not known.
    pub fitness: f64,
    /// In the order of the model; NaN as long as they are not known.
    pub metrics: Vec<f64>,
}

/// Episodes in turn. Errors are for the master's log.
pub trait World {
    /// Starts an episode.
    ///
    /// `connection`: of a simulation behind a broker, how it is reached.
    fn begin(&mut self, parameters: &Parameters, connection: &Parameters) -> Result<(), String>;

    /// Goes on by a step; `actuators`: (agents, actuators), each in -1..=1.
    fn step(&mut self, actuators: &[f32]) -> Result<(), String>;

    /// The present state of the episode.
    fn view(&self) -> &View;

    /// Gives the episode up.
    fn end(&mut self) {}

    /// Whether an episode can be repeated up to a step, so that its states can be kept.
    fn goes_back(&self) -> bool {
        true
    }
}
