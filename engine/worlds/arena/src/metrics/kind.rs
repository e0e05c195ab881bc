//! The kinds of metrics, as named in missions.

use std::collections::BTreeMap;

use serde::Deserialize;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::formation::Formation;

/// Ticks per second of an episode.
pub(super) const TICKS_PER_SECOND: f64 = 10.0;

/// A metric of a mission. A robot or object is on a patch if its middle lies in it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Metric {
    /// The number of robots on a patch.
    RobotsOn {
        patch: String,
        /// The kind of robots to count; all kinds if absent.
        robots: Option<String>,
        #[serde(default)]
        when: When,
        /// Whether the count is divided by the number of robots.
        #[serde(default)]
        share: bool,
    },
    /// The number of robots on the patch that has the most robots.
    MostRobotsOn {
        patches: Vec<String>,
        #[serde(default)]
        when: When,
        #[serde(default)]
        share: bool,
    },
    /// The number of objects on a patch: those with a name, or all.
    ObjectsOn {
        patch: String,
        object: Option<String>,
        #[serde(default)]
        when: When,
        /// Whether the count is divided by the number of these objects.
        #[serde(default)]
        share: bool,
    },
    /// The mean distance of objects, those with a name or all, from the middle of a patch, metres.
    ObjectDistance {
        patch: String,
        object: Option<String>,
        #[serde(default = "mean")]
        when: When,
    },
    /// The number of objects that robots hold: those with a name, or all.
    ObjectsHeld {
        object: Option<String>,
        #[serde(default)]
        when: When,
        /// Whether the count is divided by the number of these objects.
        #[serde(default)]
        share: bool,
    },
    /// The number of robots that are caught.
    Caught {
        /// The kind of robots to count; all kinds if absent.
        robots: Option<String>,
        #[serde(default)]
        when: When,
        /// Whether the count is divided by the number of robots.
        #[serde(default)]
        share: bool,
    },
    /// The number of times that a flag was brought home: that with a name, or all.
    FlagsBrought { flag: Option<String> },
    /// The number of flags that robots carry: that with a name, or all.
    FlagsCarried {
        flag: Option<String>,
        #[serde(default = "mean")]
        when: When,
    },
    /// The share of squares of side `cell` on the free floor in which robots of a kind were last. Where robots of
    /// several kinds are in a square in the same tick, it stays as it was.
    PaintedShare {
        robots: String,
        cell: f32,
        #[serde(default = "mean")]
        when: When,
    },
    /// The sum of a number and other metrics times factors.
    Sum {
        #[serde(default)]
        offset: f64,
        factors: BTreeMap<String, f64>,
    },
    /// Seconds until the share of robots on a patch first reached `at_least` or fell to `at_most`; the length of the
    /// episode if that did not happen.
    TimeUntil {
        patch: String,
        at_least: Option<f64>,
        at_most: Option<f64>,
    },
    /// The number of times that a robot came to the nest after visiting a source.
    Returns { sources: Vec<String>, nest: String },
    /// The number of times that a robot crossed the middle of a patch southward, minus northward; at least 0.
    CrossingsSouth { patch: String },
    /// The number of robots on the wrong side of the patch's middle, summed over ticks: south if the patch is black,
    /// north if it is white.
    RobotsInWrongHalf { patch: String },
    /// Errors in stopping, summed over robots and ticks: every tick until a robot has been on the patch, ticks in which
    /// a robot stood still before that, and ticks in which it moved afterwards.
    StopErrors { patch: String },
    /// The area that the largest group covers at the end within a circle around the origin, m^2. Robots less than
    /// `link` apart are in the same group, and each covers a disc.
    LargestGroupArea { link: f32, disc: f32, within: f32 },
    /// The mean distance at the end, in metres, from points around the origin, at uniform radii and angles, to the
    /// nearest robot that is on none of the patches. Each distance is limited to `most`, which also counts if there is
    /// no such robot.
    MeanDistance {
        radius: f32,
        most: f32,
        #[serde(default)]
        outside: Vec<String>,
    },
    /// The mean distance at the end, in metres, from points of a rectangular patch to the nearest robot on it, each limited
    /// to `most`.
    MeanDistanceInside { patch: String, most: f32 },
    /// The mean distance at the end, in metres, from points on the rim of a circular patch to the nearest robot that is
    /// at most `near` away from the rim, each limited to `most`.
    MeanDistanceRim { patch: String, near: f32, most: f32 },
    /// The mean age of the cells of a square around the origin, in ticks since a robot was there, summed over ticks.
    CellAge { side: f32, cells: u32 },
    /// The length of the mean of the robots' heading vectors: 1 if all robots have the same heading, about 1 / sqrt(n)
    /// for n random headings (the order parameter of Vicsek et al. 1995).
    Order {
        #[serde(default = "mean")]
        when: When,
    },
    /// The mean speed of the robots, m/s.
    Speed {
        #[serde(default = "mean")]
        when: When,
    },
    /// The length of the sum of the robots' velocities, divided by the number of robots, m/s: the speed of their
    /// center. With `link`, the sum includes only the largest group.
    GroupSpeed {
        link: Option<f32>,
        #[serde(default = "mean")]
        when: When,
    },
    /// The mean distance of the robots from their center, metres.
    DistanceToCenter {
        #[serde(default = "mean")]
        when: When,
    },
    /// The mean distance from a robot to the nearest other robot, metres; 0 for a single robot.
    NearestDistance {
        #[serde(default = "mean")]
        when: When,
    },
    /// The number of robots in the largest group. Robots less than `link` apart are linked, and groups are the
    /// connected components.
    LargestGroup {
        link: f32,
        #[serde(default)]
        share: bool,
        #[serde(default = "mean")]
        when: When,
    },
    /// The number of groups.
    Groups {
        link: f32,
        #[serde(default = "mean")]
        when: When,
    },
    /// The share of the free floor that is at most `radius` away from a robot, measured on squares of 0.05 m.
    CoveredShare {
        radius: f32,
        #[serde(default = "mean")]
        when: When,
    },
    /// The share of squares of side `cell` on the free floor that a robot has visited.
    VisitedShare { cell: f32 },
    /// The deviation of robots from a formation, metres: the average of the mean distance from its points to the
    /// nearest robot and the mean distance from the robots to the formation (the Chamfer distance).
    ShapeDeviation {
        shape: Formation,
        #[serde(default = "mean")]
        when: When,
    },
    /// The share, 0..1, of the way from the middle of one patch to that of another that a chain of robots spans. Links
    /// are shorter than `link`; 1 is a complete chain.
    ChainReach {
        from: String,
        to: String,
        link: f32,
        #[serde(default = "mean")]
        when: When,
    },
}

fn mean() -> When {
    When::Mean
}

/// How a metric is aggregated over time.
#[derive(Debug, Clone, Copy, PartialEq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum When {
    /// The sum over all ticks.
    #[default]
    EachTick,
    /// The mean over all ticks.
    Mean,
    /// At the end.
    End,
    /// At a time, seconds.
    At(f64),
}

impl When {
    /// Returns the tick of a single time; `None` for other aggregations.
    pub(super) fn tick(self) -> Option<u32> {
        match self {
            Self::At(seconds) => Some((seconds * TICKS_PER_SECOND).round() as u32),
            Self::EachTick | Self::Mean | Self::End => None,
        }
    }
}

impl Metric {
    /// Returns the kind of robots to which the metric is restricted, if any.
    pub fn robots(&self) -> Option<&str> {
        match self {
            Self::RobotsOn { robots, .. } | Self::Caught { robots, .. } => robots.as_deref(),
            Self::PaintedShare { robots, .. } => Some(robots),
            _ => None,
        }
    }

    /// Returns whether the metric is measured only at the end.
    #[inline]
    pub(super) fn at_end(&self) -> bool {
        self.when() == Some(When::End)
    }

    /// Checks that a single time is within an episode of so many ticks.
    pub(crate) fn check_time(&self, ticks: u32) -> Result<(), ParameterError> {
        let when = match self {
            Self::PaintedShare { when, .. } => Some(*when),
            _ => self.when(),
        };
        let duration = f64::from(ticks) / TICKS_PER_SECOND;
        match when {
            Some(When::At(seconds)) if !(0.0..=duration).contains(&seconds) => {
                let reason =
                    format!("{seconds} s found, expected 0 to the duration of {duration} s");
                Err(wrong("when.at", reason))
            }
            _ => Ok(()),
        }
    }

    /// Returns how the metric is aggregated; `None` for metrics with an aggregation of their own.
    pub(super) fn when(&self) -> Option<When> {
        match self {
            Self::RobotsOn { when, .. }
            | Self::MostRobotsOn { when, .. }
            | Self::ObjectsOn { when, .. }
            | Self::ObjectDistance { when, .. }
            | Self::ObjectsHeld { when, .. }
            | Self::Caught { when, .. }
            | Self::FlagsCarried { when, .. }
            | Self::Order { when }
            | Self::Speed { when }
            | Self::GroupSpeed { when, .. }
            | Self::DistanceToCenter { when }
            | Self::NearestDistance { when }
            | Self::LargestGroup { when, .. }
            | Self::Groups { when, .. }
            | Self::CoveredShare { when, .. }
            | Self::ShapeDeviation { when, .. }
            | Self::ChainReach { when, .. } => Some(*when),
            Self::LargestGroupArea { .. }
            | Self::MeanDistance { .. }
            | Self::MeanDistanceInside { .. }
            | Self::MeanDistanceRim { .. } => Some(When::End),
            Self::TimeUntil { .. }
            | Self::FlagsBrought { .. }
            | Self::PaintedShare { .. }
            | Self::Sum { .. }
            | Self::Returns { .. }
            | Self::CrossingsSouth { .. }
            | Self::RobotsInWrongHalf { .. }
            | Self::StopErrors { .. }
            | Self::CellAge { .. }
            | Self::VisitedShare { .. } => None,
        }
    }
}
