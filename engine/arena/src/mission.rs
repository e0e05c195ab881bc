//! Missions: a place, where robots start, what is measured, and what is to be reached.

mod checks;
mod text;

use serde_json::Value;

use super::failures::Failure;
use super::metrics::Metric;
use super::place::Place;
use super::settings::mismatch_at;
use super::start::Start;
use super::team::Team;
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

/// A built-in mission.
#[derive(Debug, Clone, Copy)]
struct BuiltIn {
    name: &'static str,
    /// What it is called beside its short name.
    also: &'static [&'static str],
    text: &'static str,
}

macro_rules! missions {
    ($($name:literal $(or $also:literal)?,)*) => {
        [$(BuiltIn {
            name: $name,
            also: &[$($also)?],
            text: include_str!(concat!("missions/", $name, ".yaml")),
        },)*]
    };
}

/// Built-in missions: a file each.
const MISSIONS: &[BuiltIn] = &missions! {
    "aac" or "aggregation",
    "area_coverage",
    "cfa" or "coverage_with_forbidden_areas",
    "chain_formation",
    "collective_transport",
    "decision",
    "directional_gate",
    "dispersion",
    "emergency_exit",
    "flocking",
    "foraging",
    "formation",
    "grid_exploration",
    "guided_shelter",
    "homing",
    "lcn" or "covering_network",
    "object_retrieval",
    "sca" or "shelter",
    "spc" or "surface_and_perimeter_coverage",
    "stop",
    "two_spots",
    "two_spots_sum",
};

/// What a built-in mission is.
#[derive(Debug, Clone, PartialEq)]
pub struct MissionInfo {
    /// The name in parameters.
    pub name: &'static str,
    /// Another name for it.
    pub also: Option<&'static str>,
    /// A few words.
    pub title: String,
    /// Number of robots where parameters do not say another.
    pub robots: u32,
    /// Seconds, where parameters do not say others.
    pub duration: f64,
    /// The YAML file, to start one's own from.
    pub text: &'static str,
}

/// The built-in missions of the arena, sorted by name.
pub fn missions() -> Vec<MissionInfo> {
    let read = |built_in: &BuiltIn| {
        let mission = Mission::named(built_in.name).ok()?;
        Some(MissionInfo {
            name: built_in.name,
            also: built_in.also.first().copied(),
            title: mission.title,
            robots: mission.team.len() as u32,
            duration: mission.duration,
            text: built_in.text,
        })
    };
    MISSIONS.iter().filter_map(read).collect()
}

/// A mission, checked.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Mission {
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

/// How to write a field of a mission, where a complaint is that it is missing.
fn example_of_missing(reason: &str) -> Option<&'static str> {
    match reason.strip_prefix("missing field `")?.strip_suffix('`')? {
        "walls" => Some("walls: {rectangle: [4, 3]}"),
        "start" => Some("start: {disc: {radius: 1}}"),
        "fitness" => Some("fitness: order, the name of a metric"),
        _ => None,
    }
}

impl Mission {
    /// The mission of the parameter `mission`: the name of a built-in one, or an object.
    pub(super) fn read(value: Option<&Value>) -> Result<Self, ParameterError> {
        match value {
            None => Self::named("aac"),
            Some(Value::String(name)) => Self::named(name),
            Some(object @ Value::Object(_)) => {
                let text = swarmwright_values::read(object);
                checks::check(text.map_err(|mut mismatch| {
                    if let Some(example) = example_of_missing(&mismatch.reason) {
                        mismatch.reason += "; for instance ";
                        mismatch.reason += example;
                    }
                    mismatch_at("mission", mismatch)
                })?)
            }
            Some(other) => Err(wrong(
                "mission",
                format!("{other} found, expected {}", Self::expected()),
            )),
        }
    }

    /// The fitness, from the values of the metrics.
    pub(super) fn fitness(&self, value: impl Fn(usize) -> f64) -> f64 {
        let factors = self.factors.iter().enumerate();
        // What does not count may be anything, infinite too.
        factors
            .filter(|(_, factor)| **factor != 0.0)
            .fold(self.offset, |sum, (metric, factor)| {
                sum + factor * value(metric)
            })
    }

    fn expected() -> String {
        let names: Vec<_> = MISSIONS
            .iter()
            .map(|mission| [&[mission.name], mission.also].concat().join(" or "))
            .collect();
        format!(
            "the name of a mission ({}), an object, or in an experiment the path of a YAML file",
            names.join(", ")
        )
    }

    fn named(name: &str) -> Result<Self, ParameterError> {
        let found = MISSIONS
            .iter()
            .find(|known| known.name == name || known.also.contains(&name));
        let Some(BuiltIn { text, .. }) = found else {
            let known = MISSIONS.iter().flat_map(|mission| {
                std::iter::once(mission.name).chain(mission.also.iter().copied())
            });
            let hint = swarmwright_values::did_you_mean(name, known);
            return Err(wrong(
                "mission",
                format!("{name:?} found, expected {}{hint}", Self::expected()),
            ));
        };
        let text =
            serde_saphyr::from_str(text).map_err(|error| wrong("mission", error.to_string()))?;
        checks::check(text)
    }
}
