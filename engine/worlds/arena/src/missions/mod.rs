//! Missions: a place, where robots start, what is measured, and what is to be reached.

mod checks;
mod mission;
mod text;

use std::sync::LazyLock;

use serde_json::{Map, Value};
use swarmwright_simulation::parameters::wrong;

use crate::mistakes::{Mistakes, part};
use text::Text;

pub(crate) use mission::Mission;

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

/// What is in the files, as `built_in.py` writes it.
static OBJECTS: LazyLock<Map<String, Value>> =
    LazyLock::new(|| serde_json::from_str(include_str!("../missions.json")).unwrap_or_default());

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

/// Reads the keys of a mission.
fn sections(fields: &Value, mistakes: &mut Mistakes) -> Text {
    if let Ok(text) = part(fields, "mission") {
        return text;
    }
    // One at a time: all unknown ones are told, and the others read.
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
    /// The mission of the parameter `mission`: the name of a built-in one, or an object.
    ///
    /// # Errors
    /// All that is wrong with it.
    pub(crate) fn read(value: Option<&Value>) -> Result<Self, Mistakes> {
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
