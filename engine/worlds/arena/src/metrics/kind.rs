//! The kinds of metrics, as missions name them.

use serde::Deserialize;

use super::formation::Formation;

/// A metric of a mission. "On" a patch is whose middle lies in it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub(crate) enum Metric {
    /// Robots on a patch.
    RobotsOn {
        patch: String,
        /// The kind of robots that counts; all where it is left out.
        robots: Option<String>,
        #[serde(default)]
        when: When,
        /// Whether it is divided by the number of robots.
        #[serde(default)]
        share: bool,
    },
    /// Robots on that of some patches on which most are.
    MostRobotsOn {
        patches: Vec<String>,
        #[serde(default)]
        when: When,
        #[serde(default)]
        share: bool,
    },
    /// Objects on a patch, those with a name or all.
    ObjectsOn {
        patch: String,
        object: Option<String>,
        #[serde(default)]
        when: When,
        /// Whether it is divided by their number.
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
    /// Objects that robots hold, those with a name or all.
    ObjectsHeld {
        object: Option<String>,
        #[serde(default)]
        when: When,
        /// Whether it is divided by their number.
        #[serde(default)]
        share: bool,
    },
    /// Seconds until a share of the robots, `at_least` or `at_most`, was on a patch for the first time; those of the
    /// episode where that did not happen.
    TimeUntil {
        patch: String,
        at_least: Option<f64>,
        at_most: Option<f64>,
    },
    /// Times that a robot came to the nest after it had been at a source.
    Returns { sources: Vec<String>, nest: String },
    /// Times that a robot crossed the middle of a patch southward, minus northward; not below 0.
    CrossingsSouth { patch: String },
    /// Robots on the side of the patch's middle where they should not be: south of it when the patch is black, north when
    /// it is white; summed over ticks.
    RobotsInWrongHalf { patch: String },
    /// Errors in stopping: ticks of robots until one has been on the patch, those in which they stood still before
    /// that, and those in which they moved after it.
    StopErrors { patch: String },
    /// The area, in m^2, that the largest group at the end covers within a circle around the origin: robots are in one
    /// group that are less than `link` apart, and each covers a disc.
    LargestGroupArea { link: f32, disc: f32, within: f32 },
    /// The mean distance at the end, in metres, from points around the origin, at uniform radii and angles, to the nearest
    /// robot that is on none of the patches. Each distance is limited to `most`, and is `most` without such a robot.
    MeanDistance {
        radius: f32,
        most: f32,
        #[serde(default)]
        outside: Vec<String>,
    },
    /// The mean distance at the end, in metres, from points of a rectangular patch to the nearest robot on it, each limited
    /// to `most`.
    MeanDistanceInside { patch: String, most: f32 },
    /// The mean distance at the end, in metres, from points of the rim of a circular patch to the nearest robot that is at
    /// most `near` away from the rim, each limited to `most`.
    MeanDistanceRim { patch: String, near: f32, most: f32 },
    /// The age of the cells of a square around the origin, in ticks since a robot was there, as a mean over the cells,
    /// summed over ticks.
    CellAge { side: f32, cells: u32 },
    /// The length of the mean of the robots' headings as unit vectors: 1 where all look the same way, about 1 / sqrt(n)
    /// for n robots that look anywhere (the order parameter of Vicsek et al. 1995).
    Order {
        #[serde(default = "mean")]
        when: When,
    },
    /// The mean speed of the robots, m/s.
    Speed {
        #[serde(default = "mean")]
        when: When,
    },
    /// The length of the sum of the robots' velocities, divided by the number of robots, m/s: the speed at which their
    /// center moves. With `link` only robots of the largest group count in the sum.
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
    /// The mean distance from a robot to the nearest other one, metres; 0 for a single robot.
    NearestDistance {
        #[serde(default = "mean")]
        when: When,
    },
    /// The number of robots in the largest group, of robots that are less than `link` apart and those linked through them.
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
    /// The share of the free floor that is at most `radius` away from a robot, by squares of a twentieth of a metre.
    CoveredShare {
        radius: f32,
        #[serde(default = "mean")]
        when: When,
    },
    /// The share of the squares of side `cell` on the free floor in which a robot has been.
    VisitedShare { cell: f32 },
    /// How far robots are from a formation, metres: the mean distance from its points to the nearest robot, and from the
    /// robots to the formation, both by halves (the Chamfer distance).
    ShapeDeviation {
        shape: Formation,
        #[serde(default = "mean")]
        when: When,
    },
    /// How far a chain of robots reaches from the middle of one patch to that of another, 0..1: links are shorter than
    /// `link`, and 1 is a chain without a gap.
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

/// When something is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum When {
    /// The sum over all ticks.
    #[default]
    EachTick,
    /// The mean over all ticks.
    Mean,
    /// At the end.
    End,
}

impl Metric {
    /// The kind of robots that it is about, if it is one.
    pub(crate) fn robots(&self) -> Option<&str> {
        match self {
            Self::RobotsOn { robots, .. } => robots.as_deref(),
            _ => None,
        }
    }

    /// Whether it is measured at the end alone.
    pub(super) fn at_end(&self) -> bool {
        self.when() == Some(When::End)
    }

    /// When it is measured; none for those that need every tick in a way of their own.
    pub(super) fn when(&self) -> Option<When> {
        match self {
            Self::RobotsOn { when, .. }
            | Self::MostRobotsOn { when, .. }
            | Self::ObjectsOn { when, .. }
            | Self::ObjectDistance { when, .. }
            | Self::ObjectsHeld { when, .. }
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
            | Self::Returns { .. }
            | Self::CrossingsSouth { .. }
            | Self::RobotsInWrongHalf { .. }
            | Self::StopErrors { .. }
            | Self::CellAge { .. }
            | Self::VisitedShare { .. } => None,
        }
    }
}
