//! The controllers of all agents of an episode, in lanes.

use std::ops::Range;

use swarmwright_lanes::{Lanes, MOST_LANES};

use super::LaneController;
use crate::Architecture;

/// Controllers in lanes for the agents of an episode: in a team those of each group, otherwise the same for all.
///
/// The states of the agents, all 0 at the start of an episode, are kept by the caller one after another.
pub struct LaneControllers<'a, L> {
    /// Those with agents.
    groups: Vec<LaneGroup<'a, L>>,
    /// By agent, the index of its group; empty where there is one.
    group_of: Vec<u8>,
}

/// Agents with the same controllers.
pub struct LaneGroup<'a, L> {
    /// One for each lane.
    pub controllers: LaneController<'a, L>,
    /// The numbers of the agents.
    pub agents: Range<usize>,
    /// Numbers that each senses: the first ones of a row.
    pub sensors: usize,
    /// Numbers that each is steered by: the first ones of a row.
    pub actuators: usize,
    /// Index of the first vector of state of these agents.
    first_state: usize,
    /// Those of the weights of a genome that are theirs.
    weights: Range<usize>,
}

impl<'a, L: Lanes> LaneGroup<'a, L> {
    fn new(
        architecture: &'a Architecture,
        agents: Range<usize>,
        first_state: usize,
        weights: Range<usize>,
    ) -> Self {
        Self {
            controllers: LaneController::new(architecture),
            agents,
            sensors: architecture.sensors(),
            actuators: architecture.actuators(),
            first_state,
            weights,
        }
    }

    /// The state of an agent of the group among those of all agents.
    #[inline(always)]
    pub fn state_of(&self, agent: usize) -> Range<usize> {
        let length = self.controllers.state_length();
        let first = self.first_state + (agent - self.agents.start) * length;
        first..first + length
    }
}

impl<'a, L: Lanes> LaneControllers<'a, L> {
    /// Controllers without weights for this many agents; `load` gives them some. In a team, each of the agents must belong to a
    /// group.
    #[inline(always)]
    pub fn new(architecture: &'a Architecture, agents: usize) -> Self {
        let Some(team) = architecture.team() else {
            let weights = 0..architecture.weight_count();
            return Self {
                groups: vec![LaneGroup::new(architecture, 0..agents, 0, weights)],
                group_of: Vec::new(),
            };
        };
        let (mut groups, mut group_of) = (Vec::<LaneGroup<'a, L>>::new(), Vec::new());
        let (mut state, mut weight) = (0, 0);
        for group in &team.groups {
            let first = group_of.len();
            let rest = agents - first;
            let count = group.agents.map_or(rest, |count| rest.min(count as usize));
            let weights = weight..weight + group.controller.weight_count();
            weight = weights.end;
            if count == 0 {
                continue;
            }
            let group = LaneGroup::new(&group.controller, first..first + count, state, weights);
            state += count * group.controllers.state_length();
            // A team has at most 256 groups.
            group_of.resize(first + count, groups.len() as u8);
            groups.push(group);
        }
        if groups.len() <= 1 {
            group_of.clear();
        }
        Self { groups, group_of }
    }

    /// Gives each lane the weights of a genome; `genomes` holds one per lane, each as long as the weight count.
    #[inline(always)]
    pub fn load(&mut self, genomes: &[&'a [f32]]) {
        for group in &mut self.groups {
            let mut own: [&'a [f32]; MOST_LANES] = [&[]; MOST_LANES];
            for (own, genome) in own.iter_mut().zip(genomes) {
                *own = &genome[group.weights.clone()];
            }
            group.controllers.load(&own[..genomes.len()]);
        }
    }

    /// Vectors of state that all agents need.
    #[inline(always)]
    pub fn state_length(&self) -> usize {
        let last = self.groups.last();
        last.map_or(0, |group| group.state_of(group.agents.end).start)
    }

    /// The groups in the order of their agents.
    #[inline(always)]
    pub fn groups_mut(&mut self) -> &mut [LaneGroup<'a, L>] {
        &mut self.groups
    }

    /// The group of all agents, if they have the same controllers.
    #[inline(always)]
    pub fn only(&mut self) -> Option<&mut LaneGroup<'a, L>> {
        match &mut self.groups[..] {
            [group] => Some(group),
            _ => None,
        }
    }

    /// The group of an agent.
    #[inline(always)]
    pub fn of(&mut self, agent: usize) -> &mut LaneGroup<'a, L> {
        let group = self.group_of.get(agent).copied().unwrap_or_default();
        &mut self.groups[usize::from(group)]
    }
}
