//! Checked missions.

use swarmwright_simulation::Side;

use crate::failures::Failure;
use crate::metrics::Metric;
use crate::place::{Place, Start};
use crate::robots::Team;
use crate::rules::Rules;

/// A number, and metrics by their index with a factor each.
pub type Sum = (f64, Vec<(usize, f64)>);

/// A checked mission.
#[derive(Debug, Clone, PartialEq)]
pub struct Mission {
    pub title: String,
    /// Default robots, for parameters without `robots` and `robot`.
    pub team: Team,
    /// Default duration, seconds, for parameters without `duration`.
    pub duration: f64,
    pub failures: Vec<Failure>,
    pub rules: Rules,
    /// The sides of a match, none without opponents.
    pub sides: Vec<Side>,
    pub place: Place,
    pub start: Start,
    /// Metrics of the mission, then those that every mission has, each sorted by name.
    pub metrics: Vec<(String, Metric)>,
    /// Number of metrics that are measured in every episode; the others are measured only on request, at the end.
    pub counted: usize,
    /// For each of the first metrics that is a sum: its offset, and the metrics in it with their factors.
    pub sums: Vec<Option<Sum>>,
    /// The fitness is `offset` plus the value of each of the first metrics times its factor.
    pub offset: f64,
    pub factors: Vec<f64>,
}

impl Mission {
    /// Returns the fitness, given the values of the metrics.
    pub fn fitness(&self, value: impl Fn(usize) -> f64) -> f64 {
        let factors = self.factors.iter().enumerate();
        // Skip metrics with factor 0, whose values may be infinite.
        factors
            .filter(|(_, factor)| **factor != 0.0)
            .fold(self.offset, |sum, (metric, factor)| {
                sum + factor * self.value(metric, &value)
            })
    }

    /// Returns the value of a metric, given those of the metrics that are no sums.
    pub fn value(&self, metric: usize, value: impl Fn(usize) -> f64) -> f64 {
        match self.sums.get(metric) {
            Some(Some((offset, parts))) => parts
                .iter()
                .fold(*offset, |sum, (part, factor)| sum + factor * value(*part)),
            _ => value(metric),
        }
    }
}
