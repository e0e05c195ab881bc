//! The controllers of the agents of one episode.

use crate::{Controller, ControllerError};

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

    /// The controller of an agent. There is room for all agents up to this one: check `agent` first where it comes from elsewhere.
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

    /// The state in which the state machine of each agent makes its next step, by agent; none for other kinds of
    /// controllers. Agents that have not acted yet, after the last of those that have, are left out: state 0.
    #[must_use]
    pub fn machine_states(&self) -> Option<Vec<u32>> {
        let first = self.prototype.current()?;
        let controllers = self.controllers.iter().map(Option::as_ref);
        let state = |one: Option<&Controller>| one.map_or(Some(first), Controller::current);
        controllers.map(state).collect()
    }
}
