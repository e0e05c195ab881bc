//! What a mission is.

use crate::failures::Failure;
use crate::metrics::Metric;
use crate::place::{Place, Start};
use crate::robots::Team;

/// A mission, checked.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Mission {
    pub title: String,
    /// The robots, where the parameters `robots` and `robot` are left out.
    pub team: Team,
    /// Seconds, where the parameter `duration` is left out.
    pub duration: f64,
    pub failures: Vec<Failure>,
    pub place: Place,
    pub start: Start,
    /// Those of the mission, and those that every mission has, each in the order of their names.
    pub metrics: Vec<(String, Metric)>,
    /// How many of them are measured in every episode; the others only where they are asked for, at the end.
    pub counted: usize,
    /// The fitness: this number, and for each of the first metrics its value times a factor.
    pub offset: f64,
    pub factors: Vec<f64>,
}

impl Mission {
    /// The fitness, from the values of the metrics.
    pub(crate) fn fitness(&self, value: impl Fn(usize) -> f64) -> f64 {
        let factors = self.factors.iter().enumerate();
        // What does not count may be anything, infinite too.
        factors
            .filter(|(_, factor)| **factor != 0.0)
            .fold(self.offset, |sum, (metric, factor)| {
                sum + factor * value(metric)
            })
    }
}
