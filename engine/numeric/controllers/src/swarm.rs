//! The controllers of the agents of one episode.

use crate::{Controller, ControllerError, TeamGroup};

/// A controller for each agent, made when the agent first acts: in a team that of its group, otherwise the same for all.
#[derive(Debug, Clone)]
pub struct SwarmControllers {
    /// Never stepped.
    prototype: Controller,
    /// By agent; none for those that have not acted.
    controllers: Vec<Option<Controller>>,
}

impl SwarmControllers {
    /// Those of an episode at its start, whatever state `prototype` is in.
    #[must_use]
    pub fn new(mut prototype: Controller) -> Self {
        prototype.reset();
        Self {
            prototype,
            controllers: Vec::new(),
        }
    }

    /// The controller, or the team, that those of the agents are made of.
    #[must_use]
    pub fn prototype(&self) -> &Controller {
        &self.prototype
    }

    /// The controller of an agent. Memory is reserved for all agents up to this one: check `agent` first where it comes from elsewhere.
    ///
    /// # Errors
    /// An agent that belongs to no group of the team.
    pub fn of(&mut self, agent: u32) -> Result<&mut Controller, ControllerError> {
        let index = agent as usize;
        if index >= self.controllers.len() {
            self.controllers.resize(index + 1, None);
        }
        match &mut self.controllers[index] {
            Some(controller) => Ok(controller),
            none => Ok(none.insert(self.prototype.of_agent(agent)?)),
        }
    }

    /// The state in which the state machine of each agent makes its next step, by agent; -1 for agents of a team whose
    /// controllers have no states. `None` if no agent's controller has any.
    ///
    /// Agents beyond the list have not acted yet: they are in state 0, or have no state if the last one has none.
    #[must_use]
    pub fn machine_states(&self) -> Option<Vec<i32>> {
        let architecture = self.prototype.architecture();
        let Some(team) = architecture.team() else {
            return architecture.has_states().then(|| self.states_of(0));
        };
        let groups = &team.groups;
        if !groups.iter().any(|group| group.controller.has_states()) {
            return None;
        }
        // Up to the first agent of the last groups of which all have states, or none has.
        let has_states = |group: &TeamGroup| group.controller.has_states();
        let last = groups.last().is_some_and(has_states);
        let others = groups.iter().rposition(|group| has_states(group) != last);
        let before = groups.iter().take(others.map_or(0, |index| index + 1));
        let counts = before.map(|group| group.agents.unwrap_or(0));
        Some(self.states_of(counts.fold(1, u32::saturating_add)))
    }

    /// States of all that have acted, and of `least` agents.
    fn states_of(&self, least: u32) -> Vec<i32> {
        let architecture = self.prototype.architecture();
        let state = |agent: usize| {
            let current = match self.controllers.get(agent) {
                Some(Some(controller)) => controller.current(),
                _ => architecture.first_state(u32::try_from(agent).ok()?),
            };
            i32::try_from(current?).ok()
        };
        let agents = self.controllers.len().max(least as usize);
        (0..agents)
            .map(|agent| state(agent).unwrap_or(-1))
            .collect()
    }
}
