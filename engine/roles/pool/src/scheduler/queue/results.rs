//! What comes out of evaluations, and in which shape.

use std::ops::Range;

/// How many of the evaluations `queued`, from the first on and at most `most`, make a rectangle: whole candidates, or
/// some episodes of one. At least 1, unless nothing is queued.
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

/// What came out of all evaluations of some work.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Results {
    /// (candidates, episodes), row-major, NaN where all attempts failed.
    pub fitness: Vec<f64>,
    /// (candidates, episodes, metrics that are needed), row-major, NaN where all attempts failed.
    pub metrics: Vec<f64>,
}

/// Candidates of which all episodes have ended.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Settled {
    /// Their numbers, in the order in which they ended.
    pub candidates: Vec<usize>,
    /// (candidates, episodes), row-major, NaN where all attempts failed.
    pub fitness: Vec<f64>,
    /// (candidates, episodes, metrics that are needed), row-major, NaN where all attempts failed.
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
