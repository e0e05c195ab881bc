//! From what a mission says to what it means, with complaints that name the place.

mod limits;
mod objects;
mod overlap;
mod place;
mod start;

use std::collections::BTreeMap;

use serde_json::Value;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use super::mission::Mission;
use super::text::{Fitness, StartText, Sum, Text};
use crate::failures::{self, Failure};
use crate::metrics::{self, Metric};
use crate::mistakes::{Mistakes, mismatch_at, part, with_place};
use crate::place::{Place, Start};
use crate::robots::Team;
use crate::time::LONGEST;
use limits::required;

/// Seconds, where a mission does not say others.
const DURATION: f64 = 120.0;

/// Reads what is written; `mistakes` has those of its keys.
///
/// # Errors
/// All that is wrong with it, but for what only follows from other mistakes.
pub(super) fn check(text: &Text, mut mistakes: Mistakes) -> Result<Mission, Mistakes> {
    let title = mistakes.take(title(text)).flatten();
    let duration = mistakes.take(duration(text.duration.as_ref()));
    let team = Team::of_mission(text.robots.as_ref(), text.robot.as_ref());
    let team = mistakes.take(team);
    let failures = mistakes.take(failures(text.failures.as_ref()));
    let before = mistakes.len();
    let place = place::place(text, &mut mistakes);
    let is_known = mistakes.len() == before;
    let start = mistakes.take(start(text.start.as_ref(), &place));
    let scored = scored(text, is_known.then_some(&place), &mut mistakes);
    let read = || {
        let scored = scored?;
        Some(Mission {
            title: title.unwrap_or_else(|| "Arena".to_owned()),
            duration: duration?,
            team: team?,
            failures: failures?,
            place,
            start: start?,
            counted: scored.counted,
            metrics: scored.metrics,
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

fn duration(given: Option<&Value>) -> Result<f64, ParameterError> {
    let at = "mission.duration";
    let duration = given.map_or(Ok(DURATION), |given| part(given, at))?;
    if !(0.1..=LONGEST).contains(&duration) {
        return Err(wrong(
            at,
            format!("{duration} found, expected seconds, 0.1 to {LONGEST}"),
        ));
    }
    Ok(duration)
}

fn failures(given: Option<&Value>) -> Result<Vec<Failure>, Mistakes> {
    given.map_or(Ok(Vec::new()), |list| {
        failures::read(list, "mission.failures")
    })
}

fn start(given: Option<&Value>, place: &Place) -> Result<Start, ParameterError> {
    let text: StartText = required(given, "start", "{disc: {radius: 1}}")?;
    start::start("mission.start", &text, place)
}

/// What is measured, and what counts.
struct Scored {
    metrics: Vec<(String, Metric)>,
    counted: usize,
    offset: f64,
    factors: Vec<f64>,
}

/// Reads metrics and fitness. `place`: where metrics are measured, none where mistakes leave it unknown.
fn scored(text: &Text, place: Option<&Place>, mistakes: &mut Mistakes) -> Option<Scored> {
    let before = mistakes.len();
    let given = text.metrics.as_ref();
    let given = given.map(|given| part::<BTreeMap<String, Value>>(given, "mission.metrics"));
    let given = given.and_then(|given| mistakes.take(given));
    let mut metrics: Vec<(String, Metric)> = Vec::new();
    for (name, value) in given.unwrap_or_default() {
        if let Some(metric) = mistakes.take(metric(&name, &value, place)) {
            metrics.push((name, metric));
        }
    }
    let are_known = mistakes.len() == before;
    let example = "order, the name of a metric";
    let fitness = mistakes.take(required(text.fitness.as_ref(), "fitness", example));
    let (offset, given) = match fitness? {
        Fitness::Metric(name) => (0.0, BTreeMap::from([(name, 1.0)])),
        Fitness::Sum(Sum { offset, factors }) => (offset, factors),
    };
    if !are_known {
        return None;
    }
    let mut others = metrics::general();
    others.retain(|(name, _)| !metrics.iter().any(|(known, _)| known == name));
    for name in given.keys() {
        if let Some(index) = others.iter().position(|(known, _)| known == name) {
            metrics.push(others.remove(index));
        } else if !metrics.iter().any(|(known, _)| known == name) {
            mistakes.add(unknown(name, metrics.iter().chain(&others)));
        }
    }
    let factor = |(name, _): &(String, Metric)| given.get(name).copied().unwrap_or(0.0);
    let factors: Vec<f64> = metrics.iter().map(factor).collect();
    if let Some(number) = factors.iter().chain([&offset]).find(|n| !n.is_finite()) {
        mistakes.add(wrong(
            "mission.fitness",
            format!("{number} found, expected a finite number"),
        ));
    }
    Some(Scored {
        counted: metrics.len(),
        metrics: metrics.into_iter().chain(others).collect(),
        offset,
        factors,
    })
}

fn metric(name: &str, value: &Value, place: Option<&Place>) -> Result<Metric, ParameterError> {
    metrics::check_name(name).map_err(|reason| wrong("mission.metrics", reason))?;
    let at = format!("mission.metrics.{name}");
    let metric: Metric =
        swarmwright_values::read_kind(value).map_err(|mismatch| mismatch_at(&at, mismatch))?;
    if let Some(place) = place {
        metric
            .check(place)
            .map_err(|error| with_place(&at, error))?;
    }
    Ok(metric)
}

/// A complaint about the name of a metric that is none of the known ones.
fn unknown<'a>(name: &str, known: impl Iterator<Item = &'a (String, Metric)>) -> ParameterError {
    let names: Vec<_> = known.map(|(name, _)| name.as_str()).collect();
    let hint = match metrics::check_name(name) {
        Ok(()) => "",
        Err(_) => "; expressions of metrics are for the experiment's own fitness",
    };
    wrong(
        "mission.fitness",
        format!(
            "no metric is named {name:?}; there is {}{hint}",
            names.join(", ")
        ),
    )
}
