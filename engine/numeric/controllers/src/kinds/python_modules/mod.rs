//! Machines, and trees, of modules of which some are written in Python: it computes them, not this crate.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::modules::Modules;
use super::{BEHAVIOUR_NAMES, CONDITION_NAMES, Kind};
use crate::SpecificationError;
use crate::reader::{Reader, wrong};

/// Behaviours, or conditions, at most.
const MOST_MODULES: usize = 256;

/// What modules are: the first of these or the second.
const ROLES: [&str; 2] = ["behaviour", "condition"];

/// A machine or a tree as [`Modules`], with behaviours and conditions of which some are classes in Python.
///
/// Weights: as those of [`Modules`], where each parameter of a module in Python has a place of its own behind the others.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PythonModules {
    /// Form and sizes.
    #[serde(flatten)]
    pub machine: Modules,
    /// In the order of their numbers; at least one.
    pub behaviours: Vec<Module>,
    /// In the order of their numbers; at least one.
    pub conditions: Vec<Module>,
}

/// A behaviour or a condition.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Module {
    /// Of a class in a file its name, otherwise the name under which it is registered.
    pub name: String,
    /// Name of that file, without its folder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub file: Option<String>,
    /// SHA-256 of the code, in hexadecimal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
    /// Lowest and highest value of each parameter, and whether it is an integer.
    pub parameters: BTreeMap<String, (f64, f64, bool)>,
}

/// A module in Python that a machine needs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Needed<'a> {
    /// behaviour or condition.
    pub role: &'static str,
    /// Its name.
    pub name: &'a str,
    /// The file of its class.
    pub file: Option<&'a str>,
    /// SHA-256 of its code.
    pub sha256: Option<&'a str>,
}

impl PythonModules {
    /// The modules in Python, behaviours first.
    pub fn needed(&self) -> impl Iterator<Item = Needed<'_>> {
        let lists = [
            (ROLES[0], &self.behaviours, &BEHAVIOUR_NAMES[..]),
            (ROLES[1], &self.conditions, &CONDITION_NAMES[..]),
        ];
        lists.into_iter().flat_map(|(role, modules, built_in)| {
            let modules = modules
                .iter()
                .filter(|module| !module.is_built_in(built_in));
            modules.map(move |module| Needed {
                role,
                name: &module.name,
                file: module.file.as_deref(),
                sha256: module.sha256.as_deref(),
            })
        })
    }
}

impl Module {
    fn is_built_in(&self, names: &[&str]) -> bool {
        self.file.is_none() && names.contains(&self.name.as_str())
    }
}

/// Number of weights for parameters of modules in Python.
fn places(modules: &[Module], built_in: &[&str]) -> usize {
    let modules = modules
        .iter()
        .filter(|module| !module.is_built_in(built_in));
    modules.map(|module| module.parameters.len()).sum()
}

impl Kind for PythonModules {
    const SIZE: (&'static str, &'static str) = Modules::SIZE;

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        Ok(Self {
            machine: Modules::read(reader)?,
            behaviours: modules(reader, "behaviours")?,
            conditions: modules(reader, "conditions")?,
        })
    }

    fn weight_count(&self) -> Option<usize> {
        let of_state = places(&self.behaviours, &BEHAVIOUR_NAMES);
        let of_transition = places(&self.conditions, &CONDITION_NAMES);
        let each = self.machine.transitions.checked_mul(of_transition)?;
        let more = self
            .machine
            .states
            .checked_mul(of_state.checked_add(each)?)?;
        self.machine.weight_count()?.checked_add(more)
    }

    fn sensors(&self) -> usize {
        self.machine.sensors
    }

    fn actuators(&self) -> usize {
        self.machine.actuators
    }

    fn state_length(&self) -> usize {
        0
    }

    fn scratch_length(&self) -> usize {
        0
    }

    /// Not called: Python computes it.
    fn step(&self, _: &[f32], _: &mut [f32], _: &mut [f32], _: &[f32], _: &mut [f32]) {}
}

fn modules(reader: &mut Reader<'_>, field: &str) -> Result<Vec<Module>, SpecificationError> {
    let expected = "a list of modules such as {\"name\": \"spiral\", \"parameters\": {\"turn\": [1, 30, true]}}";
    let modules: Vec<Module> = reader.read(field, expected)?;
    if (1..=MOST_MODULES).contains(&modules.len()) {
        return Ok(modules);
    }
    Err(wrong(
        field,
        format!("{} found, expected 1 to {MOST_MODULES}", modules.len()),
    ))
}
