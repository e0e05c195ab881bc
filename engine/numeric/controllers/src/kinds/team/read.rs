//! Specifications of teams.

use std::collections::BTreeSet;
use std::sync::Arc;

use serde_json::value::RawValue;

use super::{Team, TeamGroup};
use crate::reader::{Reader, wrong};
use crate::{Architecture, SpecificationError};

/// Groups, and agents of a group, at most.
const MOST_GROUPS: usize = 256;
const MOST_AGENTS: u32 = 1_000_000;

/// At least one group: a unique name, the number of agents, a controller that steers.
pub(super) fn read(reader: &mut Reader<'_>) -> Result<Team, SpecificationError> {
    let expected =
        "a list of groups such as {\"name\": \"leaders\", \"agents\": 2, \"controller\": {..}}";
    let items: Vec<Box<RawValue>> = reader.read("groups", expected)?;
    if !(1..=MOST_GROUPS).contains(&items.len()) {
        return Err(wrong(
            "groups",
            format!("{} found, expected 1 to {MOST_GROUPS}", items.len()),
        ));
    }
    let mut groups = Vec::with_capacity(items.len());
    let mut names = BTreeSet::new();
    for (index, item) in items.iter().enumerate() {
        let group = group(item, index + 1 == items.len())
            .map_err(|error| within(&format!("groups[{index}]"), error))?;
        if !names.insert(group.name.clone()) {
            return Err(wrong(
                &format!("groups[{index}].name"),
                format!("{:?} is given twice", group.name),
            ));
        }
        groups.push(group);
    }
    Ok(Team { groups })
}

fn group(item: &RawValue, last: bool) -> Result<TeamGroup, SpecificationError> {
    let mut reader = Reader::new(item.get())?;
    let name = reader.text("name", "a text")?;
    if name.is_empty() {
        return Err(wrong("name", "is empty; expected a text"));
    }
    let expected = if last {
        format!("a whole number from 0 to {MOST_AGENTS}, or null for all other agents")
    } else {
        format!("a whole number from 0 to {MOST_AGENTS}; null is for the last group only")
    };
    let agents: Option<u32> = reader.read("agents", &expected)?;
    if !agents.map_or(last, |agents| (0..=MOST_AGENTS).contains(&agents)) {
        let value = agents.map_or("null".to_owned(), |agents| agents.to_string());
        return Err(wrong(
            "agents",
            format!("{value} found, expected {expected}"),
        ));
    }
    let raw = reader.raw("controller", "a specification without weights")?;
    reader.end()?;
    let controller =
        Architecture::from_json(raw.get()).map_err(|error| within("controller", error))?;
    let computed = controller.team().is_none() && controller.in_python().is_none();
    if !computed || !controller.steers() {
        return Err(wrong(
            "controller.kind",
            "a team consists of controllers that steer agents, not of a team, a parameter_set or python_modules",
        ));
    }
    Ok(TeamGroup {
        name,
        agents,
        controller: Arc::new(controller),
    })
}

/// The same error, of a field inside of this one.
fn within(outer: &str, error: SpecificationError) -> SpecificationError {
    match error {
        SpecificationError::Field { field, reason } => wrong(&format!("{outer}.{field}"), reason),
        SpecificationError::NotAnObject => wrong(outer, "expected an object"),
        other @ SpecificationError::NotJson { .. } => other,
    }
}
