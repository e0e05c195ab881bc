//! What is asked of the pool and what comes back.

use serde::Serialize;
use swarmwright_controllers::Controller;

/// One episode to be run: one candidate, one seed.
#[derive(Debug, Clone)]
pub struct Task {
    /// Index of the candidate in the block.
    pub candidate: usize,
    /// Index of the episode's seed.
    pub episode: usize,
    /// The candidate's controller; each agent gets a clone.
    pub controller: Controller,
}

/// How a task ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome {
    /// The fitness that the server sent.
    Fitness(f64),
    /// No attempt succeeded; why.
    Failed(String),
}

/// A line of the journal: one attempt at one task.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Attempt {
    /// Index of the candidate in the block.
    pub candidate: usize,
    /// Index of the episode's seed.
    pub episode: usize,
    /// The server's id.
    pub server: u64,
    /// 1 for the first try.
    pub attempt: u32,
    /// Steps that the server took.
    pub steps: u64,
    /// Start, seconds since 1970.
    pub started: f64,
    /// Duration in seconds.
    pub seconds: f64,
    /// Why it failed, if it did.
    pub error: Option<String>,
}
