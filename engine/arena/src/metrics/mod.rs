//! What is measured in an episode.

mod counts;
mod shapes;

use serde::Deserialize;
use swarmwright_lanes::{Lanes, MOST_LANES, Mask, Number, number};

use super::place::{Patch, Place};
use super::swarm::Bodies;

/// A metric of a mission. "On" a patch is whose middle lies in it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum Metric {
    /// Robots on a patch.
    RobotsOn {
        patch: String,
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
    /// Times that a robot came to the nest after it had been at a source.
    Returns { sources: Vec<String>, nest: String },
    /// Times that a robot crossed the middle of a patch southward, minus northward; not below 0.
    CrossingsSouth { patch: String },
    /// Robots in the half of the arena where they should not be: below y = 0 when the patch is black, above when it is
    /// white; summed over ticks.
    RobotsInWrongHalf { patch: String },
    /// How badly robots stopped: ticks of robots until one has been on the patch, those in which they stood still before
    /// that, and those in which they moved after it.
    StopErrors { patch: String },
    /// The area, in m^2, that the largest group at the end covers within a circle around the origin: robots are in one
    /// group that are less than `link` apart, and each covers a disc.
    LargestGroupArea { link: f32, disc: f32, within: f32 },
    /// The mean distance at the end, in metres, from points around the origin, at uniform radii and angles, to the nearest
    /// robot that is on none of the patches; `most` without any.
    MeanDistance {
        radius: f32,
        most: f32,
        #[serde(default)]
        outside: Vec<String>,
    },
    /// The mean distance at the end, in metres, from points of a rectangular patch to the nearest robot on it.
    MeanDistanceInside { patch: String, most: f32 },
    /// The mean distance at the end, in metres, from points of the rim of a circular patch to the nearest robot that is at
    /// most `near` away from the rim.
    MeanDistanceRim { patch: String, near: f32, most: f32 },
    /// The age of the cells of a square around the origin, in ticks since a robot was there, as a mean over the cells,
    /// summed over ticks.
    CellAge { side: f32, cells: u32 },
}

/// When something is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum When {
    /// The sum over all ticks.
    #[default]
    EachTick,
    /// At the end.
    End,
}

impl Metric {
    /// The patches that it is about.
    fn patches(&self) -> Vec<&str> {
        match self {
            Self::RobotsOn { patch, .. }
            | Self::CrossingsSouth { patch }
            | Self::RobotsInWrongHalf { patch }
            | Self::StopErrors { patch }
            | Self::MeanDistanceInside { patch, .. }
            | Self::MeanDistanceRim { patch, .. } => vec![patch],
            Self::MostRobotsOn { patches, .. }
            | Self::MeanDistance {
                outside: patches, ..
            } => patches.iter().map(String::as_str).collect(),
            Self::Returns { sources, nest } => {
                let names = sources.iter().chain([nest]);
                names.map(String::as_str).collect()
            }
            Self::LargestGroupArea { .. } | Self::CellAge { .. } => Vec::new(),
        }
    }

    /// What is wrong with it in this place.
    pub(super) fn check(&self, place: &Place) -> Result<(), String> {
        for name in self.patches() {
            if place.patch(name).is_none() {
                let known: Vec<_> = place.patches.iter().map(|p| p.name.as_str()).collect();
                return Err(format!(
                    "no patch of the floor is named {name:?}; there is {}",
                    if known.is_empty() {
                        "none".to_owned()
                    } else {
                        known.join(", ")
                    }
                ));
            }
        }
        if let Self::CellAge { side, cells } = self
            && !(*side > 0.0 && (1..=1000).contains(cells))
        {
            return Err("expected a side above 0 and 1 to 1000 cells".to_owned());
        }
        Ok(())
    }

    pub(super) fn unit(&self) -> &'static str {
        match self {
            Self::RobotsOn { share: true, .. } | Self::MostRobotsOn { share: true, .. } => "",
            Self::RobotsOn { .. } | Self::MostRobotsOn { .. } | Self::RobotsInWrongHalf { .. } => {
                "robots"
            }
            Self::Returns { .. } => "returns",
            Self::CrossingsSouth { .. } => "crossings",
            Self::StopErrors { .. } | Self::CellAge { .. } => "ticks",
            Self::LargestGroupArea { .. } => "m^2",
            Self::MeanDistance { .. }
            | Self::MeanDistanceInside { .. }
            | Self::MeanDistanceRim { .. } => "m",
        }
    }

    pub(super) fn description(&self) -> String {
        let when = |when: &When| match when {
            When::EachTick => "summed over the ticks",
            When::End => "at the end",
        };
        match self {
            Self::RobotsOn {
                patch, when: at, ..
            } => format!("Robots on {patch}, {}.", when(at)),
            Self::MostRobotsOn {
                patches, when: at, ..
            } => format!(
                "Robots on that of {} with most of them, {}.",
                patches.join(", "),
                when(at)
            ),
            Self::Returns { sources, nest } => {
                format!("Returns from {} to {nest}.", sources.join(" or "))
            }
            Self::CrossingsSouth { patch } => {
                format!("Crossings of the middle of {patch} southward, minus northward.")
            }
            Self::RobotsInWrongHalf { patch } => format!(
                "Robots in the half where they should not be, by the colour of {patch}, summed over the ticks."
            ),
            Self::StopErrors { patch } => format!(
                "Ticks of robots until one was on {patch}, and of those that stood before or moved after that."
            ),
            Self::LargestGroupArea { .. } => {
                "Area that the largest connected group covers at the end.".to_owned()
            }
            Self::MeanDistance { .. } => {
                "Mean distance from points of the arena to the nearest robot at the end.".to_owned()
            }
            Self::MeanDistanceInside { patch, .. } => {
                format!(
                    "Mean distance from points of {patch} to the nearest robot on it at the end."
                )
            }
            Self::MeanDistanceRim { patch, .. } => format!(
                "Mean distance from points of the rim of {patch} to the nearest robot near it at the end."
            ),
            Self::CellAge { .. } => {
                "Mean ticks since the cells were visited, summed over the ticks.".to_owned()
            }
        }
    }
}

/// The value of a metric so far, in each lane, and what it remembers of the tick before.
pub(super) struct Tally<L> {
    pub values: [f64; MOST_LANES],
    /// By robot, or by cell and lane.
    marks: Vec<Number<L>>,
    ages: Vec<u32>,
    before: Vec<[Number<L>; 2]>,
}

impl<L: Lanes> Tally<L> {
    pub(super) fn new() -> Self {
        Self {
            values: [0.0; MOST_LANES],
            marks: Vec::new(),
            ages: Vec::new(),
            before: Vec::new(),
        }
    }

    /// After a tick; the first one is the start.
    #[inline(always)]
    pub(super) fn update(
        &mut self,
        metric: &Metric,
        bodies: &Bodies<L>,
        place: &Place,
        colors: &[Number<L>],
        last: bool,
    ) {
        match metric {
            Metric::RobotsOn { patch, when, share } => {
                if *when == When::EachTick || last {
                    let count = counts::on(bodies, place, patch);
                    self.add(count, bodies.len(), *share);
                }
            }
            Metric::MostRobotsOn {
                patches,
                when,
                share,
            } => {
                if *when == When::EachTick || last {
                    let mut most = number(0.0);
                    for patch in patches {
                        most = counts::on(bodies, place, patch).at_least(most);
                    }
                    self.add(most, bodies.len(), *share);
                }
            }
            Metric::Returns { sources, nest } => {
                self.marks.resize(bodies.len(), number(0.0));
                let returns = counts::returns(bodies, place, sources, nest, &mut self.marks);
                self.add(returns, 1, false);
            }
            Metric::CrossingsSouth { patch } => {
                let crossings = counts::crossings(bodies, place, patch, &self.before);
                self.remember(bodies);
                self.add(crossings, 1, false);
                if last {
                    for value in &mut self.values {
                        *value = value.max(0.0);
                    }
                }
            }
            Metric::RobotsInWrongHalf { patch } => {
                let color = place
                    .index(patch)
                    .map_or(number(0.0), |index| colors[index]);
                self.add(counts::wrong_half(bodies, color), 1, false);
            }
            Metric::StopErrors { patch } => {
                if self.before.is_empty() {
                    // As in the original, the tick before the first one is at the origin.
                    self.before = vec![[number(0.0); 2]; bodies.len()];
                    self.marks = vec![number(0.0)];
                }
                let errors = counts::stop(bodies, place, patch, &self.before, &mut self.marks[0]);
                self.remember(bodies);
                self.add(errors, 1, false);
            }
            Metric::CellAge { side, cells } => {
                let count = (cells * cells) as usize;
                self.ages.resize(count * L::WIDTH, 0);
                for lane in 0..L::WIDTH {
                    let ages = &mut self.ages[lane * count..][..count];
                    self.values[lane] += shapes::age(&points(bodies, lane), *side, *cells, ages);
                }
            }
            _ if !last => {}
            Metric::LargestGroupArea { link, disc, within } => {
                self.set(bodies, |robots| {
                    shapes::group_area(robots, *link, *disc, *within)
                });
            }
            Metric::MeanDistance {
                radius,
                most,
                outside,
            } => {
                let outside: Vec<&Patch> = outside
                    .iter()
                    .filter_map(|name| place.patch(name))
                    .collect();
                self.set(bodies, |robots| {
                    shapes::distance_around(robots, *radius, *most, &outside)
                });
            }
            Metric::MeanDistanceInside { patch, most } => {
                if let Some(patch) = place.patch(patch) {
                    self.set(bodies, |robots| {
                        shapes::distance_inside(robots, &patch.shape, *most)
                    });
                }
            }
            Metric::MeanDistanceRim { patch, near, most } => {
                if let Some(patch) = place.patch(patch) {
                    self.set(bodies, |robots| {
                        shapes::distance_rim(robots, &patch.shape, *near, *most)
                    });
                }
            }
        }
    }

    #[inline(always)]
    fn add(&mut self, counts: Number<L>, robots: usize, share: bool) {
        let mut lanes = [0.0; MOST_LANES];
        counts.store(&mut lanes);
        let parts = if share { robots as f64 } else { 1.0 };
        for (value, count) in self.values[..L::WIDTH].iter_mut().zip(lanes) {
            *value += f64::from(count) / parts;
        }
    }

    fn set(&mut self, bodies: &Bodies<L>, value: impl Fn(&[[f32; 2]]) -> f64) {
        for lane in 0..L::WIDTH {
            self.values[lane] = value(&points(bodies, lane));
        }
    }

    #[inline(always)]
    fn remember(&mut self, bodies: &Bodies<L>) {
        self.before.clear();
        for index in 0..bodies.len() {
            self.before.push([bodies.x[index], bodies.y[index]]);
        }
    }
}

/// The positions of the robots of a lane.
fn points<L: Lanes>(bodies: &Bodies<L>, lane: usize) -> Vec<[f32; 2]> {
    let of = |number: &Number<L>| {
        let mut lanes = [0.0; MOST_LANES];
        number.store(&mut lanes);
        lanes[lane]
    };
    bodies
        .x
        .iter()
        .zip(&bodies.y)
        .map(|(x, y)| [of(x), of(y)])
        .collect()
}

/// 1 where the condition holds, else 0.
#[inline(always)]
fn one_where<L: Lanes>(condition: L::Mask) -> Number<L> {
    if condition.any() {
        number::<L>(1.0).only_where(condition)
    } else {
        number(0.0)
    }
}
