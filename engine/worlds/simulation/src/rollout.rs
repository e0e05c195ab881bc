//! Episodes computed in this process: a simulation and a controller for each of its agents.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::{Description, Group, ParameterError, Parameters, Simulation};
use swarmwright_controllers::{Controller, ControllerError, SwarmControllers, Team};

/// Why an episode could not be computed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RolloutError {
    /// The simulation refuses a parameter.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
    /// The controller does not fit the simulation.
    #[error(
        "controller.{field}: {actual}, but simulation {simulation} has {expected}; \
         use a controller that was made for it"
    )]
    Mismatch {
        /// Title of the simulation.
        simulation: String,
        /// sensors or actuators.
        field: &'static str,
        /// Numbers that the simulation has.
        expected: usize,
        /// Numbers that the controller has.
        actual: usize,
    },
    /// The groups of the controller are not those of the simulation.
    #[error(
        "controller.groups: {reason} in simulation {simulation}; use a controller that was made for it"
    )]
    Groups {
        /// Title of the simulation.
        simulation: String,
        /// The group that differs, and how.
        reason: String,
    },
    /// The weights of a candidate do not make a controller.
    #[error("candidate {candidate}: {source}")]
    Weights {
        /// Which candidate.
        candidate: usize,
        /// What the controller says.
        source: ControllerError,
    },
    /// A simulation asks for the actuators of an agent, but a parameter set steers none.
    #[error("simulation {simulation}, agent {agent}: {source}")]
    NotSteered {
        /// Title of the simulation.
        simulation: String,
        /// Which agent.
        agent: u32,
        /// What the controller says.
        source: ControllerError,
    },
    /// The simulation gave a sensor reading that the controller refuses.
    #[error("agent {agent}: {source}")]
    Controller {
        /// Which agent.
        agent: u32,
        /// What the controller says.
        source: ControllerError,
    },
}

/// Controllers by agent, and buffers for a step.
#[derive(Debug, Clone)]
struct AgentControllers {
    controllers: SwarmControllers,
    sensors: Vec<f32>,
    actuators: Vec<f32>,
}

/// Whether a controller of these sizes fits a simulation.
///
/// # Errors
/// [`RolloutError::Mismatch`] where it does not.
pub fn check_sizes(
    description: &Description,
    sensors: usize,
    actuators: usize,
) -> Result<(), RolloutError> {
    for (field, expected, actual) in [
        ("sensors", description.sensors, sensors),
        ("actuators", description.actuators, actuators),
    ] {
        if expected != actual {
            return Err(RolloutError::Mismatch {
                simulation: description.title.clone(),
                field,
                expected,
                actual,
            });
        }
    }
    Ok(())
}

/// Whether the controllers of a team are for these agents; a simulation without groups takes any.
pub(crate) fn check_groups(
    simulation: &str,
    team: &Team,
    groups: &[Group],
) -> Result<(), RolloutError> {
    let wrong = |reason: String| RolloutError::Groups {
        simulation: simulation.to_owned(),
        reason,
    };
    if groups.is_empty() {
        return Ok(());
    }
    let names = |names: Vec<&str>| names.join(", ");
    let (actual, expected) = (
        names(team.groups.iter().map(|group| &*group.name).collect()),
        names(groups.iter().map(|group| &*group.name).collect()),
    );
    if actual != expected {
        return Err(wrong(format!("{actual} found, but there are {expected}")));
    }
    for (own, group) in team.groups.iter().zip(groups) {
        let agents = own.agents.unwrap_or(group.agents);
        for (noun, actual, expected) in [
            ("agents", agents as usize, group.agents as usize),
            ("sensors", own.controller.sensors(), group.sensors),
            ("actuators", own.controller.actuators(), group.actuators),
        ] {
            if actual != expected {
                let name = &own.name;
                return Err(wrong(format!(
                    "{name} has {actual} {noun}, but there are {expected}"
                )));
            }
        }
    }
    Ok(())
}

impl AgentControllers {
    fn new(simulation: &dyn Simulation, controller: &Controller) -> Result<Self, RolloutError> {
        let description = simulation.description();
        if controller.steers() {
            check_sizes(&description, controller.sensors(), controller.actuators())?;
        }
        if let Some(team) = controller.team() {
            check_groups(&description.title, team, &simulation.groups())?;
        }
        let sensors = vec![0.0; description.sensors];
        Ok(Self {
            controllers: SwarmControllers::new(controller.clone()),
            sensors,
            actuators: Vec::new(),
        })
    }

    /// All acting agents sense, then all controllers compute, then the simulation steps. `observe` gets each agent with
    /// its sensors and actuators.
    fn step(
        &mut self,
        simulation: &mut dyn Simulation,
        mut observe: impl FnMut(u32, &[f32], &[f32]),
    ) -> Result<(), RolloutError> {
        let acting = simulation.acting();
        let prototype = self.controllers.prototype();
        if let (Some(agent), false) = (acting.first(), prototype.steers()) {
            return Err(RolloutError::NotSteered {
                simulation: simulation.description().title,
                agent: *agent,
                source: ControllerError::SteersNoAgents,
            });
        }
        let width = prototype.actuators();
        self.actuators.resize(acting.len() * width, 0.0);
        for (agent, row) in acting
            .iter()
            .zip(self.actuators.chunks_exact_mut(width.max(1)))
        {
            simulation.sense(*agent, &mut self.sensors);
            self.controllers
                .of(*agent)
                .and_then(|controller| controller.step(&self.sensors, row))
                .map_err(|source| RolloutError::Controller {
                    agent: *agent,
                    source,
                })?;
            observe(*agent, &self.sensors, row);
        }
        simulation.step(&self.actuators);
        Ok(())
    }
}

/// Computes one episode and returns its fitness. `controller` gives the weights; every agent has its own state.
/// The values of a parameter set are put among the parameters.
///
/// # Errors
/// A parameter that the simulation refuses, a controller with other numbers of sensors or actuators, a parameter set where
/// agents are to be steered.
pub fn rollout(
    simulation: &mut dyn Simulation,
    parameters: &Parameters,
    controller: &Controller,
) -> Result<f64, RolloutError> {
    rollout_until(simulation, parameters, controller, None)
}

/// As [`rollout`], which ends early once `stop` is true; the fitness is then that of an episode cut short.
///
/// # Errors
/// As [`rollout`].
pub fn rollout_until(
    simulation: &mut dyn Simulation,
    parameters: &Parameters,
    controller: &Controller,
    stop: Option<&AtomicBool>,
) -> Result<f64, RolloutError> {
    simulation.take_controller(controller);
    simulation.reset(&controller.merged(parameters))?;
    let mut agents = AgentControllers::new(simulation, controller)?;
    while !simulation.done() && !stopped(stop) {
        agents.step(simulation, |_, _, _| ())?;
    }
    Ok(simulation.fitness())
}

/// Whether results are not wanted any more.
#[must_use]
pub fn stopped(stop: Option<&AtomicBool>) -> bool {
    stop.is_some_and(|stop| stop.load(Ordering::Relaxed))
}

/// One episode, a step at a time.
pub struct Episode {
    simulation: Box<dyn Simulation>,
    agents: AgentControllers,
}

impl Episode {
    /// An episode at its start.
    ///
    /// # Errors
    /// As [`rollout`].
    pub fn new(
        mut simulation: Box<dyn Simulation>,
        parameters: &Parameters,
        controller: &Controller,
    ) -> Result<Self, RolloutError> {
        simulation.take_controller(controller);
        simulation.reset(&controller.merged(parameters))?;
        let agents = AgentControllers::new(simulation.as_ref(), controller)?;
        Ok(Self { simulation, agents })
    }

    /// Whether the episode has ended.
    pub fn done(&self) -> bool {
        self.simulation.done()
    }

    /// One step, of all agents where they act in turn; nothing happens once the episode has ended.
    ///
    /// # Errors
    /// A sensor reading that is not a finite number.
    pub fn step(&mut self) -> Result<(), RolloutError> {
        self.step_observed(|_, _, _| ())
    }

    /// As [`step`](Self::step); `observe` gets each agent that acts, its sensors and its actuators, in this order.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub fn step_observed(
        &mut self,
        mut observe: impl FnMut(u32, &[f32], &[f32]),
    ) -> Result<(), RolloutError> {
        while !self.done() {
            self.agents.step(self.simulation.as_mut(), &mut observe)?;
            if !self.simulation.mid_step() {
                break;
            }
        }
        Ok(())
    }

    /// The state of each agent's state machine, see [`SwarmControllers::machine_states`].
    pub fn machine_states(&self) -> Option<Vec<i32>> {
        self.agents.controllers.machine_states()
    }

    /// The simulation, to ask for fitness, scene and step size.
    pub fn simulation(&self) -> &dyn Simulation {
        self.simulation.as_ref()
    }
}

impl std::fmt::Debug for Episode {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Episode")
            .field("simulation", &self.simulation.description())
            .finish_non_exhaustive()
    }
}
