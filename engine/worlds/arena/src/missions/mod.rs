//! Missions: a place, start positions of robots, metrics, and the fitness.

mod checks;
mod mission;
mod text;

use std::sync::LazyLock;

use serde_json::{Map, Value};
use swarmwright_simulation::ParameterError;
use swarmwright_simulation::parameters::wrong;

use crate::mistakes::{Mistakes, part};
use crate::place::{Place, Start};
use text::Text;

pub use mission::Mission;

/// A built-in mission.
#[derive(Debug, Clone, Copy)]
struct BuiltIn {
    name: &'static str,
    /// Other names of the mission.
    also: &'static [&'static str],
    text: &'static str,
}

macro_rules! missions {
    ($($name:literal $(or $also:literal)?,)*) => {
        [$(BuiltIn {
            name: $name,
            also: &[$($also)?],
            text: include_str!(concat!($name, ".yaml")),
        },)*]
    };
}

/// Built-in missions, one file each.
const MISSIONS: &[BuiltIn] = &missions! {
    "aac" or "aggregation",
    "area_coverage",
    "capture_the_flag",
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
    "pursuit",
    "sca" or "shelter",
    "soccer",
    "spc" or "surface_and_perimeter_coverage",
    "stop",
    "territory",
    "two_spots",
    "two_spots_sum",
};

/// The contents of the files, as written by `built_in.py`.
static OBJECTS: LazyLock<Map<String, Value>> =
    LazyLock::new(|| serde_json::from_str(include_str!("../missions.json")).unwrap_or_default());

/// Description of a built-in mission.
#[derive(Debug, Clone, PartialEq)]
pub struct MissionInfo {
    /// Name of the mission in parameters.
    pub name: &'static str,
    /// Alternative name of the mission.
    pub also: Option<&'static str>,
    /// Short title.
    pub title: String,
    /// Default number of robots.
    pub robots: u32,
    /// Default duration, seconds.
    pub duration: f64,
    /// Text of the YAML file, as a template for other missions.
    pub text: &'static str,
}

/// Returns the built-in missions of the arena, sorted by name.
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

/// Reads a start region; `at` is its path in error messages.
pub fn region(at: &str, value: &Value, layout: &Place) -> Result<Start, ParameterError> {
    checks::region(at, value, layout)
}

/// Reads the keys of a mission.
fn sections(fields: &Value, mistakes: &mut Mistakes) -> Text {
    if let Ok(text) = part(fields, "mission") {
        return text;
    }
    // Read each key alone, so that all unknown keys are reported and the others are still read.
    let mut valid = Map::new();
    for (key, value) in fields.as_object().into_iter().flatten() {
        let alone = Value::from(Map::from_iter([(key.clone(), value.clone())]));
        if mistakes.take(part::<Text>(&alone, "mission")).is_some() {
            valid.insert(key.clone(), value.clone());
        }
    }
    part(&Value::Object(valid), "mission").unwrap_or_default()
}

impl Mission {
    /// Reads the parameter `mission`: the name of a built-in mission, or an object.
    ///
    /// # Errors
    /// Returns all mistakes in the mission.
    pub fn read(value: Option<&Value>) -> Result<Self, Mistakes> {
        match value {
            None => Self::named("aac"),
            Some(Value::String(name)) => Self::named(name),
            Some(object @ Value::Object(_)) => Self::of(object),
            Some(other) => Err(wrong(
                "mission",
                format!("{other} found, expected {}", Self::expected()),
            )
            .into()),
        }
    }

    fn of(object: &Value) -> Result<Self, Mistakes> {
        let mut mistakes = Mistakes::default();
        let text = sections(object, &mut mistakes);
        checks::check(&text, mistakes)
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

    fn named(name: &str) -> Result<Self, Mistakes> {
        let mission = MISSIONS
            .iter()
            .find(|mission| mission.name == name || mission.also.contains(&name));
        let Some(BuiltIn { name, .. }) = mission else {
            let names = MISSIONS.iter().flat_map(|mission| {
                std::iter::once(mission.name).chain(mission.also.iter().copied())
            });
            let hint = swarmwright_values::did_you_mean(name, names);
            return Err(wrong(
                "mission",
                format!("{name:?} found, expected {}{hint}", Self::expected()),
            )
            .into());
        };
        Self::of(OBJECTS.get(*name).unwrap_or(&Value::Null))
    }
}
