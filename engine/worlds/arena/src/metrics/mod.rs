//! Metrics of an episode.

mod check;
mod counts;
mod formation;
mod kind;
mod objects;
mod paint;
mod shapes;
mod state;
mod swarm;
mod words;

use swarmwright_lanes::{Lanes, MOST_LANES, Number, number};

use crate::bodies::Bodies;
use crate::place::{Patch, Place};
use paint::Paint;
use state::{State, gather};
use swarm::{MetricCache, Visits};

pub use kind::{Metric, When};

/// Default distance of linked robots, metres.
const LINK: f32 = 0.35;

/// Returns the metrics that every mission has, measured at the end of an episode and sorted by name.
pub fn general() -> Vec<(String, Metric)> {
    let when = When::End;
    let largest = Metric::LargestGroup {
        link: LINK,
        share: false,
        when,
    };
    let metrics = [
        ("distance_to_center", Metric::DistanceToCenter { when }),
        ("group_speed", Metric::GroupSpeed { link: None, when }),
        ("largest_group", largest),
        ("nearest_distance", Metric::NearestDistance { when }),
        ("order", Metric::Order { when }),
        ("speed", Metric::Speed { when }),
    ];
    metrics
        .map(|(name, metric)| (name.to_owned(), metric))
        .to_vec()
}

/// Keywords of Python, because fitness expressions have Python's syntax.
const KEYWORDS: [&str; 35] = [
    "False", "None", "True", "and", "as", "assert", "async", "await", "break", "class", "continue",
    "def", "del", "elif", "else", "except", "finally", "for", "from", "global", "if", "import",
    "in", "is", "lambda", "nonlocal", "not", "or", "pass", "raise", "return", "try", "while",
    "with", "yield",
];

/// Checks the name of a metric.
pub fn check_name(name: &str) -> Result<(), String> {
    let mut letters = name.chars();
    let first = letters
        .next()
        .is_some_and(|c| c.is_ascii_alphabetic() || c == '_');
    if !first || !letters.all(|c| c.is_ascii_alphanumeric() || c == '_') {
        return Err(format!(
            "{name:?} found, expected a letter or _, then letters, digits and _"
        ));
    }
    if KEYWORDS.contains(&name) {
        return Err(format!(
            "{name} is a keyword in expressions of the fitness; give the metric another name"
        ));
    }
    if name == "fitness" {
        return Err("fitness is the value of the mission; give the metric another name".to_owned());
    }
    Ok(())
}

/// The value of a metric so far in each lane, with the state that it keeps between ticks.
pub struct Tally<L> {
    /// The value in each lane.
    pub values: [f64; MOST_LANES],
    /// State by robot or lane; its meaning depends on the metric.
    marks: Vec<Number<L>>,
    ages: Vec<u32>,
    before: Vec<[Number<L>; 2]>,
    /// For means, the sums and the number of ticks so far.
    sums: [f64; MOST_LANES],
    ticks: u32,
    /// The robots of each lane, lane after lane.
    states: Vec<State>,
    cache: MetricCache,
    visits: Option<Visits>,
    paint: Option<Box<Paint>>,
}

/// A tally of an episode that has not begun.
impl<L: Lanes> Default for Tally<L> {
    fn default() -> Self {
        Self {
            values: [0.0; MOST_LANES],
            marks: Vec::new(),
            ages: Vec::new(),
            before: Vec::new(),
            sums: [0.0; MOST_LANES],
            ticks: 0,
            states: Vec::new(),
            cache: MetricCache::default(),
            visits: None,
            paint: None,
        }
    }
}

impl<L: Lanes> Tally<L> {
    /// Updates the metric after a tick; the first call is at the start.
    #[inline(always)]
    pub fn update(
        &mut self,
        metric: &Metric,
        bodies: &Bodies<L>,
        layout: &Place,
        colors: &[Number<L>],
        (tick, last): (u32, bool),
    ) {
        if metric.at_end() && !last {
            return;
        }
        if let Some(time) = metric.when().and_then(When::tick)
            && time != tick
        {
            return;
        }
        match metric {
            Metric::RobotsOn {
                patch,
                robots,
                when,
                share,
            } => {
                let robots = bodies.named(robots.as_deref());
                let all = robots.len();
                let count = counts::on(bodies, layout, patch, robots);
                self.add(count, all, *share, *when);
            }
            Metric::MostRobotsOn {
                patches,
                when,
                share,
            } => {
                let mut most = number(0.0);
                for patch in patches {
                    most = counts::on(bodies, layout, patch, 0..bodies.len()).at_least(most);
                }
                self.add(most, bodies.len(), *share, *when);
            }
            Metric::ObjectsOn {
                patch,
                object,
                when,
                share,
            } => {
                let (count, all) = objects::on(bodies, layout, patch, object.as_deref());
                self.add(count, all, *share, *when);
            }
            Metric::ObjectsHeld {
                object,
                when,
                share,
            } => {
                let (count, all) = objects::held(bodies, layout, object.as_deref());
                self.add(count, all, *share, *when);
            }
            Metric::Caught {
                robots,
                when,
                share,
            } => {
                let robots = bodies.named(robots.as_deref());
                let all = robots.len();
                self.add(counts::caught(bodies, robots), all, *share, *when);
            }
            Metric::FlagsBrought { flag } => {
                let brought = counts::brought(bodies, flag.as_deref());
                self.add(brought, 1, false, When::EachTick);
            }
            Metric::FlagsCarried { flag, when } => {
                let carried = counts::carried(bodies, flag.as_deref());
                self.add(carried, 1, false, *when);
            }
            Metric::PaintedShare { robots, cell, when } => {
                gather(bodies, &mut self.states);
                let paint = self
                    .paint
                    .get_or_insert_with(|| Box::new(Paint::new(layout, *cell, L::WIDTH)));
                let mut values = [0.0; MOST_LANES];
                for (lane, value) in values[..L::WIDTH].iter_mut().enumerate() {
                    let states = &self.states[lane * bodies.len()..][..bodies.len()];
                    *value = paint.paint(states, bodies.kinds(), robots, lane);
                }
                if *when == When::End || when.tick() == Some(tick) {
                    self.values = values;
                } else if when.tick().is_none() {
                    self.settle(&values[..L::WIDTH], *when);
                }
            }
            // The mission adds up the values of the others.
            Metric::Sum { .. } => {}
            Metric::ObjectDistance {
                patch,
                object,
                when,
            } => {
                let (sum, all) = objects::distance(bodies, layout, patch, object.as_deref());
                self.add(sum, all, true, *when);
            }
            Metric::TimeUntil {
                patch,
                at_least,
                at_most,
            } => {
                if self.marks.is_empty() {
                    self.marks = vec![number(1.0)];
                }
                let on = counts::on(bodies, layout, patch, 0..bodies.len());
                let bounds = counts::bounds(*at_least, *at_most, bodies.len());
                counts::wait(on, bounds, &mut self.marks[0]);
                self.add(self.marks[0], 1, false, When::EachTick);
                for (value, ticks) in self.values.iter_mut().zip(self.sums) {
                    *value = ticks / kind::TICKS_PER_SECOND;
                }
            }
            Metric::Returns { sources, nest } => {
                self.marks.resize(bodies.len(), number(0.0));
                let returns = counts::returns(bodies, layout, sources, nest, &mut self.marks);
                self.add(returns, 1, false, When::EachTick);
            }
            Metric::CrossingsSouth { patch } => {
                let crossings = counts::crossings(bodies, layout, patch, &self.before);
                self.remember(bodies);
                self.add(crossings, 1, false, When::EachTick);
                if last {
                    for value in &mut self.values {
                        *value = value.max(0.0);
                    }
                }
            }
            Metric::RobotsInWrongHalf { patch } => {
                let (mut middle, mut color) = (0.0, number(0.0));
                if let Some(index) = layout.index(patch) {
                    middle = layout.patches[index].shape.middle()[1] as f32;
                    color = colors[index];
                }
                let count = counts::wrong_half(bodies, middle, color);
                self.add(count, 1, false, When::EachTick);
            }
            Metric::StopErrors { patch } => {
                if self.before.is_empty() {
                    // As in the original, previous positions at the first tick are the origin.
                    self.before = vec![[number(0.0); 2]; bodies.len()];
                    self.marks = vec![number(0.0)];
                }
                let errors = counts::stop(bodies, layout, patch, &self.before, &mut self.marks[0]);
                self.remember(bodies);
                self.add(errors, 1, false, When::EachTick);
            }
            Metric::CellAge { side, cells } => {
                let count = (cells * cells) as usize;
                self.ages.resize(count * L::WIDTH, 0);
                for lane in 0..L::WIDTH {
                    let ages = &mut self.ages[lane * count..][..count];
                    self.values[lane] += shapes::age(&points(bodies, lane), *side, *cells, ages);
                }
            }
            Metric::VisitedShare { cell } => {
                gather(bodies, &mut self.states);
                let visits = self
                    .visits
                    .get_or_insert_with(|| Visits::new(layout, *cell, L::WIDTH));
                for lane in 0..L::WIDTH {
                    let robots = &self.states[lane * bodies.len()..][..bodies.len()];
                    self.values[lane] = visits.visit(robots, lane);
                }
            }
            Metric::LargestGroupArea { .. }
            | Metric::Order { .. }
            | Metric::Speed { .. }
            | Metric::GroupSpeed { .. }
            | Metric::DistanceToCenter { .. }
            | Metric::NearestDistance { .. }
            | Metric::LargestGroup { .. }
            | Metric::Groups { .. }
            | Metric::CoveredShare { .. }
            | Metric::ShapeDeviation { .. }
            | Metric::ChainReach { .. } => {
                gather(bodies, &mut self.states);
                let mut values = [0.0; MOST_LANES];
                for (lane, value) in values[..L::WIDTH].iter_mut().enumerate() {
                    let robots = &self.states[lane * bodies.len()..][..bodies.len()];
                    *value = swarm::value(metric, robots, layout, &mut self.cache);
                }
                let when = metric.when().unwrap_or(When::End);
                self.settle(&values[..L::WIDTH], when);
            }
            Metric::MeanDistance {
                radius,
                most,
                outside,
            } => {
                let outside: Vec<&Patch> = outside
                    .iter()
                    .filter_map(|name| layout.patch(name))
                    .collect();
                self.set(bodies, |robots| {
                    shapes::distance_around(robots, *radius, *most, &outside)
                });
            }
            Metric::MeanDistanceInside { patch, most } => {
                if let Some(patch) = layout.patch(patch) {
                    self.set(bodies, |robots| {
                        shapes::distance_inside(robots, &patch.shape, *most)
                    });
                }
            }
            Metric::MeanDistanceRim {
                patch,
                near: margin,
                most,
            } => {
                if let Some(patch) = layout.patch(patch) {
                    self.set(bodies, |robots| {
                        shapes::distance_rim(robots, &patch.shape, *margin, *most)
                    });
                }
            }
        }
    }

    #[inline(always)]
    fn add(&mut self, counts: Number<L>, robots: usize, share: bool, when: When) {
        let mut lanes = [0.0; MOST_LANES];
        counts.store(&mut lanes);
        let parts = if share { robots as f64 } else { 1.0 };
        let mut values = [0.0; MOST_LANES];
        for (value, count) in values.iter_mut().zip(lanes) {
            *value = f64::from(count) / parts;
        }
        self.settle(&values[..L::WIDTH], when);
    }

    /// Adds the values of a tick.
    fn settle(&mut self, values: &[f64], when: When) {
        self.ticks += 1;
        for (lane, value) in values.iter().enumerate() {
            self.sums[lane] += value;
            self.values[lane] = match when {
                When::EachTick | When::End | When::At(_) => self.sums[lane],
                When::Mean => self.sums[lane] / f64::from(self.ticks),
            };
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

impl Tally<f32> {
    /// Returns the value as if the episode ended now, without changing the tally.
    pub fn now(
        &self,
        metric: &Metric,
        bodies: &Bodies<f32>,
        layout: &Place,
        colors: &[Number<f32>],
    ) -> f64 {
        match metric {
            Metric::CrossingsSouth { .. } => self.values[0].max(0.0),
            _ if metric.at_end() => {
                let mut tally = Self::default();
                tally.update(metric, bodies, layout, colors, (0, true));
                tally.values[0]
            }
            _ => self.values[0],
        }
    }
}

/// Returns the positions of the robots of a lane.
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
