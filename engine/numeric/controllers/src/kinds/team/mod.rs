//! Several kinds of agents with a controller each.

mod read;

use std::ops::Range;
use std::sync::Arc;

use serde::{Serialize, Serializer};

use super::Kind;
use crate::reader::Reader;
use crate::{Architecture, SpecificationError, VERSION};

/// Groups of agents in the order of their numbers: the first group has the agents from 0 on, the next one those after them.
///
/// Weights: those of the groups, one group after another. It steers no agent itself; [`crate::Controller::of_agent`] gives the
/// controller of an agent. Its sensors and actuators are the most that any group has.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Team {
    /// At least one.
    pub groups: Vec<TeamGroup>,
}

/// Agents with the same controller.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TeamGroup {
    /// Unique in the team.
    pub name: String,
    /// Number of agents; `None`, in the last group only, for all remaining agents.
    pub agents: Option<u32>,
    /// The controller of each agent.
    #[serde(serialize_with = "versioned")]
    pub controller: Arc<Architecture>,
}

/// A specification in a specification says its version, too.
fn versioned<S: Serializer>(
    architecture: &Arc<Architecture>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    #[derive(Serialize)]
    struct Document<'a> {
        version: u32,
        #[serde(flatten)]
        architecture: &'a Architecture,
    }
    let document = Document {
        version: VERSION,
        architecture,
    };
    document.serialize(serializer)
}

impl Team {
    /// The group of an agent, and where its weights are; none for an agent after the last.
    #[must_use]
    pub fn group_of(&self, agent: u32) -> Option<(&TeamGroup, Range<usize>)> {
        let (mut first, mut start) = (0_u32, 0);
        for group in &self.groups {
            let end = start + group.controller.weight_count();
            let last = group.agents.map(|agents| first.saturating_add(agents));
            if last.is_none_or(|last| agent < last) {
                return Some((group, start..end));
            }
            first = last.unwrap_or(u32::MAX);
            start = end;
        }
        None
    }

    /// How many agents there are; none for any number.
    #[must_use]
    pub fn agents(&self) -> Option<u32> {
        let counts = self.groups.iter().map(|group| group.agents);
        counts.sum::<Option<u32>>()
    }

    fn most(&self, numbers: impl Fn(&Architecture) -> usize) -> usize {
        let groups = self.groups.iter();
        groups
            .map(|group| numbers(&group.controller))
            .max()
            .unwrap_or(0)
    }
}

impl Kind for Team {
    const SIZE: (&'static str, &'static str) = ("groups", "use smaller controllers");

    fn read(reader: &mut Reader<'_>) -> Result<Self, SpecificationError> {
        read::read(reader)
    }

    fn weight_count(&self) -> Option<usize> {
        let mut groups = self.groups.iter();
        groups.try_fold(0_usize, |sum, group| {
            sum.checked_add(group.controller.weight_count())
        })
    }

    fn sensors(&self) -> usize {
        self.most(Architecture::sensors)
    }

    fn actuators(&self) -> usize {
        self.most(Architecture::actuators)
    }

    fn state_length(&self) -> usize {
        0
    }

    fn scratch_length(&self) -> usize {
        0
    }

    /// Not called: the controllers of its agents are.
    fn step(&self, _: &[f32], _: &mut [f32], _: &mut [f32], _: &[f32], _: &mut [f32]) {}
}
