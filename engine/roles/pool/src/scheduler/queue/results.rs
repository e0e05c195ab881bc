//! Results of evaluations.

use std::ops::Range;

/// Returns how many of the evaluations `queued`, from the first one and at most `most`, form a rectangle: whole
/// candidates, or some episodes of one candidate. At least 1, unless nothing is queued.
#[must_use]
pub fn rectangle(queued: &Range<usize>, episodes: usize, most: usize) -> usize {
    let length = queued.len().min(most.max(1));
    let episode = queued.start % episodes;
    if episode == 0 && length >= episodes {
        length - length % episodes
    } else {
        length.min(episodes - episode)
    }
}

/// Results of all evaluations of the work.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Results {
    /// (candidates, episodes), row-major; NaN if all attempts failed.
    pub fitness: Vec<f64>,
    /// (candidates, episodes, required metrics), row-major; NaN if all attempts failed.
    pub metrics: Vec<f64>,
}

/// Candidates whose episodes have all ended.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settled {
    /// Indices of the candidates, in the order in which they ended.
    pub candidates: Vec<usize>,
    /// (candidates, episodes), row-major; NaN if all attempts failed.
    pub fitness: Vec<f64>,
    /// (candidates, episodes, required metrics), row-major; NaN if all attempts failed.
    pub metrics: Vec<f64>,
}

/// The result of one evaluation by one server.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ServerResult {
    pub server: u64,
    pub fitness: f64,
    pub metrics: Vec<f64>,
}

impl ServerResult {
    pub fn new(server: u64, fitness: f64, metrics: Vec<f64>) -> Self {
        Self {
            server,
            fitness,
            metrics,
        }
    }
}
