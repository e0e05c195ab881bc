//! Sides of a match, which servers announce.

use std::collections::HashSet;

use serde::{Deserialize, Serialize};

/// Largest number of sides, and of groups in a side.
const MOST_SIDES: usize = 256;
/// Largest number of characters of the name of a side, a group or a metric.
const MOST_NAME: usize = 100;

/// A side of a match: groups of agents that are evaluated together.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AnnouncedSide {
    /// Name of the side.
    pub name: String,
    /// Names of its groups of agents.
    pub groups: Vec<String>,
    /// Metric that is the side's fitness, where larger is better; `None` if the simulation does not define one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitness: Option<String>,
}

impl AnnouncedSide {
    fn has_valid_size(&self) -> bool {
        let is_name = |name: &String| !name.is_empty() && name.chars().nth(MOST_NAME).is_none();
        (1..=MOST_SIDES).contains(&self.groups.len())
            && is_name(&self.name)
            && self.groups.iter().all(is_name)
            && self.fitness.as_ref().is_none_or(is_name)
    }
}

/// Returns whether announced sides are within the limits, and neither a name nor a group occurs twice.
pub(super) fn are_valid(sides: &[AnnouncedSide]) -> bool {
    let (mut names, mut groups) = (HashSet::new(), HashSet::new());
    sides.len() <= MOST_SIDES
        && sides.iter().all(|side| {
            side.has_valid_size()
                && names.insert(&side.name)
                && side.groups.iter().all(|group| groups.insert(group))
        })
}
