//! Checks the sections of a mission; mistakes name their place.

mod limits;
mod objects;
mod overlap;
mod place;
mod rules;
mod sides;
mod start;

use std::collections::BTreeMap;

use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::mission::{self, Mission};
use super::text::{Fitness, StartText, Sum, Text};
use crate::failures::{self, Failure};
use crate::metrics::{self, Metric};
use crate::mistakes::{Mistakes, mismatch_at, part, with_place};
use crate::place::{Place, Start};
use crate::robots::Team;
use crate::time::LONGEST;
use limits::required;

/// Default duration of a mission, seconds.
const DURATION: f64 = 120.0;

/// Checks a mission. `mistakes` contains the mistakes in its keys.
///
/// # Errors
/// Returns all mistakes, except those that only follow from others.
pub(super) fn check(text: &Text, mut mistakes: Mistakes) -> Result<Mission, Mistakes> {
    let title = mistakes.take(title(text)).flatten();
    let duration = mistakes.take(duration(text.duration.as_ref()));
    let team = Team::of_mission(text.robots.as_ref(), text.robot.as_ref());
    let team = mistakes.take(team);
    let failures = mistakes.take(failures(text.failures.as_ref()));
    let before = mistakes.len();
    let layout = place::place(text, &mut mistakes);
    let is_known = mistakes.len() == before;
    let start = mistakes.take(start(text.start.as_ref(), &layout));
    let sound = is_known.then_some(&layout);
    let rules = rules::read(text, sound, &mut mistakes);
    let scored = scored(text, sound, &mut mistakes);
    let metrics = scored.as_ref().map(|scored| &scored.metrics[..]);
    rules::check_metrics(&rules, metrics.unwrap_or_default(), &mut mistakes);
    let sides = sides::read(text.sides.as_ref(), metrics, &mut mistakes);
    let read = || {
        let scored = scored?;
        Some(Mission {
            title: title.unwrap_or_else(|| "Arena".to_owned()),
            duration: duration?,
            team: team?,
            failures: failures?,
            rules,
            sides,
            place: layout,
            start: start?,
            counted: scored.counted,
            metrics: scored.metrics,
            sums: scored.sums,
            offset: scored.offset,
            factors: scored.factors,
        })
    };
    let mission = read();
    mistakes.or(mission)
}

fn title(text: &Text) -> Result<Option<String>, ParameterError> {
    let title = text.title.as_ref();
    title.map(|title| part(title, "mission.title")).transpose()
}

fn duration(value: Option<&Value>) -> Result<f64, ParameterError> {
    let at = "mission.duration";
    let duration = value.map_or(Ok(DURATION), |value| part(value, at))?;
    if !(0.1..=LONGEST).contains(&duration) {
        return Err(wrong(
            at,
            format!("{duration} found, expected seconds, 0.1 to {LONGEST}"),
        ));
    }
    Ok(duration)
}

fn failures(value: Option<&Value>) -> Result<Vec<Failure>, Mistakes> {
    value.map_or(Ok(Vec::new()), |list| {
        failures::read(list, "mission.failures")
    })
}

fn start(value: Option<&Value>, layout: &Place) -> Result<Start, ParameterError> {
    let text: StartText = required(value, "start", "{disc: {radius: 1}}")?;
    start::start("mission.start", &text, layout)
}

/// Reads a start region; `at` is its path in error messages.
pub(super) fn region(at: &str, value: &Value, layout: &Place) -> Result<Start, ParameterError> {
    start::start(at, &part(value, at)?, layout)
}

/// Metrics and fitness of a mission.
struct Scored {
    metrics: Vec<(String, Metric)>,
    counted: usize,
    sums: Vec<Option<mission::Sum>>,
    offset: f64,
    factors: Vec<f64>,
}

/// Reads metrics and fitness. `layout` is `None` if mistakes leave the place unknown.
fn scored(text: &Text, layout: Option<&Place>, mistakes: &mut Mistakes) -> Option<Scored> {
    let before = mistakes.len();
    let texts = text.metrics.as_ref();
    let texts = texts.map(|texts| part::<BTreeMap<String, Value>>(texts, "mission.metrics"));
    let texts = texts.and_then(|texts| mistakes.take(texts));
    let mut metrics: Vec<(String, Metric)> = Vec::new();
    for (name, value) in texts.unwrap_or_default() {
        if let Some(metric) = mistakes.take(metric(&name, &value, layout)) {
            metrics.push((name, metric));
        }
    }
    let are_known = mistakes.len() == before;
    let example = "order, the name of a metric";
    let fitness = mistakes.take(required(text.fitness.as_ref(), "fitness", example));
    let (offset, factors) = match fitness? {
        Fitness::Metric(name) => (0.0, BTreeMap::from([(name, 1.0)])),
        Fitness::Sum(Sum { offset, factors }) => (offset, factors),
    };
    if !are_known {
        return None;
    }
    let mut others = metrics::general();
    others.retain(|(name, _)| !metrics.iter().any(|(other, _)| other == name));
    let of_sums: Vec<(String, String)> = metrics.iter().flat_map(parts).collect();
    let of_fitness = factors.keys().map(|name| ("fitness", name));
    let of_sums = of_sums.iter().map(|(sum, name)| (&sum[..], name));
    for (at, name) in of_fitness.chain(of_sums) {
        if let Some(index) = others.iter().position(|(other, _)| other == name) {
            metrics.push(others.remove(index));
        }
        match metrics.iter().find(|(other, _)| other == name) {
            None => mistakes.add(unknown(at, name, metrics.iter().chain(&others))),
            Some((_, Metric::Sum { .. })) if at != "fitness" => mistakes.add(wrong(
                &format!("mission.{at}"),
                format!("{name} is a sum itself; name the metrics that it adds up"),
            )),
            Some(_) => {}
        }
    }
    let sums: Vec<Option<mission::Sum>> =
        metrics.iter().map(|metric| sum(metric, &metrics)).collect();
    let factor = |(name, _): &(String, Metric)| factors.get(name).copied().unwrap_or(0.0);
    let factors: Vec<f64> = metrics.iter().map(factor).collect();
    let numbers = factors
        .iter()
        .chain([&offset])
        .map(|number| ("fitness".to_owned(), *number));
    let added = metrics
        .iter()
        .zip(&sums)
        .filter_map(|((name, _), sum)| Some((name, sum.as_ref()?)));
    let added = added.flat_map(|(name, (offset, parts))| {
        let numbers = parts.iter().map(|(_, factor)| *factor).chain([*offset]);
        numbers.map(move |number| (format!("metrics.{name}"), number))
    });
    if let Some((at, number)) = numbers.chain(added).find(|(_, number)| !number.is_finite()) {
        mistakes.add(wrong(
            &format!("mission.{at}"),
            format!("{number} found, expected a finite number"),
        ));
    }
    Some(Scored {
        counted: metrics.len(),
        sums,
        metrics: metrics.into_iter().chain(others).collect(),
        offset,
        factors,
    })
}

/// Returns the metrics that a sum adds up, each with the place of the sum; none for other metrics.
fn parts((name, metric): &(String, Metric)) -> Vec<(String, String)> {
    let at = || format!("metrics.{name}");
    match metric {
        Metric::Sum { factors, .. } => factors.keys().map(|part| (at(), part.clone())).collect(),
        _ => Vec::new(),
    }
}

/// Returns what a sum adds up, by the index of the metrics; `None` for other metrics.
fn sum((_, metric): &(String, Metric), all: &[(String, Metric)]) -> Option<mission::Sum> {
    let Metric::Sum { offset, factors } = metric else {
        return None;
    };
    let index = |name: &String| all.iter().position(|(other, _)| other == name);
    let parts = factors
        .iter()
        .filter_map(|(name, factor)| Some((index(name)?, *factor)));
    Some((*offset, parts.collect()))
}

fn metric(name: &str, value: &Value, layout: Option<&Place>) -> Result<Metric, ParameterError> {
    metrics::check_name(name).map_err(|reason| wrong("mission.metrics", reason))?;
    let at = format!("mission.metrics.{name}");
    let metric: Metric =
        swarmwright_values::read_kind(value).map_err(|mismatch| mismatch_at(&at, mismatch))?;
    if let Some(layout) = layout {
        metric
            .check(layout)
            .map_err(|error| with_place(&at, error))?;
    }
    Ok(metric)
}

/// Returns an error about an unknown metric. `at` is the place in the mission that names it.
fn unknown<'a>(
    at: &str,
    name: &str,
    metrics: impl Iterator<Item = &'a (String, Metric)>,
) -> ParameterError {
    let names: Vec<_> = metrics.map(|(name, _)| name.as_str()).collect();
    let hint = match metrics::check_name(name) {
        Ok(()) => "",
        Err(_) => "; only the experiment's own fitness may be an expression of metrics",
    };
    wrong(
        &format!("mission.{at}"),
        format!(
            "no metric is named {name:?}; available: {}{hint}",
            names.join(", ")
        ),
    )
}
